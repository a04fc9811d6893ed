"""Tolerances of checks of scenarios."""

from __future__ import annotations

SAME_PLACE = 1e-9  # Relative to coordinates, or to a step of time: nearer points or times are one
SAME_FOOT = 1e-6  # Of a line's length: nearest points before and after a border that are one
SYMMETRY = 1e-3  # Relative difference of a covariance's two off-diagonal entries
DEFINITE = 1e-12  # Least determinant of a covariance relative to the product of its diagonal
INDEPENDENT = 1e-9  # Least pivot of a correlation matrix
