"""Where obstacles may be, over time: one zone, many at once, bounds on intervals of time.

May import scenarios, estimates, trips and mathematics. Begin with `zone`, then `batch`.
"""
