"""Tolerances to which solvers keep rows and bounds, in scaled units if not said."""

GAP_TOLERANCE = 1e-12  # of Clarabel: feasibility and gap
REDUCED_TOLERANCE = 1e-8  # still accepted where rounding allows no more
ROW_TOLERANCE = 1e-9  # of a row, as solvers keep it
ACTIVE_AT_START = 1e-9  # a bound closer to the origin than this is first taken as active
NARROWEST = 1e-12  # norm of a row or column that is taken as nothing: scaling it up would only blow up rounding
UNPOLISHED_VIOLATION = 1e-6  # largest violation of an answer that could not be polished, in scaled units
