"""Curvature that the model of a subproblem lacks, learnt from the last step."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from scp_planner.arrays import Array, Index
from scp_planner.constraints.drive import DriveRows
from scp_planner.constraints.rows import Rows
from scp_planner.problem.problem import Problem
from scp_planner.trips.trajectory import Trajectory

DAMPING = 0.2  # least curvature along the step that is believed, relative to the model's
TINY_CURVATURE = 1e-14  # units of time; of a step's curvature term, below which nothing is learnt from it


@dataclass(frozen=True)
class LastStep:
    """A step, and the multipliers of its subproblem."""

    start: Trajectory
    end: Trajectory
    step: Array  # (n,): z
    keys: Index  # (a,): sorted keys of the active rows that may be violated at a price
    matrix: Array  # (a, n): these rows
    prices: Array  # (a,): their multipliers
    arrival: float  # multiplier of arrival
    # second derivative, with respect to rho, of the active bounds of the acceleration times their multipliers: what is
    # linear in the subproblem is b_k <= a tau^2
    timing: float

    @classmethod
    def of(
        cls,
        drive: DriveRows,
        rows: Rows,
        start: Trajectory,
        end: Trajectory,
        z: Array,
        prices: Array,
    ) -> LastStep:
        """Remember a step z, given the rows of its subproblem that have a price, and the multipliers of all rows."""
        hard = len(prices) - len(rows.gap)
        (active,) = prices[hard:].nonzero()
        active = active[rows.key[active].argsort()]
        return cls(
            start,
            end,
            z[: rows.matrix.shape[1]],
            rows.key[active],
            rows.matrix[active],
            prices[hard:][active],
            float(prices[0]),
            drive.timing_curvature(prices),
        )

    def gradient_change(self, problem: Problem, rows: Rows) -> Array:
        """Change of the gradient of the Lagrangian along the step, (n,), given the rows at its end."""
        free = problem.ends.free
        count = free.stop - free.start
        ratio = self.start.travel_time / self.end.travel_time
        change = np.zeros(len(self.step))
        if len(self.keys):
            place = np.minimum(self.keys.searchsorted(rows.key), len(self.keys) - 1)
            (again,) = (self.keys[place] == rows.key).nonzero()
            place = place[again]
            # b and tau are what both trips share: db = tau^2 dbeta, dtau = tau rho
            units = np.full(len(self.step), ratio * ratio)
            units[:count], units[-1] = 1.0, ratio
            change += self.prices[place] @ (rows.matrix[again] * units - self.matrix[place])
        change[:count] -= self.arrival * (self.end.path.final_gradient - self.start.path.final_gradient)[free]
        change[-1] += self.timing * self.step[-1]
        return change

    def teach(self, problem: Problem, rows: Rows, hessian: Array, proximal: Array) -> None:
        """Correct the Hessian of the next subproblem, (n, n), in place."""
        step = self.step
        change = self.gradient_change(problem, rows) + proximal * step
        expected = hessian @ step
        curvature, actual = float(step @ expected), float(step @ change)
        if curvature < TINY_CURVATURE:
            return
        if actual < DAMPING * curvature:
            share = (1.0 - DAMPING) * curvature / (curvature - actual)
            change = share * change + (1.0 - share) * expected
            actual = float(step @ change)
        hessian += np.outer(change, change / actual)
        hessian -= np.outer(expected, expected / curvature)
