"""Where a vehicle may be and how fast: its discs, speed limits of places, the workspace and the corridor."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from verification.differences import SPEED_WINDOW, Array
from verification.distances import distance_to_polygon
from verification.findings import Finding, Tolerances, find_least_room, find_worst

LITTLE = 0.05  # of a chord, by which the next ones may change it
ROUNDED = 1e6 * np.finfo(float).eps  # of the coordinates: shorter steps have no direction to a millionth


def disc_centres(data: Mapping[str, Any], positions: Array, headings: Array | None = None) -> list[Array]:
    """Centres (n, 2) of the vehicle's discs: so far ahead of the positions, along the headings (n,), if given.

    Without headings, they are along the direction of the way there.

    That direction is that of the velocity by central differences, of fourth order where that changes little: not where
    the vehicle is about to stand or to set out. Where rounding leaves little of them, it goes straight over the way
    driven from what it is before to what it is after.
    """
    offsets = [float(offset) for offset in data["vehicle"].get("discs") or (0.0,)]
    if offsets == [0.0]:
        return [positions]
    if headings is not None:
        axis = np.stack([np.cos(headings), np.sin(headings)], axis=1)
        return [positions + offset * axis for offset in offsets]
    chords = positions[3:-1] - positions[1:-3]
    more = (chords + chords - positions[4:] + positions[:-4]) / 6.0  # of what they are in two steps
    lengths = np.linalg.norm(chords, axis=1)
    moved = chords + np.where(np.linalg.norm(more, axis=1) < LITTLE * lengths, more.T, 0.0).T
    told = np.flatnonzero(lengths > ROUNDED * np.abs(positions).max())
    stands = data["start"].get("heading")
    if told.size < 2 and stands is None:
        raise ValueError("the vehicle hardly moves, and start.heading is not given: where its discs are is not known")
    if told.size < 2:
        return [positions + offset * np.array([math.cos(stands), math.sin(stands)]) for offset in offsets]
    driven = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(positions, axis=0), axis=1))])
    headings, places = np.unwrap(np.arctan2(moved[told, 1], moved[told, 0])), driven[told + 2]
    heading = np.interp(driven, places, headings)
    for beyond, (one, other) in ((driven < places[0], (0, 1)), (driven > places[-1], (-1, -2))):
        rate = (headings[other] - headings[one]) / (places[other] - places[one])
        heading[beyond] = headings[one] + rate * (driven[beyond] - places[one])
    ahead = np.stack([np.cos(heading), np.sin(heading)], axis=1)
    return [positions + offset * ahead for offset in offsets]


def place_speeds(
    data: Mapping[str, Any], times: Array, positions: Array, allowed: Tolerances, excused: Array | None = None
) -> list[Finding]:
    """Speeds on chords of which both ends belong to a stretch of a line: nearest to a point of it.

    Speeds up to those ``excused``, (n,) m/s, break no limit.
    """
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
        speed, top = np.where(inside[width:] & inside[:-width], speeds, 0.0), float(limit["speed"])
        if excused is not None:
            speed -= np.maximum(np.maximum(excused[:-width], excused[width:]) - top, 0.0)
        name = f"speed_limits[{number}]"
        found += find_worst("place_speed", speed, top, allowed.speed, times[:-width], subject=name)
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


def workspace(
    data: Mapping[str, Any], times: Array, positions: Array, allowed: Tolerances, *, falling: bool = False
) -> list[Finding]:
    """Least room to the bounds, if there are any."""
    bounds = data.get("bounds")
    if bounds is None:
        return []
    radius = float(data["vehicle"]["radius"])
    inside = np.minimum(
        (positions - np.asarray(bounds["min"], dtype=float)).min(axis=1),
        (np.asarray(bounds["max"], dtype=float) - positions).min(axis=1),
    )
    return [find_least_room("bounds", inside - radius, allowed.clearance, times, falling=falling)]


def corridor(
    data: Mapping[str, Any], times: Array, positions: Array, allowed: Tolerances, *, falling: bool = False
) -> list[Finding]:
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
    inside = np.any([distance_to_polygon(positions, polygon) <= 0.0 for polygon in polygons], axis=0)
    room = np.where(inside, distance, -distance) - float(data["vehicle"]["radius"])
    return [find_least_room("corridor", room, allowed.clearance, times, falling=falling)]


def walls(
    data: Mapping[str, Any], times: Array, positions: Array, allowed: Tolerances, *, falling: bool = False
) -> list[Finding]:
    """Least room to each wall."""
    radius, found = float(data["vehicle"]["radius"]), []
    for number, polygon in enumerate(data.get("walls") or ()):
        room = distance_to_polygon(positions, np.asarray(polygon, dtype=float)) - radius
        subject = f"walls[{number}]"
        found.append(find_least_room("walls", room, allowed.clearance, times, subject=subject, falling=falling))
    return found


def occupied(
    data: Mapping[str, Any], times: Array, positions: Array, allowed: Tolerances, ground: Any, *, falling: bool = False
) -> list[Finding]:
    """Least room to a shapely geometry of occupied ground, by shapely."""
    if ground is None or ground.is_empty:
        return []
    import shapely

    shapely.prepare(ground)
    room = shapely.distance(ground, shapely.points(positions)) - float(data["vehicle"]["radius"])
    return [find_least_room("ground", room, allowed.clearance, times, falling=falling)]


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
