"""Answers of a planner that drives: they begin where the vehicle is, and it can follow them from there.

A vehicle that is told to be elsewhere, or faster or slower, than an answer begins, follows the answer's path beside it,
and brakes or accelerates with all that it has until it is as fast as the answer is then. No follower does better.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from verification.arrivals import goal_conditions
from verification.differences import (
    SLOW,
    Array,
    HeadingFunction,
    PositionFunction,
    end_gear,
    end_heading,
    end_speed,
    ends,
    heading_at,
)
from verification.findings import Finding, Tolerances

STEPS = 400
STANDS = 1e-3  # m/s
SHORTEST = 1e-2  # m, of a trip whose heading differences of positions tell
CREEPS = 1e-4  # m/s, for a vehicle that stands to have a heading


@dataclass(frozen=True)
class Told:
    """State of a vehicle: s, m, rad or None if that is free, m/s."""

    time: float
    position: Array
    heading: float | None
    speed: float


@dataclass(frozen=True)
class Allowed:
    """How far a state may be off: m, m/s, rad."""

    position: float
    speed: float
    heading: float


def beginning(
    told: Told,
    position: PositionFunction,
    duration: float,
    allowed: Allowed,
    heading: HeadingFunction | None = None,
) -> list[Finding]:
    """Compare what an answer of a duration, s, begins with and what was told; with headings, also a signed speed."""
    gap = math.dist(np.asarray(position(np.array([told.time])))[0], told.position)
    speed = end_speed(position, told.time, 1) * (1.0 if heading is None else end_gear(position, heading, told.time))
    off = abs(speed - told.speed)
    found = [
        Finding("start_position", gap, 0.0, gap, allowed.position, told.time),
        Finding("start_speed", speed, told.speed, off, allowed.speed, told.time),
    ]
    first, last = np.asarray(position(np.array([told.time, told.time + duration])))
    if told.heading is not None and min(abs(speed), abs(told.speed)) > STANDS and math.dist(first, last) > SHORTEST:
        if heading is None:
            angle = end_heading(position, duration, told.time, 1)
        else:
            angle = heading_at(heading, told.time)
        turned = abs(math.remainder(angle - told.heading, 2.0 * math.pi))
        found.append(Finding("start_heading", angle, told.heading, turned, allowed.heading, told.time))
    return found


def followed(vehicle: Mapping[str, Any], told: Told, position: PositionFunction, until: float) -> tuple[Array, Array]:
    """Times (n,), s, and places (n, 2), m, of a vehicle that follows an answer up to a time, s, or until it stands."""
    times: Array = np.linspace(told.time, until, STEPS + 1)
    path = np.asarray(position(times), dtype=float)
    driven = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=1))])
    step = float(times[1] - times[0])
    # After a stop whoever was faster brakes on.
    more = math.ceil(told.speed / float(vehicle["max_deceleration"]) / step)
    asked = np.append(np.gradient(driven, step), np.zeros(more))
    speeds = np.full(asked.size, told.speed)
    brakes, gains = (step * float(vehicle[f"max_{name}"]) for name in ("deceleration", "acceleration"))
    for k in range(1, speeds.size):
        speeds[k] = min(max(asked[k], speeds[k - 1] - brakes), speeds[k - 1] + gains)
    stands = int(np.argmax(np.append(speeds[STEPS:-1] < SLOW, True))) if asked[STEPS] < SLOW else 0
    speeds = speeds[: STEPS + stands + 1]
    times = told.time + step * np.arange(float(speeds.size))
    along = np.concatenate([[0.0], np.cumsum(0.5 * step * (speeds[1:] + speeds[:-1]))])
    kept = np.append(True, np.diff(driven) > 0.0)
    ahead = np.array([math.cos(told.heading or 0.0), math.sin(told.heading or 0.0)])
    if kept.sum() > 1:
        chord = path[kept][-1] - path[kept][-2]
        ahead = chord / np.linalg.norm(chord)
    places = np.stack([np.interp(along, driven[kept], path[kept, k]) for k in (0, 1)], axis=1)
    beyond = np.maximum(along - driven[-1], 0.0)
    return times, places + beyond[:, None] * ahead + (told.position - path[0])


def arrived(data: Mapping[str, Any], told: Told, allowed: Allowed, speed: float) -> list[Finding]:
    """Compare a vehicle that is said to have arrived, and the last speed of what is answered, m/s, with the goal."""
    heading, pace = told.heading or 0.0, max(told.speed, CREEPS)
    step = pace * np.array([math.cos(heading), math.sin(heading)])

    def straight(times: Array) -> Array:
        return told.position + (np.asarray(times) - told.time)[:, None] * step

    unasked = {"arrival_step": None, "latest_arrival": None, "earliest_arrival": None}
    if told.heading is None:
        unasked |= {"heading": None, "heading_range": None}
    case, times = {**data, "goal": {**data["goal"], **unasked}}, np.array([told.time - 10.0, told.time])
    usual = Tolerances(position=allowed.position, heading=allowed.heading, boundary_speed=allowed.speed)
    found = [
        *ends(case, times, straight(times), straight, usual),
        *goal_conditions(case, times[0], told.time, straight, usual),
    ]
    stands = Finding("stands", speed, 0.0, speed, STANDS, told.time)
    return [stands, *(each for each in found if each.name.startswith("goal"))]
