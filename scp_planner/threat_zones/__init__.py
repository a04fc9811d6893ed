"""Space that obstacles, and the vehicle round its plan, may take, over time: one zone, many at once, bounds.

May import estimates, scenarios and mathematics. Begin with `zone`, then `batch`. `error_tube` is about the vehicle.
"""
