"""Trips with exact speeds and curvatures, for a check to judge."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from scenes import VEHICLE

from scp_planner.arrays import Array
from verification.findings import DenseReport


def scenario(**changes: Any) -> dict[str, Any]:
    data: dict[str, Any] = {
        "schema": 1,
        "name": "test",
        "vehicle": dict(VEHICLE),
        "start": {"time": 0.0, "position": [0.0, 0.0], "heading": 0.0, "speed": 1.0},
        "goal": {"position": [20.0, 0.0], "heading": None, "speed": None},
        "obstacles": [],
    }
    data.update(changes)
    return data


def straight_trip(
    length: float = 20.0, start_speed: float = 1.0, top_speed: float = 3.0, acceleration: float = 1.5
) -> tuple[Callable[[Array], Array], float]:
    """Along the x axis: full acceleration up to the top speed, then cruise; exact."""
    rise = (top_speed - start_speed) / acceleration
    climbed = (start_speed + top_speed) / 2.0 * rise
    duration = rise + (length - climbed) / top_speed

    def position(t: Array) -> Array:
        x = np.where(t < rise, start_speed * t + acceleration * t**2 / 2.0, climbed + top_speed * (t - rise))
        return np.stack([x, np.zeros_like(t)], axis=1)

    return position, duration


def arc_trip(radius: float, speed: float, angle: float = 3.0) -> tuple[Callable[[Array], Array], float, dict[str, Any]]:
    """Constant speed on a circle that starts at the origin towards +x."""

    def position(t: Array) -> Array:
        phi = speed * t / radius
        return radius * np.stack([np.sin(phi), 1.0 - np.cos(phi)], axis=1)

    duration = radius * angle / speed
    end = position(np.array([duration]))[0]
    data = scenario(
        start={"time": 0.0, "position": [0.0, 0.0], "heading": 0.0, "speed": speed},
        goal={"position": end.tolist(), "heading": math.remainder(angle, 2.0 * math.pi), "speed": speed},
    )
    return position, duration, data


def refused(report: DenseReport) -> set[str]:
    return {finding.name for finding in report.violations}
