"""Rounding that geometry allows for, and digits to which inputs are rounded."""

ANGLE_DECIMALS = 10  # of rad: what is planned with is rounded, see ZoneBatch.rounded
DECIMALS = 7  # of m, to which what is planned with is rounded
SAME_DIRECTION = 1e-9  # rad; a smaller turn is none
# relative to the largest coordinate: what is thinner, or nearer to each other, is so by rounding
COORDINATE_ROUNDING = 1e-12
UNCOVERED = 1e-9  # of a line: shorter parts of it do not leave the corridor
NEWTON_TOLERANCE = 1e-13  # relative, of a step of Newton's method
CENTRE_GUARD = 1e-9  # of the smaller half axis: keeps the normal defined on the axes of symmetry
SHORTEST_COURSE = 1e-9  # of a course: shorter pieces are left out
NO_LEAD = 1e-14  # least leading coefficient of a polynomial, relative to its largest
NEARLY_REAL = 1e-3  # of half an interval: imaginary part of a root that counts as real
STRAIGHT = 1e-12  # relative: directions that differ by less are in line
ON_LINE = 2e-16  # relative to the largest coordinate: what is nearer to a line is on it
AT_VERTEX = 1e-12  # relative to the outline: nearer to a vertex than this, the normal of an edge is taken
DIGITS = 12  # that count, of limits


def to_digits(value: float) -> float:
    """Return a number with the digits that count of a limit; it may be infinite."""
    return float(f"{value:.{DIGITS - 1}e}")
