"""Plane geometry of points, polygons and ellipses in plain Python: what the checks of a scenario need."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from itertools import pairwise

from scp_planner.mathematics.tolerances import SAME_DIRECTION

Point = tuple[float, float]


def turned(point: Point, angle: float) -> Point:
    """Turn a point anticlockwise about the origin by an angle in rad."""
    cos, sin = math.cos(angle), math.sin(angle)
    return cos * point[0] - sin * point[1], sin * point[0] + cos * point[1]


def area(polygon: Sequence[Point]) -> float:
    """Compute the signed area of a polygon in m2, positive if its vertices run anticlockwise."""
    x0, y0 = polygon[0]  # relative to a vertex: far from the origin the products would cancel
    return 0.5 * sum((ax - x0) * (by - y0) - (bx - x0) * (ay - y0) for (ax, ay), (bx, by) in edges(polygon))


def centroid(polygon: Sequence[Point]) -> Point:
    """Compute the centre of the area of a simple polygon."""
    x0, y0 = polygon[0]
    sides = [((ax - x0, ay - y0), (bx - x0, by - y0)) for (ax, ay), (bx, by) in edges(polygon)]
    weights = [a[0] * b[1] - a[1] * b[0] for a, b in sides]
    total = 3.0 * sum(weights)
    x = sum(w * (a[0] + b[0]) for w, (a, b) in zip(weights, sides, strict=True)) / total
    y = sum(w * (a[1] + b[1]) for w, (a, b) in zip(weights, sides, strict=True)) / total
    return x0 + x, y0 + y


def first_crossing(polygon: Sequence[Point]) -> tuple[int, int] | None:
    """Find two edges that touch but are no neighbours, or that fold back; edge i leaves vertex i."""
    sides = edges(polygon)
    count = len(sides)
    found: list[tuple[int, int]] = []
    for j, (shared, after) in enumerate(sides):
        before = sides[j - 1][0]
        first, last = (before, after) if j else (after, before)
        if _turn(first, shared, last) == 0 and _dot(shared, first, last) > 0:
            found.append((j - 1, j) if j else (0, count - 1))
    for i, j in _near(sides):
        if j - i not in (1, count - 1) and _touch(*sides[i], *sides[j]):
            found.append((i, j))
    return min(found, default=None)


def _near(segments: Sequence[tuple[Point, Point]]) -> Iterator[tuple[int, int]]:
    """Yield the pairs i < j of segments whose boxes along the axes overlap."""
    boxes = []
    for number, ((ax, ay), (bx, by)) in enumerate(segments):
        boxes.append((min(ax, bx), max(ax, bx), min(ay, by), max(ay, by), number))
    boxes.sort()
    for place, (_, right, low, high, i) in enumerate(boxes):
        for k in range(place + 1, len(boxes)):
            left, _, lower, upper, j = boxes[k]
            if left > right:
                break
            if lower <= high and low <= upper:
                yield (i, j) if i < j else (j, i)


def distance_to_polygon(point: Point, polygon: Sequence[Point]) -> float:
    """Compute the distance in m from a point to a filled simple polygon; 0 inside."""
    x, y = point
    inside = False
    for (ax, ay), (bx, by) in edges(polygon):
        if (ay > y) != (by > y) and x < ax + (y - ay) / (by - ay) * (bx - ax):
            inside = not inside
    return 0.0 if inside else min(_distance_to_segment(point, a, b) for a, b in edges(polygon))


def station(point: Point, line: Sequence[Point]) -> float:
    """Compute how far along a polyline, in m, its point lies that is nearest to a point."""
    nearest, found, driven = math.inf, 0.0, 0.0
    for a, b in pairwise(line):
        leg = math.dist(a, b)
        share = ((point[0] - a[0]) * (b[0] - a[0]) + (point[1] - a[1]) * (b[1] - a[1])) / leg**2 if leg else 0.0
        distance = _distance_to_segment(point, a, b)
        if distance < nearest:
            nearest, found = distance, driven + min(max(share, 0.0), 1.0) * leg
        driven += leg
    return found


def distance_to_ellipse(point: Point, semi_a: float, semi_b: float) -> float:
    """Compute the distance in m from a point to a filled ellipse at the origin, along the axes; 0 inside."""
    x, y = abs(point[0]), abs(point[1])
    if math.hypot(x / semi_a, y / semi_b) <= 1:
        return 0.0
    # The nearest point is (a^2 x / (s + a^2), b^2 y / (s + b^2)) for the one s > 0 that puts it on the
    # ellipse. Its level falls with s, so bisection finds s to the last bit.
    low, high = 0.0, max(semi_a, semi_b) * math.hypot(x, y)
    while low < (s := 0.5 * (low + high)) < high:
        if math.hypot(semi_a * x / (s + semi_a**2), semi_b * y / (s + semi_b**2)) > 1:
            low = s
        else:
            high = s
    return math.hypot(x * s / (s + semi_a**2), y * s / (s + semi_b**2))


def anticlockwise(polygon: Sequence[Point]) -> tuple[Point, ...]:
    """Give the vertices of a polygon anticlockwise."""
    return tuple(polygon) if area(polygon) >= 0.0 else tuple(reversed(polygon))


def is_convex(polygon: Sequence[Point]) -> bool:
    """True if a simple polygon has no corner that points inwards; rounding is forgiven."""
    ring = anticlockwise(polygon)
    corners = zip(ring, [*ring[1:], *ring[:1]], [*ring[2:], *ring[:2]], strict=True)
    return all(_turn(a, b, c) >= -SAME_DIRECTION * math.dist(a, b) * math.dist(b, c) for a, b, c in corners)


def overlap(polygon: Sequence[Point], other: Sequence[Point]) -> bool:
    """True if two convex polygons have an area in common: no edge of either separates them."""
    for one, two in ((polygon, other), (other, polygon)):
        for a, b in edges(anticlockwise(one)):
            in_line = SAME_DIRECTION * math.dist(a, b)
            if all(_turn(a, b, point) <= in_line * math.dist(a, point) for point in two):
                return False
    return True


def edges(polygon: Sequence[Point]) -> list[tuple[Point, Point]]:
    """Give the edges of a polygon, each from a vertex to the next."""
    return list(zip(polygon, [*polygon[1:], polygon[0]], strict=True))


def _turn(a: Point, b: Point, c: Point) -> float:
    """Cross product of ab and ac: positive if c lies left of ab."""
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])


def _dot(corner: Point, a: Point, b: Point) -> float:
    return (a[0] - corner[0]) * (b[0] - corner[0]) + (a[1] - corner[1]) * (b[1] - corner[1])


def _touch(a: Point, b: Point, c: Point, d: Point) -> bool:
    """Tell whether the segments ab and cd have a point in common."""
    turns = [_turn(a, b, c), _turn(a, b, d), _turn(c, d, a), _turn(c, d, b)]
    if turns[0] * turns[1] < 0 and turns[2] * turns[3] < 0:
        return True
    ends = zip(turns, [(a, b, c), (a, b, d), (c, d, a), (c, d, b)], strict=True)
    return any(turn == 0 and _dot(end, p, q) <= 0 for turn, (p, q, end) in ends)


def _distance_to_segment(point: Point, a: Point, b: Point) -> float:
    length2 = _dot(a, b, b)
    share = min(1.0, max(0.0, _dot(a, b, point) / length2)) if length2 else 0.0
    return math.dist(point, (a[0] + share * (b[0] - a[0]), a[1] + share * (b[1] - a[1])))
