"""Stops, what a vehicle falls back to: with an acceleration that jumps, or along ramps where the jerk is limited."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np

from scp_planner.arrays import Array, Index
from scp_planner.mathematics.frames import PlanningFrame
from scp_planner.online.ramps import Ramps
from scp_planner.online.remaining import State
from scp_planner.online.tolerances import JERK_SHARE, RELATIVE, SPEED
from scp_planner.prediction.foresight import foreseen
from scp_planner.scenario.models import Vehicle
from scp_planner.settings.planning import Settings
from scp_planner.threat_zones.batch import ZoneBatch
from scp_planner.trips.guide import StraightGuide
from scp_planner.trips.path import Path
from scp_planner.trips.space import TripSpace
from scp_planner.trips.trajectory import Trajectory, TripPoints
from scp_planner.trips.trip import Trip


@dataclass(frozen=True)
class StopParameters:
    standing: float = 1e-3  # Units of speed. A vehicle slower than this stands
    samples: int = 25  # Samples of a stop
    wait_samples: int = 12  # Samples of standing
    exact_within: float = 0.5  # Units of length. Clearances beyond this need not be exact
    hold: float = 1.0  # Units of time that a plan to stand lasts; it goes on standing after that
    spare: float = 1.5  # Lengths of a stop, that the path of one straight ahead has
    straight_spans: int = 4  # Spans of a path straight ahead


STOPS = StopParameters()


@dataclass(frozen=True)
class Stopping:
    lasts: Array  # (m,) s
    after: Array  # (m, samples) Times from when they leave it until they stand, s
    driven: Array  # (m, samples) m


@dataclass(frozen=True)
class Braking(ABC):
    """As hard as the vehicle may."""

    deceleration: float  # m/s^2

    @abstractmethod
    def time(self, speed: float) -> float:
        """Time that a stop takes, s."""

    @abstractmethod
    def spare_way(self, state: State) -> float:
        """Length of a path that a stop fits into, and half of it again, m."""

    @abstractmethod
    def stop_after(self, trajectory: Trajectory, spans: int) -> Trajectory | None:
        """Return the stop that is the trip itself for some of its spans, then decelerates, then stands."""

    @abstractmethod
    def stop_now(self, path: Path, state: State) -> Trajectory:
        """Return the stop along a path from its start, or standing there."""

    @abstractmethod
    def stopping(self, points: TripPoints) -> Stopping:
        """Return stops from points of a trip."""

    def room(
        self, trajectory: Trajectory, leads: Array, zones: ZoneBatch, since: float = 0.0, wait: float = 0.0
    ) -> Array:
        """Least clearance, sampled, of the stops that leave a trip after different times."""
        tau, path = trajectory.travel_time, trajectory.path
        before = np.linspace(since, float(leads[-1]), STOPS.samples)
        kept = trajectory.at(trajectory.space.time_table(np.concatenate([before, leads]) / tau))
        stops = self.stopping(kept.take(slice(STOPS.samples, None)))
        driven = kept.distance[STOPS.samples :, None] + stops.driven
        fit = driven[:, -1] <= path.arc_length
        if zones.size == 0:
            return np.where(fit, np.inf, -np.inf)
        position = path.points(path.parameter_at(driven.ravel())).position
        times = [before, (leads[:, None] + stops.after).ravel()]
        places = [kept.path.position[: STOPS.samples], position]
        if wait > 0.0:
            # They do not grow beyond when the last of these stops stands: up to then nothing else is looked at.
            stands = leads + stops.lasts
            zones = foreseen(zones, float(stands.max()), {})
            times.append((stands[:, None] + wait * np.linspace(0.0, 1.0, STOPS.wait_samples)).ravel())
            places.append(position[STOPS.samples - 1 :: STOPS.samples].repeat(STOPS.wait_samples, axis=0))
        # All at once: NUMPY-CALLS
        near = zones.distances(np.concatenate(times), np.concatenate(places), STOPS.exact_within).min(axis=1)
        keeping, stopping_at, standing = np.split(near, [STOPS.samples, STOPS.samples + len(position)])
        least = stopping_at.reshape(len(leads), STOPS.samples).min(axis=1)
        if len(standing):
            least = np.minimum(least, standing.reshape(len(leads), STOPS.wait_samples).min(axis=1))
        sofar = np.minimum.accumulate(keeping)[np.minimum(np.searchsorted(before, leads, "right"), STOPS.samples - 1)]
        return np.where(fit, np.minimum(least, sofar), -np.inf)


@dataclass(frozen=True)
class EvenBraking(Braking):
    def time(self, speed: float) -> float:
        return speed / self.deceleration

    def spare_way(self, state: State) -> float:
        return STOPS.spare * state.speed**2 / (2.0 * self.deceleration)

    def stop_after(self, trajectory: Trajectory, spans: int) -> Trajectory | None:
        breaks = trajectory.space.acceleration.breakpoints * trajectory.travel_time
        speeds = np.maximum(trajectory.speed_control_points(), 0.0)
        speeds[spans:] = np.maximum(speeds[spans] - self.deceleration * (breaks[spans:] - breaks[spans]), 0.0)
        if speeds[-1] > 0.0:
            return None
        beta = trajectory.beta.copy()
        beta[spans:] = np.diff(speeds[spans:]) / np.diff(breaks[spans:])
        return Trajectory(trajectory.path, beta, trajectory.travel_time)

    def stop_now(self, path: Path, state: State) -> Trajectory:
        size = path.space.acceleration_size
        if state.speed <= SPEED:
            return Trajectory(path, np.zeros(size), STOPS.hold)
        return Trajectory(path, np.full(size, -self.deceleration), state.speed / self.deceleration)

    def stopping(self, points: TripPoints) -> Stopping:
        speed = np.maximum(points.speed, 0.0)
        braking = speed / self.deceleration
        after = braking[:, None] * np.linspace(0.0, 1.0, STOPS.samples)
        return Stopping(braking, after, after * (speed[:, None] - 0.5 * self.deceleration * after))


@dataclass(frozen=True)
class RampedBraking(Braking):
    """Along ramps of the acceleration."""

    jerk: float  # m/s^3

    def time(self, speed: float) -> float:
        return float(self._ramps(np.array([speed]), np.zeros(1)).duration[0])

    def spare_way(self, state: State) -> float:
        return STOPS.spare * float(self._from(state).way[0])

    def stop_after(self, trajectory: Trajectory, spans: int) -> Trajectory:
        breaks = trajectory.space.acceleration.breakpoints[: spans + 1]
        drive = trajectory.drive_at(breaks)
        ramps = self._ramps(np.maximum(drive.speed[-1:], 0.0), drive.acceleration[-1:])
        times = breaks * trajectory.travel_time
        return _along(
            trajectory.path,
            np.concatenate([times, times[-1] + ramps.knots[0, 1:]]),
            np.concatenate([drive.acceleration, ramps.acceleration[0, 1:]]),
        )

    def stop_now(self, path: Path, state: State) -> Trajectory:
        ramps = self._from(state)
        return _along(path, ramps.knots[0], ramps.acceleration[0])

    def stopping(self, points: TripPoints) -> Stopping:
        ramps = self._ramps(np.maximum(points.speed, 0.0), points.acceleration)
        after = ramps.duration[:, None] * np.linspace(0.0, 1.0, STOPS.samples)
        return Stopping(ramps.duration, after, ramps.distance(after))

    def _from(self, state: State) -> Ramps:
        return self._ramps(np.array([state.speed]), np.array([state.acceleration or 0.0]))

    def _ramps(self, speed: Array, acceleration: Array) -> Ramps:
        return Ramps.stopping(speed, acceleration, self.deceleration, self.jerk)


def braking_of(vehicle: Vehicle, margin: float = 0.0) -> Braking:
    """Return how a vehicle brakes, with a relative margin of its deceleration."""
    deceleration = min(vehicle.max_deceleration, vehicle.max_total_acceleration or math.inf) * (1.0 - margin)
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


def standing_from(stop: Trajectory) -> float:
    """Time after its start from which on the vehicle stands, s."""
    breaks = stop.space.acceleration.breakpoints
    speeds = stop.speed_control_points() if stop.space.drive.constant else stop.speed_at(breaks)
    moving = np.flatnonzero(speeds > STOPS.standing)
    if not len(moving):
        return 0.0
    last = min(int(moving[-1]) + 1, len(speeds) - 1)
    return float(breaks[last] * stop.travel_time)


def standing_trip(like: Trip, frame: PlanningFrame, wait: float) -> Trip:
    """Return the trip that stands at the origin of a frame for a while, s, with splines like another's."""
    old = like.trajectory.space
    degree, breaks = old.path.coefficients.shape[1] - 1, old.acceleration.breakpoints
    space = TripSpace(StraightGuide(1.0), 0.0, degree, 4, 0, tuple(breaks.tolist()))
    return Trip(frame, Trajectory(Path(space, np.zeros(space.path_size)), np.zeros(space.acceleration_size), wait))


def surely_clear(zones: ZoneBatch, position: Array, times: tuple[float, float, float], ahead: float = 0.0) -> bool:
    """True if zones that soon do not grow any more surely keep clear of a place: by the discs that cover them."""
    since, grows, wait = times
    knots = zones.centers.breakpoints[:, 1:-1]
    inner = knots[(knots > since) & (knots < since + wait)]  # none inside of an interval, for its speed to be bounded
    edges = np.union1d(np.linspace(since, since + wait, STOPS.wait_samples + 1), inner)
    middle, half = 0.5 * (edges[1:] + edges[:-1]), 0.5 * np.diff(edges)
    offset = zones.centers.grid(middle) - position
    rates = zones.velocities
    moved = half[:, None] * rates.of_pieces(rates.size_bounds(since, since + wait), middle)
    reach = zones.reach(np.array([since + grows]))[0] + ahead
    return bool(np.all(np.hypot(offset[..., 0], offset[..., 1]) >= reach + moved))


def fits(stop: Trajectory) -> bool:
    """True if a stop ends before its path does."""
    tau, space = stop.travel_time, stop.space
    distance = space.start_speed * tau + tau * tau * float(space.drive.final_distance @ stop.beta)
    return distance <= stop.path.driven_length
