"""Ways round: which sides of the obstacles a trip may pass, how long each takes about, and first trips along them.

Begin with :mod:`scp_planner.search.ways`, which the others serve:

``grid``         stations, offsets, slopes, speeds and delays, as fine as the scene asks for
``blocked``      which of its cells the zones and the workspace block
``sweep``        what can be reached on it, by a vehicle that turns, speeds up and brakes no faster than it may
``ways``         the fastest way through the free cells; the next ones, with sides of obstacles closed
``first_trips``  trips within the limits that follow a way, and bows where there is none
``starts``       ways and trips together, for any method

The search reads a problem and never the loop that improves what it hands over. Nothing in it is a length or a time:
all sizes are ratios of the scene's own.
"""
