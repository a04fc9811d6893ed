from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, ClassVar, Generic, Self, TypeVar

import numpy as np

from scp_planner.arrays import Array, Index
from scp_planner.constraints.rows import Rows
from scp_planner.constraints.setup import Setup
from scp_planner.trips.space import TimeTable
from scp_planner.trips.trajectory import Trajectory

if TYPE_CHECKING:
    from scp_planner.threat_zones.batch import ZoneBatch

T = TypeVar("T")


@dataclass(frozen=True)
class Constraint(ABC):
    """One constraint: its excess is at most 0 in each of the places where it is looked at."""

    name: ClassVar[str]  # As certificates call it
    near: ClassVar[float] = np.inf  # Places with an excess below -near are not looked at in a step

    setup: Setup

    @property
    def size(self) -> int:
        """Number of violations that have a price each; place k is about number k modulo this."""
        return 1

    @abstractmethod
    def excess(self, trip: Trajectory) -> Array:
        """Return the excess in each place, (n,); -inf where it does not count."""

    @abstractmethod
    def gradient(self, trip: Trajectory, index: Index) -> Array:
        """Return the gradient of the excess in some places with respect to a step, (m, step)."""

    def slope(self, trip: Trajectory, index: Index, prices: Array) -> Array:
        """Return the gradient of the sum of some excesses, each at its price, with respect to a step, (step,)."""
        slope: Array = prices @ self.gradient(trip, index)
        return slope

    def worst(self, trip: Trajectory, excess: Array) -> Array:
        """Return the largest excess that each violation is about, (size,), given those of a trip."""
        del trip
        return excess.reshape(-1, self.size).max(axis=0, initial=-np.inf)

    def violations(self, worst: Array) -> Array:
        """Return the violations that have a price, (size,), given the largest excesses."""
        return np.maximum(worst, 0.0)

    def places(self, trip: Trajectory, excess: Array) -> Index:
        """Return the places that are looked at in a step, (m,)."""
        del trip
        return np.flatnonzero(excess > -self.near)

    def rows(self, trip: Trajectory, excess: Array) -> Rows:
        """Return the linearised constraint in the places that are looked at in a step."""
        index = self.places(trip, excess)
        return Rows(self.gradient(trip, index), -excess[index], index % self.size, index)

    def tightened(self, more: float) -> Self:
        """Return the constraint with so much more kept from it, in the unit of the excess."""
        del more  # what cannot be missed between samples need not be asked for again
        return self

    def also_at(self, sigma: Array) -> Self:
        """Return the constraint looked at at further normalised times, (n,), as well, if it is looked at at times."""
        del sigma
        return self

    def among(self, zones: ZoneBatch) -> Self:
        """Return the constraint among other zones."""
        del zones  # most have nothing to do with them
        return self

    def smooth(self, times: TimeTable) -> Constraint:
        """Return the constraint in places that do not jump from trip to trip: the samples, and times after them."""
        del times
        return self


@dataclass(frozen=True)
class Limit(Constraint):
    """A constraint whose excess is relative to an upper limit."""

    limit: float

    def tightened(self, more: float) -> Self:
        """Return a lower limit."""
        return replace(self, limit=self.limit * (1.0 - more)) if more else self


class TwoSidedLimit(Limit):
    """A limit of absolute values: its places are those of the upper side, then those of the lower one."""

    @abstractmethod
    def use(self, trip: Trajectory) -> Array:
        """Return the values over the limit, (n,)."""

    @abstractmethod
    def slopes(self, trip: Trajectory) -> Array:
        """Return their gradients, (n, step)."""

    def excess(self, trip: Trajectory) -> Array:
        """Return use - 1, then -use - 1, (2 n,)."""
        use = self.use(trip)
        return np.concatenate([use - 1.0, -use - 1.0])

    def gradient(self, trip: Trajectory, index: Index) -> Array:
        """Return the gradients of both sides."""
        slopes = self.slopes(trip)
        lower, place = np.divmod(index, len(slopes))
        found: Array = slopes[place]
        found *= np.where(lower, -1.0, 1.0)[:, None]
        return found


class LastTrip(Generic[T]):
    def __init__(self) -> None:
        self._last: tuple[Trajectory, T] | None = None

    def of(self, trip: Trajectory, make: Callable[[Trajectory], T]) -> T:
        """Return what a function makes of a trip."""
        if self._last is None or self._last[0] is not trip:
            self._last = (trip, make(trip))
        return self._last[1]
