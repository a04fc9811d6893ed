"""Everyday scenes: the vehicle, its goal, the ground, and the obstacles with their true motions."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

import scp_planner as sp
from benchmarks.everyday.motions import Array, Motion, Robot, Stateful

ROBOT: Mapping[str, Any] = {
    "radius": 0.3,
    "max_speed": 1.5,
    "max_acceleration": 1.0,
    "max_deceleration": 1.5,
    "max_curvature": 2.0,
    "max_lateral_acceleration": 1.5,
}
TRUCK: Mapping[str, Any] = {  # a truck without a driver in a warehouse
    "radius": 0.4,
    "max_speed": 1.5,
    "max_acceleration": 0.8,
    "max_deceleration": 1.2,
    "max_curvature": 1.5,
    "max_lateral_acceleration": 1.2,
}
CAR: Mapping[str, Any] = {
    "radius": 1.0,
    "discs": [0.0, 1.4, 2.8],
    "max_speed": 15.0,
    "max_acceleration": 2.5,
    "max_deceleration": 6.0,
    "max_curvature": 0.15,
    "max_lateral_acceleration": 3.0,
}
BOAT: Mapping[str, Any] = {
    "radius": 3.0,
    "max_speed": 5.0,
    "max_acceleration": 0.3,
    "max_deceleration": 0.3,
    "max_curvature": 0.05,
    "max_lateral_acceleration": 0.5,
}
DRONE: Mapping[str, Any] = {
    "radius": 0.35,
    "max_speed": 6.0,
    "max_acceleration": 3.0,
    "max_deceleration": 3.0,
    "max_lateral_acceleration": 4.0,
}
Walls = Sequence[Sequence[Sequence[float]]]


@dataclass
class Agent:
    """An obstacle with its true motion and how it is seen."""

    id: str
    shape: Mapping[str, Any]
    model: str | None
    motion: Motion
    heading: float = 0.0  # rad, before its first move
    seen: Callable[[float, Robot, Array], bool] = lambda time, robot, place: True

    @property
    def has_known_future(self) -> bool:
        """True if the motion can be evaluated at times to come."""
        return not isinstance(self.motion, Stateful)


@dataclass
class Scene:
    """A scene. Lengths in m, times in s."""

    vehicle: Mapping[str, Any]
    start: tuple[float, float, float, float]  # x, y, heading, speed
    goals: Sequence[Mapping[str, Any]]  # one, or several that are visited in turn up to the time limit
    agents: Sequence[Agent]
    time_limit: float
    walls: Walls = ()
    bounds: tuple[Sequence[float], Sequence[float]] | None = None
    corridor: Walls | None = None
    guide: Sequence[Sequence[float]] | None = None
    period: float = 0.1  # of the replans
    rate: float = 10.0  # Hz, of the measurements
    noise: float = 0.04  # m, standard deviation of a measurement in each direction
    walls_at: Callable[[float, Robot], Walls] | None = None  # doors
    name: str = field(default="everyday", init=False)

    @property
    def is_patrol(self) -> bool:
        return len(self.goals) > 1

    def scenario(
        self,
        obstacles: Sequence[Mapping[str, Any]] = (),
        start: tuple[float, float, float, float] | None = None,
        time: float = 0.0,
        walls: Walls | None = None,
    ) -> sp.Scenario:
        """Return the scenario from a start at a time, with the obstacles given."""
        x, y, heading, speed = start or self.start
        parts: dict[str, Any] = {
            "name": self.name,
            "vehicle": dict(self.vehicle),
            "start": {"time": time, "position": [x, y], "heading": heading, "speed": speed},
            "goal": dict(self.goals[0]),
            "obstacles": list(obstacles),
        }
        standing = self.walls if walls is None else walls
        if standing:
            parts["walls"] = standing
        if self.bounds is not None:
            parts["bounds"] = {"min": list(self.bounds[0]), "max": list(self.bounds[1])}
        if self.corridor is not None:
            parts["corridor"] = self.corridor
        if self.guide is not None:
            parts["guide"] = self.guide
        return sp.Scenario(**parts)

    def is_at(self, goal: Mapping[str, Any], robot: Robot) -> bool:
        """Rule of arrival, that of ``Planner``: a period's way from the goal, as slow as a period's braking."""
        vehicle = self.vehicle
        near = goal.get("radius") or self.period * vehicle["max_speed"]
        if math.dist(robot.position, goal["position"]) > near:
            return False
        speed = goal.get("speed")
        return speed is None or abs(robot.speed - speed) <= vehicle["max_deceleration"] * self.period + 1e-3


def box(x0: float, y0: float, x1: float, y1: float) -> list[list[float]]:
    """Corners of a rectangle along the axes, m."""
    return [[x0, y0], [x1, y0], [x1, y1], [x0, y1]]


def stop_at(x: float, y: float) -> dict[str, Any]:
    """Goal at which the vehicle stands."""
    return {"position": [x, y], "speed": 0.0}


def pass_by(x: float, y: float, radius: float = 0.0) -> dict[str, Any]:
    """Goal that is reached at any speed."""
    return {"position": [x, y], "speed": None, **({"radius": radius} if radius else {})}


def person(id: str, motion: Motion, **facts: Any) -> Agent:
    return Agent(id, {"disc": 0.3}, "pedestrian", motion, **facts)


def cart(id: str, motion: Motion, length: float = 1.2, width: float = 0.8, **facts: Any) -> Agent:
    return Agent(id, {"rectangle": [length, width]}, "car", motion, **facts)


def car(id: str, motion: Motion, **facts: Any) -> Agent:
    return Agent(id, {"rectangle": [4.5, 1.8]}, "car", motion, **facts)


def within(radius: float) -> Callable[[Robot, Array], bool]:
    """Condition that the robot is nearer than a radius, m."""
    return lambda robot, place: bool(np.hypot(*(robot.position - place)) < radius)
