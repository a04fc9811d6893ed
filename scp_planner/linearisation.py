"""One trip, linearised: the rows of everything that a step inside the trust region could violate.

The rows remember what they are about, so that their gaps can be read off another trip: this is what a second-order
correction needs.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from scp_planner.constraints import Limit, Rows
from scp_planner.constraints.bounds import box_rows
from scp_planner.constraints.clearance import ClearanceSites, clearance_rows
from scp_planner.constraints.kinematics import (
    both_gaps,
    curvature_rows,
    goal_speed_rows,
    lateral_rows,
    station_sites,
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


@dataclass(frozen=True)
class Linearisation:
    """Rows at a trip, and what they are about.

    Attributes
    ----------
    base : Evaluation
        The trip.
    rows : Rows
        Those that the trust region can reach.
    kept : (m,) array of int
        Which of all candidates they are.
    sample, zone : (s,) arrays of int
        Samples that are candidates for clearance rows.
    stations, bends : arrays of int
        Stations that are candidates for lateral rows, and for curvature rows.
    walls : (w,) array of int
        Stations and sides of the workspace box, flattened.
    optional : tuple of arrays of int
        Places of each optional limit.
    """

    base: Evaluation
    rows: Rows
    kept: Index
    sample: Index
    zone: Index
    stations: Index
    bends: Index
    walls: Index
    optional: tuple[Index, ...] = ()

    def gaps(self, problem: Problem, other: Evaluation) -> Array:
        """Gaps of the same rows, (m,), at another trip."""
        base, limits = self.base, problem.limits
        minima = other.trajectory.at(base.minima.table)
        contacts = problem.zones.contacts(base.minima_zone, minima.time, minima.path.position)
        peaks = station_sites(other.trajectory, base.sites.peaks.parameters)
        lateral = np.concatenate(
            [
                other.sites.stations.lateral[self.stations],
                peaks.lateral,
            ]
        )
        gaps = np.concatenate(
            [
                contacts.distance,
                other.clearance[self.sample, self.zone],
                both_gaps(lateral / limits.lateral_acceleration),
                both_gaps(other.sites.curvature[self.bends] / limits.curvature),
                other.box_gaps.ravel()[self.walls],
                goal_speed_rows(problem, other.trajectory, 0).gap,
                *[-excess[index] for excess, index in zip(other.optional, self.optional, strict=True)],
            ]
        )
        return gaps[self.kept]


def linearise(problem: Problem, base: Evaluation, trust: TrustRegion, near: float) -> Linearisation:
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
    kept = np.flatnonzero(_reach(problem, rows, trust) >= rows.gap)
    return Linearisation(base, rows.take(kept), kept, sample, zone, stations, bends, walls, optional)


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
