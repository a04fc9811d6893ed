"""Shortest ways among convex polygons: taut polylines, in the order of their lengths, one a homotopy class.

A taut polyline turns at corners of polygons only, and only round them. So the nodes of the graph are legs that touch
the polygons at both of their ends, and a leg is followed by those that turn further round the same corner (a tangent
graph: Y.-H. Liu and S. Arimoto, Path planning using a tangent graph, Int. J. Robotics Research 11 (4), 1992).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from heapq import heappop, heappush
from itertools import count

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components, dijkstra

from scp_planner.arrays import Array, Index, Mask
from scp_planner.errors import TooLargeError
from scp_planner.pauses import look_at_the_clock


@dataclass(frozen=True)
class TautSettings:
    """Rounding, and work that is done at a time."""

    thin: float = 1e-7  # of the extent: polygons overlap by more, and corners turn by more rad
    rows: int = 2**16  # pairs of corners, or of legs and edges, that are looked at together
    raster: int = 192  # cells along the longer side, by which blocked legs are found quickly
    looks: int = 32  # at the raster, on each leg
    most_corners: int = 6_000
    most_pops: int = 400  # polylines that are looked at for the next one


TAUT = TautSettings()
FAR = 1e300  # m, to a side that a polygon does not have


@dataclass(frozen=True)
class TautLine:
    """A taut polyline: its length, m, its points, (n, 2) m, and the corners that it turns at, as (polygon, corner)."""

    length: float
    points: Array
    corners: tuple[int, ...]


class ConvexPolygons:
    """Convex polygons, anticlockwise, by their corners and edges."""

    def __init__(self, polygons: Sequence[Array]) -> None:
        self.size = len(polygons)
        counts = np.array([len(one) for one in polygons], dtype=np.intp)
        most = int(counts.max(initial=3))
        padded = np.zeros((self.size, most, 2))
        for place, one in enumerate(polygons):
            padded[place, : len(one)] = one
            padded[place, len(one) :] = one[-1]
        after = np.roll(padded, -1, axis=1)
        for place, number in enumerate(counts.tolist()):  # the last corner is followed by the first
            after[place, number - 1] = padded[place, 0]
            after[place, number:] = padded[place, number - 1]
        edges = after - padded
        lengths = np.hypot(edges[..., 0], edges[..., 1])
        self.real = lengths > 0.0
        unit = edges / np.where(self.real, lengths, 1.0)[..., None]
        self.normals = np.stack([unit[..., 1], -unit[..., 0]], axis=-1)
        self.offsets = np.where(self.real, (self.normals * padded).sum(axis=-1), FAR)
        self.low, self.high = padded.min(axis=1), padded.max(axis=1)
        self.owner, corner = np.nonzero(self.real)
        self.corners = padded[self.owner, corner]
        self.leaving = unit[self.owner, corner]
        first = np.cumsum(np.bincount(self.owner, minlength=self.size)) - np.bincount(self.owner, minlength=self.size)
        last = corner == 0
        before = np.arange(len(corner)) - 1
        numbers = np.bincount(self.owner, minlength=self.size)
        before[last] = first[self.owner[last]] + numbers[self.owner[last]] - 1
        self.arriving = self.leaving[before]

    def take(self, index: Index) -> tuple[Array, Array]:
        """Normals and offsets of the edges of some of them."""
        return self.normals[index], self.offsets[index]

    def depths(self, points: Array, which: Index) -> Array:
        """Depths of points, (n, 2) m, in one polygon each, (n,) m; negative outside."""
        normals, offsets = self.take(which)
        depth: Array = (offsets - (normals * points[:, None]).sum(axis=-1)).min(axis=1)
        return depth

    def near(self, low: Array, high: Array, margin: float) -> tuple[Index, Index]:
        """Pairs of boxes, (n, 2) each, and polygons whose boxes come nearer than a margin, m."""
        found = [(np.zeros(0, dtype=np.intp), np.zeros(0, dtype=np.intp))]
        step = max(1, TAUT.rows // max(self.size, 1))
        for begin in range(0, len(low), step):
            some = slice(begin, begin + step)
            apart = (low[some, None] > self.high + margin) | (high[some, None] < self.low - margin)
            box, polygon = np.nonzero(~apart.any(axis=-1))
            found.append((box + begin, polygon))
        return np.concatenate([one for one, _ in found]), np.concatenate([one for _, one in found])

    def covered(self, points: Array, thin: float, own: Index | None = None) -> Mask:
        """True if points lie in a polygon, deeper than ``thin``, besides the own one of each."""
        point, polygon = self.near(points, points, 0.0)
        if own is not None:
            other = polygon != own[point]
            point, polygon = point[other], polygon[other]
        within = self.depths(points[point], polygon) > thin
        found = np.zeros(len(points), dtype=bool)
        found[point[within]] = True
        return found

    def crossed(self, begin: Array, end: Array, thin: float) -> Iterator[tuple[Index, Index]]:
        """Yield legs, (n, 2) m each end, and polygons that they cross deeper than ``thin``."""
        leg, polygon = self.near(np.minimum(begin, end), np.maximum(begin, end), 0.0)
        step = max(1, TAUT.rows // max(self.normals.shape[1], 1))
        for first in range(0, len(leg), step):
            some, which = leg[first : first + step], polygon[first : first + step]
            normals, offsets = self.take(which)
            at_begin = (normals * begin[some, None]).sum(axis=-1) - offsets + thin
            at_end = (normals * end[some, None]).sum(axis=-1) - offsets + thin
            change = at_end - at_begin
            with np.errstate(divide="ignore", invalid="ignore"):
                share = -at_begin / change
            enters = np.where(change < 0.0, share, 0.0).max(axis=1)
            leaves = np.where(change > 0.0, share, 1.0).min(axis=1)
            outside = ((change == 0.0) & (at_begin >= 0.0)).any(axis=1)
            met = (np.maximum(enters, 0.0) < np.minimum(leaves, 1.0)) & ~outside
            yield some[met], which[met]

    @cached_property
    def clusters(self) -> Index:
        """Number of the cluster of each polygon: those that overlap are of one."""
        one, other = self.near(self.low, self.high, 0.0)
        pairs = one < other
        one, other = one[pairs], other[pairs]
        apart = np.zeros(len(one), dtype=bool)
        for first, second in ((one, other), (other, one)):
            normals, offsets = self.take(first)
            corners = self._padded[second]
            heights = np.einsum("pei,pci->pec", normals, corners).min(axis=2)
            apart |= (heights >= offsets).any(axis=1)
        one, other = one[~apart], other[~apart]
        graph = csr_array((np.ones(len(one)), (one.astype(np.int32), other.astype(np.int32))), shape=(self.size,) * 2)
        labels: Index = connected_components(graph, directed=False)[1]
        return labels

    @cached_property
    def _padded(self) -> Array:
        first = self.corners[np.searchsorted(self.owner, np.arange(self.size))]
        corners = np.repeat(first[:, None], self.real.shape[1], axis=1)
        corners[np.nonzero(self.real)] = self.corners
        return corners


class TautLines:
    """Taut polylines from a start to a goal among convex polygons, the shortest first."""

    def __init__(
        self,
        polygons: Sequence[Array],
        start: Array,
        goal: Array,
        inside: Sequence[tuple[Array, float]] = (),
        deadline: float = np.inf,
    ) -> None:
        """Take half planes normal . r <= offset, ``inside``, that all corners are to lie in."""
        self.polygons, self.inside = list(polygons), inside
        self.start, self.goal, self.deadline = np.asarray(start, dtype=float), np.asarray(goal, dtype=float), deadline
        self.all = ConvexPolygons(self.polygons)
        ends = np.stack([self.start, self.goal])
        low = np.minimum(ends.min(axis=0), self.all.low.min(axis=0, initial=np.inf))
        high = np.maximum(ends.max(axis=0), self.all.high.max(axis=0, initial=-np.inf))
        self.thin = TAUT.thin * max(float((high - low).max()), float(np.abs(ends).max()))

    def __iter__(self) -> Iterator[TautLine]:
        """Yield them; polygons that none of them has met yet are left out of the graph."""
        active, done = np.zeros(self.all.size, dtype=bool), list[TautLine]()
        while True:
            graph, more = _Graph(self, np.flatnonzero(active)), False
            for line in graph.lines():
                met = self.met(line.points)
                if len(met):
                    active |= np.isin(self.all.clusters, self.all.clusters[met])
                    more = True
                    break
                if not any(_same(line, other, self.thin) for other in done):
                    done.append(line)
                    yield line
            if not more:
                return

    def met(self, points: Array, deeper: float = 0.0) -> Index:
        """Return the polygons that a polyline crosses, deeper than a depth in m."""
        thin = max(deeper, self.thin)
        if len(points) == 1:
            point, near = self.all.near(points, points, 0.0)
            return near[self.all.depths(points[point], near) > thin]
        found = [polygon for _, polygon in self.all.crossed(points[:-1], points[1:], thin)]
        return np.unique(np.concatenate(found)) if found else np.zeros(0, dtype=np.intp)


def _same(line: TautLine, other: TautLine, thin: float) -> bool:
    if abs(line.length - other.length) > 10.0 * thin * len(line.points) or len(line.points) != len(other.points):
        return False
    return bool(np.abs(line.points - other.points).max() <= 10.0 * thin)


class _Graph:
    """The graph of the legs among some of the polygons, and the shortest way to the goal from each."""

    def __init__(self, lines: TautLines, some: Index) -> None:
        self.lines_of = lines
        polygons = ConvexPolygons([lines.polygons[k] for k in some.tolist()])
        kept = ~polygons.covered(polygons.corners, lines.thin, polygons.owner)
        for normal, offset in lines.inside:
            kept &= polygons.corners @ normal <= offset + lines.thin
        index = np.flatnonzero(kept)
        # Of corners that polygons have in common, one: a leg that cuts into another polygon there is not free
        places = np.round(polygons.corners[index] / (10.0 * lines.thin))
        index = index[np.sort(np.unique(places, axis=0, return_index=True)[1])]
        if len(index) > TAUT.most_corners:
            raise TooLargeError(f"ground: {len(index)} corners; at most {TAUT.most_corners} are looked at together")
        self.numbers = index
        self.points = np.concatenate([polygons.corners[index], lines.start[None], lines.goal[None]])
        self.arriving, self.leaving = polygons.arriving[index], polygons.leaving[index]
        self.owner = np.concatenate([polygons.owner[index], [-1, -2]])
        self.polygons = polygons
        self._connect()

    def _connect(self) -> None:
        """Make the legs, each in both directions, and the graph of their order."""
        begin, end, at_begin, at_end = self._tangents()
        free = self._free(begin, end)
        begin, end, at_begin, at_end = begin[free], end[free], at_begin[free], at_end[free]
        # Backwards, what is passed on the left is on the right
        self.begin, self.end = np.concatenate([begin, end]), np.concatenate([end, begin])
        self.at_begin, self.at_end = np.concatenate([at_begin, -at_end]), np.concatenate([at_end, -at_begin])
        size = len(self.points)
        sensible = (self.begin != size - 1) & (self.end != size - 2)
        self.begin, self.end = self.begin[sensible], self.end[sensible]
        self.at_begin, self.at_end = self.at_begin[sensible], self.at_end[sensible]
        vectors = self.points[self.end] - self.points[self.begin]
        self.lengths = np.hypot(vectors[:, 0], vectors[:, 1])
        self.units = vectors / self.lengths[:, None]
        self._order()

    def _tangents(self) -> tuple[Index, Index, Index, Index]:
        """Legs between corners, and on which side of each end its polygon lies: 1 left, -1 right, 0 at an end."""
        size, corners = len(self.points), len(self.points) - 2
        found, thin = [], TAUT.thin
        step = max(1, TAUT.rows // size)
        for first in range(0, size, step):
            look_at_the_clock(self.lines_of.deadline)
            rows = np.arange(first, min(first + step, size))
            vectors = self.points - self.points[rows][:, None]
            lengths = np.hypot(vectors[..., 0], vectors[..., 1])
            pairs = (np.arange(size) > rows[:, None]) & (lengths > self.lines_of.thin)
            x, y = (vectors[..., axis] / np.where(lengths > 0.0, lengths, 1.0) for axis in (0, 1))
            here = np.zeros(x.shape, dtype=np.intp)
            some = rows[rows < corners]
            here[: len(some)] = _sides(x[: len(some)], y[: len(some)], self.arriving[some], self.leaving[some], thin, 1)
            pairs[: len(some)] &= here[: len(some)] != 0
            there = np.zeros(x.shape, dtype=np.intp)
            there[:, :corners] = _sides(x[:, :corners], y[:, :corners], self.arriving, self.leaving, thin, 0)
            pairs[:, :corners] &= there[:, :corners] != 0
            one, other = np.nonzero(pairs)
            found.append((rows[one], other, here[one, other], there[one, other]))
        return tuple(np.concatenate(parts) for parts in zip(*found, strict=True))  # type: ignore[return-value]

    def _free(self, begin: Index, end: Index) -> Mask:
        """True if legs cross no polygon."""
        free = self._free_by_raster(begin, end)
        left = np.flatnonzero(free)
        step = max(1, 16 * TAUT.rows // max(self.polygons.size * 4, 1))
        for first in range(0, len(left), step):
            look_at_the_clock(self.lines_of.deadline)
            some = left[first : first + step]
            ends = self.points[begin[some]], self.points[end[some]]
            for leg, _ in self.polygons.crossed(*ends, self.lines_of.thin):
                free[some[leg]] = False
        return free

    def _free_by_raster(self, begin: Index, end: Index) -> Mask:
        """False for legs that clearly cross a polygon: a cell that lies in one."""
        free = np.ones(len(begin), dtype=bool)
        if len(begin) * self.polygons.size < TAUT.rows:
            return free
        low, high = self.points.min(axis=0), self.points.max(axis=0)
        cell = float((high - low).max()) / TAUT.raster
        shape = np.floor((high - low) / cell).astype(np.intp) + 1
        taken = np.zeros(tuple(shape.tolist()), dtype=bool)
        for place in range(self.polygons.size):
            first = np.clip(np.floor((self.polygons.low[place] - low) / cell).astype(np.intp), 0, shape)
            last = np.clip(np.floor((self.polygons.high[place] - low) / cell).astype(np.intp) + 1, 0, shape)
            x, y = np.arange(first[0], last[0]), np.arange(first[1], last[1])
            if len(x) == 0 or len(y) == 0:
                continue
            centres = low + cell * (np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1).reshape(-1, 2) + 0.5)
            depth = self.polygons.depths(centres, np.full(len(centres), place)) > 0.7072 * cell
            taken[first[0] : last[0], first[1] : last[1]] |= depth.reshape(len(x), len(y))
        shares = (np.arange(TAUT.looks) + 0.5) / TAUT.looks
        step = max(1, TAUT.rows // TAUT.looks)
        for first in range(0, len(begin), step):
            a, b = self.points[begin[first : first + step]], self.points[end[first : first + step]]
            places = a[:, None] + shares[:, None] * (b - a)[:, None]
            cells = np.floor((places - low) / cell).astype(np.intp)
            free[first : first + step] = ~taken[cells[..., 0], cells[..., 1]].any(axis=1)
        return free

    def _order(self) -> None:
        """Say which leg is the next one round a corner after each leg, and after arriving by it."""
        legs, size = len(self.begin), len(self.points)
        start, goal = size - 2, size - 1
        turned = np.arctan2(self.units[:, 1], self.units[:, 0])
        departs = self._turned(self.begin, self.at_begin, turned)
        arrives = self._turned(self.end, self.at_end, turned)
        # States: a corner and on which side it is passed
        state, target = 2 * self.begin + (self.at_begin > 0), 2 * self.end + (self.at_end > 0)
        order = np.lexsort((departs, state))
        far = 4.0 * np.pi
        keys = state[order] * far + departs[order]
        place = np.searchsorted(keys, target * far + arrives + TAUT.thin, "right")
        within = place < legs
        within[within] = state[order[place[within]]] == target[within]
        self.next_turn = np.full(legs, -1, dtype=np.intp)
        same = state[order[:-1]] == state[order[1:]]
        self.next_turn[order[:-1][same]] = order[1:][same]
        self.onward = np.full(legs, -1, dtype=np.intp)
        self.onward[within] = order[place[within]]
        arrived = self.end == goal
        self.onward[arrived] = legs
        self.first = np.flatnonzero(self.begin == start)
        self.next_turn[self.first] = -1
        self._to_the_goal(legs)

    def _turned(self, corner: Index, side: Array, angle: Array) -> Array:
        """By how much legs have turned round their corners, 0 to pi."""
        ends = corner >= len(self.arriving)
        at = np.where(ends, 0, corner)
        if len(self.arriving) == 0:
            return np.zeros(len(corner))
        # To the left from the edge that arrives; to the right from the one that leaves, backwards
        left = np.arctan2(self.arriving[at, 1], self.arriving[at, 0])
        right = np.arctan2(-self.leaving[at, 1], -self.leaving[at, 0])
        turn = np.where(side > 0, angle - left, right - angle)
        turn = np.remainder(turn + 0.5 * np.pi, 2.0 * np.pi) - 0.5 * np.pi
        return np.where(ends, 0.0, turn) + 0.5 * np.pi

    def _to_the_goal(self, legs: int) -> None:
        """Least way left before each leg, m."""
        tiny = 1e-3 * self.lines_of.thin
        turn, drive = np.flatnonzero(self.next_turn >= 0), np.flatnonzero(self.onward >= 0)
        rows = np.concatenate([self.next_turn[turn], self.onward[drive]]).astype(np.int32)
        columns = np.concatenate([turn, drive]).astype(np.int32)
        weights = np.concatenate([np.full(len(turn), tiny), self.lengths[drive]])
        # A leg may be followed by one other by both: the two are kept apart by never being the same
        graph = csr_array((weights, (rows, columns)), shape=(legs + 1, legs + 1))
        self.left: Array = dijkstra(graph, indices=legs)
        self.driven = np.full(legs, np.inf)
        self.driven[drive] = self.lengths[drive] + self.left[self.onward[drive]]

    def lines(self) -> Iterator[TautLine]:
        """Yield them in the order of their lengths, without those that come back to a corner."""
        tie = count()
        heap: list[tuple[float, int, tuple[int, ...], float]] = []
        for leg in self.first.tolist():
            if np.isfinite(self.driven[leg]):
                heappush(heap, (float(self.driven[leg]), next(tie), (leg,), 0.0))
        for _ in range(TAUT.most_pops):
            if not heap:
                return
            length, _, path, before = heappop(heap)
            path, branches = self._followed(path, before)
            for total, branch, since in branches:
                heappush(heap, (total, next(tie), branch, since))
            points = self.points[np.append(self.begin[list(path)], self.end[path[-1]])]
            corners = self.end[list(path)].tolist()
            if len(set(corners)) == len(corners):
                yield TautLine(length, points, tuple(corners[:-1]))

    def _followed(
        self, path: tuple[int, ...], before: float
    ) -> tuple[tuple[int, ...], list[tuple[float, tuple[int, ...], float]]]:
        """The shortest way on from a path's last leg, and the other legs that might be taken after it."""
        goal, found = len(self.begin), list(path)
        branches: list[tuple[float, tuple[int, ...], float]] = []
        since = before
        while True:
            leg = found[-1]
            since += float(self.lengths[leg])
            node = int(self.onward[leg])
            if node == goal:
                return tuple(found), branches
            options = []
            while node >= 0:
                if np.isfinite(self.driven[node]):
                    options.append(node)
                node = int(self.next_turn[node])
            best = min(options, key=lambda one: self.driven[one])
            prefix = tuple(found)
            branches += [(since + float(self.driven[one]), (*prefix, one), since) for one in options if one != best]
            found.append(best)


def _sides(x: Array, y: Array, arriving: Array, leaving: Array, thin: float, axis: int) -> Index:
    """Sides of lines along (x, y) through corners on which their polygons lie: 1 left, -1 right, 0 both."""
    a, b = (arriving[:, None], leaving[:, None]) if axis == 1 else (arriving[None], leaving[None])
    first, last = a[..., 0] * y - a[..., 1] * x, x * b[..., 1] - y * b[..., 0]
    left = (first >= -thin) & (last >= -thin)
    right = (first <= thin) & (last <= thin)
    return left.astype(np.intp) - right.astype(np.intp)
