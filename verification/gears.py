"""Vehicles that drive backwards, stand, and turn on the spot: the limits of each gear, and what is between them."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from verification.differences import REVERSAL_LENGTH, Array, motion_limits
from verification.findings import Finding, Tolerances, find_worst
from verification.places import ROUNDED

FEWEST = 8  # samples between two changes of gear
SLIP = 1e-3  # rad; by so much a chord may miss the mean heading at its ends, and the square of the turn between them
TURNED = 1e-6  # rad; a vehicle that stands and turns by more sets out anew
CREEPING = 4.0  # times the curvature's limit, that a heading may change over a chord of which the ends blur the length


def gear_limits(
    data: Mapping[str, Any],
    times: Array,
    positions: Array,
    headings: Array,
    allowed: Tolerances,
    excused: Array | None = None,
) -> list[Finding]:
    """Compare what a vehicle does in each gear, and between them, with what it can.

    Parameters
    ----------
    data : mapping
        Scenario.
    times : (n,)
        Equidistant, s.
    positions, headings : (n, 2), (n,)
        m, rad.
    allowed : Tolerances
    excused : (n,), optional
        Speeds that break no limit, m/s.
    """
    vehicle, step = data["vehicle"], float(times[1] - times[0])
    rate = float(vehicle.get("max_turn_rate") or 0.0)
    chords = np.diff(positions, axis=0)
    lengths = np.linalg.norm(chords, axis=1)
    turns = np.remainder(np.diff(headings) + np.pi, 2.0 * np.pi) - np.pi
    middles = headings[:-1] + 0.5 * turns
    along = chords[:, 0] * np.cos(middles) + chords[:, 1] * np.sin(middles)
    across = chords[:, 1] * np.cos(middles) - chords[:, 0] * np.sin(middles)
    moves = lengths > max(REVERSAL_LENGTH, ROUNDED * float(np.abs(positions).max()))
    gears = np.where(moves, np.sign(along), 0.0)
    around = np.pad(gears, 1)
    seam = (around[:-2] != gears) | (around[2:] != gears)  # in part of the chord it may stand, and turn
    seamless = np.abs(across) > np.where(seam, allowed.position, 0.0)
    found = find_worst(
        "heading_along_path",
        np.where(
            moves & seamless,
            np.abs(np.arctan2(across, np.abs(along))) - np.where(seam, np.abs(turns), turns**2),
            0.0,
        ),
        0.0,
        SLIP,
        times[:-1],
    )
    most = np.where(moves, math.pi, rate * step)
    if vehicle.get("max_curvature") is not None:
        bent = CREEPING * lengths * float(vehicle["max_curvature"])
        most = np.minimum(most, rate * step + bent)
    found += find_worst("turn_while_standing", np.abs(turns) - most, 0.0, allowed.heading, times[:-1])
    found += _turns_on_the_spot(np.flatnonzero(moves), times, turns, rate, allowed)
    backward = 0.0
    quickest = max(float(vehicle["max_acceleration"]), float(vehicle["max_deceleration"]))
    seam_length = allowed.position + quickest * step**2  # of a chord across a seam: it tells of no speed
    for first, last, gear in _stretches(gears, turns):
        first += first > 0 and lengths[first] <= seam_length
        last -= last < len(lengths) and lengths[last - 1] <= seam_length
        part = slice(first, last + 1)
        lasts, driven = (last - first) * step, float(lengths[first:last].sum())
        farthest = quickest * lasts**2 + (abs(float(data["start"]["speed"])) * lasts if first == 0 else 0.0)
        if last - first < FEWEST:
            jump = driven - farthest
            found.append(Finding("jump", driven, farthest, jump, allowed.position, float(times[first])))
        if gear < 0.0 and vehicle.get("reverse") is None:
            backward = max(backward, float(lengths[first:last].max()) / step)
        limits = {**data, "vehicle": vehicle if gear > 0.0 else limits_backwards(vehicle)}
        rest = None if excused is None else excused[part]
        if last - first >= FEWEST:
            found += motion_limits(limits, times[part], positions[part], allowed, rest)
    found.append(Finding("reversing", -backward, 0.0, backward, allowed.speed, float(times[0])))
    return found


def _turns_on_the_spot(
    moving: NDArray[np.intp], times: Array, turns: Array, rate: float, allowed: Tolerances
) -> list[Finding]:
    """Turns of a vehicle that stands between chords that move, against what its rate allows in that time."""
    turned = np.concatenate([[0.0], np.cumsum(np.abs(turns))])
    begins, ends = np.append(0, moving + 1), np.append(moving, len(turns))
    excess = turned[ends] - turned[begins] - rate * (times[ends] - times[begins])
    return find_worst("turn_while_standing", excess, 0.0, allowed.heading, times[begins])


def limits_backwards(vehicle: Mapping[str, Any]) -> Mapping[str, Any]:
    """Limits of a vehicle while it drives backwards."""
    reverse = vehicle.get("reverse") or {}
    narrower = {
        key: min(float(vehicle[key]), float(reverse[key]))
        for key in ("max_speed", "max_acceleration")
        if reverse.get(key) is not None
    }
    return {**vehicle, **narrower}


def _stretches(gears: Array, turns: Array) -> Iterator[tuple[int, int, float]]:
    """First and last sample of each stretch in one gear: without a turn on the spot, or a change of gear, inside."""
    moving = np.flatnonzero(gears != 0.0)
    if not moving.size:
        return
    turned = np.concatenate([[0.0], np.cumsum(np.abs(turns))])
    begin = int(moving[0])
    for one, other in itertools.pairwise(moving.tolist()):
        stood = other - one > 1 and turned[other] - turned[one + 1] > TURNED
        if gears[one] != gears[other] or stood:
            yield begin, int(one) + 1, float(gears[one])
            begin = int(other)
    yield begin, int(moving[-1]) + 1, float(gears[moving[-1]])


def braking_speeds(data: Mapping[str, Any], times: Array) -> Array:
    """Speeds (n,) at times (n,) of a vehicle that brakes from the start with all it has, m/s."""
    vehicle, start = data["vehicle"], data["start"]
    since, speed = times - times[0], abs(float(start["speed"]))
    brakes = min(float(vehicle["max_deceleration"]), float(vehicle.get("max_total_acceleration") or math.inf))
    if vehicle.get("max_jerk") is None:
        return np.maximum(speed - brakes * since, 0.0)
    jerk = float(vehicle["max_jerk"])
    first = max(float(start.get("acceleration") or 0.0), -brakes)
    full = (first + brakes) / jerk
    ramp = np.minimum(since, full)
    found = speed + first * ramp - 0.5 * jerk * ramp**2 - brakes * np.maximum(since - full, 0.0)
    return np.maximum(found, 0.0)
