"""Stops: what a vehicle falls back to.

A stop follows a path, keeps the accelerations of a trip for a while (none, or at least until the next replan), then
decelerates evenly until it stands. It leaves a trip where the acceleration of that changes anyway, so that up to there
it is the trip, and it lives in the space of the trip, so it is certified like one.

What a certificate of a stop says: up to the time at which the vehicle stands, no zone touches it. A vehicle that
stands can still be hit by what moves.
"""

from __future__ import annotations

import numpy as np

from scp_planner.arrays import Array
from scp_planner.mathematics.frames import PlanningFrame
from scp_planner.online.remaining import State
from scp_planner.scenario.limits import Limits
from scp_planner.settings.planning import Settings
from scp_planner.threat_zones.batch import ZoneBatch
from scp_planner.trips.guide import StraightGuide
from scp_planner.trips.path import Path
from scp_planner.trips.space import TripSpace
from scp_planner.trips.trajectory import Trajectory
from scp_planner.trips.trip import Trip

STANDING = 1e-3
"""Units of speed. A vehicle slower than this stands."""
SAMPLES = 25
NEAR = 0.5
"""Units of length. Clearances beyond this need not be exact."""
HOLD = 1.0
"""Units of time that a plan to stand lasts; it goes on standing after that."""


def stop_after(trajectory: Trajectory, spans: int, deceleration: float) -> Trajectory | None:
    """Return the stop that is the trip itself for some of its spans of acceleration, then decelerates, then stands.

    Parameters
    ----------
    trajectory : Trajectory
        The acceleration of its space is piecewise constant.
    spans : int
        For which the trip is kept.
    deceleration : float
        At most, m/s2.

    Returns
    -------
    Trajectory or None
        With the same spans; None if there are too few of them to stop in.
    """
    breaks = trajectory.space.acceleration.breakpoints * trajectory.travel_time
    speeds = np.maximum(trajectory.speed_control_points(), 0.0)
    speeds[spans:] = np.maximum(speeds[spans] - deceleration * (breaks[spans:] - breaks[spans]), 0.0)
    if speeds[-1] > 0.0:
        return None
    beta = trajectory.beta.copy()
    beta[spans:] = np.diff(speeds[spans:]) / np.diff(breaks[spans:])
    return Trajectory(trajectory.path, beta, trajectory.travel_time)


def room_to_stop(
    trajectory: Trajectory, leads: Array, deceleration: float, zones: ZoneBatch, since: float = 0.0
) -> Array:
    """Least clearance, sampled, of the stops that leave a trip after different times.

    Parameters
    ----------
    trajectory : Trajectory
    leads : (m,) array
        s, increasing.
    deceleration : float
        m/s2.
    zones : ZoneBatch
    since : float
        Time from which on clearances matter, s.

    Returns
    -------
    (m,) array
        m; -inf for a stop that needs more than what is left of the path, inf without zones.
    """
    tau, path = trajectory.travel_time, trajectory.path
    before = np.linspace(since, float(leads[-1]), SAMPLES)
    kept = trajectory.at(trajectory.space.time_table(np.concatenate([before, leads]) / tau))
    speed, distance = np.maximum(kept.speed[SAMPLES:], 0.0), kept.distance[SAMPLES:]
    braking = speed / deceleration
    after = braking[:, None] * np.linspace(0.0, 1.0, SAMPLES)
    driven = distance[:, None] + after * (speed[:, None] - 0.5 * deceleration * after)
    fit = driven[:, -1] <= path.arc_length
    if zones.size == 0:
        return np.where(fit, np.inf, -np.inf)
    points = path.points(path.parameter_at(driven.ravel()))
    stopping = zones.distances((leads[:, None] + after).ravel(), points.position, NEAR).min(axis=1)
    least = stopping.reshape(len(leads), SAMPLES).min(axis=1)
    keeping = zones.distances(before, kept.path.position[:SAMPLES], NEAR).min(axis=1)
    sofar = np.minimum.accumulate(keeping)[np.minimum(np.searchsorted(before, leads, "right"), SAMPLES - 1)]
    return np.where(fit, np.minimum(least, sofar), -np.inf)


def standing_from(stop: Trajectory) -> float:
    """Time after its start from which on the vehicle stands, s."""
    speeds = stop.speed_control_points()
    moving = np.flatnonzero(speeds > STANDING)
    if not len(moving):
        return 0.0
    last = min(int(moving[-1]) + 1, len(speeds) - 1)
    return float(stop.space.acceleration.breakpoints[last] * stop.travel_time)


def stop_now(path: Path, speed: float, deceleration: float) -> Trajectory:
    """Return the stop along a path that decelerates evenly from its start, or stands there."""
    size = path.space.acceleration_size
    if speed <= STANDING:
        return Trajectory(path, np.zeros(size), HOLD)
    return Trajectory(path, np.full(size, -deceleration), speed / deceleration)


def straight_stop(state: State, limits: Limits, settings: Settings, breakpoints: tuple[float, ...]) -> Trip:
    """Return the stop straight ahead: what is left where no path can be planned."""
    heading = state.heading or 0.0
    length = max(1.5 * state.speed**2 / (2.0 * limits.deceleration), 1.0)
    space = TripSpace(StraightGuide(length), state.speed, settings.path_degree, 4, 0, breakpoints)
    path = Path(space, np.zeros(space.path_size))
    return Trip(PlanningFrame(state.position, heading, state.time), stop_now(path, state.speed, limits.deceleration))


def fits(stop: Trajectory) -> bool:
    """Whether a stop ends before its path does."""
    tau, space = stop.travel_time, stop.space
    distance = space.start_speed * tau + tau * tau * float(space.tables.final_distance @ stop.beta)
    return distance <= stop.path.driven_length
