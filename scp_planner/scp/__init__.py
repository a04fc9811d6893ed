"""Sequential convex programming: the loop that makes a start into the fastest trip near it.

May import the problem, solvers and all below; not the search.
Begin with `loop` and `iterations`; what steers them stands in `parameters`.
"""
