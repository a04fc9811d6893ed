"""Constraints of a trip: each gives Jacobian rows of its linearisation, with labels.

A row (J, gap) of a step z = (d theta, d beta, rho) stands for J z <= gap. Here d theta are the free control points of
the offset (m), beta + d beta = b / tau_k^2 those of the acceleration (m/s^2) and rho = (tau - tau_k) / tau_k.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from scp_planner.arrays import Array, Index


def join_blocks(theta: Array, beta: Array, rho: Array) -> Array:
    """Rows of the offset, of the acceleration and of rho side by side."""
    return np.concatenate([theta, beta, rho[:, None]], axis=1)


KEYS = 10**9  # more than there are different rows of one kind


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

    matrix: Array
    gap: Array
    group: Index
    key: Index

    @classmethod
    def stack(cls, parts: list[Rows]) -> Rows:
        """Return the rows of several constraints as one; the place in the list becomes part of the keys."""
        numbered = [
            Rows(part.matrix, part.gap, part.group, part.key + place * KEYS) if place else part
            for place, part in enumerate(parts)
            if len(part.gap)
        ]
        return cls.joined(numbered) if numbered else parts[0]

    @classmethod
    def joined(cls, parts: Sequence[Rows]) -> Rows:
        """Return several sets of rows as one."""
        if len(parts) == 1:
            return parts[0]
        return cls(
            np.concatenate([part.matrix for part in parts]),
            np.concatenate([part.gap for part in parts]),
            np.concatenate([part.group for part in parts]),
            np.concatenate([part.key for part in parts]),
        )

    @classmethod
    def none(cls, width: int) -> Rows:
        """Return no rows."""
        return cls(np.zeros((0, width)), np.zeros(0), _NONE, _NONE)

    def take(self, index: Index | slice) -> Rows:
        """Return some of the rows."""
        return Rows(self.matrix[index], self.gap[index], self.group[index], self.key[index])


_NONE: Index = np.zeros(0, dtype=np.intp)
