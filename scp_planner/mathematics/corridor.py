"""The outside of a corridor, as obstacles that stand: convex polygons that cover it."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np

from scp_planner.arrays import Array, Mask, left_of
from scp_planner.mathematics import planar
from scp_planner.mathematics.outlines import Outline
from scp_planner.mathematics.tolerances import COORDINATE_ROUNDING, UNCOVERED
from scp_planner.pauses import pause

NAME = "corridor"  # the id of its outside among obstacles
WALLS = "walls"  # and that of the walls of a scenario


@dataclass(frozen=True)
class CorridorSize:
    """Thickness, accuracy and size of the outside of a corridor."""

    wall: float = 3.0  # units of length, least thickness
    # relative to the same: what is farther from a line is on its side; shorter edges have no direction
    near: float = 3e-5
    most_corners: int = 100  # of a polygon; of 500 in each of three, what lies outside takes more than half a minute
    most_pieces: int = 200  # after which pieces do not overlap any more
    remembered: int = 64  # corridors whose outside is kept
    at_once: int = 2**18  # pairs of boxes that are compared together


SIZE = CorridorSize()
Polygon = Sequence[planar.Point]
Edge = tuple[planar.Point, planar.Point]


def outside(polygons: Sequence[Polygon], wall: float = SIZE.wall) -> list[Polygon]:
    """Return convex polygons that cover what lies outside the union of convex polygons, as far as a wall is thick."""
    rings = [planar.anticlockwise(polygon) for polygon in polygons]
    xs, ys = [x for ring in rings for x, _ in ring], [y for ring in rings for _, y in ring]
    left, right, low, high = min(xs) - wall, max(xs) + wall, min(ys) - wall, max(ys) + wall
    largest = max(abs(side) for side in (left, right, low, high))
    thin, near = COORDINATE_ROUNDING * largest, SIZE.near * largest
    pieces = [_Piece.of(((left, low), (right, low), (right, high), (left, high)))]
    boxes = np.array([pieces[0].box])
    for polygon in rings:
        pause()
        apart, new, ring = np.ones(len(pieces), dtype=bool), [], _Ring(polygon, near)
        met = np.flatnonzero(_meet(boxes, _Piece.of(polygon).box)).tolist()
        for k, cut in zip(met, ring.cuts([pieces[k].polygon for k in met]), strict=True):
            parts = None if cut is None else _beyond(pieces[k].polygon, cut, thin, len(pieces))
            if parts is not None:
                apart[k] = False
                new += parts
        left_over, boxes = [pieces[k] for k in np.flatnonzero(apart).tolist()], boxes[apart]
        kept = _largest(left_over, boxes, new, thin)
        pieces = left_over + kept
        boxes = np.concatenate([boxes, np.array([piece.box for piece in kept]).reshape(-1, 4)])
    pieces.sort(key=lambda piece: piece.area, reverse=True)
    merged = (_merged(piece.polygon, thin) for piece in pieces)
    return [piece for piece in merged if len(piece) >= 3]


@lru_cache(maxsize=SIZE.remembered)
def known_outside(polygons: tuple[Polygon, ...]) -> tuple[Polygon, ...]:
    """Return :func:`outside` of convex polygons in natural units: made once, when a scenario is checked, and kept."""
    return tuple(outside(polygons))


@lru_cache(maxsize=SIZE.remembered)
def known_outlines(polygons: tuple[Polygon, ...], place: planar.Point) -> tuple[Outline, ...]:
    """Return :func:`known_outside` of the same as outlines seen from a place: made then, too, and kept."""
    return outlines_from(place, known_outside(polygons))


def outlines_from(place: planar.Point, polygons: tuple[Polygon, ...]) -> tuple[Outline, ...]:
    """Return convex polygons as outlines seen from a place."""
    middle = np.array(place)
    return tuple(Outline.polygon(np.array(polygon) - middle) for polygon in polygons)


def way_through(polygons: Sequence[Polygon], start: planar.Point, goal: planar.Point) -> tuple[planar.Point, ...]:
    """Return points of a polyline in a corridor between start and goal; none where the straight line lies in it."""
    rings = [planar.anticlockwise(polygon) for polygon in polygons]
    if not _leaves(rings, start, goal):
        return ()
    begins = [place for place, ring in enumerate(rings) if planar.distance_to_polygon(start, ring) == 0.0]
    before: dict[int, int] = dict.fromkeys(begins, -1)
    queue, boxes = deque(begins), _boxes(rings)
    while queue:
        here = queue.popleft()
        if planar.distance_to_polygon(goal, rings[here]) == 0.0:
            break
        for other in np.flatnonzero(_meet(boxes, boxes[here])).tolist():
            if other not in before and planar.overlap(rings[here], rings[other]):
                before[other] = here
                queue.append(other)
    else:
        return ()
    points = []
    while before[here] >= 0:
        common: Polygon = rings[here]
        for a, b in planar.edges(rings[before[here]]):
            common = _clipped(common, a, b)
        points.append(planar.centroid(common))
        here = before[here]
    return tuple(reversed(points))


@lru_cache(maxsize=SIZE.remembered)
def known_way(polygons: tuple[Polygon, ...], start: planar.Point, goal: planar.Point) -> tuple[planar.Point, ...]:
    """Return :func:`way_through` of the same, made and kept as :func:`known_outside`."""
    return way_through(polygons, start, goal)


def connected(polygons: Sequence[Polygon], some: set[int]) -> set[int]:
    """Return which convex polygons one can get to from some of them, by those that overlap."""
    boxes, reached = _boxes(polygons), set(some)
    queue = deque(some)
    while queue:
        here = queue.popleft()
        near = set(np.flatnonzero(_meet(boxes, boxes[here])).tolist()) - reached
        fresh = [other for other in near if planar.overlap(polygons[here], polygons[other])]
        reached.update(fresh)
        queue.extend(fresh)
    return reached


def _leaves(rings: Sequence[Polygon], start: planar.Point, goal: planar.Point) -> bool:
    """True if a straight line leaves the union of convex polygons."""
    parts = []
    for ring in rings:
        first, last = 0.0, 1.0
        for a, b in planar.edges(ring):
            at_start, at_goal = ((b[0] - a[0]) * (y - a[1]) - (b[1] - a[1]) * (x - a[0]) for x, y in (start, goal))
            if at_start < 0.0 and at_goal < 0.0:
                last = -1.0
            elif at_start < 0.0:
                first = max(first, at_start / (at_start - at_goal))
            elif at_goal < 0.0:
                last = min(last, at_start / (at_start - at_goal))
        if first < last:
            parts.append((first, last))
    covered = 0.0
    for first, last in sorted(parts):
        if first > covered + UNCOVERED:
            return True
        covered = max(covered, last)
    return covered < 1.0 - UNCOVERED


def _beyond(piece: Polygon, cut: Sequence[Edge], thin: float, count: int) -> list[_Piece] | None:
    """The parts of a convex polygon that lie beyond each edge of another which may cut it; None if they are apart."""
    left, parts = piece, []
    for a, b in cut:
        part = _clipped(left if count > SIZE.most_pieces else piece, b, a)
        if len(part) >= 3 and not (one := _Piece.of(part)).is_thin(thin):
            parts.append(one)
        left = _clipped(left, a, b)
        if len(left) < 3 or _Piece.of(left).is_thin(thin):
            return None
    return parts


class _Ring:
    """A convex polygon, anticlockwise, that cuts others."""

    def __init__(self, polygon: Polygon, near: float) -> None:
        self.edges = planar.edges(polygon)
        ends = np.array(self.edges)
        self._corners, along = ends[:, 0], ends[:, 1] - ends[:, 0]
        self._normals = left_of(along) / np.hypot(*along.T)[:, None]
        self._offsets = np.einsum("ki,ki->k", self._normals, ends[:, 0])
        self._near = near

    def cuts(self, pieces: Sequence[Polygon]) -> list[list[Edge] | None]:
        """Edges that each of some convex polygons is not clearly on the inner side of."""
        if not pieces:
            return []
        corners = np.array([corner for piece in pieces for corner in piece])
        counts = np.array([len(piece) for piece in pieces])
        first = np.cumsum(counts) - counts
        sides = self._normals @ corners.T - self._offsets[:, None]
        apart = (np.maximum.reduceat(sides, first, axis=1) < -self._near).any(axis=0)
        after = np.arange(1, len(corners) + 1)
        after[first + counts - 1] = first
        along = corners[after] - corners
        normals = left_of(along)
        own = normals @ self._corners.T - np.einsum("ki,ki->k", normals, corners)[:, None]
        lengths = np.hypot(along[:, 0], along[:, 1])
        # Edges of pieces may be as short as rounding: these have no direction to go by
        beyond = (own.max(axis=1) < -self._near * lengths) & (lengths > self._near)
        apart |= np.logical_or.reduceat(beyond, first)
        cut = np.minimum.reduceat(sides, first, axis=1) <= self._near
        return [
            None if gone else [self.edges[k] for k in np.flatnonzero(some).tolist()]
            for gone, some in zip(apart.tolist(), cut.T, strict=True)
        ]


def _clipped(polygon: Polygon, a: planar.Point, b: planar.Point) -> Polygon:
    """The part of a convex polygon to the left of a line through two points."""
    kept: list[planar.Point] = []
    size = math.dist(a, b)
    sides = [((b[0] - a[0]) * (y - a[1]) - (b[1] - a[1]) * (x - a[0])) / size for x, y in polygon]
    for place, here in enumerate(polygon):
        before, side, last = polygon[place - 1], sides[place], sides[place - 1]
        if (side > 0.0) != (last > 0.0) and side != last:
            share = last / (last - side)
            kept.append((before[0] + share * (here[0] - before[0]), before[1] + share * (here[1] - before[1])))
        if side > 0.0:
            kept.append(here)
    return tuple(kept)


def _merged(polygon: Polygon, same: float) -> Polygon:
    """A convex polygon without vertices that are not apart from the one kept before."""
    kept: list[planar.Point] = []
    for vertex in polygon:
        if not kept or math.dist(kept[-1], vertex) > same:
            kept.append(vertex)
    while len(kept) > 1 and math.dist(kept[-1], kept[0]) <= same:
        kept.pop()
    return tuple(kept)


@dataclass(frozen=True)
class _Piece:
    """A convex polygon, its area in m2, and the box around it, m."""

    polygon: Polygon
    area: float
    left: float
    right: float
    low: float
    high: float

    @cached_property
    def edges(self) -> list[Edge]:
        return planar.edges(self.polygon)

    @property
    def box(self) -> tuple[float, ...]:
        """The sides, each positive outwards: that of a piece in another one is nowhere larger."""
        return (-self.left, self.right, -self.low, self.high)

    def is_thin(self, width: float) -> bool:
        """True if it fits between two lines so far apart: it has half the area of a box along its diameter, or more."""
        return 2.0 * self.area <= width * max(self.right - self.left, self.high - self.low)

    @classmethod
    def of(cls, polygon: Polygon, area: float | None = None) -> _Piece:
        xs, ys = [x for x, _ in polygon], [y for _, y in polygon]
        size = planar.area(polygon) if area is None else area
        return cls(polygon, size, min(xs), max(xs), min(ys), max(ys))


def _boxes(polygons: Sequence[Polygon]) -> Array:
    """The sides of the boxes around polygons, (n, 4) m, as those of a piece."""
    return np.array([_Piece.of(polygon, 0.0).box for polygon in polygons])


def _meet(boxes: Array, box: Array | tuple[float, ...]) -> Mask:
    """Boxes that have a point in common with another one."""
    met: Mask = (boxes + np.array(box)[[1, 0, 3, 2]] >= 0.0).all(axis=1)
    return met


def _largest(pieces: list[_Piece], boxes: Array, new: list[_Piece], thin: float) -> list[_Piece]:
    """New pieces that lie in no other one, new or old; the boxes of the old are (n, 4)."""
    new = sorted(new, key=lambda one: one.area, reverse=True)
    own = np.array([piece.box for piece in new]).reshape(-1, 4)
    chosen: list[int] = []
    step = max(1, SIZE.at_once // (len(boxes) + len(new) + 1))
    # Boxes first, of many at once: most pieces are elsewhere.
    for begin in range(0, len(new), step):
        some = own[begin : begin + step]
        rows = zip(_within(some, own, thin), _within(some, boxes, thin), strict=True)
        for place, (inside_new, inside_old) in enumerate(rows, start=begin):
            others = [new[k] for k in chosen if inside_new[k]] if inside_new[:place].any() else []
            others += [pieces[k] for k in np.flatnonzero(inside_old).tolist()]
            if not any(_lies_in(new[place].polygon, other.edges, thin) for other in others):
                chosen.append(place)
    return [new[k] for k in chosen]


def _within(some: Array, boxes: Array, near: float) -> Mask:
    """Boxes, (n, 4), that hold each of some others, (m, 4), to rounding: (m, n)."""
    held = np.ones((len(some), len(boxes)), dtype=bool)
    for side in range(4):
        held &= some[:, side, None] - boxes[:, side] <= near
    return held


def _lies_in(piece: Polygon, edges: Sequence[Edge], thin: float) -> bool:
    """True if a convex polygon lies in another one to rounding, given the edges of that."""
    for (left, low), (right, high) in edges:
        along, up = right - left, high - low
        tolerance = -thin * math.hypot(along, up)
        for x, y in piece:
            if along * (y - low) - up * (x - left) < tolerance:
                return False
    return True
