"""States of filters of many obstacles, each in a slot of its own."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Self

from scp_planner.arrays import Array, Index


@dataclass
class SlotStates:
    """States of M filters of each of K obstacles, in units of the covariance of the noise."""

    mean: Array  # Position first, m
    spread: Array  # The covariance of the state is this times that of the noise that is declared

    def of(self, slots: Index | slice) -> Self:
        """The states of some obstacles, (n,): where they are, if those are a slice, until they are moved on."""
        if isinstance(slots, slice):
            return replace(self, mean=self.mean[..., slots], spread=self.spread[..., slots])
        return replace(self, mean=self.mean.take(slots, axis=-1), spread=self.spread.take(slots, axis=-1))

    def put(self, slots: Index | slice, part: Self) -> None:
        """Put states where those of some obstacles are, (n,)."""
        self.mean[..., slots], self.spread[..., slots] = part.mean, part.spread


def if_alike(values: Array) -> Array:
    """The first of values (n,) alone, (1,), if all are the same, as in a frame; or else all."""
    return values[:1] if len(values) and (values == values[0]).all() else values
