"""Convex outlines, polygons and ellipses, by support functions; concave polygons as unions of convex ones.

The Minkowski sum of an outline K, an uncertainty ellipse {z : z' C^-1 z <= 1} and a disc of radius R has the support
h(nu) = h_K(nu) + sqrt(nu' C nu) + R, and the signed distance of a point d to it is the largest of nu . d - h(nu)
over unit vectors nu, negative inside. h_K of a polygon is linear between its edge normals, so the largest value is
found among finitely many nu: an edge normal, or for a vertex v the nu of the distance of d - v to the ellipse, where
v is the support point of that nu. Any nu gives a lower bound.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np

from scp_planner.arrays import Array, Index
from scp_planner.mathematics.ellipse import Contact, ellipse_contact, far_ellipse_contact, support

STRAIGHT = 1e-12  # relative: a vertex that turns less than this is none
TOUCHING = 1e-12  # relative to the outline: nearer to a vertex than this, the normal of an edge is taken
SUM_GRID = 64  # directions from which the distance to the sum of two ellipses is searched
SUM_SECTIONS = 40  # golden sections: 0.1 rad * 0.618^40 < 1e-9 rad


@dataclass(frozen=True)
class Outline:
    """A convex shape about its origin: a polygon or an ellipse.

    Attributes
    ----------
    vertices : (V, 2) array or None
        Of a polygon, anticlockwise, no three in line, m.
    matrix : (3,) array or None
        (xx, xy, yy) of A of an ellipse {z : z' A^-1 z <= 1}, m^2.
    turning : bool
        Whether it turns with the direction of its motion; then its x axis is that direction.
    """

    vertices: Array | None = None
    matrix: Array | None = None
    turning: bool = False

    @classmethod
    def polygon(cls, vertices: Sequence[Sequence[float]] | Array, turning: bool = False) -> Outline:
        """Return a convex polygon, its vertices in either direction."""
        return cls(vertices=_tidy(np.asarray(vertices, dtype=float)), turning=turning)

    @classmethod
    def rectangle(cls, length: float, width: float, heading: float | None = None) -> Outline:
        """Return a rectangle about the origin, m; ``heading`` in rad, None: along its motion."""
        x, y = 0.5 * length, 0.5 * width
        corners = np.array([[-x, -y], [x, -y], [x, y], [-x, y]])
        return cls(vertices=corners @ _rotation(heading or 0.0).T, turning=heading is None)

    @classmethod
    def ellipse(cls, along: float, across: float, heading: float | None = None) -> Outline:
        """Return an ellipse by its half axes, m; ``heading`` in rad, None: along its motion."""
        turn = _rotation(heading or 0.0)
        matrix = turn @ np.diag([along * along, across * across]) @ turn.T
        return cls(matrix=matrix[[0, 0, 1], [0, 1, 1]], turning=heading is None)

    @cached_property
    def normals(self) -> Array:
        """Outward unit normals of the edges, (V, 2); none for an ellipse."""
        if self.vertices is None:
            return np.zeros((0, 2))
        edge = np.roll(self.vertices, -1, axis=0) - self.vertices
        normal: Array = np.stack([edge[:, 1], -edge[:, 0]], axis=1) / np.hypot(edge[:, 0], edge[:, 1])[:, None]
        return normal

    @property
    def middle(self) -> Array:
        """Mean of the corners of a polygon that does not turn, else the origin, (2,) m: a point that turns with it."""
        if self.vertices is None or self.turning:
            return np.zeros(2)
        middle: Array = self.vertices.mean(axis=0)
        return middle

    def moved(self, shift: Array, heading: float = 0.0) -> Outline:
        """Return the outline after a shift and then a turn about the origin; turning ones stay as they are."""
        if self.turning:
            return self
        turn = _rotation(heading)
        if self.vertices is not None:
            return Outline(vertices=(self.vertices + shift) @ turn.T)
        assert self.matrix is not None
        full = turn @ self.matrix[[0, 1, 1, 2]].reshape(2, 2) @ turn.T
        return Outline(matrix=full[[0, 0, 1], [0, 1, 1]])

    def in_units(self, length: float) -> Outline:
        """Return the outline where lengths are so many times as large."""
        if self.vertices is not None:
            return Outline(vertices=self.vertices * length, turning=self.turning)
        assert self.matrix is not None
        return Outline(matrix=self.matrix * length**2, turning=self.turning)

    def rounded(self, decimals: int) -> Outline:
        """Return the outline with its vertices or matrix rounded; vertices that become one are one."""
        if self.vertices is not None:
            vertices = np.round(self.vertices, decimals)
            apart = np.any(vertices != np.roll(vertices, 1, axis=0), axis=1)
            if not apart.all():
                # What is too small to be rounded stays as it is.
                vertices = vertices[apart] if np.count_nonzero(apart) >= 3 else self.vertices
            return Outline(vertices=vertices, turning=self.turning)
        assert self.matrix is not None
        return Outline(matrix=np.round(self.matrix, decimals), turning=self.turning)

    @property
    def reach(self) -> float:
        """Radius of the disc about the origin that covers the outline, m."""
        if self.vertices is not None:
            return float(np.hypot(*self.vertices.T).max())
        assert self.matrix is not None
        mean = 0.5 * (self.matrix[0] + self.matrix[2])
        return float(np.sqrt(mean + np.hypot(0.5 * (self.matrix[0] - self.matrix[2]), self.matrix[1])))

    def support(self, directions: Array) -> Array:
        """Support function in directions (..., 2), m."""
        if self.vertices is not None:
            values: Array = (directions @ self.vertices.T).max(axis=-1)
            return values
        assert self.matrix is not None
        return support(self.matrix, directions)


class Outlines:
    """Many outlines, for many contacts at once. Polygons are kept as one long list of edges.

    Parameters
    ----------
    outlines : sequence of Outline
    """

    def __init__(self, outlines: Sequence[Outline]) -> None:
        self.size = len(outlines)
        self.outlines = tuple(outlines)
        self.reach = np.array([outline.reach for outline in outlines])
        self.turning = np.array([outline.turning for outline in outlines], dtype=bool)
        self.counts = np.array([0 if o.vertices is None else len(o.vertices) for o in outlines], dtype=np.intp)
        self.matrices = np.array([np.zeros(3) if o.matrix is None else o.matrix for o in outlines]).reshape(-1, 3)

    def take(self, index: Index) -> Outlines:
        """Return some of the outlines."""
        return Outlines([self.outlines[i] for i in index])

    @cached_property
    def _edges(self) -> _Edges:
        return _Edges.of([o.vertices for o in self.outlines if o.vertices is not None])

    @cached_property
    def _first(self) -> Index:
        return np.cumsum(self.counts) - self.counts

    def support(self, index: Index, directions: Array) -> Array:
        """Support functions of chosen outlines, (n,) m, in directions (n, 2)."""
        value = support(self.matrices[index], directions)
        rows = np.flatnonzero(self.counts[index])
        if len(rows):
            starts, edge, owner = self._ragged(index[rows])
            start = self._edges.start[edge]
            value[rows] = np.maximum.reduceat((start * directions[rows][owner]).sum(axis=1), starts)
        return value

    def contacts(self, index: Index, offset: Array, covariance: Array | None = None) -> Contact:
        """Exact signed distances of points to chosen outlines, or to their sums with ellipses.

        Parameters
        ----------
        index : (n,) array of int
            Which outline.
        offset : (n, 2) array
            Points relative to the outlines' origins, m.
        covariance : (n, 3) array, optional
            (xx, xy, yy) of the ellipses, positive definite, m^2.

        Returns
        -------
        Contact
        """
        distance, normal = np.empty(len(index)), np.empty((len(index), 2))
        polygon = self.counts[index] > 0
        for rows in (np.flatnonzero(polygon), np.flatnonzero(~polygon)):
            if len(rows) == 0:
                continue
            if polygon[rows[0]]:
                contact = (
                    self._to_polygons(index[rows], offset[rows])
                    if covariance is None
                    else self._to_sums(index[rows], offset[rows], covariance[rows])
                )
            elif covariance is None:
                contact = ellipse_contact(offset[rows], self.matrices[index[rows]])
            else:
                contact = two_ellipses_contact(offset[rows], self.matrices[index[rows]], covariance[rows])
            distance[rows], normal[rows] = contact.distance, contact.normal
        return Contact(distance, normal)

    def _ragged(self, index: Index) -> tuple[Index, Index, Index]:
        """Where each row's edges begin in the list of all edges of all rows; those edges; their rows."""
        counts = self.counts[index]
        starts = np.cumsum(counts) - counts
        owner = np.repeat(np.arange(len(index)), counts)
        return starts, np.arange(len(owner)) + (self._first[index] - starts)[owner], owner

    def _to_polygons(self, index: Index, offset: Array) -> Contact:
        starts, edge, owner = self._ragged(index)
        edges = self._edges
        from_start = offset[owner] - edges.start[edge]
        tangent, normal, length = edges.tangent[edge], edges.normal[edge], edges.length[edge]
        height = from_start[:, 0] * normal[:, 0] + from_start[:, 1] * normal[:, 1]
        along = from_start[:, 0] * tangent[:, 0] + from_start[:, 1] * tangent[:, 1]
        beyond = along - np.minimum(np.maximum(along, 0.0), length)
        gap = np.hypot(beyond, height)
        highest, nearest = np.maximum.reduceat(height, starts), np.minimum.reduceat(gap, starts)
        outside = highest > TOUCHING * self.reach[index]
        # Outside the nearest edge decides, inside the one whose line is nearest.
        chosen = np.where(outside[owner], gap == nearest[owner], height == highest[owner])
        best = np.minimum.reduceat(np.where(chosen, np.arange(len(edge)), len(edge)), starts)
        distance = np.where(outside, nearest, highest)
        unit = normal[best].copy()
        corner = np.flatnonzero(outside & (beyond[best] != 0.0))
        at = best[corner]
        unit[corner] = (beyond[at, None] * tangent[at] + height[at, None] * normal[at]) / gap[at, None]
        return Contact(distance, unit)

    def _to_sums(self, index: Index, offset: Array, covariance: Array) -> Contact:
        starts, edge, owner = self._ragged(index)
        edges = self._edges
        from_start = offset[owner] - edges.start[edge]
        spread = covariance[owner]
        candidates = [edges.normal[edge]]
        values = [np.einsum("ij,ij->i", from_start, edges.normal[edge]) - support(spread, edges.normal[edge])]
        for contact in (ellipse_contact(from_start, spread), far_ellipse_contact(from_start, spread)):
            nu = contact.normal
            ahead = np.einsum("ij,ij->i", nu, edges.tangent[edge])
            behind = np.einsum("ij,ij->i", nu, edges.tangent[edges.before[edge]])
            values.append(np.where((ahead <= 0.0) & (behind >= 0.0), contact.distance, -np.inf))
            candidates.append(nu)
        best = np.argmax(values, axis=0)
        value = np.max(values, axis=0)
        highest = np.maximum.reduceat(value, starts)
        at = np.minimum.reduceat(np.where(value == highest[owner], np.arange(len(edge)), len(edge)), starts)
        return Contact(highest, np.stack(candidates)[best[at], at])


@dataclass(frozen=True)
class _Edges:
    """Edges of polygons, one after the other: starts, unit tangents, outward unit normals, lengths, predecessors."""

    start: Array
    tangent: Array
    normal: Array
    length: Array
    before: Index

    @classmethod
    def of(cls, polygons: Sequence[Array]) -> _Edges:
        ends = [np.roll(vertices, -1, axis=0) for vertices in polygons]
        start = np.concatenate([*polygons, np.zeros((0, 2))])
        vector = np.concatenate([*ends, np.zeros((0, 2))]) - start
        length = np.hypot(vector[:, 0], vector[:, 1])
        tangent = vector / length[:, None]
        before, first = [np.zeros(0, dtype=np.intp)], 0
        for vertices in polygons:
            before.append(first + np.roll(np.arange(len(vertices)), 1))
            first += len(vertices)
        normal = np.stack([tangent[:, 1], -tangent[:, 0]], axis=1)
        return cls(start, tangent, normal, length, np.concatenate(before))


def two_ellipses_contact(offset: Array, first: Array, second: Array) -> Contact:
    """Signed distance from points to sums of two ellipses about the origin.

    Parameters
    ----------
    offset : (n, 2) array
        m.
    first, second : (n, 3) arrays
        (xx, xy, yy) of each ellipse, m^2.

    Returns
    -------
    Contact
    """
    step = 2.0 * np.pi / SUM_GRID
    grid = np.broadcast_to(step * np.arange(SUM_GRID), (len(offset), SUM_GRID))
    # Flat ellipses have sharp maxima: theirs alone, and the directions in which they are thin, are tried as well.
    more = [offset, ellipse_contact(offset, first).normal, ellipse_contact(offset, second).normal]
    angles = [np.arctan2(vector[:, 1], vector[:, 0]) for vector in more]
    for matrix in (first, second):
        thin = 0.5 * np.arctan2(2.0 * matrix[:, 1], matrix[:, 0] - matrix[:, 2]) + 0.5 * np.pi
        angles += [thin, thin + np.pi]
    tried = np.concatenate([grid, np.stack(angles, axis=1)], axis=1)

    def separation(angle: Array) -> Array:
        nu = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
        extra = (1,) * (angle.ndim - 1)
        shaped = [values.reshape(len(values), *extra, values.shape[1]) for values in (offset, first, second)]
        gap: Array = (shaped[0] * nu).sum(axis=-1) - support(shaped[1], nu) - support(shaped[2], nu)
        return gap

    best = tried[np.arange(len(offset)), np.argmax(separation(tried), axis=1)]
    low, high = best - step, best + step
    golden = 0.5 * (np.sqrt(5.0) - 1.0)
    inner = np.stack([high - golden * (high - low), low + golden * (high - low)])
    value = np.stack([separation(inner[0]), separation(inner[1])])
    for _ in range(SUM_SECTIONS):
        left = value[0] > value[1]
        low, high = np.where(left, low, inner[0]), np.where(left, inner[1], high)
        fresh = np.where(left, high - golden * (high - low), low + golden * (high - low))
        found = separation(fresh)
        inner = np.where(left, np.stack([fresh, inner[0]]), np.stack([inner[1], fresh]))
        value = np.where(left, np.stack([found, value[0]]), np.stack([value[1], found]))
    angle = 0.5 * (low + high)
    return Contact(separation(angle), np.stack([np.cos(angle), np.sin(angle)], axis=1))


def _rotation(angle: float) -> Array:
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s], [s, c]])


def _tidy(vertices: Array) -> Array:
    """Vertices anticlockwise, without those in line with their neighbours."""
    if _area(vertices) < 0.0:
        vertices = vertices[::-1]
    while len(vertices) > 3:
        before, after = vertices - np.roll(vertices, 1, axis=0), np.roll(vertices, -1, axis=0) - vertices
        turn = before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0]
        straight = np.abs(turn) <= STRAIGHT * np.hypot(*before.T) * np.hypot(*after.T)
        if not straight.any():
            break
        vertices = np.delete(vertices, int(np.argmax(straight)), axis=0)
    return np.ascontiguousarray(vertices)


def _area(vertices: Array) -> float:
    x, y = (vertices - vertices[0]).T
    return 0.5 * float(np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y))


@lru_cache(maxsize=256)
def convex_pieces(polygon: tuple[tuple[float, float], ...]) -> tuple[Outline, ...]:
    """Split a simple polygon into convex pieces: ears are cut off, then pieces joined while they stay convex.

    Joining in this way leaves at most four times as few pieces as possible (Hertel and Mehlhorn, 1983).

    Parameters
    ----------
    polygon : tuple of (x, y)
        Vertices in either direction, m.

    Returns
    -------
    tuple of Outline
    """
    vertices = _tidy(np.array(polygon))
    if _convex(vertices, list(range(len(vertices)))):
        return (Outline(vertices=vertices),)
    pieces = _joined(vertices, _ears(vertices))
    return tuple(Outline.polygon(vertices[piece]) for piece in pieces)


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
