"""Tolerances of rounding of simulations."""

from __future__ import annotations

ROUNDING = 1e-9  # Relative: of velocities to the top speed, of times to a step, of looks to a period
PARALLEL = 1e-12  # Sine of the angle below which two lines do not meet
INSTANT = 1e-6  # Units of time: events nearer than this are simultaneous
NO_TIME = 1e-9  # Units of time: rounding of a clock
TIME_DECIMALS = 9  # Of a unit of time, to which times of steps and looks are rounded
NOWHERE = 1e-12  # Units of length: an offset that has decayed
