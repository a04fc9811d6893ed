"""Independent check of any trip: that it is where it says, as slow as it must be, and outside every obstacle.

The check shares no mathematics with the planner. All that it takes is a function of time to position;
speed, acceleration, curvature and heading come from differences of 20,001 positions, clearances from the
distances to each obstacle at the same times. Where a trip turns so fast that this is too coarse there are up to
sixteen times as many.

What the differences can and cannot see
---------------------------------------
- **Speed** is the sum of the chords of about 1 ms divided by their duration. A chord is never longer than its arc,
  so this is at most the exact mean speed over that time: an exact trip is never refused for rounding up. It falls
  short by a share of (turn between samples)^2 / 24, below 1e-9 at 5 rad/s.
- **Acceleration along the path** is the difference of two such speeds about 4 ms apart: a weighted mean of
  the exact acceleration over 5 ms, plus less than 1e-4 m/s2 from the chords: samples are added until what they
  fall short by cannot be more. A jump is seen as a ramp, never as more than it is.
- **Curvature** is the turn between two neighbouring chords of about 3 mm by their mean length: a weighted
  mean over 6 mm. Chords are chosen by length, not by time, so that it stays sharp where the vehicle creeps
  or stops. A corner of angle phi, also one taken at standstill, shows as about phi / 3 mm.
- **Jerk** and the **rate of the curvature** are differences of those over 50 ms: their mean values over that
  time. A jump of the acceleration by 1 m/s2 shows as 20 m/s3.
- **Lateral acceleration** is that curvature times the square of the mean speed over the same two chords.
- **Clearance** between two samples h apart is overlooked by at most c'' h^2 / 8; with relative speed 6 m/s
  around a disc of 0.5 m and h = 0.4 ms this is 1.4e-6 m.

A position that carries rounding or inversion errors of e metres along the path disturbs the acceleration by
4 e / (1 ms * 4 ms) = 1e6 e: the tolerance of 5e-4 m/s2 allows e = 5e-10 m.
"""

from __future__ import annotations

import itertools
import json
import math
import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]
PositionFunction = Callable[[Array], ArrayLike]

SAMPLES = 20_000
SPEED_WINDOW = 1e-3  # s, one chord
SLOW = 0.1  # m/s; ends slower than this are looked at over the samples, not over chords of their own
END_WINDOW = 1e-4  # s; a longer one would be blurred by a jump of the acceleration just inside the end
ACCELERATION_WINDOW = 4e-3  # s, between the chords that are differenced
RATE_WINDOW = 0.05  # s, over which accelerations and curvatures are differenced for their rates
CHORD_LENGTH = 3e-3  # m, for headings and curvature
END_CHORD = 5e-4  # m, for the headings at the ends, whose error grows with the square of the chords
END_TURN = 1e-3  # rad, in a window at an end: speeds are off by a share of a third of its square
MOST_REFINEMENT = 16  # times the samples, for trips that turn fast
CHORD_SHARE = 0.2  # of what an acceleration is allowed to be off, that chords may make it
REVERSAL_LENGTH = 1e-8  # m, shorter displacements have no direction worth comparing
_THREE: Array = np.array([0.0, 1.0, 2.0])  # places of a one-sided difference of second order


@dataclass(frozen=True)
class Tolerances:
    """How far a limit may be exceeded; the defaults cover the errors of the differences, given above.

    ``clearance`` is about twice what is overlooked between samples; ``heading`` is far more than the error of
    extrapolating the first two chords to the first point, 1e-5 where curvature changes by 100 /m2, unless samples are
    farther apart than these chords.
    """

    clearance: float = 3e-6  # m
    position: float = 1e-6  # m
    arrival: float = 1e-3  # s
    heading: float = 2e-4  # rad
    boundary_speed: float = 2e-4  # m/s, one-sided differences at the ends
    speed: float = 1e-5  # m/s
    acceleration: float = 5e-4  # m/s2
    jerk: float = 0.02  # m/s3
    curvature_rate: float = 0.02  # 1/(m s)
    lateral_acceleration: float = 5e-4  # m/s2
    curvature: float = 2e-4  # 1/m


@dataclass(frozen=True)
class Finding:
    """Worst value of one quantity over the trip.

    ``excess`` is how far it is beyond its limit (negative: within), in the quantity's unit.
    """

    name: str
    value: float
    limit: float
    excess: float
    tolerance: float
    time: float
    subject: str = ""

    @property
    def ok(self) -> bool:
        """Whether the limit holds within the tolerance; a value that is not a number does not."""
        return self.excess <= self.tolerance

    def __str__(self) -> str:
        about = f" ({self.subject})" if self.subject else ""
        return (
            f"{self.name}{about} {self.value:.9g} against {self.limit:.9g} at t = {self.time:.6f} s: "
            f"{self.excess:.3g} beyond, {self.tolerance:.3g} allowed"
        )


@dataclass(frozen=True)
class DenseReport:
    """All findings of one check; ``ok`` only if every one of them is."""

    findings: tuple[Finding, ...]
    travel_time: float

    @property
    def ok(self) -> bool:
        """Whether every limit holds within its tolerance."""
        return all(finding.ok for finding in self.findings)

    @property
    def violations(self) -> tuple[Finding, ...]:
        """The findings that are beyond their tolerance."""
        return tuple(finding for finding in self.findings if not finding.ok)

    def __getitem__(self, name: str) -> Finding:
        """The worst finding of this name."""
        return max((f for f in self.findings if f.name == name), key=lambda f: f.excess)

    def __str__(self) -> str:
        return "holds" if self.ok else "; ".join(str(finding) for finding in self.violations)


def check_trip(
    scenario: Mapping[str, Any] | str | os.PathLike[str],
    position: PositionFunction,
    start_time: float,
    arrival_time: float,
    *,
    tolerances: Tolerances | None = None,
    samples: int = SAMPLES,
    regions: Mapping[str, float] | None = None,
) -> DenseReport:
    """Check one trip against a scenario in the file format.

    Parameters
    ----------
    scenario : mapping or path
        Scenario as a plain dict, or a JSON file. An obstacle needs an exact ``motion`` and a shape that is a
        ``disc``, a ``polygon`` or a ``rectangle``; or, if it is a disc, ``observations`` of known covariance.
    position : callable
        (n,) times in s to (n, 2) positions in m.
    start_time, arrival_time : float
        First and last time of the trip, s, on the scenario's clock.
    tolerances : Tolerances, optional
        Excess allowed per quantity.
    samples : int
        Number of intervals between sampled times.
    regions : mapping of str to float, optional
        For each observed or foretold obstacle q > 0: its centre may be anywhere in the ellipse z' C(t)^-1 z <= q
        around its estimate, C(t) the covariance of the estimate. Which q gives which confidence is not judged here.

    Raises
    ------
    ValueError
        If the scenario has an obstacle that this check cannot judge, or the times or positions are unusable.
    """
    data = _as_mapping(scenario)
    allowed = tolerances or Tolerances()
    if not (math.isfinite(start_time) and math.isfinite(arrival_time) and arrival_time > start_time):
        raise ValueError(f"a trip needs start_time < arrival_time, got {start_time!r} and {arrival_time!r}")
    times, positions = _sampled(position, start_time, arrival_time, samples)
    needed = _refinement(times, positions, allowed) if np.isfinite(positions).all() else 1
    if needed > 1:
        times, positions = _sampled(position, start_time, arrival_time, samples * min(needed, MOST_REFINEMENT))
    if not np.isfinite(positions).all():
        first = times[np.flatnonzero(~np.isfinite(positions).all(axis=1))[0]]
        broken = Finding("position", math.nan, 0.0, math.inf, 0.0, float(first), "not a number")
        return DenseReport((broken,), arrival_time - start_time)
    findings = [
        *_ends(data, times, positions, position, allowed),
        *_motion_limits(data, times, positions, allowed),
        *_place_speeds(data, times, positions, allowed),
    ]
    for place in _disc_centres(data, positions):
        findings += [
            *_workspace(data, times, place, allowed),
            *_corridor(data, times, place, allowed),
            *_clearances(data, times, place, allowed, regions or {}),
        ]
    return DenseReport(tuple(findings), arrival_time - start_time)


def _sampled(position: PositionFunction, start_time: float, arrival_time: float, samples: int) -> tuple[Array, Array]:
    """Equidistant times of a trip, (samples + 1,), and its positions there."""
    times = np.linspace(start_time, arrival_time, samples + 1)
    positions = np.asarray(position(times), dtype=float)
    if positions.shape != (times.size, 2):
        raise ValueError(f"position gave shape {positions.shape} for {times.size} times, (n, 2) expected")
    return times, positions


def _refinement(times: Array, positions: Array, allowed: Tolerances) -> int:
    """How many times as many samples it takes for chords to fall short of their arcs by little enough.

    A chord of speed v that turns by phi is short by v phi^2 / 24 of speed, and that is differenced.
    """
    chords = np.diff(positions, axis=0)
    lengths = np.linalg.norm(chords, axis=1)
    chords, lengths = chords[lengths > REVERSAL_LENGTH], lengths[lengths > REVERSAL_LENGTH]
    if len(lengths) < 2:
        return 1
    headings = np.arctan2(chords[:, 1], chords[:, 0])
    turns = np.remainder(np.diff(headings) + np.pi, 2.0 * np.pi) - np.pi
    step = float(times[1] - times[0])
    short = float((np.maximum(lengths[1:], lengths[:-1]) / step * turns**2).max()) / 24.0
    ratio = short / (CHORD_SHARE * allowed.acceleration * ACCELERATION_WINDOW)
    return math.ceil(math.sqrt(min(ratio, 1.0 / np.finfo(float).eps)))


def check_samples(
    scenario: Mapping[str, Any] | str | os.PathLike[str],
    times: ArrayLike,
    positions: ArrayLike,
    *,
    tolerances: Tolerances | None = None,
    samples: int = SAMPLES,
) -> DenseReport:
    """Check a trip given by recorded samples, joined by the interpolating spline of degree five.

    The error of the interpolation is the recorder's: samples must be dense enough for a smooth curve.

    Parameters
    ----------
    scenario : mapping or path
        As for :func:`check_trip`.
    times : (n,) array_like
        Increasing times, s.
    positions : (n, 2) array_like
        Positions, m.
    tolerances : Tolerances, optional
        Excess allowed per quantity.
    samples : int
        Number of intervals between the times that are checked.
    """
    from scipy.interpolate import make_interp_spline

    knots = np.asarray(times, dtype=float)
    spline = make_interp_spline(knots, np.asarray(positions, dtype=float), k=5)
    return check_trip(scenario, spline, float(knots[0]), float(knots[-1]), tolerances=tolerances, samples=samples)


def _as_mapping(scenario: Mapping[str, Any] | str | os.PathLike[str]) -> Mapping[str, Any]:
    if isinstance(scenario, Mapping):
        return scenario
    data: Mapping[str, Any] = json.loads(Path(scenario).read_text(encoding="utf-8"))
    return data


def _ends(
    data: Mapping[str, Any], times: Array, positions: Array, position: PositionFunction, allowed: Tolerances
) -> list[Finding]:
    start, goal = data["start"], data["goal"]
    begin, end = float(times[0]), float(times[-1])
    found = []

    def require(name: str, value: float, limit: float, excess: float, tolerance: float, time: float) -> None:
        found.append(Finding(name, value, limit, excess, tolerance, time))

    late = begin - float(start.get("time", 0.0))
    require("start_time", begin, begin - late, abs(late), 1e-9, begin)
    gap = float(np.linalg.norm(positions[0] - np.asarray(start["position"], dtype=float)))
    require("start_position", gap, 0.0, gap, allowed.position, begin)
    gap = float(np.linalg.norm(positions[-1] - np.asarray(goal["position"], dtype=float)))
    reach = float(goal.get("radius") or 0.0)
    require("goal_position", gap, reach, gap - reach, allowed.position, end)
    for name, sign in (("earliest_arrival", -1.0), ("latest_arrival", 1.0)):
        if goal.get(name) is not None:
            limit = float(goal[name])
            require(name, end, limit, sign * (end - limit), allowed.arrival, end)

    for name, place, when, order in (("start", start, begin, 1), ("goal", goal, end, -1)):
        if place.get("speed") is not None:
            speed = _end_speed(position, when, order * _end_window(position, when, order * END_WINDOW))
            gap = abs(speed - float(place["speed"]))
            require(f"{name}_speed", speed, float(place["speed"]), gap, allowed.boundary_speed, when)
        if place.get("heading") is not None:
            # Seen from the goal the chords point backwards.
            heading = _end_heading(position, positions[::order], when, order) + (0.0 if order == 1 else math.pi)
            gap = abs(math.remainder(heading - float(place["heading"]), 2.0 * math.pi))
            require(f"{name}_heading", heading, float(place["heading"]), gap, allowed.heading, when)
    return found


def _end_speed(position: PositionFunction, end: float, window: float) -> float:
    """Speed at an end, from the one-sided second-order difference over a window to the inside."""
    here, near, far = np.asarray(position(end + window * _THREE), dtype=float)
    velocity = (-3.0 * here + 4.0 * near - far) / (2.0 * window)
    return float(np.linalg.norm(velocity))


def _end_window(position: PositionFunction, end: float, window: float) -> float:
    """Length of a window to the inside of an end, s, that is shorter where the trip turns fast there."""
    here, near, far = np.asarray(position(end + window * _THREE), dtype=float)
    before, after = near - here, far - near
    turn = abs(math.atan2(before[0] * after[1] - before[1] * after[0], float(before @ after)))
    return abs(window) * min(1.0, END_TURN / turn) if turn > 0.0 else abs(window)


def _end_heading(position: PositionFunction, positions: Array, end: float, order: int) -> float:
    """Heading to the inside at an end, over two short chords, however far apart the samples are."""
    speed = _end_speed(position, end, order * END_WINDOW)
    if speed <= SLOW:
        distance = np.cumsum(np.linalg.norm(np.diff(positions, axis=0), axis=1))
        first = 1 + int(np.searchsorted(distance, END_CHORD))
        second = max(first + 1, 1 + int(np.searchsorted(distance, distance[min(first, len(distance)) - 1] + END_CHORD)))
        second = min(second, len(positions) - 1)
        return _first_heading(positions[[0, min(first, second - 1), second]])
    window = order * _end_window(position, end, order * END_CHORD / speed)
    return _first_heading(np.asarray(position(end + window * _THREE), dtype=float))


def _first_heading(three: Array) -> float:
    """Heading at the first of three points: the directions of two chords, extrapolated over arc length."""
    chords = np.diff(three, axis=0)
    first, second = np.arctan2(chords[:, 1], chords[:, 0])
    lengths = np.linalg.norm(chords, axis=1)
    turn = math.remainder(second - first, 2.0 * math.pi)
    return float(first - turn * lengths[0] / (lengths[0] + lengths[1]))


def _points_by_length(positions: Array) -> NDArray[np.intp]:
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


def _motion_limits(data: Mapping[str, Any], times: Array, positions: Array, allowed: Tolerances) -> list[Finding]:
    vehicle = data["vehicle"]
    step = float(times[1] - times[0])
    width = max(1, round(SPEED_WINDOW / step))
    apart = max(width, round(ACCELERATION_WINDOW / step))
    found = []

    def at_most(name: str, values: Array, limit: float, tolerance: float, when: Array) -> None:
        worst = int(np.argmax(values))
        value = float(values[worst])
        found.append(Finding(name, value, limit, value - limit, tolerance, float(when[worst])))

    displacements = positions[width:] - positions[:-width]
    chords = np.linalg.norm(displacements, axis=1)
    middles = (times[width:] + times[:-width]) / 2.0
    driven = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(positions, axis=0), axis=1))])
    speeds = (driven[width:] - driven[:-width]) / (width * step)
    at_most("speed", speeds, float(vehicle["max_speed"]), allowed.speed, middles)

    backward, when = _backward_speed(displacements, chords, width * step, middles)
    found.append(Finding("reversing", backward, 0.0, -backward, allowed.speed, when))

    rates = (speeds[apart:] - speeds[:-apart]) / (apart * step)
    between = (middles[apart:] + middles[:-apart]) / 2.0
    at_most("acceleration", rates, float(vehicle["max_acceleration"]), allowed.acceleration, between)
    at_most("deceleration", -rates, float(vehicle["max_deceleration"]), allowed.acceleration, between)
    if vehicle.get("max_jerk") is not None:
        far = max(1, round(RATE_WINDOW / step))
        jerks = np.abs(rates[far:] - rates[:-far]) / (far * step)
        at_most("jerk", jerks, float(vehicle["max_jerk"]), allowed.jerk, (between[far:] + between[:-far]) / 2.0)

    chosen = _points_by_length(positions)
    if chosen.size < 3:
        return found
    chords = np.diff(positions[chosen], axis=0)
    lengths = np.linalg.norm(chords, axis=1)
    headings = np.arctan2(chords[:, 1], chords[:, 0])
    turns = np.remainder(np.diff(headings) + np.pi, 2.0 * np.pi) - np.pi
    signed = turns / ((lengths[1:] + lengths[:-1]) / 2.0)
    curvatures = np.abs(signed)
    when_turning = times[chosen[1:-1]]
    mean_speeds = (lengths[1:] + lengths[:-1]) / (times[chosen[2:]] - times[chosen[:-2]])
    if vehicle.get("max_curvature") is not None:
        at_most("curvature", curvatures, float(vehicle["max_curvature"]), allowed.curvature, when_turning)
    if vehicle.get("max_curvature_rate") is not None:
        clock = np.arange(when_turning[0], when_turning[-1], RATE_WINDOW)
        changes = np.abs(np.diff(np.interp(clock, when_turning, signed))) / RATE_WINDOW
        at_most("curvature_rate", changes, float(vehicle["max_curvature_rate"]), allowed.curvature_rate, clock[1:])
    if vehicle.get("max_lateral_acceleration") is not None:
        limit = float(vehicle["max_lateral_acceleration"])
        lateral = curvatures * mean_speeds**2
        at_most("lateral_acceleration", lateral, limit, allowed.lateral_acceleration, when_turning)
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


def _disc_centres(data: Mapping[str, Any], positions: Array) -> list[Array]:
    """Centres (n, 2) of the vehicle's discs: so far ahead of the positions, along the direction of the way there.

    That direction is taken from chords by length about each position, as for the curvature: it is off by less than
    (rate of the curvature) (3 mm)^2 / 6.
    """
    offsets = [float(offset) for offset in data["vehicle"].get("discs") or (0.0,)]
    if offsets == [0.0]:
        return [positions]
    chosen = _points_by_length(positions)
    lengths = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(positions[chosen], axis=0), axis=1))])
    chords = np.diff(positions[chosen], axis=0)
    headings = np.unwrap(np.arctan2(chords[:, 1], chords[:, 0]))
    middles = (lengths[1:] + lengths[:-1]) / 2.0
    driven = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(positions, axis=0), axis=1))])
    driven *= lengths[-1] / driven[-1]
    heading = np.interp(driven, middles, headings)
    for beyond, (one, other) in ((driven < middles[0], (0, 1)), (driven > middles[-1], (-1, -2))):
        rate = (headings[other] - headings[one]) / (middles[other] - middles[one])
        heading[beyond] = headings[one] + rate * (driven[beyond] - middles[one])
    ahead = np.stack([np.cos(heading), np.sin(heading)], axis=1)
    return [positions + offset * ahead for offset in offsets]


def _place_speeds(data: Mapping[str, Any], times: Array, positions: Array, allowed: Tolerances) -> list[Finding]:
    """Speeds on chords of which both ends belong to a stretch of a line: nearest to a point of it."""
    step = float(times[1] - times[0])
    width = max(1, round(SPEED_WINDOW / step))
    speeds = np.linalg.norm(positions[width:] - positions[:-width], axis=1) / (width * step)
    found = []
    for number, limit in enumerate(data.get("speed_limits") or ()):
        line = limit.get("line") or data.get("guide") or (data["start"]["position"], data["goal"]["position"])
        along = _along(np.asarray(line, dtype=float), positions)
        inside = along >= float(limit["from"])
        if limit.get("to") is not None:
            inside &= along <= float(limit["to"])
        speed = np.where(inside[width:] & inside[:-width], speeds, 0.0)
        worst, top = int(np.argmax(speed)), float(limit["speed"])
        value, when = float(speed[worst]), float(times[worst])
        found.append(Finding("place_speed", value, top, value - top, allowed.speed, when, f"speed_limits[{number}]"))
    return found


def _along(line: Array, points: Array) -> Array:
    """How far along a polyline (k, 2) the points of it lie that are nearest to points (n, 2), (n,) m."""
    nearest, along = np.full(len(points), np.inf), np.zeros(len(points))
    driven = 0.0
    for begin, end in itertools.pairwise(line):
        length = float(np.linalg.norm(end - begin))
        share = np.clip((points - begin) @ (end - begin) / length**2, 0.0, 1.0)
        distance = np.linalg.norm(points - begin - share[:, None] * (end - begin), axis=1)
        along = np.where(distance < nearest, driven + share * length, along)
        nearest = np.minimum(nearest, distance)
        driven += length
    return along


def _workspace(data: Mapping[str, Any], times: Array, positions: Array, allowed: Tolerances) -> list[Finding]:
    bounds = data.get("bounds")
    if bounds is None:
        return []
    radius = float(data["vehicle"]["radius"])
    inside = np.minimum(
        (positions - np.asarray(bounds["min"], dtype=float)).min(axis=1),
        (np.asarray(bounds["max"], dtype=float) - positions).min(axis=1),
    )
    worst = int(np.argmin(inside))
    room = float(inside[worst]) - radius
    return [Finding("bounds", room, 0.0, -room, allowed.clearance, float(times[worst]))]


def _corridor(data: Mapping[str, Any], times: Array, positions: Array, allowed: Tolerances) -> list[Finding]:
    """Room to the border of the union of convex polygons, which is what of their edges lies in no other one."""
    polygons = [np.asarray(polygon, dtype=float) for polygon in data.get("corridor") or ()]
    if not polygons:
        return []
    distance = np.full(len(positions), np.inf)
    for number, polygon in enumerate(polygons):
        others = polygons[:number] + polygons[number + 1 :]
        for begin, end in zip(polygon, np.roll(polygon, -1, axis=0), strict=True):
            for first, last in _left_over(begin, end, others):
                a, b = begin + first * (end - begin), begin + last * (end - begin)
                share = np.clip((positions - a) @ (b - a) / ((b - a) @ (b - a)), 0.0, 1.0)
                distance = np.minimum(distance, np.linalg.norm(positions - a - share[:, None] * (b - a), axis=1))
    inside = np.any([_distance_to_polygon(positions, polygon) <= 0.0 for polygon in polygons], axis=0)
    room = np.where(inside, distance, -distance) - float(data["vehicle"]["radius"])
    worst = int(np.argmin(room))
    least = float(room[worst])
    return [Finding("corridor", least, 0.0, -least, allowed.clearance, float(times[worst]))]


def _left_over(begin: Array, end: Array, polygons: list[Array]) -> list[tuple[float, float]]:
    """Parts of a segment, as shares of it, that lie in none of some convex polygons."""
    parts = [(0.0, 1.0)]
    for polygon in polygons:
        first, last = 0.0, 1.0
        middle = polygon.mean(axis=0)
        for a, b in zip(polygon, np.roll(polygon, -1, axis=0), strict=True):
            normal = np.array([b[1] - a[1], a[0] - b[0]]) / np.linalg.norm(b - a)
            normal *= np.sign(normal @ (a - middle))
            out, change = float(normal @ (begin - a)) - 1e-9, float(normal @ (end - begin))
            if change > 0.0:
                last = min(last, -out / change)
            elif change < 0.0:
                first = max(first, -out / change)
            elif out > 0.0:
                last = -1.0
        if last > first:
            parts = [
                (low, high)
                for one, two in parts
                for low, high in ((one, min(two, first)), (max(one, last), two))
                if high - low > 1e-12
            ]
    return parts


def _clearances(
    data: Mapping[str, Any],
    times: Array,
    positions: Array,
    allowed: Tolerances,
    regions: Mapping[str, float],
) -> list[Finding]:
    radius = float(data["vehicle"]["radius"])
    found = []
    for obstacle in data.get("obstacles", ()):
        name = str(obstacle["id"])
        keep = radius + float(obstacle.get("margin") or 0.0)
        if name in regions and obstacle.get("motion") is not None:
            clearance = _distance_to_foretold(obstacle, times, positions, regions[name]) - keep
        elif obstacle.get("motion") is None and name in regions:
            clearance = _distance_to_observed(obstacle, times, positions, regions[name]) - keep
        else:
            clearance = _signed_distance(obstacle, times, positions) - keep
        worst = int(np.argmin(clearance))
        least = float(clearance[worst])
        found.append(Finding("clearance", least, 0.0, -least, allowed.clearance, float(times[worst]), name))
    return found


def _signed_distance(obstacle: Mapping[str, Any], times: Array, positions: Array) -> Array:
    """Distance (n,) from the points to the obstacle at the same times, m; negative inside."""
    name = obstacle["id"]
    motion = obstacle.get("motion")
    if motion is None:
        raise ValueError(f"obstacle {name!r} has no exact motion: give the size of its region")
    if "time" in motion:
        return _distance_on_course(obstacle, times, positions)
    velocity = np.asarray(motion.get("velocity", (0.0, 0.0)), dtype=float)
    acceleration = np.asarray(motion.get("acceleration", (0.0, 0.0)), dtype=float)
    clock = times[:, None]
    centres = np.asarray(motion["position"], dtype=float) + velocity * clock + acceleration * clock**2 / 2.0
    offsets = positions - centres
    shape = obstacle["shape"]
    if "disc" in shape:
        distances: Array = np.linalg.norm(offsets, axis=1) - float(shape["disc"])
        return distances
    if "polygon" in shape:
        return _distance_to_polygon(offsets, np.asarray(shape["polygon"], dtype=float))
    if "rectangle" in shape and not acceleration.any():
        length, width = (float(value) / 2.0 for value in shape["rectangle"])
        heading = math.atan2(velocity[1], velocity[0])
        axes = np.array([[math.cos(heading), -math.sin(heading)], [math.sin(heading), math.cos(heading)]])
        corners = np.array([[length, width], [-length, width], [-length, -width], [length, -width]])
        return _distance_to_polygon(offsets, corners @ axes.T)
    raise ValueError(f"obstacle {name!r}: this check does not know the shape {shape!r}")


def _on_course(motion: Mapping[str, Any], times: Array) -> tuple[Array, Array]:
    """Centres and velocities (n, 2) on the natural cubic spline through positions at times, straight on outside."""
    from scipy.interpolate import CubicSpline

    clock = np.asarray(motion["time"], dtype=float)
    spline = CubicSpline(clock, np.asarray(motion["position"], dtype=float), bc_type="natural")
    inside = np.clip(times, clock[0], clock[-1])
    velocities = spline(inside, 1)
    return spline(inside) + (times - inside)[:, None] * velocities, velocities


def _distance_on_course(obstacle: Mapping[str, Any], times: Array, positions: Array) -> Array:
    motion, shape, name = obstacle["motion"], obstacle["shape"], obstacle["id"]
    if motion.get("covariance") is not None:
        raise ValueError(f"obstacle {name!r} is not on its course for certain: give the size of its region")
    centres, velocities = _on_course(motion, times)
    offsets = positions - centres
    if "polygon" in shape:
        return _distance_to_polygon(offsets, np.asarray(shape["polygon"], dtype=float))
    if "disc" in shape:
        distances: Array = np.linalg.norm(offsets, axis=1) - float(shape["disc"])
        return distances
    if "rectangle" in shape and shape.get("heading") is None:
        length, width = (float(value) / 2.0 for value in shape["rectangle"])
        ahead = velocities / np.linalg.norm(velocities, axis=1)[:, None]
        along = np.abs((offsets * ahead).sum(axis=1)) - length
        across = np.abs(ahead[:, 0] * offsets[:, 1] - ahead[:, 1] * offsets[:, 0]) - width
        beyond = np.hypot(np.maximum(along, 0.0), np.maximum(across, 0.0))
        return beyond + np.minimum(np.maximum(along, across), 0.0)
    raise ValueError(f"obstacle {name!r}: this check does not know the shape {shape!r} on a course")


def _distance_to_foretold(obstacle: Mapping[str, Any], times: Array, positions: Array, region: float) -> Array:
    """Distance (n,) to a disc whose centre is in an ellipse about its course, of covariances linear in between."""
    motion = obstacle["motion"]
    if motion.get("covariance") is None or "disc" not in obstacle["shape"]:
        raise ValueError(f"obstacle {obstacle['id']!r}: only discs on courses with covariances have a region")
    clock = np.asarray(motion["time"], dtype=float)
    given = np.broadcast_to(np.asarray(motion["covariance"], dtype=float), (clock.size, 2, 2)).reshape(-1, 4)
    errors = np.stack([np.interp(times, clock, column) for column in given.T], axis=1).reshape(-1, 2, 2)
    offsets = positions - _on_course(motion, times)[0]
    return _distance_to_ellipses(offsets, region * errors) - float(obstacle["shape"]["disc"])


def _distance_to_polygon(points: Array, corners: Array) -> Array:
    """Signed distance (n,) from points (n, 2) to a simple polygon (m, 2); negative inside."""
    nearest = np.full(points.shape[0], np.inf)
    inside = np.zeros(points.shape[0], dtype=bool)
    for begin, end in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        edge = end - begin
        share = np.clip((points - begin) @ edge / (edge @ edge), 0.0, 1.0)
        nearest = np.minimum(nearest, np.linalg.norm(points - begin - share[:, None] * edge, axis=1))
        # Even-odd rule: count the edges that a ray in +x crosses.
        straddles = (begin[1] > points[:, 1]) != (end[1] > points[:, 1])
        if edge[1] != 0.0:
            crossing = begin[0] + edge[0] * (points[:, 1] - begin[1]) / edge[1]
            inside ^= straddles & (points[:, 0] < crossing)
    return np.where(inside, -nearest, nearest)


def _distance_to_observed(obstacle: Mapping[str, Any], times: Array, positions: Array, region: float) -> Array:
    """Distance (n,) to a disc whose centre is somewhere in the confidence ellipse; negative inside.

    The centre moves as a polynomial, fitted to the observations by generalised least squares; what is known beforehand
    of velocity and acceleration at the last of them counts like observations of these.
    """
    name, model = obstacle["id"], obstacle.get("model") or {}
    seen = obstacle.get("observations")
    if seen is None or seen.get("covariance") is None or "disc" not in obstacle["shape"]:
        raise ValueError(f"obstacle {name!r}: only discs with observations of known covariance can be checked")
    if model.get("process") is not None:
        raise ValueError(f"obstacle {name!r}: this check does not know process noise")
    order = int(model.get("order", 2))
    observed = np.asarray(seen["position"], dtype=float)
    when = np.asarray(seen["time"], dtype=float)
    covariance = np.broadcast_to(np.asarray(seen["covariance"], dtype=float), (when.size, 2, 2))
    weights = np.linalg.inv(covariance)
    # Times are shifted and scaled to [-1, 1] over the observations: the normal equations keep their digits.
    middle, half = (when.max() + when.min()) / 2.0, (when.max() - when.min()) / 2.0 or 1.0
    rows = np.vander((when - middle) / half, order + 1, increasing=True)
    # Unknowns: coefficients (order + 1, 2), flattened.
    size = 2 * (order + 1)
    information = np.einsum("ni,nj,nab->iajb", rows, rows, weights)
    moments = np.einsum("ni,nab,nb->ia", rows, weights, observed)
    for derivative, what in ((1, "velocity"), (2, "acceleration")):
        deviation = (model.get("prior") or {}).get(f"{what}_deviation")
        if deviation is not None and derivative <= order:
            powers = np.eye(order + 1)
            row = [np.polynomial.polynomial.polyder(power, derivative) for power in powers]
            last = np.array([np.polynomial.polynomial.polyval((when.max() - middle) / half, each) for each in row])
            last /= half**derivative
            information += np.einsum("i,j,ab->iajb", last, last, np.eye(2) / float(deviation) ** 2)
            mean = np.asarray(model["prior"].get(what) or (0.0, 0.0), dtype=float)
            moments += np.outer(last, mean / float(deviation) ** 2)
    information = information.reshape(size, size)
    fitted = np.linalg.solve(information, moments.ravel())
    spread = np.linalg.inv(information).reshape(order + 1, 2, order + 1, 2)
    powers = np.vander((times - middle) / half, order + 1, increasing=True)
    centres = powers @ fitted.reshape(order + 1, 2)
    errors = np.einsum("ni,iajb,nj->nab", powers, spread, powers)
    # A change of acceleration may begin with the last observation, in proportion to the noise.
    noise = covariance.mean(axis=0)
    change = float(model.get("manoeuvre") or 0.0) ** 2 * noise / np.linalg.eigvalsh(noise)[0]
    errors = region * (errors + ((times - when.max()) ** 4 / 4.0)[:, None, None] * change)
    return _distance_to_ellipses(positions - centres, errors) - float(obstacle["shape"]["disc"])


def _distance_to_ellipses(points: Array, matrices: Array) -> Array:
    """Distance (n,) from points (n, 2) to the ellipses z' M^-1 z <= 1 of matrices (n, 2, 2); zero inside.

    Along the axes of the ellipse, of half lengths a and b, its nearest point to y is
    (a^2 y1 / (a^2 + t), b^2 y2 / (b^2 + t)), t >= 0 the root of a decreasing function: bisection.
    """
    squares, axes = np.linalg.eigh(matrices)
    local = np.abs(np.einsum("nij,ni->nj", axes, points))
    outside = (local**2 / squares).sum(axis=1) > 1.0
    low = np.zeros(points.shape[0])
    high = np.linalg.norm(local, axis=1) * np.sqrt(squares[:, 1])
    for _ in range(80):
        t = (low + high) / 2.0
        beyond = (squares * local**2 / (squares + t[:, None]) ** 2).sum(axis=1) > 1.0
        low, high = np.where(beyond, t, low), np.where(beyond, high, t)
    nearest = squares * local / (squares + high[:, None])
    distances: Array = np.where(outside, np.linalg.norm(local - nearest, axis=1), 0.0)
    return distances
