"""Limits that only some scenarios have. A scenario without one pays nothing for it.

Each is looked at in a fixed number of places of every trip, and gives its excess there (what is above 0 is violated)
and the excess's gradient with respect to a step z = (d theta, d beta, rho): see the package.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import ClassVar, Self

import numpy as np

from scp_planner.trajectory import Array, Index, Trajectory


class OptionalLimit(ABC):
    """One kind of limit of a trip.

    Attributes
    ----------
    name : str
        What the certificate calls it.
    reach : float
        Places with an excess below -reach are not looked at in a step.
    """

    name: ClassVar[str]
    reach: ClassVar[float]

    @abstractmethod
    def excess(self, trajectory: Trajectory) -> Array:
        """Return the excess in each place, (n,); -inf where it does not count."""

    @abstractmethod
    def gradient(self, trajectory: Trajectory, index: Index) -> Array:
        """Return the gradient of the excess in some places with respect to a step, (m, step)."""

    def tightened(self, more: float) -> Self:
        """Return the limit with so much more kept from it, in the unit of the excess."""
        return self


@dataclass(frozen=True)
class EarliestArrival(OptionalLimit):
    """The trip takes at least so long.

    Attributes
    ----------
    travel_time : float
        s.
    step_size : int
        Number of variables of a step.
    """

    name: ClassVar[str] = "earliest arrival"
    reach: ClassVar[float] = np.inf

    travel_time: float
    step_size: int

    def excess(self, trajectory: Trajectory) -> Array:
        """Return by how much the arrival is too early, (1,) s."""
        return np.array([self.travel_time - trajectory.travel_time])

    def gradient(self, trajectory: Trajectory, index: Index) -> Array:
        """Return the gradient: -tau for rho."""
        gradient = np.zeros((len(index), self.step_size))
        gradient[:, -1] = -trajectory.travel_time
        return gradient
