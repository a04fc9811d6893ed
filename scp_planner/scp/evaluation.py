"""Everything the loop needs to know of one trip: violations, the merit, and the contacts that rows are made from.

The merit is the one objective of all methods (docs: the penalised objective),

    Q = tau + sum_l mu_l max(0, deepest entry into zone l) + sum_k mu_k max(0, excess over limit k),

with the minima between samples refined, so that it is a function of the trip and not of the sampling.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from scp_planner.arrays import Array, Index
from scp_planner.problem.problem import Problem
from scp_planner.scp.bend_sites import BendSites, bend_sites
from scp_planner.scp.merit import Limit, Penalties
from scp_planner.scp.settling import settle_minima
from scp_planner.threat_zones.contacts import ZoneContacts
from scp_planner.trips.path import Path
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


def evaluate_trip(problem: Problem, trip: Trajectory, near: float) -> Evaluation:
    """Evaluate a trip; clearances below ``near``, m, are looked at closely."""
    points = trip.kept_at(problem.samples)
    near_zones = _near_zones(problem, trip, points, near)
    sites, gaps = bend_sites(problem, trip, points), box_gaps(problem, trip.path)
    optional = tuple(limit.excess(trip) for limit in problem.optional)
    return Evaluation(
        trip,
        points,
        near_zones.clearance,
        near_zones.minima,
        near_zones.minima_zone,
        near_zones.minima_contacts,
        sites,
        near_zones.violation,
        gaps,
        _limit_violations(problem, trip, sites, gaps, optional),
        optional,
        0.0 if problem.given is None else problem.given.worst(trip),
    )


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


def _near_zones(problem: Problem, trip: Trajectory, points: TripPoints, near: float) -> _NearZones:
    """How a trip comes near to zones, given its points at the problem's samples."""
    zones = problem.zones
    clearance = zones.distances(points.time, points.path.position, near)
    equidistant = clearance[: problem.grid]
    sample, zone = local_minima(equidistant, near)
    if zones.whole is not None:
        touched = zones.contacts(zone, points.time[sample], points.path.position[sample])
        single = zones.singles(sample, zone, touched)
        sample, zone = sample[single], zone[single]
    sigma = refine_minima(problem.samples.sigma[: problem.grid], equidistant, sample, zone)
    settle_minima(problem, trip, points, sample, zone, sigma, equidistant[sample, zone])
    minima = trip.at(problem.space.time_table(sigma))
    contacts = zones.contacts(zone, minima.time, minima.path.position)
    violation = _entries(clearance, zone, contacts, zones.whole)
    return _NearZones(equidistant[::SAMPLE_STRIDE].copy(), minima, zone, contacts, violation)


def _entries(clearance: Array, zone: Index, contacts: ZoneContacts, whole: Index | None) -> Array:
    """Deepest entry into each zone, (L,) m, at the samples, (n, L), and refined minima.

    That of a zone of several parts is its first one's, and the others' are 0: walls that overlap are entered once.
    """
    violation = np.maximum(-clearance.min(axis=0), 0.0)
    np.maximum.at(violation, zone, -contacts.distance)
    if whole is None:
        return violation
    together = np.zeros_like(violation)
    np.maximum.at(together, whole, violation)
    return together


def local_minima(values: Array, below: float) -> tuple[Index, Index]:
    """Where the local minima are, along the first of two axes, of the values below a bound, ends included."""
    low = values < below
    low[1:] &= values[1:] <= values[:-1]
    low[:-1] &= values[:-1] < values[1:]
    row, column = np.nonzero(low)
    return row, column


def refine_minima(grid: Array, values: Array, row: Index, column: Index) -> Array:
    """Abscissae of the minima of parabolas through a sample and its two neighbours, on an equidistant grid."""
    last = len(grid) - 1
    inner = np.minimum(np.maximum(row, 1), last - 1)
    before, here, after = (values[inner + k, column] for k in (-1, 0, 1))
    bend = before - 2.0 * here + after
    shift = 0.5 * (before - after) / np.where(bend > 0.0, bend, np.inf)
    shift = np.where((row > 0) & (row < last), np.minimum(np.maximum(shift, -1.0), 1.0), row - inner)
    return grid[inner] + shift * (grid[1] - grid[0])


def _limit_violations(
    problem: Problem, trip: Trajectory, sites: BendSites, gaps: Array, optional: tuple[Array, ...]
) -> Array:
    """Violations, (5 + E,), in the order of Limit, then of the optional limits."""
    excess = np.zeros(len(Limit) + len(problem.optional))
    limits, goal_speed = problem.limits, problem.ends.goal_speed
    excess[Limit.LATERAL_ACCELERATION] = sites.worst_lateral / limits.lateral_acceleration - 1.0
    excess[Limit.CURVATURE] = sites.worst_curvature / limits.curvature - 1.0
    excess[Limit.SPEED] = trip.speed_control_points()[1:].max() / limits.speed - 1.0
    if gaps.size:
        excess[Limit.WORKSPACE_BOUNDS] = -gaps.min()
    if goal_speed is not None:
        excess[Limit.GOAL_SPEED] = abs(trip.final_speed - goal_speed)
    excess[len(Limit) :] = [found.max(initial=-np.inf) for found in optional]
    return np.maximum(excess, 0.0, out=excess)
