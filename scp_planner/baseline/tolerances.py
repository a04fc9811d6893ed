"""Tolerances of penalty descent; lengths, speeds and times are in the scene's units."""

from __future__ import annotations

REPAIRABLE = 0.01  # Units of length or relative: larger violations are not tightened away
SETTLED_EXCESS = 1e-4  # Units of length or relative: distance to active constraints at which settling ends
TARGET = 1e-5  # Units of length or relative: left to an active constraint by settling
MET_SPEED = 1e-10  # Units of speed: difference from the goal speed at which Newton's method ends
COUNTS = 1e-16  # Share of a violation below which an excess has no part in its gradient
