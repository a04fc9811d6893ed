"""What a vehicle does, from differences of its positions: speeds, accelerations, curvatures, headings.

What these see and cannot see is said in `verification.dense_check`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from verification.findings import Finding, Tolerances, find_worst

Array = NDArray[np.float64]
PositionFunction = Callable[[Array], ArrayLike]
HeadingFunction = Callable[[Array], ArrayLike]

SPEED_WINDOW = 1e-3  # s, one chord
SLOW = 0.1  # m/s; ends slower than this are looked at over the samples, not over chords of their own
END_WINDOW = 1e-4  # s; a longer one would be blurred by a jump of the acceleration just inside the end
ACCELERATION_WINDOW = 4e-3  # s, between the chords that are differenced
POWER_WINDOW = 3e-5  # s; what a jump of the acceleration inside a chord makes of the power, by its square
RATE_WINDOW = 0.05  # s, over which accelerations and curvatures are differenced for their rates
CHORD_LENGTH = 3e-3  # m, for headings and curvature
END_CHORD = 1e-4  # m, for the headings at the ends, whose error grows with the square of the chords
FINEST = 40  # halvings of a trip's duration, after which no moment is told from its end
HALVINGS = 20  # of the time in which a chord is left
END_TURN = 1e-3  # rad, in a window at an end: speeds are off by a share of a third of its square, headings by less
REVERSAL_LENGTH = 1e-8  # m, shorter displacements have no direction worth comparing
_THREE: Array = np.array([0.0, 1.0, 2.0])  # places of a one-sided difference of second order


def ends(
    data: Mapping[str, Any],
    times: Array,
    positions: Array,
    position: PositionFunction,
    allowed: Tolerances,
    heading: HeadingFunction | None = None,
) -> list[Finding]:
    """Where and when a trip begins and ends, how fast and which way, from positions at times and their function.

    With the headings of a vehicle that may drive backwards its speed at the start has a sign.
    """
    start, goal = data["start"], data["goal"]
    begin, end = float(times[0]), float(times[-1])
    found = []

    def require(name: str, value: float, limit: float, excess: float, tolerance: float, time: float) -> None:
        found.append(Finding(name, value, limit, excess, tolerance, time))

    late = begin - float(start.get("time", 0.0))
    require("start_time", begin, begin - late, abs(late), allowed.start_time, begin)
    gap = float(np.linalg.norm(positions[0] - np.asarray(start["position"], dtype=float)))
    require("start_position", gap, 0.0, gap, allowed.position, begin)
    if goal.get("region") is None and goal.get("target") is None:
        gap = float(np.linalg.norm(positions[-1] - np.asarray(goal["position"], dtype=float)))
        reach = float(goal.get("radius") or 0.0)
        require("goal_position", gap, reach, gap - reach, allowed.position, end)
    for name, sign in (("earliest_arrival", -1.0), ("latest_arrival", 1.0)):
        if goal.get(name) is not None:
            limit = float(goal[name])
            require(name, end, limit, sign * (end - limit), allowed.arrival, end)

    for name, place, when, order in (("start", start, begin, 1), ("goal", goal, end, -1)):
        if place.get("speed") is not None:
            speed = end_speed(position, when, order)
            if heading is not None and order == 1:
                speed *= end_gear(position, heading, when)
            gap = abs(speed - float(place["speed"]))
            tolerance = allowed.boundary_speed if name == "start" else max(allowed.boundary_speed, allowed.goal_speed)
            require(f"{name}_speed", speed, float(place["speed"]), gap, tolerance, when)
        if place.get("heading") is not None:
            # Seen from the goal the chords point backwards.
            if heading is not None:
                turned = heading_at(heading, when)
            else:
                turned = end_heading(position, end - begin, when, order) + (0.0 if order == 1 else math.pi)
            gap = abs(math.remainder(turned - float(place["heading"]), 2.0 * math.pi))
            require(f"{name}_heading", turned, float(place["heading"]), gap, allowed.heading, when)
    return found


def heading_at(heading: HeadingFunction, when: float) -> float:
    """Heading of a vehicle at a time."""
    return float(np.asarray(heading(np.array([when])), dtype=float)[0])


def end_gear(position: PositionFunction, heading: HeadingFunction, begin: float) -> float:
    """1 if a vehicle sets out along its heading, -1 against it."""
    here, there = np.asarray(position(begin + np.array([0.0, END_WINDOW])), dtype=float)
    angle = heading_at(heading, begin)
    return -1.0 if float((there - here) @ np.array([math.cos(angle), math.sin(angle)])) < 0.0 else 1.0


def end_speed(position: PositionFunction, end: float, order: int) -> float:
    """Speed at the start, of order 1, or at the goal, of order -1."""
    return _end_speed(position, end, order * _end_window(position, end, order * END_WINDOW))


def _end_speed(position: PositionFunction, end: float, window: float) -> float:
    """Speed at an end, from the one-sided second-order difference over a window to the inside."""
    here, near, far = np.asarray(position(end + window * _THREE), dtype=float)
    velocity = (-3.0 * here + 4.0 * near - far) / (2.0 * window)
    return float(np.linalg.norm(velocity))


def _end_window(position: PositionFunction, end: float, window: float) -> float:
    """Length of a window to the inside of an end, s, that is shorter where the trip turns fast there."""
    turn = _turn(np.asarray(position(end + window * _THREE), dtype=float))
    return abs(window) * min(1.0, END_TURN / turn) if turn > 0.0 else abs(window)


def end_heading(position: PositionFunction, whole: float, end: float, order: int) -> float:
    """Heading to the inside at an end of a trip of a whole duration, s, over two short chords."""
    speed = _end_speed(position, end, order * END_WINDOW)
    if speed <= SLOW:
        points = _slow_end(position, end, order * abs(whole), END_CHORD)
        turn = _turn(points)
        # What almost stands may turn as sharply as it likes: then over chords in which it turns little.
        if turn > END_TURN:
            points = _slow_end(position, end, order * abs(whole), END_CHORD * END_TURN / turn)
        return _first_heading(points)
    window = order * _end_window(position, end, order * END_CHORD / speed)
    return _first_heading(np.asarray(position(end + window * _THREE), dtype=float))


def _slow_end(position: PositionFunction, end: float, longest: float, chord: float) -> Array:
    """Three points (3, 2), m, at an end, a chord, m, and two chords from it, wherever these are in time."""
    moments = [end, *(_moment_at(position, end, longest, share * chord) for share in (1.0, 2.0))]
    return np.asarray(position(np.array(moments)), dtype=float)


def _turn(three: Array) -> float:
    """Angle, rad, between the two chords of three points (3, 2)."""
    before, after = np.diff(three, axis=0)
    return abs(math.atan2(before[0] * after[1] - before[1] * after[0], float(before @ after)))


def _moment_at(position: PositionFunction, end: float, longest: float, distance: float) -> float:
    """When it is first a distance, m, from an end, s, looked for from the end to the inside, and by halving."""

    def away(offset: float) -> float:
        here, there = np.asarray(position(np.array([end, end + offset])), dtype=float)
        return math.dist(here, there)

    far = longest * 2.0**-FINEST
    while abs(far) < abs(longest) and away(far) < distance:
        far *= 2.0
    near = 0.5 * far
    for _ in range(HALVINGS):
        middle = 0.5 * (near + far)
        near, far = (middle, far) if away(middle) < distance else (near, middle)
    return end + far


def _first_heading(three: Array) -> float:
    """Heading at the first of three points: the directions of two chords, extrapolated over arc length."""
    chords = np.diff(three, axis=0)
    first, second = np.arctan2(chords[:, 1], chords[:, 0])
    lengths = np.linalg.norm(chords, axis=1)
    turn = math.remainder(second - first, 2.0 * math.pi)
    return float(first - turn * lengths[0] / (lengths[0] + lengths[1]))


def points_by_length(positions: Array) -> NDArray[np.intp]:
    """Indices of points about CHORD_LENGTH apart along the way, whatever the speed; at least three."""
    lengths = np.linalg.norm(np.diff(positions, axis=0), axis=1)
    distance = np.concatenate([[0.0], np.cumsum(lengths)])
    total = distance[-1]
    # With samples farther apart than a chord the marks would fall on the same sample: two steps at least.
    spacing = max(CHORD_LENGTH, 2.0 * float(lengths.max(initial=0.0)))
    count = max(2, int(total / spacing))
    chosen = np.searchsorted(distance, np.linspace(0.0, total, count + 1), side="left")
    chosen[-1] = positions.shape[0] - 1
    return np.unique(np.clip(chosen, 0, positions.shape[0] - 1))


def shortfalls(positions: Array, step: float) -> Array:
    """How much slower than a vehicle each chord between positions, (n, 2) m every step s, may be by its turn, (n - 1,).

    A chord of speed v that turns by phi is short by v phi^2 / 24 of speed; one that hardly is one turns nowhere.
    """
    chords = np.diff(positions, axis=0)
    lengths = np.linalg.norm(chords, axis=1)
    short = np.zeros(len(lengths))
    real = np.flatnonzero(lengths > REVERSAL_LENGTH)
    if len(real) < 2:
        return short
    headings = np.arctan2(chords[real, 1], chords[real, 0])
    turns = np.abs(np.remainder(np.diff(headings) + np.pi, 2.0 * np.pi) - np.pi)
    turns = np.minimum(turns, np.pi - turns)  # who turns about is short of nothing
    turns = np.maximum(np.append(turns, 0.0), np.append(0.0, turns))
    short[real] = lengths[real] / step * turns**2 / 24.0
    return short


def motion_limits(
    data: Mapping[str, Any],
    times: Array,
    positions: Array,
    allowed: Tolerances,
    excused: Array | None = None,
) -> list[Finding]:
    """Compare what the vehicle does with what it can, from positions (n, 2) m at equidistant times (n,) s.

    Speeds up to those ``excused``, (n,) m/s, break no limit; if there are any, what begins beyond another limit may
    stay so as long as it does not rise.
    """
    vehicle = data["vehicle"]
    step = float(times[1] - times[0])
    width = max(1, round(SPEED_WINDOW / step))
    apart = max(width, round(ACCELERATION_WINDOW / step))
    found: list[Finding] = []

    def at_most(name: str, values: Array, limit: float, tolerance: float, when: Array) -> None:
        found.extend(find_worst(name, values, limit, tolerance, when))

    displacements = positions[width:] - positions[:-width]
    chords = np.linalg.norm(displacements, axis=1)
    middles = (times[width:] + times[:-width]) / 2.0
    driven = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(positions, axis=0), axis=1))])
    speeds = (driven[width:] - driven[:-width]) / (width * step)
    top = float(vehicle["max_speed"])
    more = 0.0 if excused is None else np.maximum(np.maximum(excused[:-width], excused[width:]) - top, 0.0)
    at_most("speed", speeds - more, top, allowed.speed, middles)

    backward, when = _backward_speed(displacements, chords, width * step, middles)
    found.append(Finding("reversing", backward, 0.0, -backward, allowed.speed, when))

    rates = (speeds[apart:] - speeds[:-apart]) / (apart * step)
    between = (middles[apart:] + middles[:-apart]) / 2.0
    # The slower of two speeds may only seem so: it is that of chords, which turns make shorter than their arcs.
    summed = np.concatenate([[0.0], np.cumsum(shortfalls(positions, step))])
    seeming = (summed[width:] - summed[:-width]) / (width * apart * step)
    for name, gained in (("acceleration", rates - seeming[:-apart]), ("deceleration", -rates - seeming[apart:])):
        at_most(name, gained, float(vehicle[f"max_{name}"]), allowed.acceleration, between)
    if vehicle.get("max_jerk") is not None:
        far = max(1, round(RATE_WINDOW / step))
        jerks = np.abs(rates[far:] - rates[:-far]) / (far * step)
        at_most("jerk", jerks, float(vehicle["max_jerk"]), allowed.jerk, (between[far:] + between[:-far]) / 2.0)
    found += _forces(vehicle, displacements, speeds, between, step, allowed, falling=excused is not None)

    return found + _bends(vehicle, times, positions, allowed, falling=excused is not None)


def _bends(
    vehicle: Mapping[str, Any], times: Array, positions: Array, allowed: Tolerances, *, falling: bool
) -> list[Finding]:
    """Curvature, its rate and the lateral acceleration, from chords of equal lengths."""
    found: list[Finding] = []

    def at_most(name: str, values: Array, limit: float, tolerance: float, when: Array) -> None:
        may_fall = falling and name != "curvature_rate"
        found.extend(find_worst(name, values, limit, tolerance, when, falling=may_fall))

    chosen = points_by_length(positions)
    if chosen.size < 3:
        return found
    chords = np.diff(positions[chosen], axis=0)
    lengths = np.linalg.norm(chords, axis=1)
    headings = np.arctan2(chords[:, 1], chords[:, 0])
    turns = np.remainder(np.diff(headings) + np.pi, 2.0 * np.pi) - np.pi
    signed = turns / ((lengths[1:] + lengths[:-1]) / 2.0)
    curvatures = np.abs(signed)
    # A curvature that changes at a constant rate has this value a third of what the second chord is longer by beyond
    # the point between the chords; there the speed is looked for, too.
    spans = np.diff(times[chosen])
    when_turning = times[chosen[1:-1]] + np.diff(spans) / 3.0
    chord_speeds = lengths / spans
    between_chords = (spans[:-1] + 2.0 * spans[1:]) / (3.0 * (spans[:-1] + spans[1:]))
    turning_speeds = chord_speeds[:-1] + between_chords * np.diff(chord_speeds)
    if vehicle.get("max_curvature") is not None:
        at_most("curvature", curvatures, float(vehicle["max_curvature"]), allowed.curvature, when_turning)
    if vehicle.get("max_curvature_rate") is not None:
        clock = np.arange(when_turning[0], when_turning[-1], RATE_WINDOW)
        changes = np.abs(np.diff(np.interp(clock, when_turning, signed))) / RATE_WINDOW
        changes, clock = np.append(changes, 0.0), np.append(clock, when_turning[-1])  # none, of what is over before
        at_most(
            "curvature_rate",
            changes,
            float(vehicle["max_curvature_rate"]),
            allowed.curvature_rate,
            clock[-len(changes) :],
        )
    if vehicle.get("max_lateral_acceleration") is not None:
        limit = float(vehicle["max_lateral_acceleration"])
        lateral = curvatures * turning_speeds**2
        at_most("lateral_acceleration", lateral, limit, allowed.lateral_acceleration, when_turning)
    return found


def _forces(
    vehicle: Mapping[str, Any],
    displacements: Array,
    speeds: Array,
    between: Array,
    step: float,
    allowed: Tolerances,
    *,
    falling: bool,
) -> list[Finding]:
    """Acceleration along and across the path together, and power, from chords (n, 2), m, and speeds (n,) of these."""
    found = []
    apart = len(speeds) - len(between)
    width = max(1, round(SPEED_WINDOW / step))
    if vehicle.get("max_total_acceleration") is not None:
        # The norm of a mean is at most the mean of the norms: an exact trip is never refused, however it turns.
        changes = (displacements[apart:] - displacements[:-apart]) / (width * step * apart * step)
        together, limit = np.linalg.norm(changes, axis=1), float(vehicle["max_total_acceleration"])
        found.extend(find_worst("total_acceleration", together, limit, allowed.acceleration, between, falling=falling))
    if vehicle.get("max_power") is not None:
        # The energy won over a time is the integral of the power, whatever the acceleration does meanwhile.
        powers = (speeds[apart:] ** 2 - speeds[:-apart] ** 2) / (2.0 * apart * step)
        jump = float(vehicle["max_acceleration"]) + float(vehicle["max_deceleration"])
        tolerance = allowed.acceleration * max(1.0, float(vehicle["max_speed"])) + POWER_WINDOW * jump**2
        found.extend(find_worst("power", powers, float(vehicle["max_power"]), tolerance, between, falling=falling))
    return found


def _backward_speed(displacements: Array, chords: Array, duration: float, when: Array) -> tuple[float, float]:
    """Least signed speed along the way, and its time; negative once the vehicle has turned on its heel.

    The sign flips wherever a displacement points against the one before it. Displacements too short to have a
    direction are passed over, so that a reversal after a stop is seen too.
    """
    moving = np.flatnonzero(chords > REVERSAL_LENGTH)
    if moving.size < 2:
        return 0.0, float(when[0])
    steps = displacements[moving]
    flips = np.einsum("ij,ij->i", steps[1:], steps[:-1]) < 0.0
    signs = np.concatenate([[1.0], np.cumprod(np.where(flips, -1.0, 1.0))])
    signed = signs * chords[moving] / duration
    worst = int(np.argmin(signed))
    return min(0.0, float(signed[worst])), float(when[moving[worst]])
