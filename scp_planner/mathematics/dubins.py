"""Shortest paths of bounded curvature between two headings: three pieces, each an arc or straight (Dubins, 1957)."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from math import acos, atan2, ceil, cos, hypot, pi, sin, sqrt

import numpy as np

from scp_planner.arrays import Array


@dataclass(frozen=True)
class Arcs:
    """Points of arcs, and headings that are tried."""

    step: float = 0.12  # rad, between points of an arc
    free_headings: int = 24  # tried where an end has none


ARCS = Arcs()
SAME_LENGTH = 1e-9  # radii; a path that is so little shorter is none
APART = 1e-7  # radii, that ends are apart at least: turns to nearer ones are full turns by rounding, or none


@dataclass(frozen=True)
class Pose:
    """A place in m and a heading in rad; None: free."""

    position: tuple[float, float]
    heading: float | None


def shortest_path(start: Pose, goal: Pose, radius: float) -> Array:
    """Return points of the shortest path whose arcs have a radius, (n, 2) m."""
    best: DubinsPath | None = None
    for path in shortest_paths(start, goal, radius).values():
        if best is None or path.length < best.length - SAME_LENGTH * radius:
            best = path
    assert best is not None, "two pairs of equal turns and a straight piece between them always lead there"
    return best.points


@dataclass(frozen=True)
class DubinsPath:
    """A path of arcs and straight pieces: its length, m, and its points, (n, 2) m."""

    length: float
    points: Array


def shortest_paths(start: Pose, goal: Pose, radius: float) -> dict[str, DubinsPath]:
    """Return the shortest path of each word, such as LSR: left, straight, right."""
    best: dict[str, tuple[float, float, tuple[float, float, float]]] = {}
    for first in _headings(start):
        for last in _headings(goal):
            for word, pieces in _words(start.position, first, goal.position, last, radius):
                length = sum(pieces)
                if word not in best or length < best[word][0] - SAME_LENGTH:
                    best[word] = (length, first, pieces)
    return {
        word: DubinsPath(length * radius, _points(start.position, heading, word, pieces, radius))
        for word, (length, heading, pieces) in best.items()
    }


def _headings(pose: Pose) -> list[float]:
    if pose.heading is not None:
        return [pose.heading]
    return [2.0 * pi * k / ARCS.free_headings for k in range(ARCS.free_headings)]


def _words(
    start: tuple[float, float], first: float, goal: tuple[float, float], last: float, radius: float
) -> Iterator[tuple[str, tuple[float, float, float]]]:
    """All paths of three pieces, their lengths relative to the radius (Shkel and Lumelsky, 2001)."""
    dx, dy = goal[0] - start[0], goal[1] - start[1]
    d, toward = max(hypot(dx, dy) / radius, APART), atan2(dy, dx)
    a, b = first - toward, last - toward
    sa, sb, ca, cb, cab = sin(a), sin(b), cos(a), cos(b), cos(a - b)
    square = 2.0 + d * d - 2.0 * cab + 2.0 * d * (sa - sb)
    if square >= 0.0:
        turn = atan2(cb - ca, d + sa - sb)
        yield "LSL", (_turn(turn - a), sqrt(square), _turn(b - turn))
    square = 2.0 + d * d - 2.0 * cab + 2.0 * d * (sb - sa)
    if square >= 0.0:
        turn = atan2(ca - cb, d - sa + sb)
        yield "RSR", (_turn(a - turn), sqrt(square), _turn(turn - b))
    square = d * d - 2.0 + 2.0 * cab + 2.0 * d * (sa + sb)
    if square >= 0.0:
        p = sqrt(square)
        turn = atan2(-ca - cb, d + sa + sb) - atan2(-2.0, p)
        yield "LSR", (_turn(turn - a), p, _turn(turn - b))
    square = d * d - 2.0 + 2.0 * cab - 2.0 * d * (sa + sb)
    if square >= 0.0:
        p = sqrt(square)
        turn = atan2(ca + cb, d - sa - sb) - atan2(2.0, p)
        yield "RSL", (_turn(a - turn), p, _turn(b - turn))
    cosine = (6.0 - d * d + 2.0 * cab + 2.0 * d * (sa - sb)) / 8.0
    if abs(cosine) <= 1.0:
        p = _turn(2.0 * pi - acos(cosine))
        t = _turn(a - atan2(ca - cb, d - sa + sb) + 0.5 * p)
        yield "RLR", (t, p, _turn(a - b - t + p))
    cosine = (6.0 - d * d + 2.0 * cab + 2.0 * d * (sb - sa)) / 8.0
    if abs(cosine) <= 1.0:
        p = _turn(2.0 * pi - acos(cosine))
        t = _turn(-a - atan2(ca - cb, d + sa - sb) + 0.5 * p)
        yield "LRL", (t, p, _turn(_turn(b) - a - t + p))


def _turn(angle: float) -> float:
    """An angle in [0, 2 pi); a full turn by rounding is none."""
    angle %= 2.0 * pi
    return 0.0 if 2.0 * pi - angle < 1e-9 else angle


def _points(
    start: tuple[float, float], heading: float, word: str, pieces: tuple[float, float, float], radius: float
) -> Array:
    (x, y), points = start, [start]
    for kind, length in zip(word, pieces, strict=True):
        if length <= 1e-9:
            continue
        if kind == "S":
            x, y = x + radius * length * cos(heading), y + radius * length * sin(heading)
            points.append((x, y))
            continue
        side = 1.0 if kind == "L" else -1.0
        center = (x - side * radius * sin(heading), y + side * radius * cos(heading))
        steps = ceil(length / ARCS.step)
        for k in range(1, steps + 1):
            at = heading + side * length * k / steps
            points.append((center[0] + side * radius * sin(at), center[1] - side * radius * cos(at)))
        heading += side * length
        x, y = points[-1]
    return np.array(points)
