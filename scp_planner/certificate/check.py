"""The certificate: whether a plan keeps every limit and every clearance at *all* times, not only at samples.

It is independent of the search for the plan: it uses the trip and the zones, and nothing of the optimisation. What it
shares with the planner is how a path and a drive are evaluated, the zones, and the ellipses and outlines in them.

Time is divided where a spline has a knot, so that on each interval [m - h, m + h] the offset f and the
acceleration are one polynomial each. Then, with interval enclosures of their derivatives on the interval:

- Clearance. For *any* fixed unit vector nu, l(t) = nu . (r(t) - eta(t)) - h_E(nu, t) - R is a lower bound of the
  signed distance. With nu taken at m,  l(m + d) >= l(m) - |l'(m)| h - K h^2 / 2, where K bounds
  |r''| + |eta''| + growth'' on the interval. For a zone that turns, nu turns with it, and K contains that.
- Curvature and lateral acceleration by the mean value form q(m) + [q'] h, q' enclosed by interval arithmetic.
- Speed and acceleration by the Bernstein coefficients of their pieces (convex hull), halved where that decides nothing.

For clearance, nu is the direction from the centre at first, for all intervals and zones at once, and the exact normal
where that does not decide. Intervals whose bound does not decide are halved or quartered, until all hold, a violation
is found at a midpoint, or the intervals get too short.

Of a trip that is driven on, limits that it was once found to keep are known (`Motions`); only the zones are new.
"""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass
from math import pi, remainder
from typing import Any, Protocol

import numpy as np

from scp_planner.arrays import Array, Index
from scp_planner.certificate.enclosures import _Enclosure, _Pieces
from scp_planner.certificate.verdict import (
    ARRIVAL_TOLERANCE,
    CLEARANCE_TOLERANCE,
    EARLIEST,
    END_TOLERANCE,
    GOAL_SPEED_TOLERANCE,
    LATEST,
    POSITION_TOLERANCE,
    RELATIVE_TOLERANCE,
    Certificate,
    Clearance,
    Ends,
    LimitUse,
    Violation,
    off_a_step,
)
from scp_planner.files import LARGEST_COORDINATE
from scp_planner.mathematics.refinement import highest
from scp_planner.scenario.goals import distance_outside
from scp_planner.scenario.limits import Limits
from scp_planner.scenario.models import Scenario
from scp_planner.scenario.places import Stretch, stretches
from scp_planner.scenario.units import NaturalUnits
from scp_planner.threat_zones.batch import ZoneBatch
from scp_planner.threat_zones.bounds import MovingPoint, ZoneBounds
from scp_planner.threat_zones.nearness import FEW_ZONES, LOOKS, Looks, least_clearances
from scp_planner.threat_zones.of_scenario import HORIZON, ZonesOf
from scp_planner.threat_zones.zone import ThreatZone
from scp_planner.trips.space import CELLS_PER_SPAN, TripSpace
from scp_planner.trips.trajectory import Trajectory
from scp_planner.trips.trip import Trip

logger = logging.getLogger(__name__)

MAX_HALVINGS = 22
MOST_PIECES = 20_000  # still undecided: along a zone at exactly no distance, no halving decides
INTERVALS = 192  # at the first level, at most, besides those between knots
FIRST_WIDTH = 0.04  # units of time, of shorter trips' intervals at the first level
FEWEST_INTERVALS = 16
MANY_ZONES = 32  # more than these are first searched for those that can matter
A_JUMP = 1e12  # units of jerk, said of the jerk where the acceleration jumps
REPORT_PRECISION = 1e-3  # units of length; see certify_trip
FIRST_PAIRS = 8  # of intervals and zones, with which the least clearance is looked for
MOST_MOTIONS = 8  # that are remembered
_BOTH_ENDS = np.array([0.0, 1.0])
_NO_KNOTS = np.zeros(0)


class HasTrip(Protocol):
    """What can be certified: a plan, and whatever else has a trip."""

    @property
    def trip(self) -> Trip:
        """The trip, in world coordinates and absolute time."""
        ...


def certify(scenario: Scenario, plan: HasTrip, threat_zones: Sequence[ThreatZone] | None = None) -> Certificate:
    """Check a plan against a scenario in continuous time, whoever made it.

    Parameters
    ----------
    scenario : Scenario
    plan : Plan
        Or whatever else has a ``trip``.
    threat_zones : sequence of ThreatZone, optional
        The scenario's zones, if they are at hand.

    Returns
    -------
    Certificate
    """
    units = NaturalUnits.to_check(scenario)
    inside, trip = units.scenario(scenario), plan.trip.inside(units)
    tell_of_horizon(inside, trip, units)
    found = ZonesOf(inside) if threat_zones is None else tuple(zone.inside(units) for zone in threat_zones)
    return certify_trip(inside, trip, found).outside(units)


def tell_of_horizon(scenario: Scenario, trip: Trip, units: NaturalUnits) -> None:
    """Warn of a trip that is longer than the zones of observed obstacles are made for: beyond, nothing is known.

    Parameters
    ----------
    scenario : Scenario
    trip : Trip
        Both in natural units.
    units : NaturalUnits
        Of the scene, in which the warning is not.
    """
    beyond = trip.frame.time + trip.trajectory.travel_time - (scenario.start.time + HORIZON)
    if beyond > 0.0 and any(obstacle.observations is not None for obstacle in scenario.obstacles):
        logger.warning(
            "the trip ends %.4g s after the zones of observed obstacles do, which hold for %.4g s: the certificate says"
            " nothing of what they do later",
            beyond * units.time,
            HORIZON * units.time,
        )


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
    motions: Motions | None = None,
) -> Certificate:
    """Check a trip against a scenario, both in its natural units, in continuous time. See :func:`certify`.

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
    motions : Motions, optional
        What was found of trips that were checked before; what is found now is added.

    Returns
    -------
    Certificate
    """
    unfit = _never_arrives(trip) or _is_anywhere(trip)
    if unfit is not None:
        return Certificate(False, Clearance(-np.inf), {}, (unfit,))
    if batch is None:
        batch = ZoneBatch.of(threat_zones, trip.frame, scenario.vehicle.radius)
    check = _Check(scenario, trip, batch)
    check.precision, check.motions = precision, motions
    if since is not None:
        check.begin(since)
        ends &= Ends.GOAL
    if until is not None:
        check.end(until)
    again = check.run_again(ends) if since is not None else None
    return again or check.run(ends)


def _never_arrives(trip: Trip) -> Violation | None:
    """What is wrong with a trip that takes no time, or for ever, or is no numbers: no bound says anything of it."""
    trajectory = trip.trajectory
    time = trajectory.travel_time
    if not (np.all(np.isfinite(trajectory.theta)) and np.all(np.isfinite(trajectory.beta))):
        time = np.nan
    if 0.0 < time <= LARGEST_COORDINATE:
        return None
    return Violation("travel time", time, LARGEST_COORDINATE, trip.frame.time)


def _is_anywhere(trip: Trip) -> Violation | None:
    """What is wrong with a trip whose positions are not known well enough: one with a cusp, or with absurd bends."""
    path = trip.trajectory.path
    error = path.space.guide.error + path.exact.error
    if error <= POSITION_TOLERANCE:
        return None
    return Violation("error of the positions", error, POSITION_TOLERANCE, trip.frame.time)


@dataclass(frozen=True)
class _Motion:
    """A motion that keeps all limits, on pieces of time.

    Attributes
    ----------
    space : TripSpace
    scenario : Scenario
        Whose limits they are.
    ends : Ends
    first, last : float
        From when to when limits were checked, in normalised time.
    pieces : _Pieces
        In order.
    discs : tuple of MovingPoint
        The discs of the vehicle on them.
    limits : dict of str to LimitUse
    """

    space: TripSpace
    scenario: Scenario
    ends: Ends
    first: float
    last: float
    pieces: _Pieces
    discs: tuple[MovingPoint, ...]
    limits: dict[str, LimitUse]

    def serves(self, check: _Check, ends: Ends) -> bool:
        """Whether a check of the same control points would find the same limits kept."""
        mine, other = self.scenario, check.scenario
        return (
            self.space is check.trajectory.space
            and mine.vehicle is other.vehicle
            and mine.goal is other.goal
            and mine.bounds is other.bounds
            and mine.speed_limits is other.speed_limits
            and all(limit.line is not None for limit in mine.speed_limits)
            and ends in self.ends
            and self.first <= check.first_sigma
            and check.last_sigma <= self.last
        )


class Motions:
    """Trips that were found to keep all limits, of which only the clearance is checked again as they are driven on.

    A trip is told by the bits of all that it depends on.
    """

    def __init__(self) -> None:
        self._known: dict[tuple[Any, ...], _Motion] = {}

    @staticmethod
    def _name(trip: Trip) -> tuple[Any, ...]:
        trajectory = trip.trajectory
        return trip.frame, trajectory.travel_time, trajectory.theta.tobytes(), trajectory.beta.tobytes()

    def of(self, trip: Trip) -> _Motion | None:
        """What is known of a trip."""
        return self._known.get(self._name(trip))

    def add(self, trip: Trip, motion: _Motion) -> None:
        """Remember a trip; the one that was added first is forgotten for it."""
        name = self._name(trip)
        self._known.pop(name, None)
        while len(self._known) >= MOST_MOTIONS:
            del self._known[next(iter(self._known))]
        self._known[name] = motion


_Finding = tuple[str, float, float, float]  # what, the value, what is allowed, when


class _Check:
    def __init__(self, scenario: Scenario, trip: Trip, batch: ZoneBatch) -> None:
        self.scenario = scenario
        self.trip = trip
        self.trajectory: Trajectory = trip.trajectory
        self.batch = batch
        self.limits = Limits.of(scenario)
        self.violations: list[Violation] = []
        self.first_sigma, self.last_sigma = 0.0, 1.0
        self.precision = REPORT_PRECISION
        self.start_speed = scenario.start.speed
        self.motions: Motions | None = None

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
        pieces = self._first_pieces()
        enclosure = self._enclose(pieces)
        self.violations.extend(self._ends(ends))
        limits = self._speed_and_acceleration()
        for name, limit in (
            ("curvature", self.limits.curvature),
            ("lateral_acceleration", self.limits.lateral_acceleration),
        ):
            limits[name] = self._bend_limit(name, limit, pieces, enclosure)
        vehicle = self.scenario.vehicle
        if vehicle.max_curvature_rate is not None:
            rate_limit = vehicle.max_curvature_rate
            limits["curvature_rate"] = self._bend_limit("curvature_rate", rate_limit, pieces, enclosure)
        for name, other in (("total_acceleration", vehicle.max_total_acceleration), ("power", vehicle.max_power)):
            if other is not None:
                limits[name] = self._bend_limit(name, other, pieces, enclosure)
        if vehicle.max_jerk is not None:
            limits["jerk"] = self._jerk(vehicle.max_jerk)
        for number, part in enumerate(stretches(self.scenario)):
            name = f"speed_limits[{number}]"
            limits[name] = self._speed_limit(name, part, pieces, enclosure)
        discs = tuple(enclosure.disc(offset) for offset in vehicle.discs)
        outside = [self._leaves_bounds(pieces, disc, offset) for disc, offset in zip(discs, vehicle.discs, strict=True)]
        if self.motions is not None and not self.violations and not any(outside) and self._keeps_speed_later():
            motion = _Motion(
                self.trajectory.space, self.scenario, ends, self.first_sigma, self.last_sigma, pieces, discs, limits
            )
            self.motions.add(self.trip, motion)
        clearance = self._least_clearance(pieces, discs)
        self.violations.extend(violation for violation in outside if violation is not None)
        return Certificate(not self.violations, clearance, limits, tuple(self.violations))

    def run_again(self, ends: Ends) -> Certificate | None:
        """Check the clearance alone, if the rest is known; None if that does not decide.

        The first piece may begin before what is to be checked: then it is kept clear of all the more, or if it is not,
        nothing follows from that.
        """
        motion = None if self.motions is None else self.motions.of(self.trip)
        if motion is None or not motion.serves(self, ends):
            return None
        pieces = motion.pieces
        begins, finishes = pieces.middle - pieces.half, pieces.middle + pieces.half
        part = slice(
            int(np.searchsorted(finishes, self.first_sigma, "right")), int(np.searchsorted(begins, self.last_sigma))
        )
        if part.start >= part.stop:
            return None
        knots = self._zone_knots()
        if np.any((knots > begins[part.start]) & (knots < finishes[part.stop - 1])):
            return None
        pieces = _Pieces(pieces.middle[part], pieces.half[part])
        clearance = self._least_clearance(pieces, tuple(disc.take(part) for disc in motion.discs))
        if not self.violations:
            return Certificate(True, clearance, motion.limits)
        found, self.violations = tuple(self.violations), []
        if all(one.value < -CLEARANCE_TOLERANCE and one.time >= self._absolute(self.first_sigma) for one in found):
            return Certificate(False, clearance, motion.limits, found)
        return None

    def _keeps_speed_later(self) -> bool:
        """Whether the trip is not too fast for a vehicle that is on its way, either."""
        top = max(self.limits.speed, self.trajectory.space.start_speed)
        return float(self.trajectory.speed_control_points().max()) <= top * (1 + RELATIVE_TOLERANCE)

    def _least_clearance(self, pieces: _Pieces, discs: Sequence[MovingPoint]) -> Clearance:
        near = self._near_batch()
        found = (
            self._clearance(near, pieces, disc, offset)
            for disc, offset in zip(discs, self.scenario.vehicle.discs, strict=True)
        )
        return min(found, key=lambda one: one.minimum)

    def _absolute(self, sigma: float) -> float:
        return self.trip.frame.time + self.trajectory.travel_time * float(sigma)

    def _ends(self, ends: Ends) -> list[Violation]:
        scenario, trajectory = self.scenario, self.trajectory
        drive = trajectory.drive_at(_BOTH_ENDS)
        times = (self._absolute(0.0), self._absolute(1.0))
        # A trip that goes on beyond its path would be held at the goal, at a speed that it does not have.
        found = [("distance beyond the path", float(drive.distance[1]) - trajectory.path.driven_length, 0.0, times[1])]
        if ends:
            points = trajectory.path.points(trajectory.path.exact.parameter_at(drive.distance))
            position = self.trip.frame.to_world(points.position)
            direction = self.trip.frame.vectors_to_world(points.direction)
        start, goal = scenario.start, scenario.goal
        headings: list[tuple[str, float | None, Array, float]] = []
        if Ends.START in ends:
            found += [
                ("start time", abs(times[0] - start.time), 0.0, times[0]),
                ("distance from the start", float(np.hypot(*(position[0] - start.position))), 0.0, times[0]),
                ("start speed", abs(float(drive.speed[0]) - start.speed), 0.0, times[0]),
            ]
            if start.acceleration is not None:
                error = abs(float(drive.acceleration[0]) - start.acceleration)
                found.append(("start acceleration error", error, 0.0, times[0]))
            headings.append(("start heading", start.heading, direction[0], times[0]))
        if Ends.GOAL in ends:
            ahead = scenario.vehicle.centre / float(np.hypot(*direction[1]))
            middle = tuple((position[1] + ahead * direction[1]).tolist())
            away = float(np.hypot(*(position[1] - goal.position)))
            found.append(
                ("distance from the goal", away, goal.radius, times[1])
                if goal.region is None
                else ("distance from the goal region", distance_outside(goal.region, middle), 0.0, times[1])
            )
            found += self._ranges(direction[1], float(drive.speed[1]), times)
            if goal.speed is not None:
                error = abs(float(drive.speed[1]) - goal.speed)
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
                early.append(Violation(EARLIEST, times[1], goal.earliest_arrival, times[1]))
        return early + [
            Violation(name, value, allowed, time)
            for name, value, allowed, time in found
            if not value <= allowed + END_TOLERANCE
        ]

    def _ranges(
        self, direction: Array, speed: float, times: tuple[float, float]
    ) -> list[tuple[str, float, float, float]]:
        """How far heading, speed and time on arrival are from what the goal leaves open, and 0, which is allowed."""
        goal, found = self.scenario.goal, []
        if goal.heading_range is not None:
            low, high = goal.heading_range
            turn = remainder(float(np.arctan2(direction[1], direction[0])) - 0.5 * (low + high), 2.0 * pi)
            found.append(("goal heading", max(abs(turn) - 0.5 * (high - low), 0.0), 0.0, times[1]))
        if goal.speed_range is not None:
            low, high = goal.speed_range
            found.append(("goal speed", max(low - speed, speed - high, 0.0), 0.0, times[1]))
        if goal.arrival_step is not None:
            missed = abs(remainder(times[1] - times[0], goal.arrival_step))
            found.append(("arrival off the step", missed, off_a_step(goal.arrival_step), times[1]))
        return found

    def _speed_and_acceleration(self) -> dict[str, LimitUse]:
        trajectory, limits = self.trajectory, self.limits
        basis, tau = trajectory.space.acceleration, trajectory.travel_time
        speeds = basis.antiderivative.combine(tau * trajectory.beta)
        speeds[:, 0] += trajectory.space.start_speed
        accelerations = basis.combine(trajectory.beta)
        # Driving faster than allowed at the start is the scenario's business, not the plan's.
        top = max(limits.speed, self.start_speed)
        fastest = self._kept("speed", speeds, top)
        self._kept("speed", speeds, 0.0, -1.0, RELATIVE_TOLERANCE * top)
        gained = self._kept("acceleration", accelerations, limits.acceleration)
        lost = self._kept("acceleration", accelerations, limits.deceleration, -1.0)
        gains = gained.worst / limits.acceleration >= -lost.worst / limits.deceleration
        speed = LimitUse(fastest.worst, limits.speed, fastest.time)
        return {"speed": speed, "acceleration": gained if gains else lost}

    def _kept(
        self, what: str, coefficients: Array, limit: float, sign: float = 1.0, tolerance: float | None = None
    ) -> LimitUse:
        """How far a piecewise polynomial of normalised time, times a sign, uses an upper limit; noted if beyond it."""
        basis = self.trajectory.space.acceleration
        allowed = limit + (RELATIVE_TOLERANCE * limit if tolerance is None else tolerance)
        found = highest(sign * coefficients, allowed)
        sigma = float(basis.breakpoints[found.piece] + found.local * basis.widths[found.piece])
        self._note(what, sign * found.value, sign * limit, sigma, not found.kept)
        return LimitUse(sign * found.value, sign * limit, self._absolute(sigma))

    def _note(
        self, what: str, value: float, allowed: float, sigma: float, broken: bool, obstacle: str | None = None
    ) -> None:
        if broken:
            self.violations.append(Violation(what, value, allowed, self._absolute(sigma), obstacle))

    def _first_pieces(self) -> _Pieces:
        trajectory = self.trajectory
        space = trajectory.space
        # Where the rate of the curvature counts, over a curved guide also where that of the guide's jumps.
        cells = self.scenario.vehicle.max_curvature_rate is not None and not space.guide.straight
        stride = 1 if cells else CELLS_PER_SPAN
        knots = trajectory.path.exact.at(space.tables.station_parameters[stride:-1:stride])
        first, last = self.first_sigma, self.last_sigma
        duration = (last - first) * trajectory.travel_time
        count = int(min(max(duration / FIRST_WIDTH, FEWEST_INTERVALS), INTERVALS))
        inner = np.concatenate([space.acceleration.breakpoints, trajectory.arrivals(knots).sigma, self._zone_knots()])
        inner = inner[(inner > first) & (inner < last)]
        edges = np.concatenate([np.linspace(first, last, count + 1), inner])
        edges.sort()
        before, after = edges[:-1], edges[1:]
        wide = after > before
        return _Pieces((0.5 * (before + after))[wide], (0.5 * (after - before))[wide])

    def _zone_knots(self) -> Array:
        """Normalised times inside the trip at which a zone's motion or growth changes to another polynomial."""
        batch = self.batch
        pieces = [part for part in (batch.centers, batch.covariances) if part is not None]
        pieces = [part for part in pieces if part.breakpoints.shape[1] > 2]
        if not pieces:
            return _NO_KNOTS
        knots = np.concatenate([part.breakpoints[:, 1:-1].ravel() for part in pieces]) / self.trajectory.travel_time
        return np.unique(knots[(knots > 0.0) & (knots < 1.0)])

    def _enclose(self, pieces: _Pieces) -> _Enclosure:
        trajectory = self.trajectory
        path, length, count = trajectory.path, trajectory.space.length, len(pieces.middle)
        half = pieces.half * trajectory.travel_time
        ends = pieces.middle - pieces.half, pieces.middle + pieces.half
        drive = trajectory.drive_at(np.concatenate([pieces.middle, *ends]))
        parameters = path.exact.parameter_at(drive.distance)
        parameter, low, high = parameters[:count], parameters[count : 2 * count], parameters[2 * count :]
        points, speed, middle = path.points(parameter), drive.speed[:count], drive.acceleration[:count]
        # Inside one span the acceleration is one polynomial of degree <= 2: linear ones are bounded by their ends.
        acceleration = np.abs(middle)
        if not trajectory.space.tables.constant:
            acceleration = acceleration + self._jerk_bound(drive.span[:count]) * half
        width = (np.maximum(high - parameter, parameter - low) * (1.0 + 1e-9) + 1e-12) * length
        fastest = speed + acceleration * half
        bend = path.bend_enclosure(points, width)
        curvature = path.bend(points).curvature
        rate = bend.curvature_rate.magnitude()
        curvature_bound = np.abs(curvature) + rate * width
        lateral = speed * speed * curvature
        # s(t): ds/dt = v / |r'|
        over_time = rate * fastest / bend.speed.lower
        lateral_bound = np.abs(lateral) + fastest * (2.0 * curvature_bound * acceleration + fastest * over_time) * half
        time = trajectory.travel_time * pieces.middle
        return _Enclosure(
            time,
            half,
            speed,
            points,
            curvature,
            lateral,
            curvature_bound,
            lateral_bound,
            acceleration,
            over_time,
            middle,
        )

    def _jerk_bound(self, span: Index) -> Array:
        """Largest |da/dt| in spans of the acceleration."""
        basis = self.trajectory.space.acceleration.derivative
        coefficients = basis.combine(self.trajectory.beta) / self.trajectory.travel_time
        return np.abs(coefficients[span]).sum(axis=1)

    def _bend_limit(self, name: str, limit: float, pieces: _Pieces, enclosure: _Enclosure) -> LimitUse:
        """Curvature, its rate, accelerations across or in total, or power, by quartering: rounds cost most."""
        allowed = limit * (1.0 + RELATIVE_TOLERANCE)
        best, best_sigma = -1.0, 0.0
        for _ in range(MAX_HALVINGS // 2):
            if name == "curvature":
                value, bound = enclosure.curvature, enclosure.curvature_bound
            elif name == "curvature_rate":
                points = enclosure.path
                value = enclosure.speed * self.trajectory.path.curvature_rate(points) / points.speed
                bound = enclosure.curvature_rate
            elif name == "total_acceleration":
                value = np.hypot(enclosure.acceleration, enclosure.lateral)
                bound = np.hypot(enclosure.acceleration_bound, enclosure.lateral_bound)
            elif name == "power":
                value = np.maximum(enclosure.acceleration, 0.0) * enclosure.speed
                bound = enclosure.power_bound
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
            pieces = pieces.quarters(undecided)
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
            half, speed = enclosure.half, enclosure.speed
            position = self.trip.frame.to_world(enclosure.path.position)
            fastest = speed + enclosure.acceleration_bound * half
            station = part.line.nearest(position)
            there = np.flatnonzero((station >= part.first) & (station <= part.last))
            if len(there):
                worst = there[np.argmax(speed[there])]
                if speed[worst] > best:
                    best, best_sigma = float(speed[worst]), float(pieces.middle[worst])
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
            points = trajectory.driven(trajectory.space.time_table(middle))
            half *= trajectory.travel_time
            reach, position = half * top + ahead, points.path.position
            bounds = least_clearances(batch, Looks(points.time, half, position - reach, position + reach))
            # The nearest zone comes at least as near as any zone is seen to be.
            seen = batch.subset(np.argsort(bounds)[:FEW_ZONES])
            batch = batch.subset(np.flatnonzero(bounds <= max(float(seen.distances(points.time, position).min()), 0.0)))
        return batch

    def _clearance(self, batch: ZoneBatch, pieces: _Pieces, disc: MovingPoint, offset: float) -> Clearance:
        """Least clearance of a disc that is so far ahead of the reference point, m."""
        if batch.size == 0:
            return Clearance(float("inf"))
        crude = ZoneBounds(batch).crude(disc)
        nearest, zone = divmod(int(np.argmin(crude)), batch.size)
        where, least, enough = (float(pieces.middle[nearest]), zone), np.inf, 0.0
        if np.isfinite(self.precision):
            some = np.argsort(crude, axis=None)[:FIRST_PAIRS]
            interval, zones = np.divmod(some, batch.size)
            value = ZoneBounds(batch).fine(zones, interval, disc).value
            worst = int(np.argmin(value))
            least, where = float(value[worst]), (float(pieces.middle[interval[worst]]), int(zones[worst]))
            enough = max(least - self.precision, 0.0)
        far = crude >= enough
        certified = float(crude[far].min(initial=np.inf))
        interval, zones = np.nonzero(~far)
        for _ in range(MAX_HALVINGS if len(interval) else 1):
            if not len(interval):
                break
            bound = ZoneBounds(batch).fine(zones, interval, disc)
            value = bound.value
            worst = int(np.argmin(value))
            if value[worst] < least:
                least, where = float(value[worst]), (float(pieces.middle[interval[worst]]), int(zones[worst]))
            if not least >= -CLEARANCE_TOLERANCE:
                certified = least
                break
            if not np.isfinite(value[worst]):
                certified = -np.inf
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
            zones = np.concatenate([zones[~done], zones[~done]])
            disc = self._enclose(pieces).disc(offset)
        else:
            certified = -np.inf
        sigma, index = where
        if certified < 0.0:
            self._note("clearance", least, 0.0, sigma, True, batch.ids[index])
            return Clearance(least, batch.ids[index], self._absolute(sigma))
        return Clearance(max(certified, 0.0), batch.ids[index], self._absolute(sigma))

    def _leaves_bounds(self, pieces: _Pieces, disc: MovingPoint, offset: float) -> Violation | None:
        """Where a disc of the vehicle leaves the workspace box, by the same bound as for clearance."""
        box = self.scenario.bounds
        if box is None:
            return None
        frame = self.trip.frame
        radius = self.scenario.vehicle.radius
        normals = np.array([[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]])
        offsets = np.array([box.min[0], -box.max[0], box.min[1], -box.max[1]]) + radius
        at = 0.0
        for _ in range(MAX_HALVINGS):
            inside = frame.to_world(disc.position) @ normals.T - offsets
            slope = np.abs(frame.vectors_to_world(disc.velocity) @ normals.T)
            half = disc.half[:, None]
            lower = inside - slope * half - 0.5 * disc.acceleration[:, None] * half * half
            worst = np.unravel_index(np.argmin(inside), inside.shape)
            at = float(pieces.middle[worst[0]])
            if inside[worst] < -END_TOLERANCE:
                break
            undecided = ~(lower >= -END_TOLERANCE).all(axis=1)
            if not undecided.any():
                return None
            pieces = pieces.halves(undecided)
            disc = self._enclose(pieces).disc(offset)
        return Violation("workspace bounds", float(inside[worst]), 0.0, self._absolute(at))
