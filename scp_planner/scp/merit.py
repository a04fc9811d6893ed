"""The limits that the merit knows, and their prices."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

import numpy as np

from scp_planner.arrays import Array, Mask
from scp_planner.problem.problem import Problem


class Limit(IntEnum):
    """The limits that every trip has: their places in the merit. Optional ones come after them."""

    LATERAL_ACCELERATION = 0
    CURVATURE = 1
    SPEED = 2
    WORKSPACE_BOUNDS = 3
    GOAL_SPEED = 4


LIMIT_NAMES = tuple(limit.name.lower().replace("_", " ") for limit in Limit)


@dataclass
class Penalties:
    """Weights of the violations in the merit.

    Attributes
    ----------
    zones : (L,) array
        s per m of the deepest entry into each zone.
    limits : (5 + E,) array
        s per unit of relative excess over lateral acceleration, curvature and speed, s per m outside the box, s per m/s
        of difference from the goal speed; then s per unit of each of the problem's optional limits.
    given : float
        s per unit of the worst violation of a user's own constraints.
    """

    zones: Array
    limits: Array
    given: float = 50.0

    @classmethod
    def uniform(cls, problem: Problem, price: float) -> Penalties:
        """Return one price for everything."""
        return cls(np.full(problem.zones.size, price), np.full(len(Limit) + len(problem.optional), price))

    def copied(self) -> Penalties:
        """Return the same, that may be raised without these."""
        return Penalties(self.zones.copy(), self.limits.copy(), self.given)

    @property
    def weights(self) -> Array:
        """Those of the zones and then of the limits, (L + 5 + E,)."""
        return np.concatenate([self.zones, self.limits])

    def raise_where(self, stuck: Mask, factor: float) -> None:
        """Multiply the weights of some violations, (L + 5 + E,) of them in the order of :attr:`weights`."""
        count = len(self.zones)
        self.zones[stuck[:count]] *= factor
        self.limits[stuck[count:]] *= factor
