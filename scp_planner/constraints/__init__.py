"""Constraints of a trip: each gives Jacobian rows of its linearisation, with labels.

A row (J, gap) of a step z = (d theta, d beta, rho) stands for J z <= gap. Here d theta are the free control points of
the offset (m), beta + d beta = b / tau_k^2 those of the acceleration (m/s^2) and rho = (tau - tau_k) / tau_k.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

KEYS = 10**9  # more than there are different rows of one kind


class Limit(IntEnum):
    """The limits that every trip has: their places in the merit. Optional ones come after them."""

    LATERAL_ACCELERATION = 0
    CURVATURE = 1
    SPEED = 2
    WORKSPACE_BOUNDS = 3
    GOAL_SPEED = 4


@dataclass(frozen=True)
class Rows:
    """Linearised constraints J z <= gap.

    Attributes
    ----------
    matrix : (m, n) array
        J, over the free control points of the offset, those of the acceleration, and rho.
    gap : (m,) array
        What is left, in the constraint's own unit; negative where it is violated.
    group : (m,) array of int
        Index of the violation in the merit that the row belongs to.
    key : (m,) array of int
        What the row is about: the same from one linearisation to the next, for warm starts.
    """

    matrix: NDArray[np.float64]
    gap: NDArray[np.float64]
    group: NDArray[np.intp]
    key: NDArray[np.intp]

    @classmethod
    def stack(cls, parts: list[Rows]) -> Rows:
        """Return the rows of several constraints as one; the place in the list becomes part of the keys."""
        numbered = [(place, part) for place, part in enumerate(parts) if len(part.gap)]
        if not numbered:
            return parts[0]
        parts = [part for _, part in numbered]
        return cls(
            np.concatenate([part.matrix for part in parts]),
            np.concatenate([part.gap for part in parts]),
            np.concatenate([part.group for part in parts]),
            np.concatenate([part.key + place * KEYS for place, part in numbered]),
        )

    @classmethod
    def none(cls, width: int) -> Rows:
        """Return no rows."""
        return cls(np.zeros((0, width)), np.zeros(0), np.zeros(0, dtype=np.intp), np.zeros(0, dtype=np.intp))

    def take(self, index: NDArray[np.intp]) -> Rows:
        """Return some of the rows."""
        return Rows(self.matrix[index], self.gap[index], self.group[index], self.key[index])
