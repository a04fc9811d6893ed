"""Tolerances that a certificate grants, and rounding that it allows for; in natural units if not said."""

RELATIVE_TOLERANCE = 1e-9  # of limits: rounding
BRAKING_SHARE = 0.99  # of the strongest braking: an excess may fall by so much slower, as planners keep a margin
END_TOLERANCE = 1e-6  # of lengths, speeds and angles at the ends of the trip, in natural units and rad
GOAL_SPEED_TOLERANCE = 1e-3  # units of speed, of which the highest has three
LENGTH_TOLERANCE = 1e-9  # units of length: of clearances, and of positions against the trip that is certified
ARRIVAL_TOLERANCE = 1e-7  # of the travel time, around the earliest and latest arrival
STEP_TOLERANCE = 0.01  # of the step that the arrival is on
LARGEST_OFF_STEP = 1e-3  # units of time
ROUNDING = 2.0 * END_TOLERANCE  # of lengths and speeds: what is certified keeps its ends to END_TOLERANCE
SPEED_ROUNDING = 1e-8  # relative, of speeds and of distances driven
SHORTEST_CHECK = 1e-9  # normalised time that is checked
CELL_EDGE = 1e-9  # of a cell: places nearer than this to its edge are on both sides
ALIGNED = 1.0 - 1e-6  # of a step that moves by whole cells
NORMAL_OFFSET = 1e-9  # rad: support points are taken so far to both sides of an edge's normal
REPORT_PRECISION = 1e-3  # units of length: by how much the reported clearance may be below the true one
STANDING_TURN = 1e-3  # rad; by so much a direction in which a vehicle moves off may miss its heading, by interpolation
