"""Borders of vehicles, obstacles and zones, as points to draw."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from scp_planner.arrays import Array, unit_vectors
from scp_planner.scenario.shapes import Disc, Ellipse, Rectangle

if TYPE_CHECKING:
    from scp_planner.scenario.shapes import Shape


@dataclass(frozen=True)
class BorderParameters:
    fine: float = 0.02  # Borders of several polygons are cut into bits no longer than this part of their extent


BORDERS = BorderParameters()


def body_of(shape: Shape) -> tuple[Array, bool]:
    """Vertices of a shape, (k, 2) m, at heading 0 if it turns with the heading, and whether it does."""
    angles = np.linspace(0.0, 2.0 * np.pi, 48, endpoint=False)
    circle = unit_vectors(angles)
    if isinstance(shape, Disc):
        return shape.disc * circle, False
    if isinstance(shape, Ellipse | Rectangle):
        if isinstance(shape, Ellipse):
            points = np.array(shape.ellipse) * circle
        else:
            points = 0.5 * np.array(shape.rectangle) * np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]])
        return turned(points, shape.heading or 0.0), shape.heading is None
    return np.array(shape.polygon), False


def turned(points: Array, heading: float) -> Array:
    """Turn points (n, 2) about the origin by a heading, rad."""
    cos, sin = np.cos(heading), np.sin(heading)
    return points @ np.array([[cos, sin], [-sin, cos]])


def vehicle_rectangle(discs: Sequence[float], radius: float) -> Array | None:
    """Corners of the largest rectangle that a row of discs covers, (4, 2) m, at heading 0; None if it is no row."""
    along = np.sort(np.asarray(discs, dtype=float))
    half = 0.5 * float(np.diff(along).max(initial=0.0))
    if not 0.0 < half < radius:
        return None
    left, right, side = along[0] - half, along[-1] + half, np.sqrt(radius**2 - half**2)
    return np.array([[right, side], [left, side], [left, -side], [right, -side]])


def borders_of(pieces: Sequence[Array]) -> Array:
    """Give the border of the union of convex polygons."""
    size = float(np.ptp(np.concatenate(pieces), axis=0).max())
    return np.concatenate([_borders(piece, k, pieces, size) for k, piece in enumerate(pieces)])


def _borders(piece: Array, own: int, pieces: Sequence[Array], size: float) -> Array:
    """Cut the border of a convex piece into bits, (n, 2, 2) m, and leave out those that are seams."""
    ends = np.roll(piece, -1, axis=0)
    counts = np.ceil(np.linalg.norm(ends - piece, axis=1) / (BORDERS.fine * size)).astype(int)
    parts = np.concatenate([np.arange(count) / count for count in counts if count])
    start, side = np.repeat(piece, counts, axis=0), np.repeat(ends - piece, counts, axis=0)
    step = side / np.repeat(counts, counts)[:, None]
    first = start + parts[:, None] * side
    bits, middle = np.stack([first, first + step], axis=1), first + 0.5 * step
    seam = np.zeros(len(bits), dtype=bool)
    for k, other in enumerate(pieces):
        edges = np.roll(other, -1, axis=0) - other
        known = np.linalg.norm(edges, axis=1) > 1e-9 * size
        if k == own or not known.any():
            continue
        edges = edges[known]
        normals = np.stack([edges[:, 1], -edges[:, 0]], axis=1) / np.linalg.norm(edges, axis=1)[:, None]
        beyond = np.einsum("nij,ij->ni", middle[:, None] - other[known], normals)
        nearest = beyond.argmax(axis=1)
        distance = beyond[np.arange(len(bits)), nearest]
        against = np.einsum("ij,ij->i", edges[nearest], step) < 0.0
        seam |= (distance < -1e-6 * size) | ((distance <= 1e-6 * size) & against)
    return bits[~seam]
