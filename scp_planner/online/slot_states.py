"""States of filters of many obstacles, each in a slot of its own."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Self

from scp_planner.arrays import Array, Index


@dataclass
class SlotStates:
    """States of M filters of each of K obstacles, in units of the covariance of the noise.

    Obstacles are the last axis: what is done to them is done to neighbours in memory.

    Attributes
    ----------
    mean : (d, 2, M, K)
        Position first, m.
    spread : (d (d + 1) / 2, M, K)
        The covariance of the state is this times that of the noise that is declared: its upper triangle, row by row.
    """

    mean: Array
    spread: Array

    def of(self, slots: Index | slice) -> Self:
        """Copy the states of some obstacles, (n,)."""
        return replace(self, mean=self.mean[..., slots].copy(), spread=self.spread[..., slots].copy())

    def at(self, slots: Index | slice) -> Self:
        """The states of some obstacles: where they are if those are a slice, else copies."""
        return replace(self, mean=self.mean[..., slots], spread=self.spread[..., slots])

    def put(self, slots: Index | slice, part: Self) -> None:
        """Put states where those of some obstacles are, (n,)."""
        self.mean[..., slots], self.spread[..., slots] = part.mean, part.spread
