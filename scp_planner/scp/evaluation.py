"""Everything the loop needs to know of one trip: violations, the merit, and the contacts that rows are made from.

The merit is the one objective of all methods (docs: the penalised objective),

    Q = tau + sum_l mu_l max(0, deepest entry into zone l) + sum_k mu_k max(0, excess over limit k),

with the minima between samples refined, so that it is a function of the trip and not of the sampling.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from scp_planner.arrays import Array, Index
from scp_planner.problem.problem import Problem
from scp_planner.scp.bend_sites import BendSites, bend_sites
from scp_planner.scp.merit import Limit, Penalties
from scp_planner.scp.settling import settle_minima
from scp_planner.threat_zones.contacts import ZoneContacts
from scp_planner.trips.bundle import TripBundle
from scp_planner.trips.path import Path
from scp_planner.trips.space import TimeTable
from scp_planner.trips.trajectory import Trajectory, TripPoints

SAMPLE_STRIDE = 3  # every third sample near a zone is a row, besides the minima of clearance


def box_gaps(problem: Problem, path: Path) -> Array:
    """Distances of the vehicle's disc to the sides of the box, inside, at the fixed stations.

    Parameters
    ----------
    problem : Problem
    path : Path

    Returns
    -------
    (M, S) array
        m, negative outside; S is 0 without a box.
    """
    box = problem.box
    if len(box.offsets) == 0:
        return np.zeros((len(problem.space.tables.station_parameters), 0))
    return box.offsets - path.station_positions @ box.normals.T


# NUMPY-CALLS: shaped by the cost of numpy calls alone
@dataclass(frozen=True)
class TripBatch:
    """Trips that were evaluated together, and their points at the problem's samples, one trip after the other."""

    bundle: TripBundle
    points: TripPoints

    @classmethod
    def of(cls, evaluations: Sequence[Evaluation], table: TimeTable) -> TripBatch:
        """Return trips as a batch: for one trip that of its evaluation, if it has one."""
        if len(evaluations) == 1 and evaluations[0].batch is not None:
            return evaluations[0].batch
        bundle = TripBundle([evaluation.trajectory for evaluation in evaluations])
        return cls(bundle, TripPoints.joined([evaluation.points for evaluation in evaluations], table))


@dataclass(frozen=True)
class Evaluation:
    """One trip, evaluated.

    Attributes
    ----------
    trajectory : Trajectory
    points : TripPoints
        At the problem's samples.
    clearance : (ceil(grid / SAMPLE_STRIDE), L) array
        Signed distances to the inflated zones at some of the equidistant samples, m.
    minima : TripPoints
        At the refined minima of the clearances over time.
    minima_zone : (m,) array of int
        Which zone each of them is about.
    minima_contacts : ZoneContacts
        The contacts there.
    sites : BendSites
        Curvature and lateral acceleration.
    zone_violation : (L,) array
        Deepest entry into each zone, m, 0 where there is none.
    box_gaps : (M, S) array
        Distances to the sides of the workspace box at the fixed stations, m.
    limit_violation : (5 + E,) array
        Excess over the limits, see LIMIT_NAMES, and then over the problem's optional ones.
    optional : tuple of (n,) arrays
        Excesses over each of the optional limits in all places.
    given_violation : float
        Worst violation of a user's own constraints.
    batch : TripBatch or None
        Of this trip, if it was evaluated alone: it keeps no other trips alive.
    """

    trajectory: Trajectory
    points: TripPoints
    clearance: Array
    minima: TripPoints
    minima_zone: Index
    minima_contacts: ZoneContacts
    sites: BendSites
    zone_violation: Array
    box_gaps: Array
    limit_violation: Array
    optional: tuple[Array, ...] = ()
    given_violation: float = 0.0
    batch: TripBatch | None = None

    def merit(self, penalties: Penalties) -> float:
        """Travel time plus penalised violations, s."""
        return float(
            self.trajectory.travel_time
            + penalties.zones @ self.zone_violation
            + penalties.limits @ self.limit_violation
            + penalties.given * self.given_violation
        )

    @cached_property
    def worst_violation(self) -> float:
        """Largest of all violations (m for zones, relative for limits)."""
        worst = max(float(self.limit_violation.max()), self.given_violation)
        return max(worst, float(self.zone_violation.max())) if len(self.zone_violation) else worst


def evaluate_trip(problem: Problem, trajectory: Trajectory, near: float) -> Evaluation:
    """Evaluate a trip.

    Parameters
    ----------
    problem : Problem
    trajectory : Trajectory
    near : float
        Clearances below this are looked at closely, m.

    Returns
    -------
    Evaluation
    """
    return evaluate_trips(problem, [trajectory], near)[0]


# NUMPY-CALLS: shaped by the cost of numpy calls alone
def evaluate_trips(problem: Problem, trips: Sequence[Trajectory], near: float) -> list[Evaluation]:
    """Evaluate several trips at once.

    Parameters
    ----------
    problem : Problem
    trips : sequence of Trajectory
        At least one.
    near : float
        Clearances below this are looked at closely, m.

    Returns
    -------
    list of Evaluation
        One for each.
    """
    count = len(trips)
    bundle = TripBundle(trips)
    known = trips[0].known_at(problem.samples) if count == 1 else None
    points = bundle.at_each(problem.samples) if known is None else known
    near_zones = _near_zones(problem, bundle, points, near)
    sites = bend_sites(problem, bundle, points)
    gaps = [box_gaps(problem, trip.path) for trip in trips]
    each = bundle.split_each(points)
    for trip, its_points in zip(trips, each, strict=True):
        trip.keep(its_points)
    optional = [tuple(limit.excess(trip) for limit in problem.optional) for trip in trips]
    limits = _limit_violations(problem, bundle, sites, gaps, optional)
    alone = TripBatch(bundle, points) if count == 1 else None
    evaluations = []
    for k, (trip, its_points, its_zones) in enumerate(zip(trips, each, near_zones, strict=True)):
        evaluations.append(
            Evaluation(
                trip,
                its_points,
                its_zones.clearance,
                its_zones.minima,
                its_zones.minima_zone,
                its_zones.minima_contacts,
                sites[k],
                its_zones.violation,
                gaps[k],
                limits[k],
                optional[k],
                0.0 if problem.given is None else problem.given.worst(trip),
                alone,
            )
        )
    return evaluations


def among_smaller(evaluation: Evaluation, less: Array) -> Evaluation:
    """Return the evaluation of the same trip in a problem that has zones of smaller radii, and is the same otherwise.

    Parameters
    ----------
    evaluation : Evaluation
        In the problem with the larger ones.
    less : (L,) array
        By how much their radii are smaller, m, not negative; parts of one zone by the same.

    Returns
    -------
    Evaluation
        What `evaluate_trip` would return, but that minima are those that were found near the larger zones.
    """
    contacts = evaluation.minima_contacts
    return replace(
        evaluation,
        clearance=evaluation.clearance + less,
        minima_contacts=replace(contacts, distance=contacts.distance + less[evaluation.minima_zone]),
        zone_violation=np.maximum(evaluation.zone_violation - less, 0.0),
    )


@dataclass(frozen=True)
class _NearZones:
    """What an evaluation says of zones: see there."""

    clearance: Array
    minima: TripPoints
    minima_zone: Index
    minima_contacts: ZoneContacts
    violation: Array


def _near_zones(problem: Problem, bundle: TripBundle, points: TripPoints, near: float) -> list[_NearZones]:
    """How trips come near to zones, one for each, given their points at the problem's samples."""
    zones = problem.zones
    clearance = zones.distances(points.time, points.path.position, near)
    clearance = clearance.reshape(bundle.count, len(problem.samples.sigma), zones.size)
    equidistant = clearance[:, : problem.grid]
    owner, sample, zone = local_minima(equidistant, near)
    if zones.whole is not None:
        place = sample + len(points.table.sigma) * owner
        touched = zones.contacts(zone, points.time[place], points.path.position[place])
        single = zones.singles(place, zone, touched)
        owner, sample, zone = owner[single], sample[single], zone[single]
    sigma = refine_minima(problem.samples.sigma[: problem.grid], equidistant, owner, sample, zone)
    settle_minima(problem, bundle, points, owner, sample, zone, sigma, equidistant[owner, sample, zone])
    minima = bundle.at(owner, sigma)
    contacts = zones.contacts(zone, minima.time, minima.path.position)
    violation = _entries(clearance, owner, zone, contacts, zones.whole)
    bounds = bundle.bounds(owner)
    some = equidistant[:, ::SAMPLE_STRIDE]
    found = []
    for k, its_minima in enumerate(bundle.split(minima, owner)):
        mine = slice(bounds[k], bounds[k + 1])
        its_contacts = contacts if bundle.count == 1 else contacts.take(mine)
        found.append(_NearZones(some[k].copy(), its_minima, zone[mine], its_contacts, violation[k]))
    return found


def _entries(clearance: Array, owner: Index, zone: Index, contacts: ZoneContacts, whole: Index | None) -> Array:
    """Deepest entry of each trip into each zone, (trips, L) m, at the samples (trips, n, L) and refined minima.

    That of a zone of several parts is its first one's, and the others' are 0: walls that overlap are entered once.
    """
    violation = np.zeros((len(clearance), clearance.shape[2]))
    if violation.shape[1]:
        np.maximum(-clearance.min(axis=1), 0.0, out=violation)
        np.maximum.at(violation, (owner, zone), -contacts.distance)
    if whole is None:
        return violation
    together = np.zeros_like(violation)
    trip, part = violation.nonzero()
    np.maximum.at(together, (trip, whole[part]), violation[trip, part])
    return together


def local_minima(values: Array, below: float) -> tuple[Index, Index, Index]:
    """Where the local minima are, along the second of three axes, of the values below a bound, ends included."""
    low = values < below
    low[:, 1:] &= values[:, 1:] <= values[:, :-1]
    low[:, :-1] &= values[:, :-1] < values[:, 1:]
    owner, row, column = np.nonzero(low)
    return owner, row, column


def refine_minima(grid: Array, values: Array, owner: Index, row: Index, column: Index) -> Array:
    """Abscissae of the minima of parabolas through a sample and its two neighbours, on an equidistant grid."""
    last = len(grid) - 1
    inner = np.minimum(np.maximum(row, 1), last - 1)
    before, here, after = (values[owner, inner + k, column] for k in (-1, 0, 1))
    bend = before - 2.0 * here + after
    shift = 0.5 * (before - after) / np.where(bend > 0.0, bend, np.inf)
    shift = np.where((row > 0) & (row < last), np.minimum(np.maximum(shift, -1.0), 1.0), row - inner)
    return grid[inner] + shift * (grid[1] - grid[0])


def _limit_violations(
    problem: Problem,
    bundle: TripBundle,
    sites: Sequence[BendSites],
    gaps: Sequence[Array],
    optional: Sequence[tuple[Array, ...]],
) -> Array:
    """Violations of each trip, (K, 5 + E), in the order of Limit, then of the optional limits."""
    excess = np.zeros((bundle.count, len(Limit) + len(problem.optional)))
    limits, goal_speed = problem.limits, problem.ends.goal_speed
    excess[:, Limit.LATERAL_ACCELERATION] = [site.worst_lateral / limits.lateral_acceleration - 1.0 for site in sites]
    excess[:, Limit.CURVATURE] = [site.worst_curvature / limits.curvature - 1.0 for site in sites]
    excess[:, Limit.SPEED] = bundle.top_speeds / limits.speed - 1.0
    if len(problem.box.offsets):
        excess[:, Limit.WORKSPACE_BOUNDS] = [-its.min() for its in gaps]
    if goal_speed is not None:
        excess[:, Limit.GOAL_SPEED] = [abs(trip.final_speed - goal_speed) for trip in bundle.trips]
    for number in range(len(problem.optional)):
        excess[:, len(Limit) + number] = [its[number].max(initial=-np.inf) for its in optional]
    return np.maximum(excess, 0.0, out=excess)
