"""Routes over a map: the shortest way of a disc over free cells, and convex ground free of occupied cells along it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from math import ceil, cos, hypot, sin, sqrt

import numpy as np

from scp_planner.arrays import Array, Index, Mask, unit_vectors
from scp_planner.mathematics.occupancy import OccupancyMap, pooled
from scp_planner.pauses import Budget, pause
from scp_planner.routes.drivable import drivable_route
from scp_planner.routes.outlines import StandingShape
from scp_planner.scenario.models import Scenario


@dataclass(frozen=True)
class MapSettings:
    """Fineness of routes over maps, and how wide the ground along them is."""

    fine: float = 0.5  # of the vehicle's radius: cells may be so large for routes; finer where there is none
    many: int = 9_000_000  # cells: with no more than these, routes are looked for over the map's own cells
    blocks: int = 250_000  # of cells, among which a route is looked for first
    beside: float = 12.0  # radii, to each side of the shortest route, where the vehicle may follow another one
    wide: float = 12.0  # radii to each side, that the ground along a route is at most wide
    least: float = 0.5  # radii to each side, that it is wide
    long: float = 8.0  # radii, of a piece of ground along its route at most
    most_pieces: int = 40  # of a route; of longer ones each is longer
    most_open: int = 60  # pieces, in which trips find guides of their own; of more legs, those held before have none
    more: float = 1.001  # of the radius, that a route keeps from occupied cells
    sides: int = 16  # of a polygon round what stands besides the map


MAPS = MapSettings()
_EIGHT = np.array([[1, 0], [0, 1], [1, 1], [1, -1]])  # half of the neighbours of a cell: the others see them


class MapRoutes:
    """Free cells of a map for a disc, and routes over them."""

    def __init__(
        self,
        scenario: Scenario,
        ground: OccupancyMap,
        standing: Sequence[StandingShape] = (),
        budget: Budget | None = None,
    ) -> None:
        self.scenario, self.ground, self.standing = scenario, ground, standing
        self.budget = budget or Budget()
        self.radius = MAPS.more * scenario.vehicle.radius
        self.drivable: Array | None = None

    def route(self) -> Array | None:
        """Return a polyline from start to goal, (n, 2) m, near to the shortest; None where there is none."""
        wanted = ceil(sqrt(self.ground.occupied.size / MAPS.many))
        size = max(1, min(int(MAPS.fine * self.radius / self.ground.resolution), wanted))
        while True:
            found = self._route(pooled(self.ground, size))
            if found is not None or size == 1:
                return found
            size = max(1, size // 2)

    def _route(self, coarse: OccupancyMap) -> Array | None:
        free = ~_dilated(coarse, self.radius)
        self._without_others(coarse, free)
        self.budget.check()
        ends = coarse.local([self.scenario.start.position, self.scenario.goal.position])
        begin, end = (self._free_cell(coarse, free, place) for place in ends)
        if begin is None or end is None:
            return None
        band = _band(free, begin, end)
        path = None if band is None else shortest_over(band, begin, end)[0]
        if path is None:
            return None
        route = _route_over(ends, path, free)
        band = _beside(free, route, MAPS.beside * self.radius / coarse.resolution)
        path, left = shortest_over(band, begin, end)
        if path is not None:  # between blocks the first one goes from side to side
            route = min(route, _route_over(ends, path, free), key=_length)
        for place, cell in zip(ends, (begin, end), strict=True):  # they may lie beside free cells by less than one
            own = tuple(np.clip(np.floor(place).astype(np.intp), 0, np.array(free.shape[::-1]) - 1)[::-1])
            band[own], left[own] = True, min(left[own], left[cell[1], cell[0]])
        self.budget.check()
        found = drivable_route(
            self.scenario, self.radius, (*ends, coarse.yaw), band, left, coarse.resolution, self.budget
        )
        self.drivable = None if found is None else coarse.world(found)
        return coarse.world(route)

    def _free_cell(self, coarse: OccupancyMap, free: Mask, place: Array) -> Index | None:
        """The free cell that is nearest to a place, (column, row), within the vehicle's or the goal's radius."""
        reach = ceil(max(self.radius, self.scenario.goal.radius) / coarse.resolution) + 1
        low, high = coarse.clipped(place - reach, 0), coarse.clipped(place + reach, 0) + 1
        rows, columns = np.nonzero(free[low[1] : high[1], low[0] : high[0]])
        if len(rows) == 0:
            return None
        cells = np.stack([columns, rows], axis=1) + low
        found: Index = cells[np.argmin(np.hypot(*(cells + 0.5 - place).T))]
        return found

    def _without_others(self, coarse: OccupancyMap, free: Mask) -> None:
        """Take the cells out from where the vehicle touches bounds, walls, or what stands."""
        bounds = self.scenario.bounds
        if bounds is not None:
            centre = 0.5 * (np.array(bounds.min) + bounds.max)
            half = 0.5 * (np.array(bounds.max) - bounds.min) - self.radius
            _keep(coarse, free, np.array([[1.0, 0.0], [0.0, 1.0], [-1.0, 0.0], [0.0, -1.0]]), centre, np.tile(half, 2))
        angles = 2.0 * np.pi * np.arange(MAPS.sides) / MAPS.sides
        fan = unit_vectors(angles)
        for shape in self.standing:
            heights = shape.support(fan) - fan @ shape.centre + self.radius
            _take_out(coarse, free, fan, shape.centre, heights)

    def along(self, route: Array) -> list[Array]:
        """Return convex polygons, (k, 2) m each, without occupied cells, round the legs of a route."""
        longest = max(MAPS.long * self.radius, float(np.hypot(*np.diff(route, axis=0).T).sum()) / MAPS.most_pieces)
        found: list[Array] = []
        for begin, end in pairwise(route):
            count = ceil(hypot(*(end - begin)) / longest)
            places = begin + np.linspace(0.0, 1.0, count + 1)[:, None] * (end - begin)
            for one, other in pairwise(places):
                if not (
                    len(route) > MAPS.most_open and found and _holds(found[-1], np.stack([one, other]), self.radius)
                ):
                    found.append(self._round(one, other))
        start = self.scenario.start
        for disc in self.scenario.vehicle.discs:  # a leg from here may touch what the vehicle does not
            if disc == 0.0 or start.heading is not None:
                heading = start.heading or 0.0
                place = np.array(start.position) + disc * np.array([cos(heading), sin(heading)])
                found.append(self._round(place, place))
        return [piece for piece in [*found, self._round(route[-1], route[-1])] if len(piece)]

    def _round(self, begin: Array, end: Array) -> Array:
        """Cut the nearest cell off a box round a leg till none is left (Liu et al. 2017); all, if the leg is on one."""
        self.budget.check()
        ground, least = self.ground, MAPS.least * self.radius / self.ground.resolution
        wide = MAPS.wide * self.radius / ground.resolution
        one, other = ground.local([begin, end])
        along = (other - one) / max(hypot(*(other - one)), 1e-12) if (one != other).any() else np.array([1.0, 0.0])
        aside = np.array([-along[1], along[0]])
        corners = [one - wide * along, other + wide * along]
        polygon = np.array(
            [corners[0] - wide * aside, corners[1] - wide * aside, corners[1] + wide * aside, corners[0] + wide * aside]
        )
        if ground.at(ground.clipped(np.stack([one, other]))).any():
            return np.zeros((0, 2))
        cells = ground.occupied_in(polygon.min(axis=0), polygon.max(axis=0)).astype(np.float64) + 0.5
        apart = _apart(cells, one, other)
        while len(cells):
            k = int(np.argmin(np.hypot(*apart.T)))
            way = apart[k] if apart[k].any() else cells[k] - 0.5 * (one + other)  # a leg that touches the cell
            normal = way / max(hypot(*way), 1e-12)
            lowest = cells @ normal - 0.5 * np.abs(normal).sum()
            polygon = _cut(polygon, normal, float(lowest[k]))
            if not _holds(polygon, np.stack([one, other]), least):
                return np.zeros((0, 2))
            left = lowest < lowest[k] - 1e-9
            left[k] = False
            cells, apart = cells[left], apart[left]
        return ground.world(polygon)


def _holds(polygon: Array, points: Array, apart: float) -> bool:
    """True if a convex polygon, anticlockwise, holds points (n, 2), a distance from its sides."""
    edges = np.roll(polygon, -1, axis=0) - polygon
    away = points[:, None] - polygon
    depth = (edges[:, 0] * away[..., 1] - edges[:, 1] * away[..., 0]) / np.maximum(np.hypot(*edges.T), 1e-300)
    return len(polygon) > 0 and bool(depth.min() >= apart)


def _apart(cells: Array, one: Array, other: Array) -> Array:
    """Shortest way (n, 2) from a leg to each cell, by its centre."""
    leg = other - one
    squared = max(float(leg @ leg), 1e-300)
    ways = [np.clip(place, cells - 0.5, cells + 0.5) - place for place in (one, other)]
    for corner in np.array([[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]]):
        away = cells + corner - one
        ways.append(away - np.clip(away @ leg / squared, 0.0, 1.0)[:, None] * leg)
    every = np.stack(ways)
    nearest = np.argmin((every**2).sum(axis=2), axis=0)
    found: Array = every[nearest, np.arange(len(cells))]
    return found


def _cut(polygon: Array, normal: Array, height: float) -> Array:
    """The part of a convex polygon with normal . x <= height."""
    over = polygon @ normal - height
    found = []
    for k, (here, there) in enumerate(zip(over, np.roll(over, -1), strict=True)):
        if here <= 0.0:
            found.append(polygon[k])
        if here * there < 0.0:
            found.append(polygon[k] + here / (here - there) * (polygon[(k + 1) % len(polygon)] - polygon[k]))
    return np.array(found)


def _dilated(ground: OccupancyMap, radius: float, rows_at_once: int = 512) -> Mask:
    """Cells whose centre is nearer to an occupied cell than a radius, m."""
    reach = radius / ground.resolution
    rows, columns = ground.occupied.shape
    up = min(int(reach + 0.5), max(rows, columns))
    away = np.maximum(np.abs(np.arange(-up, up + 1)) - 0.5, 0.0)
    half = [min(int(sqrt(max(reach**2 - a * a, 0.0)) + 0.5 - 1e-9), up) if a < reach else -1 for a in away.tolist()]
    found = np.zeros((rows, columns), dtype=bool)
    for first in range(0, rows, rows_at_once):
        last = min(first + rows_at_once, rows)
        part = np.full((last - first + 2 * up, columns + 2 * up), ground.beyond)
        low, high = max(first - up, 0), min(last + up, rows)
        part[low - first + up : high - first + up, up : up + columns] = ground.occupied[low:high]
        grown, wide = part[:, up : up + columns].copy(), 0
        for width, shift in sorted((w, k) for k, w in enumerate(half) if w >= 0):
            while wide < width:
                wide += 1
                grown |= part[:, up + wide : up + wide + columns]
                grown |= part[:, up - wide : up - wide + columns]
            found[first:last] |= grown[shift : shift + last - first]
    return found


def _keep(coarse: OccupancyMap, free: Mask, normals: Array, centre: Array, heights: Array) -> None:
    """Leave cells free only where their centres lie in a convex polygon."""
    rows, columns = free.shape
    turned = normals @ coarse.rotation * coarse.resolution
    start = (coarse.world(np.array([0.5, 0.5])) - centre) @ normals.T
    for k in range(len(normals)):
        over = start[k] + turned[k, 0] * np.arange(columns)[None] + turned[k, 1] * np.arange(rows)[:, None]
        free &= over <= heights[k]


def _take_out(coarse: OccupancyMap, free: Mask, normals: Array, centre: Array, heights: Array) -> None:
    """Leave cells free only where their centres lie outside of a convex polygon."""
    middle, reach = coarse.local(centre), float(heights.max()) / coarse.resolution + 2.0
    low = np.maximum(np.floor(middle - reach).astype(np.intp), 0)
    high = np.minimum(np.ceil(middle + reach).astype(np.intp), free.shape[::-1])
    if (low >= high).any():
        return
    inside = np.ones((high[1] - low[1], high[0] - low[0]), dtype=bool)
    shape = OccupancyMap(inside, coarse.resolution, tuple(coarse.world(low.astype(float))), coarse.yaw)
    _keep(shape, inside, normals, centre, heights)
    free[low[1] : high[1], low[0] : high[0]] &= ~inside


def _band(free: Mask, begin: Index, end: Index) -> Mask | None:
    """Free cells in blocks along a route from one cell to another; None where there is none.

    Blocks are cut into parts that hang together, so that every route over parts is one over cells.
    """
    from scipy.ndimage import label
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import dijkstra

    size = max(1, ceil(sqrt(free.size / MAPS.blocks)))
    if size == 1:
        return free
    across = np.ix_(*(np.arange(count) + np.arange(count) // size for count in free.shape))
    spaced = np.zeros(tuple(count + (count - 1) // size for count in free.shape), dtype=bool)
    spaced[across] = free
    parts, count = label(spaced)
    middle, pairs = np.zeros((count + 1, 2)), []
    for axis in (0, 1):
        whole = parts if axis == 0 else parts.T
        one, other = whole[size - 1 :: size + 1], whole[size + 1 :: size + 1]
        one = one[: len(other)]
        met = (one > 0) & (other > 0)
        met[:, 1:] &= (one[:, 1:] != one[:, :-1]) | (other[:, 1:] != other[:, :-1]) | ~met[:, :-1]  # once in a row
        row, column = np.nonzero(met)
        pairs.append(one[row, column].astype(np.int64) * (count + 1) + other[row, column])
        for side, found in ((0, one[row, column]), (1, other[row, column])):
            middle[found] = np.stack([row + side, column // (size + 1)], axis=1)[:, :: 1 - 2 * axis]
    one, other = np.divmod(np.unique(np.concatenate(pairs)), count + 1)
    apart = np.hypot(*(middle[one] - middle[other]).T)
    graph = coo_array((apart, (one, other)), shape=(count + 1, count + 1)).tocsr()
    first, last = (int(parts[cell[1] + cell[1] // size, cell[0] + cell[0] // size]) for cell in (begin, end))
    _, before = dijkstra(graph, directed=False, indices=first, return_predecessors=True)
    on = np.zeros(count + 1, dtype=bool)
    while last != first:
        if last < 0:
            return None
        on[last] = True
        last = int(before[last])
    on[first] = True
    near = on.copy()
    near[one[on[other]]] = near[other[on[one]]] = True
    near[0] = False
    band: Mask = near[parts][across]
    return band


def shortest_over(free: Mask, begin: Index, end: Index) -> tuple[Array | None, Array]:
    """Shortest path over free cells from one to another, by their eight neighbours: (n, 2) columns and rows.

    With it the length of that to the other one from each cell, cells.
    """
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import dijkstra

    pause()
    rows, columns = free.shape
    cells = np.flatnonzero(free)
    row, column = np.divmod(cells, columns)
    edges = []
    for step in _EIGHT:
        x, y = column + step[0], row + step[1]
        inside = (x >= 0) & (x < columns) & (y < rows) & (y >= 0)
        here = np.flatnonzero(inside)
        here = here[free[y[here], x[here]]]
        there = np.searchsorted(cells, y[here] * columns + x[here])
        edges.append(np.stack([here, there, np.full(len(here), hypot(*step))]))
    one, other, length = np.concatenate(edges, axis=1)
    shape = len(cells), len(cells)
    graph = coo_array((length, (one.astype(np.intp), other.astype(np.intp))), shape=shape).tocsr()
    first, last = (int(np.searchsorted(cells, cell[1] * columns + cell[0])) for cell in (begin, end))
    away, before = dijkstra(graph, directed=False, indices=last, return_predecessors=True)
    left: Array = np.full(free.shape, np.inf, dtype=np.float32)
    left[row, column] = away
    if not np.isfinite(away[first]):
        return None, left
    path = [first]
    while path[-1] != last:
        path.append(int(before[path[-1]]))
    return np.stack([column[path], row[path]], axis=1).astype(float), left


def _beside(free: Mask, line: Array, reach: float) -> Mask:
    """Free cells in blocks along a polyline and in those beside these, each as wide as a reach, cells."""
    from scipy.ndimage import binary_dilation

    side = max(1, min(round(reach), max(free.shape)))
    blocks = np.zeros(tuple(count // side + 1 for count in free.shape), dtype=bool)
    line = np.clip(line, 0.0, free.shape[::-1])
    for one, other in pairwise(line):
        count = ceil(2.0 * hypot(*(other - one)) / side) + 1
        at = (one + np.linspace(0.0, 1.0, count)[:, None] * (other - one)) / side
        column, row = np.clip(np.floor(at).astype(np.intp), 0, np.array(blocks.shape[::-1]) - 1).T
        blocks[row, column] = True
    wide = np.repeat(binary_dilation(blocks, np.ones((3, 3))), side, axis=0)[: len(free)]
    return np.repeat(wide, side, axis=1)[:, : free.shape[1]] & free


def _length(line: Array) -> float:
    return float(np.hypot(*np.diff(line, axis=0).T).sum())


def _route_over(ends: Array, path: Array, free: Mask) -> Array:
    """A path over cells from one place to another, with as few corners as free cells allow."""
    line = np.concatenate([ends[:1], path + 0.5, ends[1:]])
    return _pulled(line, lambda one, other: _sees(line[one], line[other], free))


def _pulled(line: Array, joins: Callable[[int, int], bool]) -> Array:
    """A polyline with fewer corners: from each the farthest one, about, that a leg joins it to."""
    kept, here = [0], 0
    while here < len(line) - 1:
        low, step = here + 1, 1
        while low + step < len(line) and joins(here, low + step):
            low, step = low + step, 2 * step
        while step > 1:
            step //= 2
            if low + step < len(line) and joins(here, low + step):
                low += step
        kept.append(low)
        here = low
    return line[kept]


def straightened(line: Array, off: float) -> Array:
    """Return a polyline, (n, 2) m, with fewer corners, that is off by no more than a distance, m."""

    def joins(one: int, other: int) -> bool:
        away, leg = line[one : other + 1] - line[one], line[other] - line[one]
        share = np.clip(away @ leg / max(float(leg @ leg), 1e-300), 0.0, 1.0)
        return float(np.hypot(*(away - share[:, None] * leg).T).max()) <= off

    return _pulled(line, joins)


def _sees(one: Array, other: Array, free: Mask) -> bool:
    """True if a leg lies in free cells; its ends may lie beside them by less than one."""
    one, other = np.clip([one, other], 0.0, free.shape[::-1])
    count = int(2.0 * np.abs(other - one).max()) + 2
    places = one + np.linspace(0.0, 1.0, count + 1)[1:-1, None] * (other - one)
    cells = np.clip(np.floor(places).astype(np.intp), 0, np.array(free.shape[::-1]) - 1)
    return bool(free[cells[:, 1], cells[:, 0]].all())
