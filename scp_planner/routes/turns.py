"""Turns at the ends of a route: arcs from a heading onto its first leg, and loops where there is no room for a leg."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from math import atan2, ceil, cos, hypot, pi, sin, sqrt

import numpy as np

from scp_planner.arrays import Array
from scp_planner.mathematics.dubins import ARCS, Pose, shortest_paths

Clear = Callable[[Array], bool]
"""True if a polyline, (n, 2) m, may be driven."""


@dataclass(frozen=True)
class TurnSettings:
    """Turns that are made, and their radii."""

    askew: float = 0.7  # rad; a leg that misses the heading by less is bent into it by the path
    smaller: tuple[float, ...] = (1.0, 0.6, 0.35, 0.2, 0.1, 0.05)  # of the wanted radius: the first that has room
    steep: float = 1.05  # rad; a goal that is so far off the heading, and nearer than
    near: float = 6.0  # radii, takes a loop
    same: float = 1e-3  # radii; an arc that ends so near to its target ends there
    tightest: float = 1.05  # times the least radius of the vehicle: guides along loops have no more


TURNS = TurnSettings()


def radii(wanted: float, least: float) -> list[float]:
    """Radii to try, the widest first, none less than a little above the vehicle's least, m."""
    tightest = TURNS.tightest * least
    found = [wanted * share for share in TURNS.smaller if wanted * share > tightest]
    return [*found, tightest] if least > 0.0 else found


def misses(leg: Array, heading: float | None) -> bool:
    """True if a leg, (2,) m, leads elsewhere than a heading, rad."""
    if heading is None:
        return False
    return float(leg @ [cos(heading), sin(heading)]) < cos(TURNS.askew) * float(np.hypot(*leg))


def turned_into(points: Array, ends: Sequence[tuple[float | None, list[float]]], clear: Clear) -> Array:
    """Return a route that begins and ends along headings, rad, by an arc of the first of some radii that has room."""
    (first, widest_first), (last, widest_last) = ends
    if misses(points[1] - points[0], first):
        assert first is not None
        points = _turned(points, first, widest_first, clear)
    if misses(points[-1] - points[-2], last):
        assert last is not None
        points = _turned(points[::-1], last + pi, widest_last, clear)[::-1]
    return points


def _turned(points: Array, heading: float, turns: list[float], clear: Clear) -> Array:
    """A route that begins along a heading."""
    found = None
    for radius in turns:
        for arc in arcs_to(points[0], heading, points[1], radius):
            found = np.concatenate([arc, points[2:]])
            if clear(arc):
                return found
    return points if found is None else found


def arcs_to(start: Array, heading: float, target: Array, radius: float) -> Iterator[Array]:
    """Yield an arc and a straight leg to a point, to either side, the shorter first; none to points in the circle."""
    found = []
    for side in (1.0, -1.0):
        centre = start + side * radius * np.array([-sin(heading), cos(heading)])
        away = target - centre
        distance = hypot(*away)
        if distance < radius * (1.0 + 1e-6):
            continue
        straight = sqrt(distance**2 - radius**2)
        # Heading at which the tangent leaves the circle
        leaving = atan2(away[1], away[0]) + side * atan2(radius, straight)
        turn = (side * (leaving - heading)) % (2.0 * pi)
        at = heading + side * turn * np.linspace(0.0, 1.0, ceil(turn / ARCS.step) + 1)
        arc = centre + side * radius * np.stack([np.sin(at), -np.cos(at)], axis=1)
        found.append((turn * radius + straight, arc))
    for _, arc in sorted(found, key=lambda one: one[0]):
        ends = hypot(*(arc[-1] - target)) < TURNS.same * radius
        yield np.concatenate([arc[:-1] if ends else arc, target[None]])


def out_of_reach(start: Array, heading: float | None, goal: Array, near: float, radius: float) -> bool:
    """True if a vehicle of a least turning radius, m, has to make a loop to come near to a goal by so many m."""
    if heading is None or radius == 0.0:
        return False
    away, normal = goal - start, radius * np.array([-sin(heading), cos(heading)])
    far = hypot(*away)
    ahead = float(away @ [cos(heading), sin(heading)])
    behind = far < TURNS.near * radius and ahead < cos(TURNS.steep) * far
    return behind or any(hypot(*(away - side * normal)) + near < radius for side in (1.0, -1.0))


def loops(start: Pose, goal: Pose, turns: list[float], clear: Clear) -> Iterator[tuple[float, Array]]:
    """Yield loops by their lengths, m, the shortest first, those with the widest arcs that have room."""
    found: dict[str, tuple[float, Array]] = {}
    for radius in turns:
        for word, path in shortest_paths(start, goal, radius).items():
            if word not in found and clear(path.points):
                found[word] = (path.length, path.points)
    yield from sorted(found.values(), key=lambda one: one[0])
