"""Tolerances of rounding of the online planner; lengths, times and speeds are in the scene's units."""

RELATIVE = 1e-9  # Of a speed limit, the size of a zone, a period, or the duration of a trip
LENGTH = 1e-9  # A position is known no better than this; stations of a path that go back by less go forward
TIME = 1e-9  # Times that differ by less are the same
SPEED = 1e-10  # Slower, with the little acceleration that a stop has then, a vehicle stands
ANGLE = 1e-9  # rad: a turn that is a full one but for this is none
OFF = 1e-6  # Length, speed and rad, that a vehicle or an obstacle may be off besides what it is allowed
LATE = 1e-6  # Share of a period, by which a replan is not too late yet
EIGENVALUE = 1e-8  # Least eigenvalue of the correlation matrix of a measurement
JERK_SHARE = 1.0 - 1e-7  # Share of the largest jerk that ramps use: rounding of the shortest ones stays within it
