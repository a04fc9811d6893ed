"""Limits that only some scenarios have. A scenario without one pays nothing for it.

Each is looked at in a fixed number of places of every trip, and gives its excess there (what is above 0 is violated)
and the excess's gradient with respect to a step z = (d theta, d beta, rho): see the package.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import TYPE_CHECKING, ClassVar, Self

import numpy as np

from scp_planner.arrays import Array, Index
from scp_planner.trips.trajectory import Trajectory

if TYPE_CHECKING:
    from scp_planner.threat_zones.batch import ZoneBatch


class OptionalLimit(ABC):
    """One kind of limit of a trip.

    Attributes
    ----------
    name : str
        What the certificate calls it.
    near : float
        Places with an excess below -near are not looked at in a step.
    """

    name: ClassVar[str]
    near: ClassVar[float]

    @abstractmethod
    def excess(self, trajectory: Trajectory) -> Array:
        """Return the excess in each place, (n,); -inf where it does not count."""

    def places(self, trajectory: Trajectory, excess: Array) -> Index:
        """Return the places that are looked at in a step, (m,), given the excesses of a trip."""
        del trajectory
        return np.flatnonzero(excess > -self.near)

    @abstractmethod
    def gradient(self, trajectory: Trajectory, index: Index) -> Array:
        """Return the gradient of the excess in some places with respect to a step, (m, step)."""

    def tightened(self, more: float) -> Self:
        """Return the limit with so much more kept from it, in the unit of the excess."""
        del more  # what cannot be missed between samples need not be asked for again
        return self

    def also_at(self, sigma: Array) -> Self:
        """Return the limit looked at at further normalised times, (n,), as well, if it is looked at at times."""
        del sigma
        return self

    def among(self, zones: ZoneBatch) -> Self:
        """Return the limit among other zones."""
        del zones  # most limits have nothing to do with them
        return self
