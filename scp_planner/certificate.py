"""The certificate: whether a plan keeps every limit and every clearance at *all* times, not only at samples.

It is independent of the code that made the plan: it uses the trip and the zones, and nothing of the optimisation.

Time is divided where a spline has a knot, so that on each interval [m - h, m + h] the offset f and the
acceleration are one polynomial each. Then, with interval enclosures of their derivatives on the interval:

- Clearance. For *any* fixed unit vector nu, l(t) = nu . (r(t) - eta(t)) - h_E(nu, t) - R is a lower bound of the
  signed distance. With nu taken at m,  l(m + d) >= l(m) - |l'(m)| h - K h^2 / 2, where K bounds
  |r''| + |eta''| + growth'' on the interval. For a zone that turns, nu turns with it, and K contains that.
- Curvature and lateral acceleration by the mean value form q(m) + [q'] h, q' enclosed by interval arithmetic.
- Speed and acceleration by the control points of their splines (convex hull).

Intervals whose bound does not decide are halved, until all hold, a violation is found at a midpoint, or the
intervals get too short.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from enum import Flag, auto
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from scp_planner.intervals import Interval
from scp_planner.places import Stretch, stretches
from scp_planner.plan import Clearance, LimitUse, Plan, Trip
from scp_planner.problem import Limits
from scp_planner.relevance import FEW_ZONES, LOOKS, Looks, least_clearances
from scp_planner.scenario import Scenario
from scp_planner.trajectory import Trajectory, TripPoints
from scp_planner.zones import ThreatZone, ZoneBatch, ZonesOf

Array = NDArray[np.float64]
Index = NDArray[np.intp]

MAX_HALVINGS = 22
MOST_PIECES = 20_000  # still undecided: along a zone at exactly no distance, no halving decides
INTERVALS = 192  # at the first level, at most, besides those between knots
FIRST_WIDTH = 0.04  # s, of shorter trips' intervals at the first level
FEWEST_INTERVALS = 16
MANY_ZONES = 32  # more than these are first searched for those that can matter
RELATIVE_TOLERANCE = 1e-9  # of limits: rounding
END_TOLERANCE = 1e-6  # m, m/s and rad at the ends of the trip
GOAL_SPEED_TOLERANCE = 1e-3  # m/s
CLEARANCE_TOLERANCE = 1e-9  # m
ARRIVAL_TOLERANCE = 1e-3  # s, around the earliest and latest arrival
LATEST = "latest arrival"
UNITS = {
    "clearance": "m",
    "workspace bounds": "m",
    "distance beyond the path": "m",
    "distance from the start": "m",
    "distance from the goal": "m",
    "start time": "s",
    "earliest arrival": "s",
    LATEST: "s",
    "start heading": "rad",
    "goal heading": "rad",
    "speed": "m/s",
    "speed_limits": "m/s",
    "start speed": "m/s",
    "goal speed error": "m/s",
    "acceleration": "m/s2",
    "start acceleration error": "m/s2",
    "lateral_acceleration": "m/s2",
    "jerk": "m/s3",
    "curvature": "1/m",
    "curvature_rate": "1/(m s)",
}
"""Of what can be violated; what users' own constraints exceed has none."""
A_JUMP = 1e12  # m/s^3, said of the jerk where the acceleration jumps
REPORT_PRECISION = 1e-3  # m; see certify_trip


@dataclass(frozen=True)
class Violation:
    """Something that a plan does not keep.

    Attributes
    ----------
    what : str
        ``clearance``, a limit's name, or an end condition.
    value : float
        The value found, SI.
    allowed : float
        What is allowed, SI.
    time : float
        Absolute time, s.
    obstacle : str or None
        Id, for clearance.
    """

    what: str
    value: float
    allowed: float
    time: float
    obstacle: str | None = None

    @property
    def unit(self) -> str:
        """Of value and allowed, after a space; empty without one."""
        unit = UNITS.get(self.what.partition("[")[0])
        return "" if unit is None else f" {unit}"

    def __str__(self) -> str:
        whom = f" to {self.obstacle}" if self.obstacle is not None else ""
        found, allowed = f"{self.value:.6g}{self.unit}", f"{self.allowed:.6g}{self.unit}"
        if self.obstacle is not None and self.value > -CLEARANCE_TOLERANCE:
            found, allowed = "too near 0 m to tell from contact", "0 m"
        return f"{self.what}{whom} {found} at t = {self.time:.3f} s, allowed {allowed}"


@dataclass(frozen=True)
class Certificate:
    """The outcome of a check in continuous time.

    Attributes
    ----------
    holds : bool
        Whether every limit and clearance is kept at all times.
    clearance : Clearance
        Least signed distance of the vehicle's disc to the zones; a lower bound if it holds.
    limits : dict of str to LimitUse
    violations : tuple of Violation
    """

    holds: bool
    clearance: Clearance
    limits: dict[str, LimitUse]
    violations: tuple[Violation, ...] = field(default=())

    @property
    def late(self) -> bool:
        """Whether the trip arrives later than it may, and nothing else is wrong with it."""
        return bool(self.violations) and all(violation.what == LATEST for violation in self.violations)


def certify(scenario: Scenario, plan: Plan, threat_zones: Sequence[ThreatZone] | None = None) -> Certificate:
    """Check a plan against a scenario in continuous time, whoever made it.

    Parameters
    ----------
    scenario : Scenario
    plan : Plan
    threat_zones : sequence of ThreatZone, optional
        The scenario's zones, if they are at hand.

    Returns
    -------
    Certificate
    """
    return certify_trip(scenario, plan.trip, ZonesOf(scenario) if threat_zones is None else threat_zones)


class Ends(Flag):
    """Ends of a trip that must be those of the scenario."""

    START = auto()
    GOAL = auto()
    BOTH = START | GOAL


def certify_trip(
    scenario: Scenario,
    trip: Trip,
    threat_zones: Sequence[ThreatZone],
    *,
    since: float | None = None,
    until: float | None = None,
    ends: Ends = Ends.BOTH,
    precision: float = REPORT_PRECISION,
    batch: ZoneBatch | None = None,
) -> Certificate:
    """Check a trip against a scenario in continuous time. See :func:`certify`.

    Parameters
    ----------
    scenario : Scenario
    trip : Trip
    threat_zones : sequence of ThreatZone
    since : float, optional
        Absolute time, s, from which on clearance, curvature, lateral acceleration and the workspace box are checked:
        what has been driven is driven. Speed and acceleration are checked all along, and the start not at all.
    until : float, optional
        Absolute time, s, up to which they are checked: a vehicle that stands can be hit by what moves.
    ends : Ends
        ``Ends.START`` for a trip that stops on its way.
    precision : float
        The reported least clearance is a lower bound at most this far below the true one, m; with inf it is any lower
        bound that is not negative, and found sooner.
    batch : ZoneBatch, optional
        The zones in the trip's frame, inflated by the vehicle's radius, if they are at hand.

    Returns
    -------
    Certificate
    """
    if batch is None:
        batch = ZoneBatch(threat_zones, trip.frame, scenario.vehicle.radius)
    check = _Check(scenario, trip, batch)
    check.precision = precision
    if since is not None:
        check.begin(since)
        ends &= Ends.GOAL
    if until is not None:
        check.end(until)
    return check.run(ends)


@dataclass(frozen=True)
class _Pieces:
    """Intervals of time, none across a knot: middles and half widths in normalised time."""

    middle: Array
    half: Array

    def halves(self, keep: NDArray[np.bool_]) -> _Pieces:
        middle, half = self.middle[keep], 0.5 * self.half[keep]
        return _Pieces(np.concatenate([middle - half, middle + half]), np.concatenate([half, half]))


@dataclass(frozen=True)
class _Enclosure:
    """What holds on whole intervals.

    Attributes
    ----------
    points : TripPoints
        At the middles.
    half : (n,) array
        Half widths, s.
    curvature, lateral : (n,) arrays
        At the middles, signed.
    curvature_bound, lateral_bound, acceleration_bound : (n,) arrays
        Upper bounds of the absolute values on the whole intervals.
    curvature_rate : Interval
        Of the curvature over time, 1/(m s).
    """

    points: TripPoints
    half: Array
    curvature: Array
    lateral: Array
    curvature_bound: Array
    lateral_bound: Array
    acceleration_bound: Array
    curvature_rate: Interval


class _Check:
    def __init__(self, scenario: Scenario, trip: Trip, batch: ZoneBatch) -> None:
        self.scenario = scenario
        self.trip = trip
        self.trajectory: Trajectory = trip.trajectory
        self.batch = batch
        self.limits = Limits.of(scenario)
        self.violations: list[Violation] = []
        self.accelerations = batch.centers.derivative.derivative
        self.first_sigma, self.last_sigma = 0.0, 1.0
        self.precision = REPORT_PRECISION
        self.start_speed = scenario.start.speed

    def begin(self, since: float) -> None:
        """Leave out what lies before an absolute time, s."""
        sigma = (since - self.trip.frame.time) / self.trajectory.travel_time
        self.first_sigma = min(max(sigma, 0.0), 1.0 - 1e-9)
        self.start_speed = self.trajectory.space.start_speed

    def end(self, until: float) -> None:
        """Leave out what lies after an absolute time, s."""
        sigma = (until - self.trip.frame.time) / self.trajectory.travel_time
        self.last_sigma = min(max(sigma, self.first_sigma + 1e-9), 1.0)

    def run(self, ends: Ends = Ends.BOTH) -> Certificate:
        self.violations.extend(self._ends(ends))
        limits = self._speed_and_acceleration()
        pieces = self._first_pieces()
        enclosure = self._enclose(pieces)
        for name, limit in (
            ("curvature", self.limits.curvature),
            ("lateral_acceleration", self.limits.lateral_acceleration),
        ):
            limits[name] = self._bend_limit(name, limit, pieces, enclosure)
        vehicle = self.scenario.vehicle
        if vehicle.max_curvature_rate is not None:
            rate_limit = vehicle.max_curvature_rate
            limits["curvature_rate"] = self._bend_limit("curvature_rate", rate_limit, pieces, enclosure)
        if vehicle.max_jerk is not None:
            limits["jerk"] = self._jerk(vehicle.max_jerk)
        for number, part in enumerate(stretches(self.scenario)):
            name = f"speed_limits[{number}]"
            limits[name] = self._speed_limit(name, part, pieces, enclosure)
        self.batch = self._near_batch()
        discs = self.scenario.vehicle.discs
        clearance = min((self._clearance(pieces, enclosure, disc) for disc in discs), key=lambda found: found.minimum)
        for disc in discs:
            self._inside_bounds(pieces, enclosure, disc)
        return Certificate(not self.violations, clearance, limits, tuple(self.violations))

    def _absolute(self, sigma: float) -> float:
        return self.trip.frame.time + self.trajectory.travel_time * float(sigma)

    def _ends(self, ends: Ends) -> list[Violation]:
        scenario, trajectory = self.scenario, self.trajectory
        points = trajectory.at(trajectory.space.time_table(np.array([0.0, 1.0])))
        position = self.trip.frame.to_world(points.path.position)
        direction = self.trip.frame.vectors_to_world(points.path.direction)
        start, goal = scenario.start, scenario.goal
        times = (self._absolute(0.0), self._absolute(1.0))
        # A trip that goes on beyond its path would be held at the goal, at a speed that it does not have.
        found = [("distance beyond the path", float(points.distance[1]) - trajectory.path.arc_length, 0.0, times[1])]
        headings: list[tuple[str, float | None, Array, float]] = []
        if Ends.START in ends:
            found += [
                ("start time", abs(times[0] - start.time), 0.0, times[0]),
                ("distance from the start", float(np.hypot(*(position[0] - start.position))), 0.0, times[0]),
                ("start speed", abs(float(points.speed[0]) - start.speed), 0.0, times[0]),
            ]
            if start.acceleration is not None:
                error = abs(float(points.acceleration[0]) - start.acceleration)
                found.append(("start acceleration error", error, 0.0, times[0]))
            headings.append(("start heading", start.heading, direction[0], times[0]))
        if Ends.GOAL in ends:
            away = float(np.hypot(*(position[1] - goal.position)))
            found.append(("distance from the goal", away, goal.radius, times[1]))
            if goal.speed is not None:
                error = abs(float(points.speed[1]) - goal.speed)
                found.append(("goal speed error", error, GOAL_SPEED_TOLERANCE, times[1]))
            headings.append(("goal heading", goal.heading, direction[1], times[1]))
            if goal.latest_arrival is not None:
                found.append((LATEST, times[1], goal.latest_arrival + ARRIVAL_TOLERANCE, times[1]))
        for name, wanted, vector, time in headings:
            if wanted is not None:
                turn = np.arctan2(vector[1], vector[0]) - wanted
                found.append((name, abs(float(np.arctan2(np.sin(turn), np.cos(turn)))), 0.0, time))
        early = []
        if Ends.GOAL in ends and goal.earliest_arrival is not None:
            if times[1] < goal.earliest_arrival - ARRIVAL_TOLERANCE:
                early.append(Violation("earliest arrival", times[1], goal.earliest_arrival, times[1]))
        return early + [
            Violation(name, value, allowed, time)
            for name, value, allowed, time in found
            if not value <= allowed + END_TOLERANCE
        ]

    def _speed_and_acceleration(self) -> dict[str, LimitUse]:
        trajectory, limits = self.trajectory, self.limits
        speeds = trajectory.speed_control_points()
        degree = trajectory.space.acceleration.coefficients.shape[1] - 1
        breakpoints = tuple(trajectory.space.acceleration.breakpoints.tolist())
        speed_sites, sites = _greville(breakpoints, degree + 1), _greville(breakpoints, degree)
        fastest, slowest = int(np.argmax(speeds)), int(np.argmin(speeds))
        # Driving faster than allowed at the start is the scenario's business, not the plan's.
        top = max(limits.speed, self.start_speed)
        self._note(
            "speed",
            float(speeds[fastest]),
            top,
            speed_sites[fastest],
            float(speeds[fastest]) > top * (1 + RELATIVE_TOLERANCE),
        )
        self._note(
            "speed",
            float(speeds[slowest]),
            0.0,
            speed_sites[slowest],
            float(speeds[slowest]) < -RELATIVE_TOLERANCE * top,
        )
        beta = trajectory.beta
        use = np.maximum(beta / limits.acceleration, -beta / limits.deceleration)
        worst = int(np.argmax(use))
        allowed = limits.acceleration if beta[worst] > 0 else -limits.deceleration
        self._note(
            "acceleration",
            float(beta[worst]),
            allowed,
            sites[worst],
            float(use[worst]) > 1 + RELATIVE_TOLERANCE,
        )
        return {
            "speed": LimitUse(float(speeds[fastest]), limits.speed, self._absolute(speed_sites[fastest])),
            "acceleration": LimitUse(float(beta[worst]), allowed, self._absolute(sites[worst])),
        }

    def _note(
        self, what: str, value: float, allowed: float, sigma: float, broken: bool, obstacle: str | None = None
    ) -> None:
        if broken:
            self.violations.append(Violation(what, value, allowed, self._absolute(sigma), obstacle))

    def _first_pieces(self) -> _Pieces:
        trajectory = self.trajectory
        space = trajectory.space
        knots = trajectory.path.arc_length_at(space.path.breakpoints[1:-1])
        first, last = self.first_sigma, self.last_sigma
        duration = (last - first) * trajectory.travel_time
        grid = np.linspace(first, last, int(np.clip(duration / FIRST_WIDTH, FEWEST_INTERVALS, INTERVALS)) + 1)
        inner = np.concatenate([space.acceleration.breakpoints, trajectory.arrivals(knots).sigma, self._zone_knots()])
        edges = np.unique(np.concatenate([grid, inner[(inner > first) & (inner < last)]]))
        return _Pieces(0.5 * (edges[1:] + edges[:-1]), 0.5 * np.diff(edges))

    def _zone_knots(self) -> Array:
        """Normalised times inside the trip at which a zone's motion or growth changes to another polynomial."""
        batch = self.batch
        pieces = [batch.centers] if batch.covariances is None else [batch.centers, batch.covariances]
        knots = np.concatenate([part.breakpoints[:, 1:-1].ravel() for part in pieces]) / self.trajectory.travel_time
        return np.unique(knots[(knots > 0.0) & (knots < 1.0)])

    def _enclose(self, pieces: _Pieces) -> _Enclosure:
        trajectory = self.trajectory
        space = trajectory.space
        points = trajectory.at(space.time_table(pieces.middle))
        half = pieces.half * trajectory.travel_time
        ends = trajectory.parameters_at(np.concatenate([pieces.middle - pieces.half, pieces.middle + pieces.half]))
        # Inside one span the acceleration is one polynomial of degree <= 2: linear ones are bounded by their ends.
        middle = points.acceleration
        count = len(middle)
        slope = self._jerk_bound(pieces)
        acceleration = np.abs(middle) + slope * half
        low, high = ends[:count], ends[count:]
        width = np.maximum(high - points.parameter, points.parameter - low) * (1.0 + 1e-9) + 1e-12
        fastest = points.speed + acceleration * half
        slowest = np.maximum(points.speed - acceleration * half, 0.0)
        bend = trajectory.path.bend_enclosure(points.path, width * space.length)
        # s(t): ds/dt = v / |r'|
        speed = Interval(slowest, fastest)
        curvature = trajectory.path.bend(points.path).curvature
        curvature_bound = np.abs(curvature) + bend.curvature_rate.magnitude() * width * space.length
        lateral = points.speed**2 * curvature
        over_time = bend.curvature_rate * speed * bend.speed.power(-1.0)
        rate = (Interval(-curvature_bound, curvature_bound) * speed * Interval(-acceleration, acceleration)).scaled(
            2.0
        ) + speed.squared() * over_time
        lateral_bound = np.abs(lateral) + rate.magnitude() * half
        return _Enclosure(points, half, curvature, lateral, curvature_bound, lateral_bound, acceleration, over_time)

    def _jerk_bound(self, pieces: _Pieces) -> Array:
        """Largest |da/dt| on each interval."""
        basis = self.trajectory.space.acceleration.derivative
        coefficients = basis.combine(self.trajectory.beta) / self.trajectory.travel_time
        span, _ = basis.locate(pieces.middle)
        return np.abs(coefficients[span]).sum(axis=1)

    def _bend_limit(self, name: str, limit: float, pieces: _Pieces, enclosure: _Enclosure) -> LimitUse:
        """Curvature, its rate or lateral acceleration, by halving."""
        allowed = limit * (1.0 + RELATIVE_TOLERANCE)
        best, best_sigma = -1.0, 0.0
        for _ in range(MAX_HALVINGS):
            if name == "curvature":
                value, bound = enclosure.curvature, enclosure.curvature_bound
            elif name == "curvature_rate":
                points = enclosure.points
                value = points.speed * self.trajectory.path.curvature_rate(points.path) / points.path.speed
                bound = enclosure.curvature_rate.magnitude()
            else:
                value, bound = enclosure.lateral, enclosure.lateral_bound
            worst = int(np.argmax(np.abs(value)))
            if abs(value[worst]) > best:
                best, best_sigma = float(abs(value[worst])), float(pieces.middle[worst])
            if best > allowed:
                self._note(name, best, limit, best_sigma, True)
                break
            undecided = bound > allowed
            if not undecided.any():
                break
            pieces = pieces.halves(undecided)
            enclosure = self._enclose(pieces)
        else:
            self._note(name, best, limit, best_sigma, True)
        return LimitUse(best, float(limit) if np.isfinite(limit) else None, self._absolute(best_sigma))

    def _jerk(self, limit: float) -> LimitUse:
        """The jerk by the ends of its pieces, which are straight: accelerations are quadratic at most."""
        trajectory = self.trajectory
        basis, breaks = trajectory.space.acceleration, trajectory.space.acceleration.breakpoints
        if basis.coefficients.shape[1] == 1:
            jumps = np.abs(np.diff(trajectory.beta))
            worst = int(np.argmax(jumps)) if len(jumps) else 0
            sigma = float(breaks[1:-1][worst]) if len(jumps) else 0.0
            value = A_JUMP if jumps.max(initial=0.0) > 0.0 else 0.0
        else:
            pieces = basis.derivative.combine(trajectory.beta) / trajectory.travel_time
            ends = np.abs(np.concatenate([pieces[:, :1], pieces.sum(axis=1, keepdims=True)], axis=1))
            piece, end = np.unravel_index(int(np.argmax(ends)), ends.shape)
            sigma, value = float(breaks[piece + end]), float(ends[piece, end])
        self._note("jerk", value, limit, sigma, value > limit * (1.0 + RELATIVE_TOLERANCE))
        return LimitUse(value, limit, self._absolute(sigma))

    def _speed_limit(self, name: str, part: Stretch, pieces: _Pieces, enclosure: _Enclosure) -> LimitUse:
        """The speed wherever the vehicle may be in a stretch of a line, by halving."""
        allowed = part.speed * (1.0 + RELATIVE_TOLERANCE)
        best, best_sigma = 0.0, 0.0
        for _ in range(MAX_HALVINGS):
            points, half = enclosure.points, enclosure.half
            position = self.trip.frame.to_world(points.path.position)
            fastest = points.speed + enclosure.acceleration_bound * half
            station = part.line.nearest(position)
            there = np.flatnonzero((station >= part.first) & (station <= part.last))
            if len(there):
                worst = there[np.argmax(points.speed[there])]
                if points.speed[worst] > best:
                    best, best_sigma = float(points.speed[worst]), float(pieces.middle[worst])
            if best > allowed:
                break
            undecided = fastest > allowed
            undecided[undecided] = part.line.may_be_between(
                position[undecided], (fastest * half)[undecided] + END_TOLERANCE, part.first, part.last
            )
            if not undecided.any():
                return LimitUse(best, part.speed, self._absolute(best_sigma))
            pieces = pieces.halves(undecided)
            enclosure = self._enclose(pieces)
        self._note(name, best, part.speed, best_sigma, True)
        return LimitUse(best, part.speed, self._absolute(best_sigma))

    def _near_batch(self) -> ZoneBatch:
        """The zones that could be the nearest one, or nearer than allowed, at some time of the trip."""
        batch, trajectory = self.batch, self.trajectory
        if batch.size <= MANY_ZONES:
            return batch
        top = max(float(trajectory.speed_control_points().max()), 0.0)
        ahead = max(map(abs, self.scenario.vehicle.discs))
        for count in LOOKS:
            # Only where it is checked: a zone says nothing of what lies before it was made.
            half = 0.5 * (self.last_sigma - self.first_sigma) / count
            middle = np.linspace(self.first_sigma + half, self.last_sigma - half, count)
            points = trajectory.at(trajectory.space.time_table(middle))
            half *= trajectory.travel_time
            reach, position = half * top + ahead, points.path.position
            bounds = least_clearances(batch, Looks(points.time, half, position - reach, position + reach))
            # The nearest zone comes at least as near as any zone is seen to be.
            seen = batch.subset(np.argsort(bounds)[:FEW_ZONES])
            batch = batch.subset(np.flatnonzero(bounds <= max(float(seen.distances(points.time, position).min()), 0.0)))
        return batch

    def _clearance(self, pieces: _Pieces, enclosure: _Enclosure, disc: float) -> Clearance:
        batch = self.batch
        if batch.size == 0:
            return Clearance(float("inf"))
        points = enclosure.points
        moving = _DiscMotion.of(enclosure, disc)
        nearer = self._nearer(enclosure, moving)
        exact = np.inf if np.isfinite(self.precision) else float(nearer.max())
        distance = batch.distances(points.time, moving.position, exact)
        least = float(distance.min())
        at = np.unravel_index(np.argmin(distance), distance.shape)
        where = (float(pieces.middle[at[0]]), int(at[1]))
        lower = distance - nearer
        far = (lower >= 0.0) & (lower >= least - self.precision)
        certified = float(lower[far].min(initial=np.inf))
        interval, zone = np.nonzero(~far)
        for _ in range(MAX_HALVINGS if len(interval) else 1):
            if not len(interval):
                break
            bound = self._clearance_bound(enclosure, disc, interval, zone)
            value = bound.value
            worst = int(np.argmin(value))
            if value[worst] < least:
                least, where = float(value[worst]), (float(pieces.middle[interval[worst]]), int(zone[worst]))
            if least < -CLEARANCE_TOLERANCE:
                certified = least
                break
            # Good enough: certainly outside, and not far below the least value found.
            done = (bound.lower >= 0.0) & (bound.lower >= least - self.precision)
            if done.any():
                certified = min(certified, float(bound.lower[done].min()))
            if done.all():
                break
            open_pieces, inverse = np.unique(interval[~done], return_inverse=True)
            if len(open_pieces) > MOST_PIECES:
                certified = -np.inf
                break
            keep = np.zeros(len(pieces.middle), dtype=bool)
            keep[open_pieces] = True
            pieces = pieces.halves(keep)
            interval = np.concatenate([inverse, inverse + len(open_pieces)])
            zone = np.concatenate([zone[~done], zone[~done]])
            enclosure = self._enclose(pieces)
        else:
            certified = -np.inf
        sigma, index = where
        if certified < 0.0:
            self._note("clearance", least, 0.0, sigma, True, batch.ids[index])
            return Clearance(least, batch.ids[index], self._absolute(sigma))
        return Clearance(max(certified, 0.0), batch.ids[index], self._absolute(sigma))

    def _nearer(self, enclosure: _Enclosure, moving: _DiscMotion) -> Array:
        """How much nearer each zone can come on each interval than in its middle, crudely, (n, L) m."""
        points, half = enclosure.points, enclosure.half
        first, last = float(np.min(points.time - half)), float(np.max(points.time + half))
        return self.batch.approach_bound(first, last, half, moving.speed_bound)

    def _clearance_bound(self, enclosure: _Enclosure, disc: float, interval: Index, zone: Index) -> _Bound:
        batch, times = self.batch, enclosure.points.time[interval]
        moving = _DiscMotion.of(enclosure, disc)
        position, velocity = moving.position[interval], moving.velocity[interval]
        contacts = batch.contacts(zone, times, position)
        half = enclosure.half[interval]
        slope = np.einsum("ij,ij->i", contacts.normal, velocity) + contacts.rate
        own = moving.acceleration_bound[interval]
        bend = batch.bend_bound(zone, times, half, contacts.normal, position, velocity, own)
        return _Bound(contacts.distance, contacts.distance - np.abs(slope) * half - 0.5 * bend * half * half)

    def _inside_bounds(self, pieces: _Pieces, enclosure: _Enclosure, disc: float) -> None:
        """A disc of the vehicle stays inside the workspace box, by the same bound as for clearance."""
        box = self.scenario.bounds
        if box is None:
            return
        frame = self.trip.frame
        radius = self.scenario.vehicle.radius
        normals = np.array([[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]])
        offsets = np.array([box.min[0], -box.max[0], box.min[1], -box.max[1]]) + radius
        for _ in range(MAX_HALVINGS):
            moving = _DiscMotion.of(enclosure, disc)
            inside = frame.to_world(moving.position) @ normals.T - offsets
            slope = np.abs(frame.vectors_to_world(moving.velocity) @ normals.T)
            own = moving.acceleration_bound[:, None]
            half = enclosure.half[:, None]
            lower = inside - slope * half - 0.5 * own * half * half
            worst = np.unravel_index(np.argmin(inside), inside.shape)
            if inside[worst] < -END_TOLERANCE:
                self._note("workspace bounds", float(inside[worst]), 0.0, float(pieces.middle[worst[0]]), True)
                return
            undecided = (lower < -END_TOLERANCE).any(axis=1)
            if not undecided.any():
                return
            pieces = pieces.halves(undecided)
            enclosure = self._enclose(pieces)
        self._note("workspace bounds", float(inside[worst]), 0.0, float(pieces.middle[0]), True)


@dataclass(frozen=True)
class _DiscMotion:
    """The centre of a disc on the vehicle's axis in the middles of intervals, and bounds on the whole intervals.

    It is at q = r + o T, o ahead of the reference point, with q' = v T + o w N and w = v kappa the rate of the heading,
    so that |q'| <= v (1 + |o kappa|) and |q''| <= |r''| + |o| |(w', w^2)|, w' = v dkappa/dt + a kappa.

    Attributes
    ----------
    position, velocity : (n, 2) arrays
        m, m/s.
    speed_bound, acceleration_bound : (n,) arrays
        m/s, m/s^2.
    """

    position: Array
    velocity: Array
    speed_bound: Array
    acceleration_bound: Array

    @classmethod
    def of(cls, enclosure: _Enclosure, offset: float) -> _DiscMotion:
        """Return the motion of a disc that is so far ahead of the reference point, m."""
        points = enclosure.points
        unit = points.path.direction / points.path.speed[:, None]
        fastest = points.speed + enclosure.acceleration_bound * enclosure.half
        own = np.hypot(enclosure.acceleration_bound, enclosure.lateral_bound)
        velocity = points.speed[:, None] * unit
        if offset == 0.0:
            return cls(points.path.position, velocity, fastest, own)
        across = np.stack([-unit[:, 1], unit[:, 0]], axis=1)
        turning = fastest * enclosure.curvature_bound
        change = fastest * enclosure.curvature_rate.magnitude()
        change = change + enclosure.acceleration_bound * enclosure.curvature_bound
        return cls(
            points.path.position + offset * unit,
            velocity + (offset * points.speed * enclosure.curvature)[:, None] * across,
            fastest * (1.0 + abs(offset) * enclosure.curvature_bound),
            own + abs(offset) * np.hypot(change, turning**2),
        )


@dataclass(frozen=True)
class _Bound:
    value: Array
    lower: Array


@lru_cache(maxsize=64)
def _greville(breakpoints: tuple[float, ...], degree: int) -> Array:
    """Sites in normalised time that the control points of a clamped spline belong to."""
    breaks = np.array(breakpoints)
    if degree == 0:
        return 0.5 * (breaks[1:] + breaks[:-1])
    knots = np.concatenate([np.full(degree, breaks[0]), breaks, np.full(degree, breaks[-1])])
    count = len(knots) - degree - 1
    return np.array([knots[k + 1 : k + degree + 1].mean() for k in range(count)])
