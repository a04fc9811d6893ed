"""Rounding that plans allow for."""

ROUNDING = 1e-9  # relative, of lengths and times that are to be equal
SAMPLES_TOLERANCE = 1e-6  # relative, to the size of the samples: they may be rounded to seven digits
SAMPLE_ROUNDING = 1e-15  # relative to the largest number of a list
TRIP_ROUNDING = 1e-6  # of the trip's length or time
