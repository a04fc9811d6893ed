"""Lines of routes on CommonRoad's maps, and where they come into a goal's region."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, TypeAlias

import numpy as np

from scp_planner.arrays import Array
from scp_planner.scenario.commonroad_roads import GUIDE_STEP, spaced
from scp_planner.scenario.goals import aim_at

Point: TypeAlias = tuple[float, float]

INSIDE = 0.01
"""Of the size of a goal's region: how far inside its border the line ends."""


def entry(line: Array, places: Sequence[Any], start: Point, soonest: float) -> tuple[Point, Any, Array]:
    """Return where a line first comes into one of some polygons, that polygon, and the line up to there.

    If the vehicle may not arrive before it would have driven ``soonest`` metres at its speed, it is so far on the line,
    as long as that is inside.
    """
    from shapely import LineString
    from shapely import Point as ShapelyPoint

    if len(line) > 1:
        curve = LineString(line)
        crossed = [(_stretch(curve, place), place) for place in places if curve.intersection(place).length > 0.0]
        if crossed:
            (first, last), place = min(crossed, key=lambda one: one[0])
            margin = min(INSIDE * math.sqrt(place.area), 0.25 * (last - first))
            at = curve.interpolate(min(max(first + margin, soonest), last - margin))
            return (at.x, at.y), place, cut(line, curve.project(at))
    origin = start if len(line) < 2 else (float(line[-1, 0]), float(line[-1, 1]))
    nearest = min(places, key=lambda place: place.distance(ShapelyPoint(origin)))
    return aim_at(_ring(nearest), origin), nearest, line


def _stretch(curve: Any, place: Any) -> tuple[float, float]:
    """From where to where a line is in a polygon for the first time, m along the line."""
    from shapely import Point as ShapelyPoint

    inside = curve.intersection(place)
    parts = [part for part in getattr(inside, "geoms", [inside]) if part.length > 0.0]
    ends = [[curve.project(ShapelyPoint(part.coords[k])) for k in (0, -1)] for part in parts]
    stretches = sorted((min(pair), max(pair)) for pair in ends)
    return stretches[0]


def _ring(polygon: Any) -> list[Point]:
    return [(float(x), float(y)) for x, y in polygon.exterior.coords[:-1]]


def from_beside(line: Array, start: Point, length: float) -> Array:
    """Return a line, (k, 2) m, that begins at the start, beside it, and is where it was after so many metres."""
    if len(line) < 2:
        return line
    line = spaced(line)
    stations = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1))])
    share = np.minimum(stations / max(length, 2.0 * GUIDE_STEP), 1.0)
    away = 1.0 - share * share * (3.0 - 2.0 * share)
    return line + away[:, None] * (np.asarray(start) - line[0])


def cut(line: Array, length: float) -> Array:
    """Return a polyline, (k, 2) m, up to a length, m."""
    stations = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1))])
    inner = line[(stations < length)]
    end = [np.interp(min(length, stations[-1]), stations, line[:, axis]) for axis in (0, 1)]
    return np.vstack([inner, [end]]) if len(inner) else np.array([line[0], end])


def point_ahead(point: Point, heading: float, distance: float) -> Point:
    """Return the point so far ahead of another, m."""
    return (point[0] + distance * math.cos(heading), point[1] + distance * math.sin(heading))


def rectangle(middle: Point, heading: float, length: float, width: float) -> Any:
    """Return a rectangle about its middle, a polygon of shapely, m."""
    from shapely import Polygon

    c, s = math.cos(heading), math.sin(heading)
    corners = [(x * length / 2, y * width / 2) for x, y in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
    return Polygon([(middle[0] + c * x - s * y, middle[1] + s * x + c * y) for x, y in corners])
