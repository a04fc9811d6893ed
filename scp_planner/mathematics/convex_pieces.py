"""Concave polygons as unions of convex ones."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from scp_planner.arrays import Array, Mask, cross
from scp_planner.mathematics.outlines import Outline


@lru_cache(maxsize=256)
def convex_pieces(polygon: tuple[tuple[float, float], ...]) -> tuple[Outline, ...]:
    """Split a simple polygon into convex pieces: ears are cut off, then pieces joined while they stay convex."""
    # Joining in this way leaves at most four times as few pieces as possible (Hertel and Mehlhorn, 1983).
    whole = Outline.polygon(polygon)
    vertices = whole.vertices
    assert vertices is not None, "it is a polygon"
    if _convex(vertices, list(range(len(vertices)))):
        return (whole,)
    pieces = _joined(vertices, _ears(vertices))
    return tuple(Outline.polygon(vertices[piece]) for piece in pieces)


def in_convex(polygon: Array, points: Array) -> Mask:
    """True if points (n, 2) lie in a convex polygon, anticlockwise, (n,)."""
    inside: Mask = np.all(cross(np.roll(polygon, -1, axis=0) - polygon, points[:, None] - polygon) >= 0.0, axis=1)
    return inside


def _cross(a: Array, b: Array, c: Array) -> Array:
    """Twice the signed area of the triangles a b c."""
    area: Array = (b[..., 0] - a[..., 0]) * (c[..., 1] - a[..., 1]) - (b[..., 1] - a[..., 1]) * (c[..., 0] - a[..., 0])
    return area


def _convex(vertices: Array, ring: list[int]) -> bool:
    corner = vertices[ring]
    return bool(np.all(_cross(np.roll(corner, 1, axis=0), corner, np.roll(corner, -1, axis=0)) >= 0.0))


def _ears(vertices: Array) -> list[list[int]]:
    """Triangles that make up a simple polygon, as indices."""
    ring, triangles = list(range(len(vertices))), []
    while len(ring) > 3:
        corner = vertices[ring]
        turn = _cross(np.roll(corner, 1, axis=0), corner, np.roll(corner, -1, axis=0))
        for place in np.argsort(-turn, kind="stable"):
            three = [ring[place - 1], ring[place], ring[(place + 1) % len(ring)]]
            a, b, c = vertices[three]
            others = vertices[[k for k in ring if k not in three]]
            inside = (_cross(a, b, others) >= 0.0) & (_cross(b, c, others) >= 0.0) & (_cross(c, a, others) >= 0.0)
            if not inside.any():
                break
        if turn[place] > 0.0:
            triangles.append(three)
        ring.pop(int(place))
    return [*triangles, ring]


def _joined(vertices: Array, pieces: list[list[int]]) -> list[list[int]]:
    """Join pieces over their common edges while what comes out is convex."""
    pieces = [list(piece) for piece in pieces]
    edges = {(p[k - 1], p[k]): number for number, p in enumerate(pieces) for k in range(len(p))}
    for (start, end), _ in list(edges.items()):
        one, other = edges.get((start, end)), edges.get((end, start))
        if one is None or other is None or one == other:
            continue
        first, second = pieces[one], pieces[other]
        i, j = first.index(end), second.index(start)
        # first from end round to start, then second from start round to end, without the common edge
        ring = first[i:] + first[:i] + (second[j:] + second[:j])[1:-1]
        if not _convex(vertices, ring):
            continue
        pieces[one], pieces[other] = ring, []
        for edge, number in edges.items():
            if number == other:
                edges[edge] = one
        del edges[(start, end)], edges[(end, start)]
    return [piece for piece in pieces if piece]
