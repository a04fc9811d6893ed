"""Targets that are met, and places that are passed on the way."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from verification.differences import Array, HeadingFunction, PositionFunction, end_heading, heading_at
from verification.distances import expected_motion
from verification.findings import Finding, Tolerances

LAST_WINDOW = 1e-4  # s, of the one-sided difference that gives the velocity at the end
STANDS = 1e-6  # m/s; slower targets have no direction


def _moved(data: Mapping[str, Any], goal: Mapping[str, Any], times: Array) -> tuple[Array, Array]:
    """Places (n, 2) to meet a target at, and its velocities (n, 2)."""
    target = goal["target"]
    if isinstance(target, str):
        target = {"obstacle": target}
    if target.get("obstacle") is not None:
        target = next(each for each in data["obstacles"] if each["id"] == target["obstacle"])
    elif "course" in target:
        target = {**target, "motion": target["course"]}
    centres, velocities = expected_motion(target, times, float(data["start"]["time"]))
    return centres + np.asarray(goal.get("offset") or (0.0, 0.0), dtype=float), velocities


def meeting(
    data: Mapping[str, Any],
    position: PositionFunction,
    heading: HeadingFunction | None,
    begin: float,
    end: float,
    allowed: Tolerances,
) -> list[Finding]:
    """Compare where and how a trip ends with a target that moves: place, velocity as a vector, direction."""
    goal = data["goal"]
    if goal.get("target") is None:
        return []
    (place,), (velocity,) = _moved(data, goal, np.array([end]))
    here, near, far = np.asarray(position(end - LAST_WINDOW * np.arange(3.0)), dtype=float)
    gap, radius = math.dist(here, place), float(goal.get("radius") or 0.0)
    found = [Finding("target_position", gap, radius, gap - radius, allowed.position, end)]
    if goal.get("match_velocity"):
        own = (3.0 * here - 4.0 * near + far) / (2.0 * LAST_WINDOW)
        off = math.dist(own, velocity)
        tolerance = max(allowed.boundary_speed, allowed.goal_speed)
        tolerance += allowed.heading * float(np.linalg.norm(velocity))
        found.append(Finding("target_velocity", off, 0.0, off, tolerance, end))
    if goal.get("approach") is not None:
        turned = end_heading(position, end - begin, end, -1) + math.pi if heading is None else heading_at(heading, end)
        moves = float(np.linalg.norm(velocity)) > STANDS
        seen = turned - (math.atan2(velocity[1], velocity[0]) if moves else 0.0)
        found.append(_in_range("target_approach", seen, goal["approach"], allowed.heading, end))
    return found


def _in_range(name: str, angle: float, between: Any, tolerance: float, when: float) -> Finding:
    least, largest = (float(value) for value in between)
    half = 0.5 * (largest - least)
    off = abs(math.remainder(angle - least - half, 2.0 * math.pi))
    return Finding(name, angle, half, off - half, tolerance, when)


def passages(
    data: Mapping[str, Any], times: Array, positions: Array, headings: Array | None, allowed: Tolerances
) -> list[Finding]:
    """Compare a trip with the places to pass: radius, window, heading, and order, from chords between samples."""
    found, passed = [], 0
    given = data.get("goals_order", "given") == "given"
    for number, place in enumerate(data.get("goals") or ()):
        near = _distances(data, place, times, positions)
        radius = float(place.get("radius") or data["vehicle"]["radius"])
        there = _in_time(place, times, allowed)
        if place.get("heading_range") is not None:
            there &= _heads(place["heading_range"], positions, headings, allowed)
        beyond = np.where(there, near - radius, np.inf)
        first = passed if given else 0
        subject = f"goals[{number}]"
        after = beyond[first:]
        reached = np.flatnonzero(after <= allowed.position)
        if reached.size:
            k = first + int(reached[0])
            passed = k if given else passed
        else:
            k = first + int(np.argmin(after))
        found.append(
            Finding("passage", float(near[k]), radius, float(beyond[k]), allowed.position, float(times[k]), subject)
        )
    return found


def _distances(data: Mapping[str, Any], place: Mapping[str, Any], times: Array, positions: Array) -> Array:
    """Least distance on each chord (n - 1,) from a place, or a target that moves straight meanwhile."""
    if place.get("target") is not None:
        away = positions - _moved(data, place, times)[0]
    else:
        away = positions - np.asarray(place["position"], dtype=float)
    chords = np.diff(away, axis=0)
    squares = np.maximum((chords**2).sum(axis=1), np.finfo(float).tiny)
    share = np.clip(-(away[:-1] * chords).sum(axis=1) / squares, 0.0, 1.0)
    return np.asarray(np.linalg.norm(away[:-1] + share[:, None] * chords, axis=1))


def _in_time(place: Mapping[str, Any], times: Array, allowed: Tolerances) -> NDArray[np.bool_]:
    inside = np.ones(len(times) - 1, dtype=bool)
    if place.get("earliest_arrival") is not None:
        inside &= times[1:] >= float(place["earliest_arrival"]) - allowed.arrival
    if place.get("latest_arrival") is not None:
        inside &= times[:-1] <= float(place["latest_arrival"]) + allowed.arrival
    return inside


def _heads(between: Any, positions: Array, headings: Array | None, allowed: Tolerances) -> NDArray[np.bool_]:
    least, largest = (float(value) for value in between)
    half = 0.5 * (largest - least)
    if headings is None:
        chords = np.diff(positions, axis=0)
        headings = np.arctan2(chords[:, 1], chords[:, 0])
    else:
        headings = headings[:-1]
    off = np.abs(np.remainder(headings - least - half + np.pi, 2.0 * np.pi) - np.pi)
    return off <= half + allowed.heading + 1e-3
