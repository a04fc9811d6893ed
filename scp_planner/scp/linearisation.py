"""One trip, linearised: the rows of everything that a step inside the trust region could violate."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from scp_planner.arrays import Array
from scp_planner.problem.limits.limit import OptionalLimit
from scp_planner.problem.problem import Problem
from scp_planner.scp.evaluation import SAMPLE_STRIDE, Evaluation, TripBatch
from scp_planner.scp.merit import Limit
from scp_planner.scp.rows.base import Rows
from scp_planner.scp.rows.bends import curvature_rows, lateral_rows
from scp_planner.scp.rows.box import box_rows
from scp_planner.scp.rows.clearance import ClearanceSites, clearance_rows
from scp_planner.scp.rows.drive import goal_speed_rows
from scp_planner.threat_zones.contacts import ZoneContacts
from scp_planner.threat_zones.nearness import ABREAST, nearness_of_samples
from scp_planner.trips.bundle import stacked
from scp_planner.trips.trajectory import TripPoints


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

    Parameters
    ----------
    problem : Problem
    base : Evaluation
        The trip.
    trust : TrustRegion
        Rows that no step inside it can violate are left out: a rigorous test of |J| times the box against the gap.
    near : float
        Samples with a clearance above this are no candidates, m.

    Returns
    -------
    Rows
    """
    return linearise_trips(problem, [base], [trust], near)[0]


# NUMPY-CALLS: shaped by the cost of numpy calls alone
def linearise_trips(
    problem: Problem, bases: Sequence[Evaluation], trusts: Sequence[TrustRegion], near: float
) -> list[Rows]:
    """Linearise several trips at once.

    Parameters
    ----------
    problem : Problem
    bases : sequence of Evaluation
        At least one trip.
    trusts : sequence of TrustRegion
        One for each.
    near : float
        Samples with a clearance above this are no candidates, m.

    Returns
    -------
    list of Rows
        One for each trip.
    """
    zones = problem.zones
    batch = TripBatch.of(bases, problem.samples)
    bundle, points = batch.bundle, batch.points
    sites = [base.sites for base in bases]
    # Trip by trip: limits of the same trip share what they look at.
    optional = [
        [_optional_rows(problem, limit, number, k, base) for number, limit in enumerate(problem.optional)]
        for k, base in enumerate(bases)
    ]
    rows = Rows.stack(
        [
            clearance_rows(problem, bundle, _clearance_sites(problem, bases, points, near)),
            lateral_rows(problem, bundle, points, sites, zones.size + Limit.LATERAL_ACCELERATION),
            curvature_rows(problem, sites, zones.size + Limit.CURVATURE),
            box_rows(problem, stacked([base.box_gaps for base in bases]), zones.size + Limit.WORKSPACE_BOUNDS, near),
            goal_speed_rows(problem, bundle, zones.size + Limit.GOAL_SPEED),
            *[Rows.joined(of_trips) for of_trips in zip(*optional, strict=True)],
        ]
    )
    return rows.shares((_usable(problem, rows, trusts) >= rows.gap).nonzero()[0], len(bases))


def rows_within(problem: Problem, rows: Rows, trust: TrustRegion) -> Rows:
    """Return those rows of one trip that a step inside a trust region could violate.

    Parameters
    ----------
    problem : Problem
    rows : Rows
        Of a trust region that is as large or larger.
    trust : TrustRegion

    Returns
    -------
    Rows
    """
    return rows.take((_usable(problem, rows, [trust]) >= rows.gap).nonzero()[0])


def _clearance_sites(problem: Problem, bases: Sequence[Evaluation], samples: TripPoints, near: float) -> ClearanceSites:
    """Places near zones that become rows: minima of clearance, then some of the samples."""
    zones = problem.zones
    below = nearness_of_samples(zones, near)
    clearance = stacked([base.clearance for base in bases])
    owner, sample, zone = np.nonzero(clearance < below)
    sample *= SAMPLE_STRIDE
    table = problem.samples
    points = samples.part(sample + len(table.sigma) * owner, table.take(sample))
    minima = TripPoints.joined([base.minima for base in bases])
    contacts = ZoneContacts.joined([base.minima_contacts for base in bases])
    which = np.concatenate([base.minima_zone for base in bases])
    whose = np.arange(len(bases)).repeat([len(base.minima_zone) for base in bases])
    at_samples = zones.contacts(zone, points.time, points.path.position)
    if zones.whole is not None:
        some = zones.leaders(sample + problem.grid * owner, zone, at_samples, ABREAST * near)
        owner, sample, zone = owner[some], sample[some], zone[some]
        points, at_samples = points.take(some), at_samples.take(some)
    return ClearanceSites.of(whose, which, np.zeros_like(which), minima, contacts).joined(
        ClearanceSites.of(owner, zone, sample, points, at_samples)
    )


def _optional_rows(problem: Problem, limit: OptionalLimit, number: int, owner: int, base: Evaluation) -> Rows:
    excess = base.optional[number]
    index = limit.places(base.trajectory, excess)
    group = np.full(len(index), problem.zones.size + len(Limit) + number)
    return Rows(
        limit.gradient(base.trajectory, index), -excess[index], group, index, np.full(len(index), owner, dtype=np.intp)
    )


def _usable(problem: Problem, rows: Rows, trusts: Sequence[TrustRegion]) -> Array:
    """Most that a step inside the trust region can use of each row's gap."""
    free = problem.ends.free
    count = free.stop - free.start
    boxes = np.empty((len(trusts), rows.matrix.shape[1]))
    for box, trust in zip(boxes, trusts, strict=True):
        box[:count] = trust.theta * problem.space.tables.leverage[free]
        box[count:-1] = trust.beta * problem.agility
        box[-1] = trust.rho
    if len(trusts) == 1:
        reach: Array = np.abs(rows.matrix) @ boxes[0]
        return reach
    reach = (np.abs(rows.matrix) @ boxes.T)[np.arange(len(rows.owner)), rows.owner]
    return reach
