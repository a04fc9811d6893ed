"""The fastest way on the ground."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import pairwise
from math import ceil, sqrt

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra

from scp_planner.arrays import Array, Index
from scp_planner.mathematics.tolerances import DECIMALS
from scp_planner.pauses import OutOfTimeError, look_at_the_clock
from scp_planner.problem.problem import Problem
from scp_planner.scenario.limits import Box
from scp_planner.scenario.places import Line, Stretch, limits_at, reference_line
from scp_planner.threat_zones.batch import ZoneBatch

MOST_NODES = 2500
NEIGHBOURS = ((1, 0), (0, 1), (1, 1), (1, -1), (1, 2), (2, 1), (1, -2), (2, -1))  # and those opposite
LONGEST_LEG = 4.0  # steps, and more: between neighbours, of which ends may be half a step off their places
LOOKS_A_STEP = 4  # at a straight leg, in the distance of two nodes
MOST_LOOKS = 200_000  # points times zones, or times the corners of these, that are looked at together
PASSES = 3  # of pulling tight
AROUND = np.array([[0.0, 0.0], [1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]])
SAVED = 1e-9  # relative: a straight leg that is so little slower is taken


@dataclass(frozen=True)
class Ground:
    standing: ZoneBatch  # zones that neither move nor grow
    box: Box
    line: Line  # the guide of the scenario, in the planning frame
    farthest: float  # largest distance from it, m
    slow: tuple[Stretch, ...]  # in the planning frame
    top: float  # speed where there is no limit, m/s
    beside: float = 0.0  # places so near to slow ones count as slow, m
    deadline: float = np.inf  # value of :func:`time.perf_counter`, at which looks at it are given up

    def _parts(self, count: int, looks: int) -> Iterator[slice]:
        """Yield parts of so many points at each of which is looked so often, while there is time."""
        size = max(1, MOST_LOOKS // max(looks, 1))
        for begin in range(0, count, size):
            look_at_the_clock(self.deadline)
            yield slice(begin, begin + size)

    def room(self, points: Array, enough: float = 0.0) -> Array:
        found = np.minimum(self.farthest - self.line.distances(points), self.box.room(points))
        if self.standing.size:
            outlines = self.standing.outlines
            corners = 0 if outlines is None else len(outlines.corners)
            for some in self._parts(len(points), max(self.standing.size, corners)):
                part = points[some]
                away = self.standing.distances(np.zeros(len(part)), part, enough).min(axis=1)
                np.minimum(found[some], away, out=found[some])
        return found

    def slowness(self, points: Array) -> Array:
        """Time in s that a metre takes at points (n, 2) m, (n,)."""
        around = self.beside * AROUND if self.beside > 0.0 else AROUND[:1]
        limits = np.empty(len(points))
        for some in self._parts(len(points), len(around) * max(len(self.slow), 1)):
            places = points[some] + around[:, None]
            limits[some] = limits_at(self.slow, places.reshape(-1, 2)).reshape(len(around), -1).min(axis=0)
        return 1.0 / np.minimum(limits, self.top)

    def duration(self, begin: Array, end: Array, step: float) -> float:
        """Time that a straight leg takes, s, looked at in steps of so many m; inf where it may not be driven."""
        length = float(np.hypot(*(end - begin)))
        count = max(2, ceil(length / step))
        points = begin + ((np.arange(count) + 0.5) / count)[:, None] * (end - begin)
        if self.room(points).min() < 0.0:
            return np.inf
        return length * float(self.slowness(points).mean())


def fastest_way(
    problem: Problem, slow: tuple[Stretch, ...], beside: float = 0.0, deadline: float = np.inf
) -> Array | None:
    """Return the way from start to goal that takes least at the highest speeds that are allowed."""
    ground = replace(ground_of(problem, slow), deadline=deadline)
    try:
        grid = _NodesNearLine.of(ground)
        ground = replace(ground, beside=beside * grid.step)
        points = grid.way(ground)
        if points is None:
            return None
        for _ in range(PASSES):
            before, points = len(points), _pulled_tight(points, ground, grid.step / LOOKS_A_STEP)
            if len(points) == before:
                break
    except OutOfTimeError:
        return None
    return points


def ground_of(problem: Problem, slow: tuple[Stretch, ...]) -> Ground:
    """Return the ground of a problem, given its limits of the speed by place in the planning frame."""
    line = np.round(problem.frame.to_frame(np.array(reference_line(problem.scenario))), DECIMALS)
    standing = problem.zones.subset(problem.zones.standing)
    return Ground(standing, problem.box, Line(line), problem.settings.max_offset, slow, problem.limits.speed)


@dataclass(frozen=True)
class _NodesNearLine:
    """Nodes of a grid that lie near a line, whose ends stand in the place of the nodes that are nearest to them."""

    points: Array
    room: Array
    number: Index  # of the node at each place of the grid, (rows, columns); -1 where there is none
    first: int  # number of the node at the start, and of that at the end; -1 where there is none
    last: int
    step: float

    @classmethod
    def of(cls, ground: Ground) -> _NodesNearLine:
        line = ground.line.points
        low, high = line.min(axis=0) - ground.farthest, line.max(axis=0) + ground.farthest
        step = sqrt(float(np.prod(high - low)) / MOST_NODES)
        counts = np.ceil((high - low) / step).astype(np.intp) + 1
        columns, rows = np.meshgrid(np.arange(counts[0]), np.arange(counts[1]))
        places = low + step * np.stack([columns, rows], axis=-1)
        ends = []
        for end in (line[0], line[-1]):
            column, row = np.rint((end - low) / step).astype(np.intp).tolist()
            places[row, column] = end
            ends.append((row, column))
        flat = places.reshape(-1, 2)
        room = ground.room(flat, LONGEST_LEG * step)
        kept = room >= 0.0
        number = np.where(kept, np.cumsum(kept) - 1, -1).reshape(places.shape[:2])
        return cls(flat[kept], room[kept], number, int(number[ends[0]]), int(number[ends[1]]), step)

    def way(self, ground: Ground) -> Array | None:
        """Return the nodes of the fastest way, (n, 2) m; None where there is none."""
        if min(self.first, self.last) < 0:
            return None
        room, slowness = self.room, ground.slowness(self.points)
        pairs, count = self._legs(), len(self.points)
        legs = self.points[pairs[1]] - self.points[pairs[0]]
        lengths = np.hypot(legs[:, 0], legs[:, 1])
        # No longer than the room about its ends, a leg cannot meet anything
        passed = room[pairs[0]] + room[pairs[1]] >= lengths
        unsure = np.flatnonzero(~passed)
        middles = 0.5 * (self.points[pairs[0][unsure]] + self.points[pairs[1][unsure]])
        passed[unsure] = ground.room(middles) >= 0.0
        costs = 0.5 * (slowness[pairs[0]] + slowness[pairs[1]]) * lengths
        ends = pairs[:, passed].astype(np.int32)  # all that older graphs of SciPy take
        graph = csr_array((costs[passed], ends), shape=(count, count))
        _, before = dijkstra(graph, directed=False, indices=self.first, return_predecessors=True)
        if before[self.last] < 0:
            return None
        nodes = [self.last]
        while nodes[-1] != self.first:
            nodes.append(int(before[nodes[-1]]))
        return self.points[nodes[::-1]]

    def _legs(self) -> Index:
        """Pairs of nodes that are neighbours, (2, m)."""
        rows, columns = self.number.shape
        pairs = []
        for down, right in NEIGHBOURS:
            left, shifted = max(-right, 0), max(right, 0)
            begin = self.number[: rows - down, left : columns - shifted]
            end = self.number[down:, left + right : columns - shifted + right]
            pairs.append(np.stack([begin.ravel(), end.ravel()]))
        legs = np.concatenate(pairs, axis=1)
        kept: Index = legs[:, (legs >= 0).all(axis=0)]
        return kept


def _pulled_tight(points: Array, ground: Ground, step: float) -> Array:
    """A polyline with straight legs in place of parts that are no faster."""
    durations = [ground.duration(a, b, step) for a, b in pairwise(points)]
    since = np.concatenate([[0.0], np.cumsum(durations)])
    kept = [0]
    while kept[-1] < len(points) - 1:
        here, ahead = kept[-1], len(points) - 1 - kept[-1]
        while ahead > 1:
            straight = ground.duration(points[here], points[here + ahead], step)
            if straight <= (since[here + ahead] - since[here]) * (1.0 + SAVED):
                break
            ahead = (ahead + 1) // 2 if ahead > 2 else 1
        kept.append(here + ahead)
    return points[kept]
