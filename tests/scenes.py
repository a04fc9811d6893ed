"""Small scenes that tests of several modules use."""

from __future__ import annotations

from typing import Any

from scp_planner import Scenario

VEHICLE = {
    "radius": 0.3,
    "max_speed": 3.0,
    "max_acceleration": 1.5,
    "max_deceleration": 2.0,
    "max_lateral_acceleration": 2.0,
    "max_curvature": 1.0,
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


CROSSERS = (
    disc("slow", (8.5, -3.9), (0.23, 0.86), (0.05, 0.1), 0.55),
    disc("oncoming", (16.0, 0.6), (-1.6, -0.1), (0.0, 0.02), 0.7),
    disc("fast", (12.0, 9.0), (0.1, -1.9), (0.0, 0.05), 0.5),
)
