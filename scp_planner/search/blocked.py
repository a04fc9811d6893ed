"""Cells of the grid that zones and workspace block."""

from __future__ import annotations

from collections.abc import Container, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import chain, pairwise
from math import ceil
from time import perf_counter

import numpy as np

from scp_planner.arrays import Array, Index, Mask, rows_of
from scp_planner.constraints.ends import FOLD
from scp_planner.pauses import pause
from scp_planner.problem.problem import Problem
from scp_planner.search.grid import DELAYS, Grid, Words
from scp_planner.threat_zones.batch import ZoneBatch
from scp_planner.threat_zones.sections import sections
from scp_planner.trips.guide import GuideFrame
from scp_planner.trips.path import Path


@dataclass(frozen=True)
class Chunks:
    """Work that is done at a time."""

    stretch: int = 16  # delays that are looked at together
    most_looks: int = 100_000  # at a time: lines, times and zones
    most_cut: int = 20_000  # lines and delays of zones that are cut at a time
    usual_corners: int = 5  # of a zone; with more of them fewer are cut at a time
    most_kept: int = 100_000  # cuts, of all zones
    few_cells: int = 10_000  # at a delay, that are looked at in no time: in smaller grids the clock is not looked at,
    few_corners: int = 1000  # but where zones have more than so many corners
    most_marked: int = 1_000_000  # cells at a time


CHUNKS = Chunks()


@dataclass(frozen=True)
class Cuts:
    """Offsets that zones block on lines at some delays."""

    line: Index  # (n,)
    delay: Index  # (n,)
    zone: Index  # (n,)
    lower: Array  # (n,) Ends of the blocked offsets, and the offset of the zone's centre
    upper: Array  # (n,) Ends of the blocked offsets, and the offset of the zone's centre
    middle: Array  # (n,) Ends of the blocked offsets, and the offset of the zone's centre
    lasting: bool = False


class Lines:
    """Lines across the guide at the grid's stations and between them."""

    def __init__(self, problem: Problem, grid: Grid) -> None:
        self.grid, self.zones = grid, problem.zones
        guide = problem.space.guide
        self.frame: GuideFrame | None = None if guide.straight else guide.frame(grid.lines)

    def seen(self, line: Index, centers: Array) -> tuple[Array, Array]:
        """Distances of points (..., 2) ahead of lines, and their offsets on them."""
        if self.frame is None:
            return centers[..., 0] - self.grid.lines[line], centers[..., 1]
        x, y = (centers[..., axis] - self.frame.position[line, axis] for axis in (0, 1))
        # of arrays of one axis, as sums over an axis of two take many times as long
        return tuple(x * way[line, 0] + y * way[line, 1] for way in (self.frame.tangent, self.frame.normal))

    def times(self, line: Index, delay: Index) -> Array:
        """Times of delays on lines."""
        times: Array = self.grid.fastest[line] + self.grid.delay_step * delay
        return times

    def cuts(self, line: Index, delay: Index, zone: Index, times: Array) -> Cuts:
        """Return what zones block on lines at times; only where they do."""
        zones = self.zones
        ahead, middle = self.seen(line, zones.centers.at(zone, times))
        radius = np.maximum(reach_at(zones, zone, times) - self.grid.shrunk, 0.0)
        half = radius * radius - ahead * ahead
        met = np.flatnonzero(half > 0.0)
        half = np.sqrt(half[met])
        line, delay, zone, times, middle = line[met], delay[met], zone[met], times[met], middle[met]
        lower, upper = middle - half, middle + half
        if zones.outlines is not None:
            rows = np.flatnonzero(zones.outline_slot[zone] >= 0)
            at = line[rows]
            if self.frame is None:
                origins = np.stack([self.grid.lines[at], np.zeros(len(at))], axis=1)
                tangents = np.broadcast_to([1.0, 0.0], origins.shape)
            else:
                origins, tangents = self.frame.position[at], self.frame.tangent[at]
            cut = sections(zones, zone[rows], times[rows], origins, tangents)
            lower[rows], upper[rows] = cut.lower + self.grid.shrunk, cut.upper - self.grid.shrunk
        found = Cuts(line, delay, zone, lower, upper, middle)
        return rows_of(found, lower < upper)

    def all_cuts(self, some: Index, delays: range) -> Iterator[Cuts]:
        """Yield what some zones block on all lines at some delays, whole stretches of them, a part at a time."""
        zones, grid = self.zones, self.grid
        count = len(grid.lines)
        still = np.isin(some, zones.standing)
        standing, moving = some[still], some[~still]
        every = np.arange(count)
        for part in _parts(standing, count * self._corners(standing), CHUNKS.most_cut):
            line, zone = np.repeat(every, len(part)), np.tile(part, count)
            cuts = self.cuts(line, np.zeros(len(line), dtype=np.intp), zone, np.zeros(len(line)))
            yield replace(cuts, lasting=True)
        edges = np.arange(delays.start, delays.stop + 1, CHUNKS.stretch)
        for part in _parts(moving, count * len(edges), CHUNKS.most_looks):
            met = np.nonzero(self._near(part, edges))
            most = max(1, CHUNKS.most_cut // (CHUNKS.stretch * self._corners(part)))
            for begin in range(0, len(met[0]), most):
                line, stretch, place = (index[begin : begin + most] for index in met)
                delay = (edges[stretch][:, None] + np.arange(CHUNKS.stretch)).ravel()
                line, zone = np.repeat(line, CHUNKS.stretch), np.repeat(part[place], CHUNKS.stretch)
                for moment in self.grid.moments:
                    yield self.cuts(line, delay, zone, self.times(line, delay) + moment)

    def _corners(self, some: Index) -> int:
        """Relative cost of cutting the zone with the most corners."""
        outlines = self.zones.outlines
        if outlines is None or len(some) == 0:
            return 1
        slots = self.zones.outline_slot[some]
        return 1 + int(np.where(slots >= 0, outlines.counts[slots], 0).max()) // CHUNKS.usual_corners

    def _near(self, part: Index, edges: Index) -> Mask:
        """True if zones come near lines in stretches of delays, (lines, stretches, zones)."""
        zones, lines = self.zones, np.arange(len(self.grid.lines))
        times = self.times(lines[:, None], edges).ravel()
        shape = (len(lines), len(edges), len(part))
        some = zones if len(part) == zones.size else zones.subset(part)
        centers = some.centers.grid(times).reshape(*shape, 2)
        ahead, _ = self.seen(lines[:, None, None], centers)
        reach = some.reach(times).reshape(shape)
        reach = np.maximum(reach[:, :-1], reach[:, 1:])
        first, last = ahead[:, :-1], ahead[:, 1:]
        # Between the ends of a stretch a zone is hardly farther from the line than it moves there.
        moved = np.abs(last - first)
        near: Mask = np.minimum(np.abs(first), np.abs(last)) <= reach + moved
        return near


Closure = list[tuple[Index, Words]]
"""Lines, and words of what is blocked on them."""


class Cells:
    """Free cells of the grid, as words of delays."""

    def __init__(self, problem: Problem, grid: Grid, deadline: float = np.inf) -> None:
        self.problem, self.grid, self.deadline = problem, grid, deadline
        self.cut_off = False
        self.lines = Lines(problem, grid)
        self._looked = 0  # at so many delays
        self._open = ~self._outside()  # of what stands
        self._free: Words = np.where(self._open, ~np.uint64(0), np.uint64(0))
        self._kept: list[Cuts] | None = []  # None: too many to be kept
        self._closed: dict[tuple[int, int], Closure] = {}
        self._shut: dict[int, frozenset[int]] | None = None

    @property
    def free(self) -> Words:
        """Free cells with all sides open, (lines, half offsets)."""
        self.look(DELAYS)
        return self._free

    @property
    def shape(self) -> tuple[int, int]:
        """Lines and half offsets."""
        return len(self.grid.lines), len(self.grid.half_offsets)

    @property
    def out_of_time(self) -> bool:
        """True if the deadline has passed, where a large grid, or zones of many corners, take time."""
        outlines = self.problem.zones.outlines
        few = self.shape[0] * self.shape[1] <= CHUNKS.few_cells and (
            outlines is None or len(outlines.corners) <= CHUNKS.few_corners
        )
        return not few and perf_counter() > self.deadline

    def look(self, delays: int) -> None:
        """See to it that at so many delays cells are known; at further ones they may be as if free."""
        until = min(CHUNKS.stretch * ceil(delays / CHUNKS.stretch), DELAYS)
        if until <= self._looked or self.cut_off:
            return
        new = range(self._looked, until)
        self._looked = until
        self._closed.clear()
        self._shut = None
        for cuts, known in self._cuts(new):
            for lines, words in self._blocked(cuts, np.zeros(len(cuts.line), dtype=np.intp), new):
                self._free[lines] &= ~words
                if cuts.lasting:
                    self._open[lines] &= words == 0
                pause()
                if self.out_of_time:
                    self.cut_off = True
                    return
            if self._kept is not None and not known:
                self._kept.append(cuts)
                if sum(len(some.line) for some in self._kept) > CHUNKS.most_kept:
                    self._kept = None

    def _cuts(self, new: range) -> Iterator[tuple[Cuts, bool]]:
        """Yield what zones block at further delays, and whether that is kept already."""
        some = np.arange(self.problem.zones.size)
        if new.start > 0 and self._kept is not None:  # what stands is the same as before
            yield from [(cuts, True) for cuts in self._kept if cuts.lasting]
            some = self.problem.zones.moving
        for cuts in self.lines.all_cuts(some, new):
            yield cuts, False

    def without(self, closed: tuple[tuple[int, int], ...]) -> Words:
        """Free cells when some (zone, side) are closed: +1 above, -1 below."""
        return self.without_each([closed], DELAYS)[:, :, 0]

    def without_each(self, cases: Sequence[tuple[tuple[int, int], ...]], delays: int) -> Words:
        """Free cells of several cases, known at so many delays, (lines, half offsets, cases)."""
        self.look(delays)
        words = np.repeat(self._free[:, :, None], len(cases), axis=2)
        new = [side for side in dict.fromkeys(chain(*cases)) if side not in self._closed]
        if new:
            self._closed.update(self._closures(new))
        for case, closed in enumerate(cases):
            for side in closed:
                for lines, blocked in self._closed[side]:
                    words[lines, :, case] &= ~blocked
        return words

    def shut(self, closed: Iterable[tuple[int, int]]) -> bool:
        """True if sides that are closed surely block a line between start and goal at all times."""
        return any(zone in self._walled[side] for zone, side in closed)

    @property
    def _walled(self) -> dict[int, frozenset[int]]:
        """Zones that shut a line when they are closed above (1), or below (-1)."""
        if self._shut is None:
            low, step = self.grid.half_offsets[0], 0.5 * self.grid.offset_step
            lowest, highest = self._open.argmax(axis=1), self.shape[1] - 1 - self._open[:, ::-1].argmax(axis=1)
            lowest[[0, -1]], highest[[0, -1]] = -1, self.shape[1]  # where ways begin and end
            above: set[int] = set()
            below: set[int] = set()
            for cuts in self._kept or ():
                if cuts.lasting:
                    above.update(cuts.zone[np.ceil((cuts.lower - low) / step) <= lowest[cuts.line]].tolist())
                    below.update(cuts.zone[np.floor((cuts.upper - low) / step) >= highest[cuts.line]].tolist())
            self._shut = {1: frozenset(above), -1: frozenset(below)}
        return self._shut

    def first_line(self, closed: Iterable[tuple[int, int]], besides: Container[tuple[int, int]]) -> int:
        """The first line on which sides that are closed block anything, besides some that are not looked at."""
        lines = [lines for side in closed if side not in besides for lines, _ in self._closed[side] if len(lines)]
        return min((int(some[0]) for some in lines), default=self.shape[0])

    def _closures(self, closed: Sequence[tuple[int, int]]) -> dict[tuple[int, int], Closure]:
        """Blocked cells when sides of zones are closed, each for itself."""
        known, count = range(self._looked), self.shape[0]
        found: dict[tuple[int, int], Closure] = {one: [] for one in closed}
        zones, sides = np.array(closed, dtype=np.intp).T
        kept = self.lines.all_cuts(np.unique(zones), known) if self._kept is None else self._kept
        for cuts in kept:
            # All at once, as if each had lines of its own
            number, index = (zones[:, None] == cuts.zone).nonzero()
            some = rows_of(cuts, index)
            some = replace(some, line=some.line + count * number)
            for lines, words in self._blocked(some, sides[number], known):
                bounds = lines.searchsorted(count * np.arange(len(closed) + 1)).tolist()
                for own, (one, (first, last)) in enumerate(zip(closed, pairwise(bounds), strict=True)):
                    if last > first:
                        found[one].append((lines[first:last] - count * own, words[first:last]))
        return found

    def _blocked(self, cuts: Cuts, sides: Index, delays: range) -> Iterator[tuple[Index, Words]]:
        """Yield words of what zones block, or that and all to one side of it, on lines that they meet."""
        lines, place = np.unique(cuts.line, return_inverse=True)
        cuts = replace(cuts, line=place, delay=np.zeros_like(place) if cuts.lasting else cuts.delay - delays.start)
        marked, full = 1 if cuts.lasting else len(delays), np.uint64(2 ** len(delays) - 1)
        at_once = max(1, CHUNKS.most_marked // (self.shape[1] * marked))
        for begin in range(0, len(lines), at_once):
            some = lines[begin : begin + at_once]
            part, side = cuts, sides
            if len(lines) > at_once:
                here = np.flatnonzero((place >= begin) & (place < begin + at_once))
                part, side = rows_of(cuts, here), sides[here]
                part = replace(part, line=part.line - begin)
            blocked = np.zeros((len(some), self.shape[1], marked), dtype=np.bool_)
            self._mark(blocked, part, side)
            words = np.where(blocked[:, :, 0], full, np.uint64(0)) if cuts.lasting else _words(blocked)
            yield some, words << np.uint64(delays.start)

    def _mark(self, blocked: Mask, cuts: Cuts, side: Index) -> None:
        """Mark what zones block, or that and all to one side of it: above (1), below (-1), or neither."""
        size, step = blocked.shape[1], 0.5 * self.grid.offset_step
        low = self.grid.half_offsets[0]
        lowest = np.where(side >= 0, np.ceil((cuts.lower - low) / step), 0.0)
        highest = np.where(side <= 0, np.floor((cuts.upper - low) / step), size - 1.0)
        # Zones may reach farther than any index.
        first: Index = np.clip(lowest, 0.0, size).astype(np.intp)
        length: Index = np.maximum(np.clip(highest, -1.0, size - 1.0).astype(np.intp) - first + 1, 0)
        if int(length.sum()) > blocked.size:  # large zones: their ends alone, and what lies between
            self._fill(blocked, cuts, first, length)
            return
        until, delays, cells = np.cumsum(length), blocked.shape[2], blocked.reshape(-1)
        # NUMPY-CALLS: as one index of all cells, which takes half as long as three
        begin = (cuts.line * size + first) * delays + cuts.delay
        done = 0
        while done < len(length):
            before = int(until[done - 1]) if done else 0
            part = slice(done, max(int(np.searchsorted(until, before + CHUNKS.most_marked, "right")), done + 1))
            some = length[part]
            cell = np.arange(0, int(some.sum()) * delays, delays)
            cell += np.repeat(begin[part] - (until[part] - some - before) * delays, some)
            cells[cell] = True
            done = part.stop

    @staticmethod
    def _fill(blocked: Mask, cuts: Cuts, first: Index, length: Index) -> None:
        """Mark from the first cell of each cut on so many."""
        lines, size, delays = blocked.shape
        cells = lines * (size + 1) * delays
        begins, ends = (
            # Counted, as `np.add.at` takes ten times as long
            np.bincount((cuts.line * (size + 1) + np.minimum(place, size)) * delays + cuts.delay, minlength=cells)
            for place in (first, first + length)
        )
        depth = (begins - ends).reshape(lines, size + 1, delays)
        blocked |= np.cumsum(depth, axis=1, out=depth)[:, :size] > 0

    def _outside(self) -> Mask:
        """Cells outside the workspace box, or where the guide folds."""
        box, space, grid = self.problem.box, self.problem.space, self.grid
        outside = np.zeros(self.shape, dtype=np.bool_)
        if len(box.offsets):
            base = Path(space, np.zeros(space.path_size)).points(grid.lines / space.length)
            normal = np.broadcast_to(base.normal, (len(grid.lines), 2))
            cells = base.position[:, None] + grid.half_offsets[:, None] * normal[:, None]
            outside |= np.any(cells @ box.normals.T > box.offsets + 0.5 * grid.offset_step, axis=2)
        if self.lines.frame is not None:
            outside |= self.lines.frame.curvature[:, None] * grid.half_offsets > FOLD
        return outside


def reach_at(zones: ZoneBatch, index: Index, times: Array) -> Array:
    """Radius of a disc around the centre that covers chosen zones, each at its own time, (n,)."""
    radius: Array = zones.radius[index] + zones.extent[index]
    if zones.covariances is None:
        return radius
    rows = np.flatnonzero(zones.slot[index] >= 0)
    covariance = zones.covariances.at(zones.slot[index[rows]], times[rows])
    mean = 0.5 * (covariance[:, 0] + covariance[:, 2])
    spread = np.hypot(0.5 * (covariance[:, 0] - covariance[:, 2]), covariance[:, 1])
    radius[rows] += np.sqrt(np.maximum(mean + spread, 0.0))
    return radius


def _parts(index: Index, each: int, at_once: int) -> Iterator[Index]:
    """Parts of an index that are not too many to be looked at together."""
    most = max(1, at_once // each)
    for begin in range(0, len(index), most):
        yield index[begin : begin + most]


def _words(bits: Mask) -> Words:
    """Words of 64 bits each, the first delay the lowest; of as many or fewer delays, whole bytes of them."""
    # NUMPY-CALLS: row by row packing takes seven times as long
    packed = np.packbits(bits.ravel(), bitorder="little").reshape(*bits.shape[:-1], -1)
    room = np.zeros((*packed.shape[:-1], DELAYS // 8), dtype=np.uint8)
    room[..., : packed.shape[-1]] = packed
    words: Words = room.view("<u8")[..., 0]
    return words.astype(np.uint64, copy=False)
