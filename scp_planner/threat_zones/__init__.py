"""Space that obstacles may take, over time: one zone, many at once, bounds on intervals of time.

May import estimates, scenarios and mathematics. Begin with `zone`, then `batch`.
"""
