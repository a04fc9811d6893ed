"""Convex polygons inside zones."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from scp_planner.arrays import Array, Index, unit_vectors
from scp_planner.certificate.tolerances import NORMAL_OFFSET
from scp_planner.mathematics.ellipse import support_point
from scp_planner.mathematics.frames import directions_of, turned_back
from scp_planner.mathematics.outlines import Outline
from scp_planner.threat_zones.batch import ZoneBatch

CORNERS = 48  # of the polygon inside each zone


def polygons_inside(
    batch: ZoneBatch, times: Array, low: Array, high: Array, corners: int = CORNERS
) -> Iterator[tuple[Index, Array]]:
    """Convex polygons inside the parts of zones that come near a box."""
    centers, reaches = batch.centers.grid(times), batch.reach(times)
    headings = directions_of(batch.directions.grid(times)) if batch.any_turning else None
    covariances = None if batch.covariances is None else batch.covariances.grid(times)
    for part in range(batch.size):
        center, reach = centers[:, part], reaches[:, part, None]
        met = np.flatnonzero(np.all((center + reach >= low) & (center - reach <= high), axis=1))
        if len(met) == 0:
            continue
        outline = None
        if batch.outlines is not None and batch.outline_slot[part] >= 0:
            outline = batch.outlines.outlines[batch.outline_slot[part]]
        own = _directions(outline, corners)
        places = batch.radius[part] * own
        if outline is not None:
            places = places + _farthest(outline, own)
        directions, places = (np.broadcast_to(vectors, (len(met), *own.shape)) for vectors in (own, places))
        if headings is not None and batch.turning[part]:
            backwards = headings[met, part][:, None] * [1.0, -1.0]
            directions, places = turned_back(directions, backwards), turned_back(places, backwards)
        if covariances is not None and batch.slot[part] >= 0:
            places = places + support_point(covariances[met, batch.slot[part]][:, None], directions)
        yield met, center[met, None] + places


def _directions(outline: Outline | None, corners: int) -> Array:
    """Directions all around, and beside those of a polygon's edges, by their angle, (C, 2)."""
    angles = 2.0 * np.pi * np.arange(corners) / corners
    if outline is not None and outline.vertices is not None:
        normals = np.arctan2(outline.normals[:, 1], outline.normals[:, 0])
        beside = [(normals - NORMAL_OFFSET) % (2.0 * np.pi), (normals + NORMAL_OFFSET) % (2.0 * np.pi)]
        angles = np.concatenate([angles, *beside])
    angles = np.sort(angles)
    return unit_vectors(angles)


def _farthest(outline: Outline, directions: Array) -> Array:
    """Points of an outline that are farthest in directions (C, 2), m."""
    if outline.vertices is not None:
        farthest: Array = outline.vertices[np.argmax(directions @ outline.vertices.T, axis=1)]
        return farthest
    assert outline.matrix is not None
    return support_point(outline.matrix, directions)
