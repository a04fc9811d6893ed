"""Guides on CommonRoad's maps: what a car drives that is steered along the line of a route, into a goal's region."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from scp_planner.arrays import Array, Mask, unit_vectors
from scp_planner.formats.commonroad.roads import ROADS, Point, spaced, steps_in
from scp_planner.mathematics.polylines import lengths_along


@dataclass(frozen=True)
class LineParameters:
    inside: float = 0.01  # Of the size of a goal's region: how far inside its border the guide ends
    # Of the radius of the largest disc in a goal's region: what the line is led through lies so far inside
    core: float = 0.5
    stride: float = 0.1  # Lengths of the car, of a step in which it is steered
    sight: float = 1.2  # Lengths of the car: how far ahead on the line it is steered to, at least
    sight_time: float = 0.4  # s of the file, at the speed of the start: how far ahead it looks where that is farther
    # Times the length of the line, after which a car that does not get to its end is no longer steered
    longest: float = 3.0


LINES = LineParameters()


@dataclass(frozen=True)
class SteeredCar:
    """A car that is steered."""

    length: float  # m
    ahead: float  # of its middle from its reference point, m
    bend: float  # largest curvature of the reference point's path, 1/m
    sight: float  # distance that it is steered to, m


@dataclass(frozen=True)
class DrivenLine:
    places: Array  # of the reference point, (k, 2) m
    headings: Array  # (k,) rad
    middles: Array  # of the car, (k, 2) m
    stations: Array  # driven until there, (k,) m


@dataclass(frozen=True)
class Arrival:
    index: int  # of the drive
    place: Any  # shapely polygon of the goal


def driven(line: Array, start: Point, heading: float, car: SteeredCar) -> DrivenLine:
    """Return what a car drives that is steered along a line, (k, 2) m, by pure pursuit."""
    # Coulter, "Implementation of the pure pursuit path tracking algorithm", CMU-RI-TR-92-01, 1992.
    stride = LINES.stride * car.length
    target = _continued(line, stride, car.sight)
    last = len(target) - 1 - steps_in(car.sight, stride)
    x, y, turn, at = start[0], start[1], heading, 0
    near, poses = steps_in(2.0 * car.sight, stride), [(x, y, turn)]
    for _ in range(math.ceil(LINES.longest * len(target))):
        away = np.hypot(target[at : at + near, 0] - x, target[at : at + near, 1] - y)
        nearest = int(away.argmin())
        at += nearest
        if at >= last:
            break
        ahead = np.flatnonzero(away[nearest:] >= car.sight)
        goal = target[at + int(ahead[0])] if len(ahead) else target[min(at + near, len(target)) - 1]
        reach = math.hypot(goal[0] - x, goal[1] - y)
        side = math.sin(math.atan2(goal[1] - y, goal[0] - x) - turn)
        behind = math.cos(math.atan2(goal[1] - y, goal[0] - x) - turn) < 0.0
        bend = math.copysign(car.bend, side) if behind else 2.0 * side / reach
        step = stride * max(min(bend, car.bend), -car.bend)
        x, y = x + stride * math.cos(turn + 0.5 * step), y + stride * math.sin(turn + 0.5 * step)
        turn += step
        poses.append((x, y, turn))
    table = np.array(poses)
    headings = table[:, 2]
    along = unit_vectors(headings)
    stations = np.linspace(0.0, stride * (len(table) - 1), len(table))
    return DrivenLine(table[:, :2], headings, table[:, :2] + car.ahead * along, stations)


def _continued(line: Array, step: float, length: float) -> Array:
    """A line with points at a distance, and straight on beyond its end, m."""
    points = spaced(line, step)
    leg = (points[-1] - points[-2]) / math.dist(points[-1], points[-2])
    beyond = points[-1] + step * np.arange(1, steps_in(length, step) + 1)[:, None] * leg
    return np.vstack([points, beyond])


def arrival(drive: DrivenLine, places: Sequence[Any], turned: Array, soonest: float, depth: float) -> Arrival:
    """Return where a drive comes into one of some polygons with a heading that is allowed, or nearest to that."""
    from shapely import contains_xy, distance, points

    found: list[tuple[tuple[float, float, float], Arrival]] = []
    for place in places:
        inner = place.buffer(-LINES.inside * math.sqrt(place.area))
        inside = contains_xy(inner if inner.area > 0.0 else place, drive.middles[:, 0], drive.middles[:, 1])
        if not inside.any():
            away = distance(place, points(drive.middles))
            index = int(away.argmin())
            found.append(((float(away[index]), 0.0, drive.stations[index]), Arrival(index, place)))
            continue
        least = float(turned[inside].min())
        fits = _first_stretch(inside & (turned <= least))
        late = fits[drive.stations[fits] >= soonest]
        left = late if len(late) else fits[-1:]
        index = int(left[round(depth * (len(left) - 1))])
        found.append(((0.0, least, drive.stations[index]), Arrival(index, place)))
    return min(found, key=lambda one: one[0])[1]


def turned_too_far(headings: Array, allowed: Point | None, share: float) -> Array:
    """Return by how much headings, (k,) rad, are outside of a share of a range, (k,) rad; 0 without a range."""
    if allowed is None or math.isinf(share):
        return np.zeros(len(headings))
    middle, half = 0.5 * (allowed[0] + allowed[1]), 0.5 * (allowed[1] - allowed[0])
    away = np.abs(np.mod(headings - middle + math.pi, 2.0 * math.pi) - math.pi)
    return np.asarray(np.maximum(away - share * half, 0.0))


def _first_stretch(marks: Mask) -> Any:
    """Indices of the first marks that stand side by side."""
    found = np.flatnonzero(marks)
    gaps = np.flatnonzero(np.diff(found) > 1)
    return found[: gaps[0] + 1] if len(gaps) else found


def led_through(line: Array, places: Sequence[Any], length: float) -> Array:
    """Return a line, (k, 2) m, that is moved aside, over some metres, to lead through the core of the nearest place."""
    from shapely import LineString, maximum_inscribed_circle
    from shapely.ops import nearest_points

    curve = LineString(line)
    place = min(places, key=lambda one: (one.distance(curve), -one.intersection(curve).length))
    core = place.buffer(-LINES.core * maximum_inscribed_circle(place).length)
    if core.is_empty or core.intersects(curve):
        return line
    on_line, inside = nearest_points(curve, core)
    line = spaced(line, ROADS.guide_step)
    share = np.clip((lengths_along(line) - curve.project(on_line)) / length + 1.0, 0.0, 1.0)
    return line + (share * share * (3.0 - 2.0 * share))[:, None] * np.array(
        [inside.x - on_line.x, inside.y - on_line.y]
    )


def heading_near(line: Array, place: Any) -> float:
    """Return the direction of a line, (k, 2) m, beside the middle of a polygon, rad."""
    middle = place.representative_point()
    nearest = int(np.hypot(line[:, 0] - middle.x, line[:, 1] - middle.y).argmin())
    last = max(nearest, 1)
    leg = line[last] - line[last - 1]
    return math.atan2(leg[1], leg[0])


def point_ahead(point: Point, heading: float, distance: float) -> Point:
    """Return the point so far ahead of another, m."""
    return (point[0] + distance * math.cos(heading), point[1] + distance * math.sin(heading))


def rectangle(middle: Point, heading: float, length: float, width: float) -> Any:
    """Return a rectangle about its middle, a polygon of shapely, m."""
    from shapely import Polygon

    c, s = math.cos(heading), math.sin(heading)
    corners = [(x * length / 2, y * width / 2) for x, y in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
    return Polygon([(middle[0] + c * x - s * y, middle[1] + s * x + c * y) for x, y in corners])
