"""One trip, linearised: the rows of everything that a step inside the trust region could violate."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from scp_planner.constraints import Limit, Rows
from scp_planner.constraints.bounds import box_rows
from scp_planner.constraints.clearance import ClearanceSites, clearance_rows
from scp_planner.constraints.kinematics import (
    curvature_rows,
    goal_speed_rows,
    lateral_rows,
)
from scp_planner.evaluation import Evaluation
from scp_planner.problem import Problem

Array = NDArray[np.float64]
Index = NDArray[np.intp]

SAMPLE_STRIDE = 3  # every third sample near a zone is a row, besides the minima of clearance
LATERAL_REACH = 0.8  # stations whose use of the lateral limit is further from it than this are no rows
CURVATURE_REACH = 0.5  # the same for curvature


@dataclass(frozen=True)
class TrustRegion:
    """Largest steps: of the offset's control points (m), the acceleration's (m/s^2), and the relative travel time."""

    theta: float
    beta: float
    rho: float

    def scaled(self, factor: float) -> TrustRegion:
        """Return the region with all radii multiplied."""
        return TrustRegion(self.theta * factor, self.beta * factor, self.rho * factor)


def linearise(problem: Problem, base: Evaluation, trust: TrustRegion, near: float) -> Rows:
    """Linearise what a step from a trip could violate.

    Parameters
    ----------
    problem : Problem
    base : Evaluation
        The trip.
    trust : TrustRegion
        Rows that no step inside it can violate are left out: a rigorous test of |J| times the box against the gap.
    near : float
        Samples with a clearance above this are no candidates, m.
    """
    trajectory, zones = base.trajectory, problem.zones
    sample, zone = np.nonzero(base.clearance[: problem.grid : SAMPLE_STRIDE] < near)
    sample *= SAMPLE_STRIDE
    points = base.points.take(sample)
    contacts = zones.contacts(zone, points.time, points.path.position)
    lateral, bend = problem.limits.lateral_acceleration, problem.limits.curvature
    stations = np.flatnonzero(np.abs(base.sites.stations.lateral) > (1.0 - LATERAL_REACH) * lateral)
    bends = np.flatnonzero(np.abs(base.sites.curvature) > (1.0 - CURVATURE_REACH) * bend)
    walls = np.flatnonzero(base.box_gaps < near)
    optional = tuple(
        np.flatnonzero(excess > -limit.reach) for limit, excess in zip(problem.optional, base.optional, strict=True)
    )
    minima = np.zeros(len(base.minima_zone), dtype=np.intp)
    sites = ClearanceSites.of(base.minima_zone, minima, base.minima, base.minima_contacts).joined(
        ClearanceSites.of(zone, sample, points, contacts)
    )
    rows = Rows.stack(
        [
            clearance_rows(problem, trajectory, sites),
            lateral_rows(problem, trajectory, base.sites, stations, zones.size + Limit.LATERAL_ACCELERATION),
            curvature_rows(problem, trajectory, base.sites, bends, zones.size + Limit.CURVATURE),
            box_rows(problem, base.box_gaps, walls, zones.size + Limit.WORKSPACE_BOUNDS),
            goal_speed_rows(problem, trajectory, zones.size + Limit.GOAL_SPEED),
            *[
                Rows(
                    limit.gradient(trajectory, index),
                    -excess[index],
                    np.full(len(index), zones.size + len(Limit) + number),
                    index,
                )
                for number, (limit, excess, index) in enumerate(
                    zip(problem.optional, base.optional, optional, strict=True)
                )
            ],
        ]
    )
    return rows.take(np.flatnonzero(_reach(problem, rows, trust) >= rows.gap))


def _reach(problem: Problem, rows: Rows, trust: TrustRegion) -> Array:
    """Most that a step inside the trust region can use of each row's gap."""
    free = problem.ends.free
    count = free.stop - free.start
    box = np.empty(rows.matrix.shape[1])
    box[:count] = trust.theta * problem.space.tables.leverage[free]
    box[count:-1] = trust.beta
    box[-1] = trust.rho
    reach: Array = np.abs(rows.matrix) @ box
    return reach
