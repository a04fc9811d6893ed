"""Rounding that paths, guides and samples allow for."""

SPEED_ERROR = 5e-12  # of the speed over the station, by which its interpolation may be off
ARC_ROUNDING = 1e-15  # of the arc length
GUIDE_ERROR = 1e-12  # of the length: how far positions may be off, as far as that takes no more cells than the most
SLIVER = 1e-11  # of the length; intervals overlap the next piece by less from rounding alone
SAME_LENGTH = 1e-13  # relative: rounding
SAME_STATION = 1e-12  # of the guide's length: ends of cells and of pieces that are nearer are the same
WITHOUT_DIRECTION = 1e-9  # of the highest speed: slower, a velocity has no direction worth comparing
STILL = 1e-150  # m/s; slower it does not get there: small enough for nothing, and no quotient by it overflows
SAME_TIME = 1e-9  # relative: rounding
