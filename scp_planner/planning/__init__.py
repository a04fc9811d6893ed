"""One plan for one scenario, and why there is none.

May import the search, the loop and all below. Begin with `plan_search`, which holds the function `plan`; the module
`plan` holds its result. `search` is the one best-first search: over decisions about the scene in `plan_search`, over
starts of the loop in `starts`. Each kind of decision is a file in `sources`. `runs` certifies runs of the loop.
"""
