"""Convex polygons around zones that stand, as tight as passages between them need."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import ceil, pi

import numpy as np

from scp_planner.arrays import Array, Index, cross, unit_vectors
from scp_planner.mathematics.ellipse import support
from scp_planner.mathematics.frames import directions_of
from scp_planner.mathematics.outlines import Outline
from scp_planner.threat_zones.batch import ZoneBatch


@dataclass(frozen=True)
class OutlineSettings:
    """Fineness of the polygons."""

    turn: float = 0.25 * pi + 1e-9  # rad, between neighbouring sides at most
    fan: int = 64  # directions in which a passage between two zones is looked for
    closer: int = 33  # and again, between the neighbours of the best one
    same: float = 1e-9  # of the size: sides that are shorter are left out


OUTLINES = OutlineSettings()


@dataclass(frozen=True)
class StandingShape:
    """A convex zone that stands, by its support function: centre, m, disc, m, outline, and ellipse of uncertainty."""

    centre: Array
    radius: float
    outline: Outline | None = None
    covariance: Array | None = None

    def support(self, directions: Array) -> Array:
        """Largest n . x of its points in directions n, (..., 2), m."""
        found: Array = directions @ self.centre + self.radius
        if self.outline is not None:
            found = found + self.outline.support(directions)
        if self.covariance is not None:
            found = found + support(self.covariance, directions)
        return found


def standing_shapes(zones: ZoneBatch) -> list[StandingShape]:
    """Return the zones that neither move nor grow, in order."""
    now, found = np.zeros(1), []
    centers = zones.centers.grid(now)[0]
    covariances = None if zones.covariances is None else zones.covariances.grid(now)[0]
    headings = directions_of(zones.directions.grid(now))[0] if zones.any_turning else None
    for k in zones.standing.tolist():
        outline = None
        if zones.outlines is not None and zones.outline_slot[k] >= 0:
            outline = zones.outlines.outlines[zones.outline_slot[k]]
            if headings is not None and outline.turning:
                fixed = Outline(outline.vertices, outline.matrix)
                outline = fixed.moved(np.zeros(2), float(np.arctan2(headings[k, 1], headings[k, 0])))
        blurred = None if covariances is None or zones.slot[k] < 0 else covariances[zones.slot[k]]
        found.append(StandingShape(centers[k], float(zones.radius[k]), outline, blurred))
    return found


def polygons_around(shapes: Sequence[StandingShape], points: Array) -> list[Array]:
    """Return a convex polygon around each shape; apart from each other and from points, (n, 2) m, where the shapes are.

    Sides touch the shape. Where two shapes are near to each other, or to a point, one side of each is across the line
    along which they are the farthest apart, so that every passage between them is one between the polygons.
    """
    if not shapes:
        return []
    ends = [StandingShape(point, 0.0) for point in points]
    apart = _apart([*shapes, *ends], len(shapes))
    return [_polygon(shape, apart[k]) for k, shape in enumerate(shapes)]


def _apart(shapes: Sequence[StandingShape], count: int) -> list[list[Array]]:
    """Directions in which each of the first shapes is the farthest away from others near to it."""
    angles = 2.0 * pi * np.arange(OUTLINES.fan) / OUTLINES.fan
    fan = unit_vectors(angles)
    heights = np.array([shape.support(fan) for shape in shapes])
    opposite = np.roll(heights, OUTLINES.fan // 2, axis=1)  # in the direction -n
    found: list[list[Array]] = [[] for _ in shapes]
    one, other = _near_pairs(heights, opposite, count)
    if len(one) == 0:
        return found
    best = np.argmax(-opposite[other] - heights[one], axis=1)
    step = 2.0 * pi / OUTLINES.fan
    for k, j, place in zip(one.tolist(), other.tolist(), best.tolist(), strict=True):
        closer = unit_vectors(angles[place] + np.linspace(-step, step, OUTLINES.closer))
        normals = [shape.outline.normals for shape in (shapes[k], shapes[j]) if shape.outline is not None]
        closer = np.concatenate([closer, *[sign * each for each in normals for sign in (1.0, -1.0)]])
        gaps = -shapes[j].support(-closer) - shapes[k].support(closer)
        widest = int(np.argmax(gaps))
        if gaps[widest] > 0.0:
            found[k].append(closer[widest])
            found[j].append(-closer[widest])
    return found


def _near_pairs(heights: Array, opposite: Array, count: int) -> tuple[Index, Index]:
    """Pairs of a shape and a later one whose boxes, with half their own size around them, meet."""
    quarter = OUTLINES.fan // 4
    high, low = heights[:, [0, quarter]], -opposite[:, [0, quarter]]
    margin = 0.1 * (high - low).max(axis=1)
    found = [(np.zeros(0, dtype=np.intp), np.zeros(0, dtype=np.intp))]
    for k in range(count):
        apart = (low[k + 1 :] > high[k] + margin[k]) | (high[k + 1 :] < low[k] - margin[k])
        (later,) = np.nonzero(~apart.any(axis=1))
        found.append((np.full(len(later), k), later + k + 1))
    return np.concatenate([one for one, _ in found]), np.concatenate([other for _, other in found])


def _polygon(shape: StandingShape, apart: Sequence[Array]) -> Array:
    """Corners of a polygon around a shape, anticlockwise."""
    wanted = [np.zeros((0, 2)) if shape.outline is None else shape.outline.normals, *[one[None] for one in apart]]
    vectors = np.concatenate(wanted)
    angles = np.unique(np.arctan2(vectors[:, 1], vectors[:, 0]) % (2.0 * pi))
    if len(angles) == 0:
        angles = np.zeros(1)
    gaps = np.diff(np.append(angles, angles[0] + 2.0 * pi))
    parts = [ceil(gap / OUTLINES.turn) for gap in gaps.tolist()]
    angles = np.concatenate(
        [first + gap * np.arange(n) / n for first, gap, n in zip(angles.tolist(), gaps.tolist(), parts, strict=True)]
    )
    normals = unit_vectors(angles)
    after = np.roll(normals, -1, axis=0)
    height = shape.support(normals)
    ahead = np.roll(height, -1)
    turn = cross(normals, after)
    keep = turn > 1e-7
    if not keep.all():  # sides in nearly one direction: the first of them
        normals, height = normals[keep], height[keep]
        after, ahead = np.roll(normals, -1, axis=0), np.roll(height, -1)
        turn = cross(normals, after)
    x = (height * after[:, 1] - ahead * normals[:, 1]) / turn
    y = (ahead * normals[:, 0] - height * after[:, 0]) / turn
    corners = np.stack([x, y], axis=1)
    size = float(np.abs(corners - corners[0]).max())
    apart_by = np.abs(corners - np.roll(corners, 1, axis=0)).max(axis=1)
    return corners[apart_by > OUTLINES.same * size]
