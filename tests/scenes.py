"""Small scenes that tests of several modules use."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from scp_planner import Scenario

VEHICLE = {
    "radius": 0.3,
    "max_speed": 3.0,
    "max_acceleration": 1.5,
    "max_deceleration": 2.0,
    "max_lateral_acceleration": 2.0,
    "max_curvature": 1.0,
}
SLOW_VEHICLE = {
    "radius": 0.3,
    "max_speed": 2.0,
    "max_acceleration": 1.0,
    "max_deceleration": 1.5,
    "max_lateral_acceleration": 1.5,
    "max_curvature": 1.5,
}


def disc(
    name: str,
    position: tuple[float, float],
    velocity: tuple[float, float] = (0.0, 0.0),
    acceleration: tuple[float, float] = (0.0, 0.0),
    radius: float = 0.5,
) -> dict[str, Any]:
    """A disc with a known motion."""
    return {
        "id": name,
        "shape": {"disc": radius},
        "motion": {"position": position, "velocity": velocity, "acceleration": acceleration},
    }


def scene(*obstacles: dict[str, Any], **changes: Any) -> Scenario:
    """A trip of 20 m among obstacles, with changes to single keys such as ``vehicle={"max_speed": 2.0}``."""
    data: dict[str, Any] = {
        "name": "scene",
        "vehicle": dict(VEHICLE),
        "start": {"time": 0.0, "position": [0.0, 0.0], "heading": 0.0, "speed": 1.0},
        "goal": {"position": [20.0, 0.0]},
        "obstacles": list(obstacles),
    }
    for key, value in changes.items():
        data[key] = {**data[key], **value} if isinstance(value, dict) and key in data else value
    return Scenario(**data)


def observed(name: str, seed: int, isotropic: bool = False) -> dict[str, Any]:
    """A disc seen ten times through noise."""
    rng = np.random.default_rng(seed)
    times = np.linspace(-2.0, -0.1, 12)
    truth = np.array([7.0, 3.0]) + times[:, None] * rng.normal(size=2) + 0.5 * times[:, None] ** 2 * 0.1
    covariance = [[0.01, 0.0], [0.0, 0.01]] if isotropic else [[0.02, 0.006], [0.006, 0.008]]
    seen = truth + rng.multivariate_normal([0, 0], covariance, len(times))
    return {
        "id": name,
        "shape": {"disc": 0.4},
        "observations": {"time": times.tolist(), "position": seen.tolist(), "covariance": covariance},
    }


POCKET = [[-2, -2], [2, -2], [2, 2], [-2, 2], [-2, 1.6], [1.6, 1.6], [1.6, -1.6], [-2, -1.6]]
"""Corners of a room that is open to the left: concave, of three convex pieces."""


def shaped(**obstacles: tuple[dict[str, Any], dict[str, Any]]) -> list[dict[str, Any]]:
    """Obstacles by their ids, each a shape and a motion."""
    return [{"id": name, "shape": shape, "motion": motion} for name, (shape, motion) in obstacles.items()]


CROSSERS = (
    disc("slow", (8.5, -3.9), (0.23, 0.86), (0.05, 0.1), 0.55),
    disc("oncoming", (16.0, 0.6), (-1.6, -0.1), (0.0, 0.02), 0.7),
    disc("fast", (12.0, 9.0), (0.1, -1.9), (0.0, 0.05), 0.5),
)


def drone(seed: int, noise: float = 1.0) -> Scenario:
    """A drone of 15 m/s on 300 m, among others that were seen through noise for five seconds."""
    rng = np.random.default_rng(seed)
    times = np.linspace(-4.9, 0.0, 50)
    along, velocity = rng.uniform(30.0, 280.0, 20), rng.uniform(-8.0, 8.0, (20, 2))
    start = np.stack([along, rng.uniform(-6.0, 6.0, 20)], axis=1) - velocity * (along / 15.0)[:, None]
    covariance = [[noise**2, 0.0], [0.0, noise**2]]
    others = []
    for k in np.flatnonzero(np.hypot(*start.T) > 40.0).tolist():
        seen = start[k] + times[:, None] * velocity[k] + noise * rng.normal(size=(50, 2))
        observations = {"time": times.tolist(), "position": seen.tolist(), "covariance": covariance}
        others.append(
            {"id": f"uav{k}", "shape": {"disc": 3.0}, "observations": observations, "model": {"order": 1}},
        )
    vehicle: dict[str, float | None] = {
        "radius": 1.0,
        "max_speed": 15.0,
        "max_acceleration": 4.0,
        "max_deceleration": 4.0,
    }
    vehicle |= {"max_lateral_acceleration": 5.0, "max_curvature": None}
    return scene(*others, vehicle=vehicle, start={"speed": 15.0}, goal={"position": [300.0, 0.0]})


def rewritten(
    scenario: Scenario,
    length: float = 1.0,
    time: float = 1.0,
    clock: float = 0.0,
    shift: tuple[float, float] = (0.0, 0.0),
    turn: float = 0.0,
) -> Scenario:
    """A scene with lengths and times so many times as large, then moved in time and place, and turned first.

    Only what scenes of tests have is looked at: discs, motions and observations that are seen in all directions alike.
    """
    data = scenario.to_dict()
    c, s = math.cos(turn), math.sin(turn)

    def vector(value: Any, unit: float) -> list[float]:
        x, y = value
        return [(c * x - s * y) * unit, (s * x + c * y) * unit] if turn else [x * unit, y * unit]

    def place(value: Any) -> list[float]:
        x, y = vector(value, length)
        return [x + shift[0], y + shift[1]]

    def scale(part: dict[str, Any], **units: float) -> None:
        for key, unit in units.items():
            if part.get(key) is not None:
                part[key] = part[key] * unit

    speed, rate = length / time, length / time**2
    scale(data["vehicle"], radius=length, max_speed=speed, max_acceleration=rate, max_deceleration=rate)
    scale(data["vehicle"], max_lateral_acceleration=rate, max_curvature=1 / length, max_jerk=rate / time)
    scale(data["vehicle"], max_curvature_rate=1 / length / time)
    scale(data["vehicle"], max_total_acceleration=rate, max_power=length**2 / time**3, centre=length)
    data["vehicle"]["discs"] = [offset * length for offset in data["vehicle"]["discs"]]
    for end in (data["start"], data["goal"]):
        end["position"] = place(end["position"])
        scale(end, speed=speed, acceleration=rate, radius=length, time=time)
        if turn and end["heading"] is not None:
            end["heading"] += turn
    data["start"]["time"] += clock
    for key in ("earliest_arrival", "latest_arrival"):
        if data["goal"][key] is not None:
            data["goal"][key] = data["goal"][key] * time + clock
    goal = data["goal"]
    scale(goal, arrival_step=time)
    if goal["region"] is not None:
        goal["region"] = [place(point) for point in goal["region"]]
    if goal["heading_range"] is not None:
        goal["heading_range"] = [value + turn for value in goal["heading_range"]]
    if goal["speed_range"] is not None:
        goal["speed_range"] = [value * speed for value in goal["speed_range"]]
    if data["guide"] is not None:
        data["guide"] = [place(point) for point in data["guide"]]
    data["walls"] = [[place(point) for point in wall] for wall in data["walls"]]
    data["lanes"] = [[place(point) for point in line] for line in data["lanes"]]
    for obstacle in data["obstacles"]:
        scale(obstacle, margin=length)
        scale(obstacle["shape"], disc=length)
        if "rectangle" in obstacle["shape"]:
            obstacle["shape"]["rectangle"] = [side * length for side in obstacle["shape"]["rectangle"]]
        if isinstance(obstacle.get("motion", {}).get("time"), list):
            course = obstacle["motion"]
            course["time"] = [t * time + clock for t in course["time"]]
            course["position"] = [place(point) for point in course["position"]]
            if course["heading"] is not None:
                course["heading"] = [value + turn for value in course["heading"]]
        elif "motion" in obstacle:
            motion = obstacle["motion"]
            motion.update(
                time=motion["time"] * time + clock,
                position=place(motion["position"]),
                velocity=vector(motion["velocity"], speed),
                acceleration=vector(motion["acceleration"], rate),
            )
        else:
            seen = obstacle["observations"]
            seen["time"] = [t * time + clock for t in seen["time"]]
            seen["position"] = [place(point) for point in seen["position"]]
            if seen["covariance"] is not None:
                seen["covariance"] = [[entry * length**2 for entry in row] for row in seen["covariance"]]
    return Scenario(**data)
