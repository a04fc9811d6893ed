"""The prices of violations in the merit."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from scp_planner.arrays import Array, Mask
from scp_planner.problem.problem import Problem


@dataclass
class Penalties:
    """Prices of the violations in the merit."""

    # (G,): s per unit of each violation of the problem's constraints, in their order: m, m/s, rad, or relative
    weights: Array
    given: float = 50.0  # s per unit of the worst violation of a user's own constraints

    @classmethod
    def uniform(cls, problem: Problem, price: float) -> Penalties:
        """Return one price for everything."""
        return cls(np.full(sum(problem.sizes), price))

    def copied(self) -> Penalties:
        """Return the same, that may be raised without these."""
        return Penalties(self.weights.copy(), self.given)

    def raise_where(self, stuck: Mask, factor: float) -> None:
        """Multiply the prices of some violations, (G,)."""
        self.weights[stuck] *= factor
