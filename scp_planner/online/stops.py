"""Stops: what a vehicle falls back to."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np

from scp_planner.arrays import Array
from scp_planner.mathematics.frames import PlanningFrame
from scp_planner.online.foresight import foreseen
from scp_planner.online.tolerances import SPEED
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


def stop_after(trajectory: Trajectory, spans: int, deceleration: float) -> Trajectory | None:
    """Return the stop that is the trip itself for some of its spans of acceleration, then decelerates, then stands."""
    breaks = trajectory.space.acceleration.breakpoints * trajectory.travel_time
    speeds = np.maximum(trajectory.speed_control_points(), 0.0)
    speeds[spans:] = np.maximum(speeds[spans] - deceleration * (breaks[spans:] - breaks[spans]), 0.0)
    if speeds[-1] > 0.0:
        return None
    beta = trajectory.beta.copy()
    beta[spans:] = np.diff(speeds[spans:]) / np.diff(breaks[spans:])
    return Trajectory(trajectory.path, beta, trajectory.travel_time)


@dataclass(frozen=True)
class Stopping:
    lasts: Array  # (m,) s
    after: Array  # (m, samples) Times from when they leave it until they stand, s
    driven: Array  # (m, samples) m


def evenly(points: TripPoints, deceleration: float) -> Stopping:
    """Return stops that decelerate evenly, m/s2, from points of a trip."""
    speed = np.maximum(points.speed, 0.0)
    braking = speed / deceleration
    after = braking[:, None] * np.linspace(0.0, 1.0, STOPS.samples)
    return Stopping(braking, after, after * (speed[:, None] - 0.5 * deceleration * after))


def room_to_stop(
    trajectory: Trajectory, leads: Array, deceleration: float, zones: ZoneBatch, since: float = 0.0, wait: float = 0.0
) -> Array:
    """Least clearance, sampled, of the stops that leave a trip after different times and decelerate evenly."""
    return room_of_stops(trajectory, leads, partial(evenly, deceleration=deceleration), zones, since, wait)


def room_of_stops(
    trajectory: Trajectory,
    leads: Array,
    stopping: Callable[[TripPoints], Stopping],
    zones: ZoneBatch,
    since: float,
    wait: float,
) -> Array:
    """Least clearance, sampled, of the stops that leave a trip after different times; see :func:`room_to_stop`."""
    tau, path = trajectory.travel_time, trajectory.path
    before = np.linspace(since, float(leads[-1]), STOPS.samples)
    kept = trajectory.at(trajectory.space.time_table(np.concatenate([before, leads]) / tau))
    stops = stopping(kept.take(slice(STOPS.samples, None)))
    driven = kept.distance[STOPS.samples :, None] + stops.driven
    fit = driven[:, -1] <= path.arc_length
    if zones.size == 0:
        return np.where(fit, np.inf, -np.inf)
    position = path.points(path.parameter_at(driven.ravel())).position
    times, places = [before, (leads[:, None] + stops.after).ravel()], [kept.path.position[: STOPS.samples], position]
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


def standing_from(stop: Trajectory) -> float:
    """Time after its start from which on the vehicle stands, s."""
    breaks = stop.space.acceleration.breakpoints
    speeds = stop.speed_control_points() if stop.space.tables.constant else stop.speed_at(breaks)
    moving = np.flatnonzero(speeds > STOPS.standing)
    if not len(moving):
        return 0.0
    last = min(int(moving[-1]) + 1, len(speeds) - 1)
    return float(breaks[last] * stop.travel_time)


def stop_now(path: Path, speed: float, deceleration: float) -> Trajectory:
    """Return the stop along a path that decelerates evenly from its start, or stands there."""
    size = path.space.acceleration_size
    if speed <= SPEED:
        return Trajectory(path, np.zeros(size), STOPS.hold)
    return Trajectory(path, np.full(size, -deceleration), speed / deceleration)


def standing_trip(like: Trip, frame: PlanningFrame, wait: float) -> Trip:
    """Return the trip that stands at the origin of a frame for a while, s, with splines like another's."""
    old = like.trajectory.space
    degree, breaks = old.path.coefficients.shape[1] - 1, old.acceleration.breakpoints
    space = TripSpace(StraightGuide(1.0), 0.0, degree, 4, 0, tuple(breaks.tolist()))
    return Trip(frame, Trajectory(Path(space, np.zeros(space.path_size)), np.zeros(space.acceleration_size), wait))


def surely_clear(zones: ZoneBatch, position: Array, times: tuple[float, float, float], ahead: float = 0.0) -> bool:
    """True if zones that soon do not grow any more surely keep clear of a place: by the discs that cover them."""
    since, grows, wait = times
    half = 0.5 * wait / STOPS.wait_samples
    middle: Array = since + half * np.arange(1.0, 2.0 * STOPS.wait_samples, 2.0)
    reach = zones.reach(np.array([since + grows]))[0] + ahead
    offset = zones.centers.grid(middle) - position
    # No knot may lie inside of an interval, for the speed to be bounded; then it is left to the certificate.
    breaks = zones.centers.breakpoints[:, 1:-1]
    if np.any((breaks > since) & (breaks < since + wait)):
        return False
    rates = zones.velocities
    moved = half * rates.of_pieces(rates.size_bounds(since, since + wait), middle)
    return bool(np.all(np.hypot(offset[..., 0], offset[..., 1]) >= reach + moved))


def fits(stop: Trajectory) -> bool:
    """True if a stop ends before its path does."""
    tau, space = stop.travel_time, stop.space
    distance = space.start_speed * tau + tau * tau * float(space.tables.final_distance @ stop.beta)
    return distance <= stop.path.driven_length
