"""Linearised constraints."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from scp_planner.arrays import Array, Index

KEYS = 10**9  # more than there are different rows of one constraint


@dataclass(frozen=True)
class Rows:
    """Linearised constraints J z <= gap on a step z = (d theta, d beta, rho), see `Constraint`."""

    matrix: Array  # (m, n) J, over the free control points of the offset, those of the acceleration, and rho
    gap: Array  # (m,)
    group: Index  # (m,) Index of the violation in the merit that the row belongs to
    key: Index  # (m,)

    @classmethod
    def stack(cls, parts: Sequence[Rows], sizes: Sequence[int]) -> Rows:
        """Return the rows of several constraints as one, given how many violations each has."""
        first = np.cumsum([0, *sizes])
        some = [(place, part) for place, part in enumerate(parts) if len(part.gap)]
        if not some:
            return parts[0]
        return cls(
            np.concatenate([part.matrix for _, part in some]),
            np.concatenate([part.gap for _, part in some]),
            np.concatenate([part.group + first[place] for place, part in some]),
            np.concatenate([part.key + place * KEYS for place, part in some]),
        )

    @classmethod
    def none(cls, width: int) -> Rows:
        """Return no rows."""
        nothing: Index = np.zeros(0, dtype=np.intp)
        return cls(np.zeros((0, width)), np.zeros(0), nothing, nothing)
