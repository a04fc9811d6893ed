"""Ways round: which sides of the obstacles a trip may pass, how long each takes about, and first trips along them.

Begin with :mod:`scp_planner.search.ways`, which the others serve:
"""
