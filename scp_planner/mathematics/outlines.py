"""Convex outlines, polygons and ellipses, by support functions."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from scp_planner.arrays import Array, Index, Mask, cross, unit_vectors
from scp_planner.mathematics.ellipse import Contact, ellipse_contact, far_ellipse_contact, support
from scp_planner.mathematics.frames import covariance_turned_back
from scp_planner.mathematics.tolerances import AT_VERTEX, ON_LINE


@dataclass(frozen=True)
class SumSearch:
    """Search for the distance to the sum of two ellipses."""

    grid: int = 64  # directions from which the distance to the sum of two ellipses is searched
    sections: int = 40  # golden sections: 0.1 rad * 0.618^40 < 1e-9 rad


SUM_SEARCH = SumSearch()


@dataclass(frozen=True)
class Outline:
    """A convex shape about its origin: a polygon or an ellipse."""

    vertices: Array | None = None  # (V, 2) m
    matrix: Array | None = None  # (3,) (xx, xy, yy) of A of an ellipse {z : z' A^-1 z <= 1}, m^2
    turning: bool = False

    @classmethod
    def polygon(cls, vertices: Sequence[Sequence[float]] | Array) -> Outline:
        """Return a convex polygon, its vertices in either direction."""
        return cls(vertices=_tidy(np.asarray(vertices, dtype=float)))

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
        edge = _next(self.vertices) - self.vertices
        normal: Array = np.stack([edge[:, 1], -edge[:, 0]], axis=1) / np.hypot(edge[:, 0], edge[:, 1])[:, None]
        return normal

    @cached_property
    def middle(self) -> Array:
        """Mean of the corners of a polygon that does not turn, else the origin, (2,) m: a point that turns with it."""
        if self.vertices is None or self.turning:
            return np.zeros(2)
        middle: Array = self.vertices.sum(axis=0) / len(self.vertices)  # faster than np.mean
        return middle

    @cached_property
    def centred(self) -> Outline:
        """About its middle."""
        return self.moved(-self.middle)

    def moved(self, shift: Array, heading: float = 0.0) -> Outline:
        """Return the outline after a shift and then a turn about the origin; turning ones stay as they are."""
        if self.turning:
            return self
        if self.vertices is not None and heading == 0.0:
            return Outline(vertices=self.vertices + shift)
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
        return Outline(matrix=self.matrix * (length * length), turning=self.turning)

    def rounded(self, decimals: int) -> Outline:
        """Return the outline with its vertices or matrix rounded; vertices that become one are one."""
        if self.vertices is not None:
            vertices = np.round(self.vertices, decimals)
            apart = np.any(vertices != _last(vertices), axis=1)
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
    """Many outlines, for many contacts at once."""

    def __init__(self, outlines: Sequence[Outline]) -> None:
        corners = [outline.vertices for outline in outlines if outline.vertices is not None]
        self.turning = np.array([outline.turning for outline in outlines], dtype=bool)
        self.counts = np.array([0 if o.vertices is None else len(o.vertices) for o in outlines], dtype=np.intp)
        self.matrices = np.array([np.zeros(3) if o.matrix is None else o.matrix for o in outlines]).reshape(-1, 3)
        self.corners = np.concatenate(corners) if corners else np.zeros((0, 2))

    @classmethod
    def _of(cls, turning: Mask, counts: Index, matrices: Array, corners: Array) -> Outlines:
        """Outlines by what they are kept as: one by one they are made where somebody asks for that."""
        made = cls(())
        made.turning, made.counts, made.matrices, made.corners = turning, counts, matrices, corners
        return made

    @property
    def size(self) -> int:
        return len(self.counts)

    @cached_property
    def outlines(self) -> tuple[Outline, ...]:
        """Each by itself."""
        ends = np.cumsum(self.counts).tolist()
        return tuple(
            Outline(self.corners[end - count : end], None, turning) if count else Outline(None, matrix, turning)
            for end, count, matrix, turning in zip(
                ends, self.counts.tolist(), self.matrices, self.turning.tolist(), strict=True
            )
        )

    def take(self, index: Index) -> Outlines:
        """Return some of the outlines."""
        _, corner, _ = self.ragged(index)
        return self._of(self.turning[index], self.counts[index], self.matrices[index], self.corners[corner])

    @cached_property
    def reach(self) -> Array:
        """Radius of the disc about the origin that covers each outline, (n,) m."""
        xx, xy, yy = self.matrices.T
        reach: Array = np.sqrt(0.5 * (xx + yy) + np.hypot(0.5 * (xx - yy), xy))
        rows = np.flatnonzero(self.counts)
        if len(rows):
            reach[rows] = np.maximum.reduceat(np.hypot(*self.corners.T), self._first[rows])
        return reach

    @cached_property
    def edges(self) -> Edges:
        """All edges of the polygons."""
        return Edges.of(self.corners, self.counts[self.counts > 0])

    def turned(self, heading: float) -> Outlines:
        """Return the outlines after a turn about their origins by an angle in rad; turning ones stay as they are."""
        backwards = np.array([[np.cos(heading), -np.sin(heading)]])
        matrices = np.where(self.turning[:, None], self.matrices, covariance_turned_back(self.matrices, backwards))
        stays = np.repeat(self.turning, self.counts)[:, None]
        corners = np.where(stays, self.corners, self.corners @ _rotation(heading).T)
        return self._of(self.turning, self.counts, matrices, corners)

    def rounded(self, decimals: int) -> Outlines:
        """Return the outlines rounded, each as by itself."""
        corners = np.round(self.corners, decimals)
        edges = self.edges
        apart = np.any(corners != corners[edges.before], axis=1)
        if not apart.all():
            return Outlines([outline.rounded(decimals) for outline in self.outlines])
        return self._of(self.turning, self.counts, np.round(self.matrices, decimals), corners)

    @cached_property
    def _first(self) -> Index:
        return np.cumsum(self.counts) - self.counts

    def support(self, index: Index, directions: Array) -> Array:
        """Support functions of chosen outlines, (n,) m, in directions (n, 2)."""
        value = support(self.matrices[index], directions)
        rows = np.flatnonzero(self.counts[index])
        if len(rows):
            starts, edge, owner = self.ragged(index[rows])
            start = self.edges.start[edge]
            value[rows] = np.maximum.reduceat((start * directions[rows][owner]).sum(axis=1), starts)
        return value

    def contacts(self, index: Index, offset: Array, covariance: Array | None = None) -> Contact:
        """Exact signed distances of points to chosen outlines, or to their sums with ellipses."""
        polygon = self.counts[index] > 0
        if covariance is None and polygon.all():
            return self._to_polygons(index, offset)
        distance, normal = np.empty(len(index)), np.empty((len(index), 2))
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

    def ragged(self, index: Index) -> tuple[Index, Index, Index]:
        """First edge of each row in the list of all edges of all rows; those edges; their rows."""
        counts = self.counts[index]
        starts = np.cumsum(counts) - counts
        owner = np.repeat(np.arange(len(index)), counts)
        return starts, np.arange(len(owner)) + (self._first[index] - starts)[owner], owner

    def _to_polygons(self, index: Index, offset: Array) -> Contact:
        starts, edge, owner = self.ragged(index)
        edges = self.edges
        # Component by component: of all edges of all rows, arrays of one axis are much the cheaper ones
        x, y = (offset[:, axis][owner] - edges.start[:, axis][edge] for axis in (0, 1))
        along_x, along_y = (edges.tangent[:, axis][edge] for axis in (0, 1))
        height = x * along_y - y * along_x
        beyond = x * along_x + y * along_y
        beyond -= np.minimum(np.maximum(beyond, 0.0), edges.length[edge])
        highest = np.maximum.reduceat(height, starts)
        outside = highest > AT_VERTEX * self.reach[index]
        # Outside the nearest edge decides, inside the one whose line is nearest.
        away = np.where(outside[owner], beyond * beyond + height * height, -height)
        chosen = np.flatnonzero(away == np.minimum.reduceat(away, starts)[owner])
        best = chosen[owner[chosen].searchsorted(np.arange(len(index)))]
        at = edge[best]
        height, beyond = height[best], beyond[best]
        unit, tangent = edges.normal[at], edges.tangent[at]
        distance = np.where(outside, np.hypot(beyond, height), highest)
        corner = np.flatnonzero(outside & (beyond != 0.0))
        unit[corner] = (beyond[corner, None] * tangent[corner] + height[corner, None] * unit[corner]) / distance[
            corner, None
        ]
        return Contact(distance, unit)

    def _to_sums(self, index: Index, offset: Array, covariance: Array) -> Contact:
        starts, edge, owner = self.ragged(index)
        edges = self.edges
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
class Edges:
    """Edges of polygons, one after the other."""

    start: Array  # (E, 2)
    tangent: Array  # (E, 2)
    normal: Array  # (E, 2)
    length: Array  # (E,) m
    before: Index  # (E,) The edge before each

    @classmethod
    def of(cls, corners: Array, counts: Index) -> Edges:
        """Return the edges of polygons, given their vertices, (E, 2) m, one after the other, and how many each has."""
        last = np.cumsum(counts)
        first = last - counts
        after, before = np.arange(1, len(corners) + 1), np.arange(-1, len(corners) - 1)
        after[last - 1], before[first] = first, last - 1
        vector = corners[after] - corners
        length = np.hypot(vector[:, 0], vector[:, 1])
        tangent = vector / length[:, None]
        normal = np.stack([tangent[:, 1], -tangent[:, 0]], axis=1)
        return cls(corners, tangent, normal, length, before)


def two_ellipses_contact(offset: Array, first: Array, second: Array) -> Contact:
    """Signed distance from points to sums of two ellipses about the origin."""
    step = 2.0 * np.pi / SUM_SEARCH.grid
    grid = np.broadcast_to(step * np.arange(SUM_SEARCH.grid), (len(offset), SUM_SEARCH.grid))
    # Flat ellipses have sharp maxima: theirs alone, and the directions in which they are thin, are tried as well.
    more = [offset, ellipse_contact(offset, first).normal, ellipse_contact(offset, second).normal]
    angles = [np.arctan2(vector[:, 1], vector[:, 0]) for vector in more]
    for matrix in (first, second):
        thin = 0.5 * np.arctan2(2.0 * matrix[:, 1], matrix[:, 0] - matrix[:, 2]) + 0.5 * np.pi
        angles += [thin, thin + np.pi]
    tried = np.concatenate([grid, np.stack(angles, axis=1)], axis=1)

    def separation(angle: Array) -> Array:
        nu = unit_vectors(angle)
        extra = (1,) * (angle.ndim - 1)
        shaped = [values.reshape(len(values), *extra, values.shape[1]) for values in (offset, first, second)]
        gap: Array = (shaped[0] * nu).sum(axis=-1) - support(shaped[1], nu) - support(shaped[2], nu)
        return gap

    best = tried[np.arange(len(offset)), np.argmax(separation(tried), axis=1)]
    low, high = best - step, best + step
    golden = 0.5 * (np.sqrt(5.0) - 1.0)
    inner = np.stack([high - golden * (high - low), low + golden * (high - low)])
    value = np.stack([separation(inner[0]), separation(inner[1])])
    for _ in range(SUM_SEARCH.sections):
        left = value[0] > value[1]
        low, high = np.where(left, low, inner[0]), np.where(left, inner[1], high)
        fresh = np.where(left, high - golden * (high - low), low + golden * (high - low))
        found = separation(fresh)
        inner = np.where(left, np.stack([fresh, inner[0]]), np.stack([inner[1], fresh]))
        value = np.where(left, np.stack([found, value[0]]), np.stack([value[1], found]))
    angle = 0.5 * (low + high)
    return Contact(separation(angle), unit_vectors(angle))


def _rotation(angle: float) -> Array:
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s], [s, c]])


def _tidy(vertices: Array) -> Array:
    """Vertices anticlockwise, without those that are off the line through their neighbours by rounding alone."""
    rounding = ON_LINE * float(np.abs(vertices).max())
    if _area(vertices) < 0.0:
        vertices = vertices[::-1]
    while len(vertices) > 3:
        before, after = vertices - _last(vertices), _next(vertices) - vertices
        straight = np.abs(cross(before, after)) <= rounding * np.hypot(*(before + after).T)
        if not straight.any():
            break
        vertices = np.delete(vertices, int(np.argmax(straight)), axis=0)
    return np.ascontiguousarray(vertices)


def _next(values: Array) -> Array:
    """Values of the vertex after each; np.roll takes many times as long."""
    return np.concatenate([values[1:], values[:1]])


def _last(values: Array) -> Array:
    """Values of the vertex before each."""
    return np.concatenate([values[-1:], values[:-1]])


def _area(vertices: Array) -> float:
    x, y = (vertices - vertices[0]).T
    return 0.5 * float(np.sum(x * _next(y) - _next(x) * y))
