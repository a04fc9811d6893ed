"""Braking: with an acceleration that jumps, or along ramps where the jerk is limited."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from scp_planner.arrays import Array, Index
from scp_planner.mathematics.frames import PlanningFrame
from scp_planner.online.ramps import Ramps
from scp_planner.online.remaining import State
from scp_planner.online.stops import STOPS, Stopping, fits, room_of_stops, room_to_stop, stop_after, stop_now
from scp_planner.online.tolerances import JERK_SHARE, RELATIVE
from scp_planner.scenario.models import Vehicle
from scp_planner.settings.planning import Settings
from scp_planner.threat_zones.batch import ZoneBatch
from scp_planner.trips.guide import StraightGuide
from scp_planner.trips.path import Path
from scp_planner.trips.space import TripSpace
from scp_planner.trips.trajectory import Trajectory, TripPoints
from scp_planner.trips.trip import Trip


def time_from_a_stand(vehicle: Vehicle, way: float) -> float:
    """The time in which a vehicle that stands drives a way, m, as fast as it can, s."""
    speed, acceleration = vehicle.max_speed, vehicle.max_acceleration
    if 2.0 * acceleration * way <= speed**2:
        return math.sqrt(2.0 * way / acceleration)
    return way / speed + 0.5 * speed / acceleration


def leaving(trip: Trip, braking: Braking, spans: int) -> tuple[Trip, float] | None:
    """Give the stop that leaves a trip after so many spans of its acceleration, and the absolute time of that, s."""
    stop = braking.stop_after(trip.trajectory, spans)
    if stop is None or not fits(stop):
        return None
    share = float(trip.trajectory.space.acceleration.breakpoints[spans])
    return Trip(trip.frame, stop), trip.frame.time + share * trip.trajectory.travel_time


def spans_between(breaks: Array, first: float, last: float, most: int) -> Index:
    """After how many spans of its acceleration a trip may be left between two times, s: some of them, evenly spread."""
    begin, end = int(np.searchsorted(breaks, first)), int(np.searchsorted(breaks, last, "right")) - 1
    end = min(max(end, begin), len(breaks) - 1)
    return np.unique(np.linspace(begin, end, max(min(most, end - begin + 1), 0)).astype(np.intp))


@dataclass(frozen=True)
class EvenBraking:
    """At once, and evenly."""

    deceleration: float  # m/s^2

    def time(self, speed: float) -> float:
        """Time that a stop takes, s."""
        return speed / self.deceleration

    def spare_way(self, state: State) -> float:
        """Length of a path that a stop fits into, and half of it again, m."""
        return STOPS.spare * state.speed**2 / (2.0 * self.deceleration)

    def stop_after(self, trajectory: Trajectory, spans: int) -> Trajectory | None:
        """Return the stop that leaves a trip after some of its spans."""
        return stop_after(trajectory, spans, self.deceleration)

    def room(self, trajectory: Trajectory, leads: Array, zones: ZoneBatch, since: float, wait: float) -> Array:
        """Least clearance, sampled."""
        return room_to_stop(trajectory, leads, self.deceleration, zones, since, wait)

    def stop_now(self, path: Path, state: State) -> Trajectory:
        """Return the stop along a path from its start."""
        return stop_now(path, state.speed, self.deceleration)


@dataclass(frozen=True)
class RampedBraking:
    """Along ramps of the acceleration."""

    deceleration: float  # m/s^2
    jerk: float  # m/s^3

    def time(self, speed: float) -> float:
        """Time that a stop takes, s."""
        return float(self._ramps(np.array([speed]), np.zeros(1)).duration[0])

    def spare_way(self, state: State) -> float:
        """Length of a path that a stop fits into, and half of it again, m."""
        return STOPS.spare * float(self._from(state).way[0])

    def stop_after(self, trajectory: Trajectory, spans: int) -> Trajectory:
        """Return the stop that leaves a trip after some of its spans, with breakpoints of its own from there on."""
        breaks = trajectory.space.acceleration.breakpoints[: spans + 1]
        drive = trajectory.drive_at(breaks)
        ramps = self._ramps(np.maximum(drive.speed[-1:], 0.0), drive.acceleration[-1:])
        times = breaks * trajectory.travel_time
        return _along(
            trajectory.path,
            np.concatenate([times, times[-1] + ramps.knots[0, 1:]]),
            np.concatenate([drive.acceleration, ramps.acceleration[0, 1:]]),
        )

    def room(self, trajectory: Trajectory, leads: Array, zones: ZoneBatch, since: float, wait: float) -> Array:
        """Least clearance, sampled."""
        return room_of_stops(trajectory, leads, self._stopping, zones, since, wait)

    def stop_now(self, path: Path, state: State) -> Trajectory:
        """Return the stop along a path from its start."""
        ramps = self._from(state)
        return _along(path, ramps.knots[0], ramps.acceleration[0])

    def _stopping(self, points: TripPoints) -> Stopping:
        ramps = self._ramps(np.maximum(points.speed, 0.0), points.acceleration)
        after = ramps.duration[:, None] * np.linspace(0.0, 1.0, STOPS.samples)
        return Stopping(ramps.duration, after, ramps.distance(after))

    def _from(self, state: State) -> Ramps:
        return self._ramps(np.array([state.speed]), np.array([state.acceleration or 0.0]))

    def _ramps(self, speed: Array, acceleration: Array) -> Ramps:
        return Ramps.stopping(speed, acceleration, self.deceleration, self.jerk)


Braking = EvenBraking | RampedBraking
"""As hard as the vehicle may."""


def braking_of(vehicle: Vehicle, margin: float = 0.0) -> Braking:
    """Return how a vehicle brakes, with a relative margin of its deceleration."""
    deceleration = vehicle.max_deceleration * (1.0 - margin)
    if vehicle.max_jerk is None:
        return EvenBraking(deceleration)
    return RampedBraking(deceleration, JERK_SHARE * vehicle.max_jerk)


def _along(path: Path, times: Array, accelerations: Array) -> Trajectory:
    """A drive along a path with given accelerations, m/s^2, at times that do not decrease, s; straight in between."""
    duration = float(times[-1])
    if duration <= 0.0:
        times, accelerations, duration = np.array([0.0, STOPS.hold]), np.zeros(2), STOPS.hold
    breaks, beta = distinct_knots(times / duration, accelerations)
    space = path.space
    degree = space.path.coefficients.shape[1] - 1
    own = TripSpace(space.guide, space.start_speed, degree, len(space.path.widths), 1, tuple(breaks.tolist()))
    return Trajectory(Path(own, path.theta), beta, duration)


def distinct_knots(breaks: Array, values: Array) -> tuple[Array, Array]:
    """Leave out those of breakpoints from 0 to 1, with values there, that are too near to the one before, or to 1."""
    keep = np.append(True, np.diff(breaks) > RELATIVE)
    keep &= breaks < 1.0 - RELATIVE
    keep[-1] = True
    return breaks[keep], values[keep]


def straight_stop(state: State, braking: Braking, settings: Settings, breakpoints: tuple[float, ...]) -> Trip:
    """Return the stop straight ahead: what is left where no path can be planned."""
    heading = state.heading or 0.0
    length = max(braking.spare_way(state), 1.0)
    space = TripSpace(StraightGuide(length), state.speed, settings.path_degree, STOPS.straight_spans, 0, breakpoints)
    path = Path(space, np.zeros(space.path_size))
    return Trip(PlanningFrame(state.position, heading, state.time), braking.stop_now(path, state))
