"""A motion under check: its scope, its zones, and enclosures on pieces of time."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from functools import cached_property
from typing import Generic, TypeVar

import numpy as np

from scp_planner.arrays import Array, Index
from scp_planner.certificate.enclosures import Enclosed, Enclosure, Pieces
from scp_planner.certificate.excess import HardestStop, cubics
from scp_planner.certificate.tolerances import (
    LENGTH_TOLERANCE,
    RELATIVE_TOLERANCE,
    REPORT_PRECISION,
    SHORTEST_CHECK,
    TripUnit,
)
from scp_planner.certificate.verdict import Ends, LimitUse, Violation
from scp_planner.mathematics.frames import PlanningFrame
from scp_planner.mathematics.refinement import highest
from scp_planner.pauses import look_at_the_clock
from scp_planner.scenario.models import Scenario
from scp_planner.scenario.places import Line
from scp_planner.threat_zones.batch import ZoneBatch
from scp_planner.threat_zones.error_tube import TrackingTube
from scp_planner.threat_zones.nearness import NEARNESS, SweptBoxes, least_clearances
from scp_planner.trips.space import CELLS_PER_SPAN
from scp_planner.trips.trajectory import Trajectory
from scp_planner.trips.trip import Trip


@dataclass(frozen=True)
class PieceSettings:
    """Pieces of time that a check begins with, and how often they are halved."""

    intervals: int = 192  # at the first level, at most, besides those between knots
    width: float = 0.04  # units of time, of shorter trips' intervals at the first level
    finer: float = 2.0  # times as many, where the clearance is wanted closely: that mostly spares quartering them
    fewest: int = 16
    max_halvings: int = 22
    fewest_followed: int = 400  # places of a trip along a line that crosses itself
    many_zones: int = 32  # more than these are first searched for those that can matter


PIECES = PieceSettings()


@dataclass(frozen=True)
class Finding:
    """Use of a limit by a trip, and its violations."""

    use: LimitUse
    violations: tuple[Violation, ...] = ()  # None, if the limit is kept


@dataclass(frozen=True)
class Scope:
    """Part of a trip that is checked, and the precision of the check."""

    since: float | None = None
    until: float | None = None  # Absolute time, s, up to which they are checked
    ends: Ends = Ends.BOTH  # ``Ends.START`` for a trip that stops on its way
    precision: float = REPORT_PRECISION
    tube: TrackingTube | None = None  # In which the vehicle stays round the trip; see `certify`
    deadline: float = np.inf  # Value of :func:`time.perf_counter` at which the check is given up


WHOLE = Scope()
EnclosedT = TypeVar("EnclosedT", bound=Enclosed)


class Checked(ABC, Generic[EnclosedT]):
    """A motion under check, and what it is checked against, in natural units; pieces of time are on its own clock."""

    scenario: Scenario
    batch: ZoneBatch  # The zones in the motion's frame, inflated by the vehicle's radius
    first: float  # From when on it is checked
    unit: TripUnit  # Of tolerances: by the distance that is driven

    @property
    def slack(self) -> float:
        """Tolerance of clearances, in units of the scenario."""
        return LENGTH_TOLERANCE * self.unit.length

    @property
    @abstractmethod
    def frame(self) -> PlanningFrame:
        """Frame of positions and of zones."""

    @abstractmethod
    def absolute(self, clock: float) -> float:
        """Absolute time, s."""

    @abstractmethod
    def enclosed(self, pieces: Pieces) -> EnclosedT:
        """Return what holds of the motion on pieces of time."""

    @property
    @abstractmethod
    def hardest_stop(self) -> HardestStop:
        """The stop that brakes the hardest from where the check begins."""

    @abstractmethod
    def excused_until(self, after: float) -> float:
        """Return the time at which the motion gets faster than the hardest stop, at most so long after the first, s."""

    @abstractmethod
    def followed(self, line: Line) -> tuple[Array, Array] | None:
        """Stations (n,) along a line that crosses itself, m, and by what progress (n,) it is there; else None."""

    def near(self, most_off: float) -> ZoneBatch:  # noqa: ARG002 - of other motions
        """Zones that could be the nearest one to a vehicle that is off by so much at most, or nearer than allowed."""
        return self.batch

    def go_on(self) -> None:
        """Give the check up if it is late."""

    def zone_instants(self) -> Array:
        """Times on the planning clock at which a zone's motion, growth or turn changes to another polynomial, s."""
        batch = self.batch
        pieces = [part for part in (batch.centers, batch.covariances, batch.own_directions) if part is not None]
        several = [part.instants for part in pieces if part.breakpoints.shape[1] > 2]
        if len(several) == 1:
            return several[0]
        return np.unique(np.concatenate([np.zeros(0), *several]))

    def broken(self, what: str, value: float, allowed: float, clock: float) -> Violation:
        """Return that a limit is broken at a time."""
        return Violation(what, value, allowed, self.absolute(clock))

    def finding(self, what: str, value: float, limit: float, clock: float, *, kept: bool) -> Finding:
        """Return the use of a limit, and that it is broken unless it is kept."""
        use = LimitUse(value, float(limit) if np.isfinite(limit) else None, self.absolute(clock))
        return Finding(use, () if kept else (self.broken(what, value, limit, clock),))


@dataclass(frozen=True)
class CheckedTrip(Checked[Enclosure]):
    """A trip, or a part of it, and what it is checked against; its clock is normalised time."""

    scenario: Scenario  # In its natural units, as all the rest
    trip: Trip
    batch: ZoneBatch
    first: float  # From when to when it is checked, in normalised time
    last: float  # From when to when it is checked, in normalised time
    unit: TripUnit
    fresh: bool  # True if it is checked from its start on
    tube: TrackingTube | None = None  # Round the trip, in which the vehicle stays
    deadline: float = np.inf  # Value of :func:`time.perf_counter` at which the check is given up

    @classmethod
    def of(
        cls, scenario: Scenario, trip: Trip, batch: ZoneBatch, scope: Scope = WHOLE, unit: TripUnit | None = None
    ) -> CheckedTrip:
        """Return what is checked of a trip, by tolerances of a unit; by default of that of the trip alone."""
        unit = unit or TripUnit.of_trips(scenario, [trip])
        first, last = 0.0, 1.0
        begin, duration = trip.frame.time, trip.trajectory.travel_time
        if scope.since is not None:
            first = min(max((scope.since - begin) / duration, 0.0), 1.0 - SHORTEST_CHECK)
        if scope.until is not None:
            last = min(max((scope.until - begin) / duration, first + SHORTEST_CHECK), 1.0)
        fresh = scope.since is None
        return cls(scenario, trip, batch, first, last, unit, fresh, scope.tube, scope.deadline)

    def go_on(self) -> None:
        look_at_the_clock(self.deadline)

    @cached_property
    def hardest_stop(self) -> HardestStop:
        drive = self.trajectory.drive_at(np.array([self.first]))
        speed, acceleration = max(float(drive.speed[0]), 0.0), float(drive.acceleration[0])
        if self.fresh and self.scenario.start.acceleration is None:
            acceleration = min(acceleration, 0.0)  # it may jump
        return HardestStop.from_state(speed, acceleration, self.scenario.vehicle)

    def excused_until(self, after: float) -> float:
        stop, tau = self.hardest_stop, self.trajectory.travel_time
        end = max(min(self.first + after / tau, self.last - 0.5 * SHORTEST_CHECK), self.first)
        knots = np.concatenate([self.trajectory.space.acceleration.breakpoints, self.first + stop.time / tau])
        edges = np.unique(np.concatenate([[self.first, end], knots[(knots > self.first) & (knots < end)]]))

        def faster(sigma: Array) -> Array:
            return self.trajectory.speed_at(sigma) - stop.speed_at((sigma - self.first) * tau)

        most = RELATIVE_TOLERANCE * float(stop.speed.max())
        for part, begin in zip(cubics(faster, edges), edges, strict=False):
            if not highest(part[None], most).kept:
                return float(begin)
        return end

    @property
    def frame(self) -> PlanningFrame:
        return self.trip.frame

    @property
    def trajectory(self) -> Trajectory:
        """The trip in its frame."""
        return self.trip.trajectory

    def absolute(self, clock: float) -> float:
        return self.trip.frame.time + self.trajectory.travel_time * float(clock)

    def first_pieces(self, precision: float = np.inf) -> Pieces:
        """Return the pieces that a check begins with: between all knots of trip and zones, and short ones."""
        trajectory = self.trajectory
        space = trajectory.space
        # Where the rate of the curvature counts, over a curved guide also where that of the guide's jumps.
        cells = self.scenario.vehicle.max_curvature_rate is not None and not space.guide.straight
        stride = 1 if cells else CELLS_PER_SPAN
        knots = trajectory.path.exact.at(space.tables.station_parameters[stride:-1:stride])
        duration = (self.last - self.first) * trajectory.travel_time
        finer = PIECES.finer if np.isfinite(precision) else 1.0
        count = int(finer * min(max(duration / PIECES.width, PIECES.fewest), PIECES.intervals))
        inner = np.concatenate([space.acceleration.breakpoints, trajectory.arrivals(knots).sigma, self.zone_knots()])
        inner = inner[(inner > self.first) & (inner < self.last)]
        edges = np.concatenate([np.linspace(self.first, self.last, count + 1), inner])
        edges.sort()
        return Pieces.between(edges)

    def zone_knots(self) -> Array:
        """Normalised times inside the trip at which a zone's motion, growth or turn changes to another polynomial."""
        knots = self.zone_instants() / self.trajectory.travel_time
        return knots[(knots > 0.0) & (knots < 1.0)]

    def near(self, most_off: float) -> ZoneBatch:
        batch, trajectory = self.batch, self.trajectory
        # Of polygons that stand the bound to begin with is hardly dearer than these.
        standing = 0 if batch.ground is None else len(batch.ground.zones)
        if batch.size - standing <= PIECES.many_zones:
            return batch
        top = max(trajectory.top_speed, 0.0)
        ahead = max(map(abs, self.scenario.vehicle.discs))
        for count in NEARNESS.looks:
            self.go_on()
            # Only where it is checked: a zone says nothing of what lies before it was made.
            half = 0.5 * (self.last - self.first) / count
            middle = np.linspace(self.first + half, self.last - half, count)
            points = trajectory.driven(trajectory.space.time_table(middle))
            half *= trajectory.travel_time
            reach, position = half * top + ahead, points.path.position
            bounds = least_clearances(batch, SweptBoxes(points.time, half, position - reach, position + reach))
            if np.isneginf(bounds).all():
                return batch
            # The nearest zone comes at least as near as any zone is seen to be.
            seen = batch.subset(np.argsort(bounds)[: NEARNESS.few_zones])
            nearest = max(float(seen.distances(points.time, position).min()), 0.0)
            batch = batch.subset(np.flatnonzero(bounds <= nearest + most_off))
        return batch

    def followed(self, line: Line) -> tuple[Array, Array] | None:
        if not np.isfinite(line.loop):
            return None
        space = self.trajectory.space
        parameters = np.linspace(0.0, 1.0, max(PIECES.fewest_followed, 2 * space.tables.cells) + 1)
        stations = line.followed(self.frame.to_world(self.trajectory.path.places(parameters)))
        return None if stations is None else (parameters * space.length, stations)

    def enclosed(self, pieces: Pieces) -> Enclosure:
        self.go_on()
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
        if not trajectory.space.drive.constant:
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
        return Enclosure(
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
            self.tube,
        )

    def _jerk_bound(self, span: Index) -> Array:
        """Largest |da/dt| in spans of the acceleration."""
        basis = self.trajectory.space.acceleration.derivative
        coefficients = basis.combine(self.trajectory.beta) / self.trajectory.travel_time
        return np.abs(coefficients[span]).sum(axis=1)
