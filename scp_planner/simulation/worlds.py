"""True motions of simulated obstacles: functions of time, records, or a crowd that reacts."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike

from scp_planner.arrays import Array
from scp_planner.mathematics.polylines import points_at
from scp_planner.scenario.models import Obstacle
from scp_planner.scenario.motions import Futures, KnownMotion, Motion
from scp_planner.threat_zones.of_scenario import motion_polynomials
from scp_planner.tracking.estimate import estimate_obstacle
from scp_planner.tracking.motion_estimate import PolynomialEstimate
from scp_planner.tracking.tracks import Track, Tracks

Course = Callable[[Array], Array]
"""Centres (n, 2) m at times (n,) s; NaN where the obstacle is not there."""


@dataclass(frozen=True)
class VehicleState:
    """The vehicle, as those around it see it."""

    time: float  # s
    position: Array  # (2,) m
    velocity: Array  # (2,) m/s
    radius: float  # m


@runtime_checkable
class World(Protocol):
    """Obstacles that move, and may react to the vehicle."""

    def step(self, dt: float, vehicle: VehicleState) -> Mapping[str, ArrayLike]:
        """Move on by dt, s, with the vehicle as it is at the beginning; return centres (2,) m of all present by id."""
        ...


class Script:
    """Obstacles that do what is written."""

    def __init__(self, courses: Mapping[str, Course]) -> None:
        self.courses = dict(courses)

    def at(self, times: Array) -> dict[str, Array]:
        """Centres at times (n,) s: (n, 2) m each, NaN where an obstacle is not there."""
        return {name: np.asarray(course(times), dtype=float) for name, course in self.courses.items()}


def motion_course(motion: KnownMotion) -> Course:
    """The course of a known motion."""
    if not isinstance(motion, Motion):
        centers = motion_polynomials(motion)
        return lambda times: centers.at(np.zeros(len(times), dtype=np.intp), np.asarray(times, dtype=float))
    place, velocity, acceleration = (np.array(part) for part in (motion.position, motion.velocity, motion.acceleration))
    since = motion.reference_time

    def course(times: Array) -> Array:
        t = np.asarray(times)[:, None] - since
        return place + velocity * t + 0.5 * acceleration * t * t

    return course


def track_course(track: Track) -> Course:
    """The course of a recorded track: straight between its positions, not there before and after."""
    first, last = float(track.times[0]), float(track.times[-1])

    def course(times: Array) -> Array:
        if len(times) == 1 and not first <= times[0] <= last:
            return np.full((1, 2), np.nan)  # most of a long recording
        return points_at(times, track.times, track.positions, np.nan)

    return course


def drawn_course(obstacle: Obstacle, rng: np.random.Generator) -> Course:
    """A course that an obstacle may take."""
    if obstacle.motion is not None and not isinstance(obstacle.motion, Futures):
        return motion_course(obstacle.motion)
    if isinstance(obstacle.motion, Futures):
        weights = np.array([future.weight for future in obstacle.motion.futures])
        drawn_one = rng.choice(len(weights), p=weights / weights.sum())
        return motion_course(obstacle.motion.futures[int(drawn_one)].motion)
    estimate = estimate_obstacle(obstacle)
    if not isinstance(estimate, PolynomialEstimate):
        return lambda times: estimate.position(np.maximum(times, estimate.reference_time))
    size = 2 * (estimate.order + 1)
    covariance = estimate.coefficient_covariance.reshape(size, size)
    values, vectors = np.linalg.eigh(covariance)
    drawn = vectors @ (np.sqrt(np.maximum(values, 0.0)) * rng.standard_normal(size))
    coefficients = estimate.coefficients + drawn.reshape(-1, 2)

    def course(times: Array) -> Array:
        s = (np.asarray(times) - estimate.center_time) / estimate.time_scale
        return s[:, None] ** np.arange(estimate.order + 1) @ coefficients

    return course


def as_course(given: Any) -> Course:
    """A course from a function of times, a track, or the two arrays (times, centres)."""
    if isinstance(given, Track):
        return track_course(given)
    if callable(given):
        return given
    times, centers = (np.asarray(part, dtype=float) for part in given)
    return track_course(Track("given", times, centers))


def track_courses(tracks: Tracks) -> dict[str, Course]:
    """The courses of recorded tracks, by id."""
    return {track.id: track_course(track) for track in tracks}


class SocialForces:
    """People who walk to their goals and give way to each other and to the vehicle."""

    # E 51 (1995), circular form.

    relaxation = 0.5  # s
    strength, reach = 2.1, 0.3  # m/s2 at touch; m
    most = 3.0  # m/s2

    def __init__(
        self, positions: ArrayLike, goals: ArrayLike, speeds: ArrayLike, radius: float = 0.3, shyness: float = 1.0
    ) -> None:
        self.positions = np.array(positions, dtype=float)
        self.goals = np.array(goals, dtype=float)
        self.speeds = np.broadcast_to(np.asarray(speeds, dtype=float), (len(self.positions),)).copy()
        self.radius, self.shyness = radius, shyness
        towards = self.goals - self.positions
        distance = np.maximum(np.hypot(*towards.T), 1e-9)[:, None]
        self.velocities = self.speeds[:, None] * towards / distance

    def step(self, dt: float, vehicle: VehicleState) -> Mapping[str, ArrayLike]:
        """Move on."""
        towards = self.goals - self.positions
        distance = np.hypot(*towards.T)[:, None]
        wanted = self.speeds[:, None] * towards / np.maximum(distance, 0.5)
        force = (wanted - self.velocities) / self.relaxation
        between = self.positions[:, None] - self.positions[None]
        apart = np.hypot(between[..., 0], between[..., 1])
        np.fill_diagonal(apart, np.inf)
        push = self.strength * np.exp((2.0 * self.radius - apart) / self.reach)
        force += ((push / apart)[..., None] * between).sum(axis=1)
        away = self.positions - vehicle.position
        far = np.maximum(np.hypot(*away.T), 1e-9)
        push = self.shyness * self.strength * np.exp((self.radius + vehicle.radius - far) / self.reach)
        force += (push / far)[:, None] * away
        size = np.hypot(*force.T)[:, None]
        force *= np.minimum(1.0, self.most / np.maximum(size, 1e-9))
        self.velocities = self.velocities + dt * force
        pace = np.hypot(*self.velocities.T)[:, None]
        self.velocities *= np.minimum(1.0, 1.3 * self.speeds[:, None] / np.maximum(pace, 1e-9))
        self.positions = self.positions + dt * self.velocities
        return {f"p{k}": position for k, position in enumerate(self.positions)}
