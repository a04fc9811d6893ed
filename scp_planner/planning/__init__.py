"""One plan for one scenario, and why there is none.

May import the search, the loop and all below. Begin with `offline`, whose `attempts` are the list of all that is tried;
`plan` is the result. `attempts` walks the list: `ways_round` tries ways, `along_routes` other routes, `refinements` go
on from the best trip. `runs` makes runs of the loop and certifies them.
"""
