"""One plan for one scenario, and why there is none.

May import the search, the loop and all below. Begin with `offline`; `plan` is what comes out. `attempts` holds the
outer search of every method; `ways_round` tries ways, `runs` improves and certifies them, `refinements` go on from
the best.
"""
