"""Different ways round the obstacles, to start from.

May import the problem, solvers and all below; not the loop. Begin with `starts`.
"""
