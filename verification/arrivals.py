"""Where, how and when a trip may end where its goal is more than a place, and how it has to begin.

What these see and cannot see is said in `verification.dense_check`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from verification.differences import Array, HeadingFunction, PositionFunction, end_heading, end_speed, heading_at
from verification.distances import distance_to_polygon
from verification.findings import Finding, Tolerances

STEP_SHARE = 0.01  # of a step, by which an arrival may miss a multiple of it
SECOND_WINDOW = 1e-3  # s, the widest between points from which the first acceleration is extrapolated; of 1 s of trip
WINDOWS = 5  # of which each is a third of the one before
_FIRST: Array = np.array([-137.0, 300.0, -300.0, 200.0, -75.0, 12.0]) / 60.0  # one-sided, of fifth order: for turns
_SECOND: Array = np.array([45.0, -154.0, 214.0, -156.0, 61.0, -10.0]) / 12.0  # and of fourth order


def goal_conditions(
    data: Mapping[str, Any],
    begin: float,
    end: float,
    position: PositionFunction,
    allowed: Tolerances,
    turned: HeadingFunction | None = None,
) -> list[Finding]:
    """Region, ranges and step of a goal, of a trip from one time to another, s, by its positions."""
    goal, found = data["goal"], []
    if turned is not None:
        heading = heading_at(turned, end)
    else:
        heading = end_heading(position, end - begin, end, -1) + math.pi  # seen from the goal the chords point backwards

    def require(name: str, value: float, limit: float, excess: float, tolerance: float) -> None:
        found.append(Finding(name, value, limit, excess, tolerance, end))

    if goal.get("region") is not None:
        ahead = float(data["vehicle"].get("centre") or 0.0) * np.array([math.cos(heading), math.sin(heading)])
        middle = np.asarray(position(np.array([end])), dtype=float) + ahead
        outside = float(distance_to_polygon(middle, np.asarray(goal["region"], dtype=float))[0])
        swing = abs(float(data["vehicle"].get("centre") or 0.0)) * allowed.heading
        require("goal_region", outside, 0.0, outside, allowed.position + swing)
    if goal.get("heading_range") is not None:
        least, largest = (float(value) for value in goal["heading_range"])
        half = 0.5 * (largest - least)
        off = abs(math.remainder(heading - least - half, 2.0 * math.pi))
        require("goal_heading_range", heading, half, off - half, allowed.heading)
    if goal.get("speed_range") is not None:
        least, largest = (float(value) for value in goal["speed_range"])
        speed = end_speed(position, end, -1)
        require("goal_speed_range", speed, largest, max(speed - largest, least - speed), allowed.boundary_speed)
    if goal.get("arrival_step") is not None:
        steps = (end - begin) / float(goal["arrival_step"])
        require("arrival_step", steps, STEP_SHARE, abs(steps - round(steps)), STEP_SHARE + 1e-6)
    return found


def first_acceleration(
    data: Mapping[str, Any], begin: float, end: float, position: PositionFunction, allowed: Tolerances
) -> list[Finding]:
    """Compare the acceleration along the path at the start, where one is asked for, by a one-sided difference.

    Only where the jerk is limited: else the acceleration may be another one at once.
    """
    asked = data["start"].get("acceleration")
    if asked is None or data["vehicle"].get("max_jerk") is None:
        return []
    widest = SECOND_WINDOW * min(1.0, end - begin)
    found = [_first_acceleration(position, begin, end, widest / 3.0**k) for k in range(WINDOWS)]
    # Wide windows blur turns, and narrow ones rounding: where the next narrower one says nearly the same is neither.
    value = found[int(np.argmin(np.abs(np.diff(found)))) + 1]
    gap = abs(value - float(asked))
    return [Finding("start_acceleration", value, float(asked), gap, allowed.first_acceleration, begin)]


def _first_acceleration(position: PositionFunction, begin: float, end: float, window: float) -> float:
    """Acceleration along the path at the start by one-sided differences over windows, s."""
    points = np.asarray(position(begin + window * np.arange(float(_SECOND.size))), dtype=float)
    velocity, force = _FIRST @ points / window, _SECOND @ points / window**2
    if np.linalg.norm(velocity) > window * np.linalg.norm(force):
        heading = math.atan2(velocity[1], velocity[0])
    else:  # at rest, or nearly
        heading = end_heading(position, end - begin, begin, 1)
    return float(force @ np.array([math.cos(heading), math.sin(heading)]))
