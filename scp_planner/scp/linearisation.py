"""One trip, linearised: the rows of everything that a step inside the trust region could violate."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from scp_planner.arrays import Array
from scp_planner.problem.limits.limit import OptionalLimit
from scp_planner.problem.problem import Problem
from scp_planner.scp.evaluation import SAMPLE_STRIDE, Evaluation
from scp_planner.scp.merit import Limit
from scp_planner.scp.rows.base import Rows
from scp_planner.scp.rows.bends import curvature_rows, lateral_rows
from scp_planner.scp.rows.box import box_rows
from scp_planner.scp.rows.clearance import ClearanceSites, clearance_rows
from scp_planner.scp.rows.drive import goal_speed_rows
from scp_planner.threat_zones.nearness import ABREAST, nearness_of_samples


@dataclass(frozen=True)
class TrustRegion:
    """Largest steps: of control points of offset and, times the agility, acceleration; of the time, relative."""

    theta: float
    beta: float
    rho: float

    def scaled(self, factor: float) -> TrustRegion:
        """Return the region with all radii multiplied."""
        return TrustRegion(self.theta * factor, self.beta * factor, self.rho * factor)


def linearise(problem: Problem, base: Evaluation, trust: TrustRegion, near: float) -> Rows:
    """Linearise what a step from a trip could violate.

    Rows that no step inside the trust region can violate are left out: a rigorous test of |J| times the box against the
    gap. Samples with a clearance above ``near``, m, are no candidates.
    """
    zones, trip = problem.zones, base.trajectory
    rows = Rows.stack(
        [
            clearance_rows(problem, trip, _clearance_sites(problem, base, near)),
            lateral_rows(problem, trip, base.points, base.sites, zones.size + Limit.LATERAL_ACCELERATION),
            curvature_rows(problem, base.sites, zones.size + Limit.CURVATURE),
            box_rows(problem, base.box_gaps, zones.size + Limit.WORKSPACE_BOUNDS, near),
            goal_speed_rows(problem, trip, zones.size + Limit.GOAL_SPEED),
            *[_optional_rows(problem, limit, number, base) for number, limit in enumerate(problem.optional)],
        ]
    )
    return rows_within(problem, rows, trust)


def rows_within(problem: Problem, rows: Rows, trust: TrustRegion) -> Rows:
    """Return those rows, of a trust region that is as large or larger, that a step inside one could violate."""
    return rows.take((_usable(problem, rows, trust) >= rows.gap).nonzero()[0])


def _clearance_sites(problem: Problem, base: Evaluation, near: float) -> ClearanceSites:
    """Places near zones that become rows: minima of clearance, then some of the samples."""
    zones = problem.zones
    sample, zone = np.nonzero(base.clearance < nearness_of_samples(zones, near))
    sample *= SAMPLE_STRIDE
    points = base.points.take(sample)
    at_samples = zones.contacts(zone, points.time, points.path.position)
    if zones.whole is not None:
        some = zones.leaders(sample, zone, at_samples, ABREAST * near)
        sample, zone = sample[some], zone[some]
        points, at_samples = points.take(some), at_samples.take(some)
    which = base.minima_zone
    return ClearanceSites.of(which, np.zeros_like(which), base.minima, base.minima_contacts).joined(
        ClearanceSites.of(zone, sample, points, at_samples)
    )


def _optional_rows(problem: Problem, limit: OptionalLimit, number: int, base: Evaluation) -> Rows:
    excess = base.optional[number]
    index = limit.places(base.trajectory, excess)
    group = np.full(len(index), problem.zones.size + len(Limit) + number)
    return Rows(limit.gradient(base.trajectory, index), -excess[index], group, index)


def _usable(problem: Problem, rows: Rows, trust: TrustRegion) -> Array:
    """Most that a step inside the trust region can use of each row's gap."""
    free = problem.ends.free
    count = free.stop - free.start
    box = np.empty(rows.matrix.shape[1])
    box[:count] = trust.theta * problem.space.tables.leverage[free]
    box[count:-1] = trust.beta * problem.agility
    box[-1] = trust.rho
    reach: Array = np.abs(rows.matrix) @ box
    return reach
