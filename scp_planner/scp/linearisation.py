"""One trip, linearised: the rows of everything that a step inside the trust region could violate."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from scp_planner.arrays import rows_of
from scp_planner.constraints.rows import Rows
from scp_planner.problem.problem import Problem
from scp_planner.scp.evaluation import Evaluation


@dataclass(frozen=True)
class TrustRegion:
    """Largest steps: of control points of offset and, times the agility, acceleration; of the time, relative."""

    theta: float
    beta: float
    rho: float

    def scaled(self, factor: float) -> TrustRegion:
        """Return the region with all radii multiplied."""
        return TrustRegion(self.theta * factor, self.beta * factor, self.rho * factor)


def linearise(problem: Problem, base: Evaluation, trust: TrustRegion) -> Rows:
    """Linearise what a step from a trip could violate."""
    trip, each = base.trajectory, zip(problem.constraints, base.excesses, strict=True)
    rows = Rows.stack([constraint.rows(trip, excess) for constraint, excess in each], problem.sizes)
    return rows_within(problem, rows, trust)


def rows_within(problem: Problem, rows: Rows, trust: TrustRegion) -> Rows:
    """Return those rows, of a trust region that is as large or larger, that a step inside one could violate."""
    box, count = np.empty(rows.matrix.shape[1]), problem.free_size
    box[:count] = trust.theta * problem.space.tables.leverage[problem.ends.free]
    box[count:-1] = trust.beta * problem.agility
    box[-1] = trust.rho
    return rows_of(rows, (np.abs(rows.matrix) @ box >= rows.gap).nonzero()[0])
