"""Motions of the obstacles in everyday scenes: functions of the time, s, and of the robot."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

Array = np.ndarray
STEP = 0.02  # s, of motions that are integrated


@dataclass
class Robot:
    """State of the vehicle under test."""

    position: Array  # (2,) m
    heading: float  # rad
    speed: float  # m/s, negative in reverse


Motion = Callable[[float, Robot | None], Array]
"""Position (2,) in m at a time in s. Called with times that do not decrease; without a robot where none is near."""


class Stateful:
    """Base of motions that react or are integrated: their future is not known beforehand."""


def constant_velocity(place: Sequence[float], velocity: Sequence[float], begins: float = 0.0) -> Motion:
    """Stand at a place up to ``begins``, then keep a velocity."""
    p, v = np.array(place, dtype=float), np.array(velocity, dtype=float)
    return lambda time, robot: p + v * max(time - begins, 0.0)


def standing(place: Sequence[float], sway: float = 0.0, phase: float = 0.0) -> Motion:
    """Stand at a place and sway by so much, m."""
    p = np.array(place, dtype=float)
    return lambda time, robot: p + sway * np.array([math.sin(0.9 * time + phase), math.cos(0.7 * time + 2.0 * phase)])


def polyline(points: Sequence[Sequence[float]]) -> Motion:
    """Follow ``(time, x, y)`` points at constant speeds; stand before the first and after the last."""
    table = np.array(points, dtype=float)
    return lambda time, robot: np.array([np.interp(time, table[:, 0], table[:, k]) for k in (1, 2)])


def braking(place: Sequence[float], velocity: Sequence[float], begins: float, deceleration: float) -> Motion:
    """Keep a velocity up to ``begins``, then brake to a stand."""
    p, v = np.array(place, dtype=float), np.array(velocity, dtype=float)
    speed = float(np.hypot(*v))

    def at(time: float, robot: Robot | None) -> Array:
        late = min(max(time - begins, 0.0), speed / deceleration)
        return p + v * min(time, begins) + v / speed * (speed * late - 0.5 * deceleration * late**2)

    return at


def circle(centre: Sequence[float], radius: float, speed: float, angle: float = 0.0) -> Motion:
    """Drive round a circle, counter-clockwise where the speed is positive."""
    c = np.array(centre, dtype=float)
    turning = speed / radius
    return lambda time, robot: (
        c + radius * np.array([math.cos(angle + turning * time), math.sin(angle + turning * time)])
    )


@dataclass
class SetsOut(Stateful):
    """Stand until the robot meets a condition, then accelerate to a velocity for a while."""

    place: Sequence[float]
    velocity: Sequence[float]
    when: Callable[[Robot, Array], bool]
    lasts: float = math.inf  # s
    acceleration: float = 1.5  # m/s2
    _began: float | None = None

    def __call__(self, time: float, robot: Robot | None) -> Array:
        place, velocity = np.array(self.place, dtype=float), np.array(self.velocity, dtype=float)
        if self._began is None and robot is not None and self.when(robot, place):
            self._began = time
        if self._began is None:
            return place
        speed, passed = float(np.hypot(*velocity)), min(time - self._began, self.lasts)
        ramp = speed / self.acceleration
        driven = 0.5 * self.acceleration * min(passed, ramp) ** 2 + speed * max(passed - ramp, 0.0)
        return place + velocity / speed * driven


@dataclass
class RandomPlaces(Stateful):
    """Walk from one random place of a box to the next, stand there now and then."""

    rng: np.random.Generator
    low: Sequence[float]
    high: Sequence[float]
    speed: float
    stands: float = 0.25  # share of the places at which it stands
    _place: Array = field(init=False)
    _goal: Array = field(init=False)
    _velocity: Array = field(init=False)
    _time: float = 0.0
    _rest: float = 0.0

    def __post_init__(self) -> None:
        self._place, self._goal, self._velocity = self._draw(), self._draw(), np.zeros(2)

    def _draw(self) -> Array:
        return self.rng.uniform(self.low, self.high)

    def __call__(self, time: float, robot: Robot | None) -> Array:
        while self._time < time - 1e-9:
            step = min(STEP, time - self._time)
            self._time += step
            self._velocity = self._velocity + (self._wanted(step) - self._velocity) * min(step / 0.4, 1.0)
            self._place = self._place + step * self._velocity
        return self._place.copy()

    def _wanted(self, step: float) -> Array:
        if self._rest > 0.0:
            self._rest -= step
            return np.zeros(2)
        ahead = self._goal - self._place
        far = float(np.hypot(*ahead))
        if far < 0.3:
            self._goal = self._draw()
            self._rest = self.rng.uniform(1.0, 4.0) if self.rng.random() < self.stands else 0.0
        return self.speed * ahead / max(far, 1e-9)


@dataclass
class Polite(Stateful):
    """Walk to a goal, and slow down while the robot is near and ahead."""

    place: Sequence[float]
    goal: Sequence[float]
    speed: float
    keeps: float = 1.2  # m, between the centres
    _at: Array = field(init=False)
    _time: float = 0.0

    def __post_init__(self) -> None:
        self._at = np.array(self.place, dtype=float)

    def __call__(self, time: float, robot: Robot | None) -> Array:
        while self._time < time - 1e-9:
            step = min(STEP, time - self._time)
            self._time += step
            ahead = np.array(self.goal, dtype=float) - self._at
            far = float(np.hypot(*ahead))
            speed = min(self.speed, far / step)
            if robot is not None and far > 0.0:
                to_robot = robot.position - self._at
                near = float(np.hypot(*to_robot))
                if near < self.keeps and to_robot @ ahead > 0.0:
                    speed *= max(2.0 * near / self.keeps - 1.0, 0.0)
            if far > 0.0:
                self._at = self._at + step * speed * ahead / far
        return self._at.copy()
