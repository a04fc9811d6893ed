"""Rounding that estimates allow for, and precision to which they are computed."""

from sys import float_info

SCALE_TOLERANCE = 1e-13  # of log q
PLACE_TOLERANCE = 1e-7  # relative, of a standardised length
EQUAL_EIGENVALUES = 1e-9  # relative difference of two eigenvalues below which they count as equal
TIME_TOLERANCE = 1e-9  # units of time; times this little before the last observation are taken for it
LEAST_RISK_SHARE = 1e-9  # Least share, relative to the largest one.
LAST_DIGITS = 8.0 * float_info.epsilon  # relative, of coefficients and residuals
LAG_DIGITS = 12  # after the point, s, that tell lags apart
SHORT_LAG = 0.05  # time constants, below which a series is used in place of a difference
SERIES_TERMS = 12  # of it, all of that are larger than rounding
PROBABILITY = 1e-9  # Probabilities, and ratios of pivots of a factor, that are smaller are 0 but for rounding
# Least and largest standard deviation that are used, in any unit: beside one another in one estimate, their squares
# leave some digits. What is less exact than the largest one may be anywhere on the trip all the same.
LEAST_DEVIATION, MOST_DEVIATION = 1e-5, 1e2
