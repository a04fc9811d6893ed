"""Manoeuvres of arcs and straight pieces, ahead and backwards, among what stands: a search over poses.

The search is best first over places, headings and directions (hybrid A*: D. Dolgov, S. Thrun, M. Montemerlo, J. Diebel,
Int. J. Robotics Research 29, 2010): poses keep their exact values, and one is kept in each cell. Curves of Reeds and
Shepp to the goal bound what is left from below, and end the search where they are clear.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import dataclass
from math import ceil, inf, pi, sqrt

import numpy as np

from scp_planner.arrays import Array, Index, unit_vectors
from scp_planner.pauses import Budget
from scp_planner.routes.over_map import shortest_over
from scp_planner.routes.reeds_shepp import along, words
from scp_planner.scenario.models import Scenario
from scp_planner.threat_zones.batch import ZoneBatch


@dataclass(frozen=True)
class SearchSettings:
    """Steps, cells and work of a search."""

    turn: float = 0.1  # rad, of a step at the smallest radius
    headings: int = 72  # cells of a turn
    cell: float = 0.6  # steps, of places
    raster: float = 0.2  # steps, between places where the room is known
    tile: int = 16  # cells of the raster each way, that are filled together
    fill: int = 2**14  # distances to zones between two looks at the clock
    around: float = 4.0  # radii, beyond start and goal, of the ground that is searched where there are no bounds
    most_nodes: int = 60_000
    more_nodes: int = 8_000  # after the first manoeuvre
    together: float = 4.0  # steps, by which poses that are looked at together differ
    at_once: int = 2**12  # poses whose room is looked up, and whose curves to the goal are made, at once
    stride: int = 9  # odd: every so many poses of a curve are looked at first, and those between where room is scarce
    few: int = 64  # poses of a curve that are all looked at
    most_looks: int = 2**19  # poses of a curve: where more have to be looked at, it is not followed
    slack: float = 0.25  # of the raster, by which what stands may be cut into: paths are moved out of it
    shots: int = 8  # poses of a round from which curves to the goal are tried
    of_each: int = 3  # curves of each of them
    slower: float = 1.1  # times the fastest manoeuvre so far: slower ones are not looked for
    most: int = 6  # manoeuvres, at most
    free_headings: int = 12  # tried at a goal that has none
    weights: tuple[float, float] = (1.0, 2.0)  # of what is left, where nothing is found with the first one
    coarse: float = 2.0  # steps: cells of the ground over which the way round what stands bounds what is left
    most_cells: int = 40_000  # of these: on larger ground the cells are larger
    diagonal: float = 1.0824  # times the shortest way that one over cells, by eight neighbours, is at most


SEARCH = SearchSettings()
SAME = 1e-6  # of a step, or a radius: what is shorter is nothing


@dataclass(frozen=True)
class Drives:
    """Top speeds in both directions, and the time that a stop takes besides."""

    ahead: float  # m/s
    backwards: float  # m/s, 0 if it cannot
    radius: float  # m, the smallest one of turns
    stop: float  # s

    @classmethod
    def of(cls, scenario: Scenario, curvature: float) -> Drives:
        """Return the drives of a vehicle whose curvature is limited."""
        vehicle, radius = scenario.vehicle, 1.0 / curvature
        ramps = 1.0 / vehicle.max_acceleration + 1.0 / vehicle.max_deceleration
        top = min(vehicle.max_speed, sqrt(2.0 * radius / ramps))
        return cls(
            top, 0.0 if vehicle.reverse is None else min(vehicle.reverse.max_speed, top), radius, 0.5 * top * ramps
        )

    def times(self, lengths: Array) -> Array:
        """Time of pieces (..., p) m, negative backwards, with their stops, (...) s."""
        with np.errstate(divide="ignore", invalid="ignore"):
            driven = np.where(lengths < 0.0, -lengths / self.backwards if self.backwards else inf, lengths / self.ahead)
        signs = np.sign(np.where(np.abs(lengths) > SAME * self.radius, lengths, 0.0))
        before = signs.copy()
        for k in range(1, lengths.shape[-1]):  # a piece of no length has the direction of the one before it
            before[..., k] = np.where(signs[..., k] == 0.0, before[..., k - 1], signs[..., k])
        stops = ((before[..., 1:] * before[..., :-1]) < 0.0).sum(axis=-1)
        total: Array = np.where(signs == 0.0, 0.0, driven).sum(axis=-1) + self.stop * stops
        return total


@dataclass(frozen=True)
class Manoeuvre:
    """Arcs and straight pieces from a pose on, and about how long they take."""

    start: Array  # (3,): x and y, m, and heading, rad
    curvature: Array  # (p,) 1/m
    lengths: Array  # (p,) m, negative backwards
    time: float  # s

    @property
    def kind(self) -> tuple[int, ...]:
        """Directions of its legs, 1 ahead and -1 backwards."""
        return tuple(int(np.sign(lengths[0])) for _, lengths in self.legs)

    @property
    def legs(self) -> tuple[tuple[Array, Array], ...]:
        """Curvatures and lengths of the pieces between two stops, (q,) each; none of a vehicle that is there."""
        if not len(self.lengths):
            return ()
        cuts = np.flatnonzero(np.diff(np.sign(self.lengths))) + 1
        return tuple(zip(np.split(self.curvature, cuts), np.split(self.lengths, cuts), strict=True))


class Room:
    """Distance to all that stands, on a raster of places that is filled, tile by tile, where it is asked for."""

    def __init__(
        self, scenario: Scenario, zones: ZoneBatch, ends: tuple[Array, Array], step: float, budget: Budget
    ) -> None:
        """Take the zones that stand, already inflated by the vehicle's radius, in world coordinates."""
        (self._low, high), self._step, self._budget = ends, step, budget
        self._scenario, self._zones, self._discs = scenario, zones, np.array(scenario.vehicle.discs)
        self._last = np.ceil((high - self._low) / step).astype(np.int64)
        self._across = int(self._last[1]) // SEARCH.tile + 1
        self._edge = np.arange(SEARCH.tile + 1)
        self._most = int(budget.size) // (8 * len(self._edge) ** 2)
        self._tiles = np.array([np.iinfo(np.int64).max])  # numbers of those that are known, and a last one
        self._rows: Index = np.zeros(1, dtype=np.intp)  # of tiles in the array
        self._room = np.empty((64, len(self._edge), len(self._edge)))

    def least(self, poses: Array) -> Array:
        """Least room of the vehicle's discs at poses (n, 3), (n,) m; negative beyond the raster.

        Distances of more than two cells of the raster are bounds from below.
        """
        found = [self._least(poses[k : k + SEARCH.at_once]) for k in range(0, len(poses), SEARCH.at_once)]
        return np.concatenate(found) if found else np.zeros(0)

    def exact(self, poses: Array, *, reference: bool = False) -> Array:
        """Least room of the discs at poses (n, 3), or of the one at the ``reference`` point, (n,) m."""
        places = poses[:, :2] if reference else self._places(poses).reshape(-1, 2)
        rows = max(1, SEARCH.fill // max(self._zones.size, 1))
        found = [self._distances(places[k : k + rows], inf) for k in range(0, len(places), rows)]
        return np.concatenate(found).reshape(len(poses), -1).min(axis=1)

    def _places(self, poses: Array) -> Array:
        return poses[:, None, :2] + self._discs[:, None] * unit_vectors(poses[:, 2, None])

    def _least(self, poses: Array) -> Array:
        at = (self._places(poses) - self._low) / self._step
        cell = np.clip(at.astype(np.int64), 0, self._last)
        x, y = np.moveaxis(at - cell, -1, 0)
        tile, (i, j) = cell // SEARCH.tile, np.moveaxis(cell % SEARCH.tile, -1, 0)
        k, known = self._rows_of(tile[..., 0] * self._across + tile[..., 1]), self._room
        room = (1.0 - x) * ((1.0 - y) * known[k, i, j] + y * known[k, i, j + 1])
        room += x * ((1.0 - y) * known[k, i + 1, j] + y * known[k, i + 1, j + 1])
        outside = (at < 0.0).any(axis=-1) | (at > self._last + 1).any(axis=-1)
        least: Array = np.where(outside, -inf, room).min(axis=-1)
        return least

    def _rows_of(self, tiles: Index) -> Index:
        """Rows of tiles in the array, which is filled with those that are new."""
        place = np.searchsorted(self._tiles, tiles)
        new = self._tiles[place] != tiles
        if new.any():
            self._fill(np.unique(tiles[new]), tiles)
            place = np.searchsorted(self._tiles, tiles)
        return self._rows[place]

    def _fill(self, new: Index, asked: Index) -> None:
        """Add tiles; all but those that are asked for are forgotten before they take too much memory."""
        count = len(self._tiles) - 1
        if count + len(new) > self._most:
            self._tiles, self._rows, count, new = self._tiles[-1:], self._rows[-1:], 0, np.unique(asked)
        if count + len(new) > len(self._room):
            self._room = np.concatenate([self._room, np.empty((max(len(self._room), len(new)), *self._room.shape[1:]))])
        together = max(1, SEARCH.fill // (self._room[0].size * max(self._zones.size, 1)))
        for first in range(0, len(new), together):
            some = new[first : first + together]
            corner = SEARCH.tile * np.stack(np.divmod(some, self._across), axis=1)
            x, y = (self._low[k] + self._step * (corner[:, k, None] + self._edge) for k in (0, 1))
            points = np.stack(np.broadcast_arrays(x[:, :, None], y[:, None, :]), axis=-1).reshape(-1, 2)
            room = self._distances(points, 2.0 * self._step)
            self._room[count + first : count + first + len(some)] = room.reshape(len(some), len(self._edge), -1)
        tiles = np.concatenate([self._tiles, new])
        rows = np.concatenate([self._rows, np.arange(count, count + len(new))])
        order = np.argsort(tiles)
        self._tiles, self._rows = tiles[order], rows[order]

    def _distances(self, points: Array, exact_below: float) -> Array:
        """Distances of points (n, 2) to zones and bounds, (n,) m; those above a length may be bounds from below."""
        self._budget.check()
        room, bounds = np.full(len(points), 1e3 * self._step), self._scenario.bounds
        if self._zones.size:
            room = np.minimum(room, self._zones.distances(np.zeros(len(points)), points, exact_below).min(axis=1))
        if bounds is not None:
            inner = np.minimum(points - bounds.min, bounds.max - points).min(axis=1)
            room = np.minimum(room, inner - self._scenario.vehicle.radius)
        return room


@dataclass(frozen=True)
class _Ground:
    """Length of the way to the goal from each cell, round what stands: none is shorter, m."""

    low: Array  # (2,) m
    size: float  # m, of a cell
    lengths: Array  # (rows, columns) m

    @classmethod
    def of(cls, room: Room, ends: tuple[Array, Array], goal_and_start: Array, size: float) -> _Ground:
        low, high = ends
        extent = high - low
        size = max(size, sqrt(float(extent.prod()) / SEARCH.most_cells))
        columns, rows = (np.ceil(extent / size) + 1).astype(int).tolist()
        x, y = np.meshgrid(low[0] + size * (np.arange(columns) + 0.5), low[1] + size * (np.arange(rows) + 0.5))
        places = np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], axis=1)
        free = (room.exact(places, reference=True) >= -sqrt(0.5) * size).reshape(rows, columns)
        end, begin = np.floor((goal_and_start - low) / size).astype(np.intp)
        free[end[1], end[0]] = free[begin[1], begin[0]] = True
        _, cells = shortest_over(free, begin, end)
        lengths = np.maximum(cells.astype(float) / SEARCH.diagonal - sqrt(2.0), 0.0) * size
        return cls(low, size, lengths)

    def left(self, poses: Array) -> Array:
        """Lengths of the ways from poses (n, 3), (n,) m."""
        last = np.array(self.lengths.shape[::-1]) - 1
        column, row = np.clip(((poses[:, :2] - self.low) / self.size).astype(np.intp), 0, last).T
        found: Array = self.lengths[row, column]
        return found


class ManoeuvreSearch:
    """Search for manoeuvres of a scenario, among zones in world coordinates that are inflated by the radius."""

    def __init__(self, scenario: Scenario, zones: ZoneBatch, curvature: float, budget: Budget | None = None) -> None:
        start, goal = scenario.start, scenario.goal
        assert start.heading is not None, "manoeuvres begin with a heading"
        self.scenario = scenario
        self.budget, self.drives = budget or Budget(), Drives.of(scenario, curvature)
        self.first_ahead = start.speed > 0.0
        first = np.array([*start.position, start.heading])
        headings = [2.0 * pi * k / SEARCH.free_headings for k in range(SEARCH.free_headings)]
        goals = np.array([[*goal.position, h] for h in (headings if goal.heading is None else [goal.heading])])
        self.step = SEARCH.turn * self.drives.radius
        ends = np.stack([first[:2], goals[0, :2]])
        around = SEARCH.around * self.drives.radius + max(map(abs, scenario.vehicle.discs))
        low, high = ends.min(axis=0) - around, ends.max(axis=0) + around
        if scenario.bounds is not None:
            low, high = np.maximum(low, scenario.bounds.min), np.minimum(high, scenario.bounds.max)
        raster = SEARCH.raster * self.step
        self.room = Room(scenario, zones.subset(zones.standing), (low, high), raster, self.budget)
        self.slack, self._low = SEARCH.slack * raster, low
        self._ground = _Ground.of(self.room, (low, high), ends[::-1], SEARCH.coarse * self.step)
        self._count = np.ceil((high - low) / (SEARCH.cell * self.step)).astype(int) + 1
        # From the end that has less room: there are fewer ways out of it than into it
        self.swapped = len(goals) == 1 and not self.first_ahead and self._room_at(goals[0]) < self._room_at(first)
        self.first: Array
        self.first, self.goals = (goals[0], first[None]) if self.swapped else (first, goals)
        if self.swapped:
            drives = self.drives
            self.drives = Drives(drives.backwards, drives.ahead, drives.radius, drives.stop)

    def _room_at(self, pose: Array) -> float:
        return float(self.room.exact(pose[None])[0])

    def run(self, known: float = inf, without: Collection[tuple[int, ...]] = ()) -> list[Manoeuvre]:
        """Find the fastest manoeuvre of each kind but for some, the fastest first, if a known time is not faster.

        If the first search finds none in time, search again with an inflated estimate: faster, but not optimal.
        """
        if self._ground.left(self.first[None])[0] == inf:  # round what stands no way leads there
            return []
        for weight in SEARCH.weights:
            found = self._found(known, without, weight)
            if found:
                break
        return sorted(found.values(), key=lambda one: one.time)[: SEARCH.most]

    def _found(
        self, known: float, without: Collection[tuple[int, ...]], weight: float
    ) -> dict[tuple[int, ...], Manoeuvre]:
        found: dict[tuple[int, ...], Manoeuvre] = {}
        nodes, best = _Nodes(self.first), dict[int, float]()
        waiting: Index = np.zeros(1, dtype=np.intp)
        most = SEARCH.most_nodes
        while len(waiting) and nodes.count < most:
            self.budget.check()
            guess = nodes.guess[waiting]
            least = float(guess.min())
            if least > SEARCH.slower * weight * known:
                break
            now = guess <= least + SEARCH.together * self.step / max(self.drives.ahead, self.drives.backwards)
            chosen, waiting = waiting[now], waiting[~now]
            order = chosen[np.argsort(nodes.guess[chosen], kind="stable")]
            for made in self._shots(nodes, order[: SEARCH.shots]):
                kind = made.kind
                if not kind or kind in without:
                    continue
                known = min(known, made.time)
                if kind not in found or made.time < found[kind].time:
                    found[kind] = made
            most = min(most, nodes.count + SEARCH.more_nodes) if found else most
            waiting = np.concatenate([waiting, self._expanded(nodes, chosen, best, weight)])
        return found

    def _expanded(self, nodes: _Nodes, chosen: Index, best: dict[int, float], weight: float) -> Index:
        """Add the poses a step on from some nodes; return those that are better than any before in their cells."""
        steps = [(turn, sign) for sign in (1.0, -1.0) for turn in (0.0, 1.0, -1.0) if self._speed(sign)]
        step, parent = np.repeat(np.array(steps), len(chosen), axis=0), np.tile(chosen, len(steps))
        if self.first_ahead:
            some = (nodes.sign[parent] != 0.0) | (step[:, 1] > 0.0)
            step, parent = step[some], parent[some]
        bend, length = step[:, 0] / self.drives.radius, step[:, 1] * self.step
        moved = np.stack([_moved(nodes.pose[parent], bend, share * length) for share in (0.5, 1.0)])
        clear = (self.room.least(moved.reshape(-1, 3)).reshape(2, -1) >= -self.slack).all(axis=0)
        poses, step, parent = moved[1][clear], step[clear], parent[clear]
        speed = np.where(step[:, 1] > 0.0, self.drives.ahead, self.drives.backwards)
        cost = nodes.cost[parent] + self.step / speed + self.drives.stop * (nodes.sign[parent] * step[:, 1] < 0.0)
        cell = ((poses[:, :2] - self._low) / (SEARCH.cell * self.step)).astype(int)
        heading = np.floor(poses[:, 2] / (2.0 * pi) * SEARCH.headings).astype(int) % SEARCH.headings
        shape = (*self._count.tolist(), SEARCH.headings, 2)
        flat = np.ravel_multi_index((*cell.T, heading, (step[:, 1] > 0.0).astype(int)), shape)
        order = np.lexsort((cost, flat))
        first = order[np.unique(flat[order], return_index=True)[1]]
        known = np.array([best.get(cell, inf) for cell in flat[first].tolist()])
        better = first[cost[first] < known - SAME * self.step]
        best.update(zip(flat[better].tolist(), cost[better].tolist(), strict=True))
        left = weight * self._least_left(poses[better], step[better, 1])
        return nodes.add(poses[better], cost[better], left, parent[better], step[better])

    def _speed(self, sign: float) -> float:
        return self.drives.ahead if sign > 0.0 else self.drives.backwards

    def _words(self, poses: Array) -> tuple[Array, Array]:
        """Words from poses (n, 3) to all goals, turns (w, 5) and lengths (n, w, 5)."""
        count, each = len(self.goals), np.repeat(poses, len(self.goals), axis=0)
        goals = np.tile(self.goals, (len(poses), 1))
        away = (goals[:, :2] - each[:, :2]) / self.drives.radius
        c, s = np.cos(each[:, 2]), np.sin(each[:, 2])
        x, y = c * away[:, 0] + s * away[:, 1], c * away[:, 1] - s * away[:, 0]
        turns, lengths = words(x, y, goals[:, 2] - each[:, 2])
        return np.tile(turns, (count, 1)), lengths.reshape(len(poses), count * len(turns), turns.shape[1])

    def _times(self, lengths: Array, signs: Array) -> Array:
        """Times of words (n, w, 5) that follow on drives in directions (n,), inf where there is none, s."""
        there = ~np.isnan(lengths[..., 0])
        begun = np.broadcast_to((signs * 10.0 * SAME)[:, None, None], (*lengths.shape[:2], 1))
        pieces = np.concatenate([begun, np.nan_to_num(lengths)], axis=-1) * self.drives.radius
        return np.where(there, self.drives.times(pieces), inf)

    def _least_left(self, poses: Array, signs: Array) -> Array:
        """Time from poses to the goal, by curves over free ground and by the way round what stands, (n,) s."""
        if len(self.goals) > 1:  # the curves to all of them would take longer than what they spare
            return self._ground.left(poses) / max(self.drives.ahead, self.drives.backwards)
        least, rows = np.empty(len(poses)), SEARCH.at_once // 4
        for first in range(0, len(poses), rows):
            self.budget.check()
            some = slice(first, first + rows)
            free = self._times(self._words(poses[some])[1], signs[some]).min(axis=1)
            round_ = self._ground.left(poses[some]) / max(self.drives.ahead, self.drives.backwards)
            least[some] = np.maximum(free, round_)
        return least

    def _shots(self, nodes: _Nodes, chosen: Index) -> Iterator[Manoeuvre]:
        """Yield manoeuvres that end with a curve from one of some nodes to the goal."""
        turns, lengths = self._words(nodes.pose[chosen])
        times = self._times(lengths, nodes.sign[chosen])
        if self.first_ahead:
            begins = nodes.sign[chosen] == 0.0
            times[begins[:, None] & (np.nan_to_num(lengths)[..., 0] < 0.0)] = inf
        of_each = len(turns) if len(chosen) == 1 else SEARCH.of_each
        for number, node in enumerate(chosen.tolist()):
            for word in np.argsort(times[number])[:of_each]:
                if not np.isfinite(times[number, word]):
                    break
                curvature, driven = turns[word] / self.drives.radius, lengths[number, word] * self.drives.radius
                if self._is_clear(nodes.pose[node], curvature, driven):
                    yield self._manoeuvre(nodes, node, curvature, driven)

    def _is_clear(self, pose: Array, curvature: Array, lengths: Array) -> bool:
        """True if there is room along pieces that begin with a pose.

        Where there is more room than to the next poses that are looked at, those between are clear, too.
        """
        longest = float(np.abs(lengths).max())
        count = max(2, ceil(longest / self.step * 2.0))
        begins, total, stride = _driven(pose, curvature, lengths), count * len(lengths), 1
        while SEARCH.few * stride < total:
            stride *= SEARCH.stride
        apart = longest / count * (1.0 + max(map(abs, self.scenario.vehicle.discs)) / self.drives.radius)
        looks: Index = np.arange(stride // 2, total + stride // 2, stride)
        while len(looks) <= SEARCH.most_looks:
            piece, part = np.divmod(np.minimum(looks, total - 1), count)
            poses = _moved(begins[piece], curvature[piece], (part + 1) / count * lengths[piece])
            room = self.room.least(poses) if stride <= SEARCH.stride else self.room.exact(poses)
            if (room < -self.slack).any():
                return False
            near = looks[room < (stride // 2) * apart]
            if stride == 1 or not len(near):
                return True
            stride //= SEARCH.stride
            between = stride * (np.arange(SEARCH.stride) - SEARCH.stride // 2)
            looks = (near[:, None] + between).ravel()
            looks = looks[(looks >= 0) & (looks < total + stride // 2)]
        return False

    def _manoeuvre(self, nodes: _Nodes, node: int, curvature: Array, lengths: Array) -> Manoeuvre:
        steps = nodes.steps_to(node)
        bends = np.concatenate([steps[:, 0] / self.drives.radius, curvature])
        driven = np.concatenate([steps[:, 1] * self.step, lengths])
        some = np.abs(driven) > SAME * self.drives.radius
        bends, driven = bends[some], driven[some]
        time = float(self.drives.times(driven))
        if self.swapped:
            return Manoeuvre(self.goals[0], bends[::-1], -driven[::-1], time)
        return Manoeuvre(self.first, bends, driven, time)


class _Nodes:
    """Poses that a search has come to."""

    def __init__(self, first: Array) -> None:
        most = 2 * SEARCH.most_nodes
        self.count = 1
        self.pose, self.cost, self.guess, self.sign = (
            np.empty((most, 3)),
            np.zeros(most),
            np.zeros(most),
            np.zeros(most),
        )
        self.step, self.parent = np.zeros((most, 2)), np.full(most, -1, dtype=np.intp)
        self.pose[0] = first

    def add(self, poses: Array, cost: Array, left: Array, parent: Index, step: Array) -> Index:
        """Add poses that are steps, of a turn and a direction, on from others; return their numbers."""
        room = min(len(poses), len(self.cost) - self.count)
        some = slice(self.count, self.count + room)
        self.pose[some], self.cost[some], self.guess[some] = poses[:room], cost[:room], (cost + left)[:room]
        self.sign[some], self.step[some], self.parent[some] = step[:room, 1], step[:room], parent[:room]
        self.count += room
        return np.arange(some.start, some.stop)

    def steps_to(self, node: int) -> Array:
        """Turns and directions of the steps to a node, (n, 2)."""
        steps = []
        while self.parent[node] >= 0:
            steps.append(self.step[node])
            node = int(self.parent[node])
        return np.array(steps[::-1]).reshape(-1, 2)


def _moved(poses: Array, curvature: Array, length: Array) -> Array:
    """Poses (n, 3) after arcs."""
    half = 0.5 * curvature * length
    chord = length * np.sinc(half / pi)
    ahead = poses[:, 2] + half
    return np.stack(
        [poses[:, 0] + chord * np.cos(ahead), poses[:, 1] + chord * np.sin(ahead), poses[:, 2] + 2.0 * half], axis=1
    )


def _driven(pose: Array, curvature: Array, lengths: Array) -> Array:
    """Poses at the ends of pieces (p,) that begin with one, (p + 1, 3)."""
    local = along(curvature, lengths)
    c, s = np.cos(pose[2]), np.sin(pose[2])
    x, y, turned = np.moveaxis(local, -1, 0)
    return np.stack([pose[0] + c * x - s * y, pose[1] + s * x + c * y, pose[2] + turned], axis=-1)
