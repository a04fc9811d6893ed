"""Manoeuvres of arcs and straight pieces, ahead and backwards, among what stands: a search over poses.

The search is best first over places, headings and directions (hybrid A*: D. Dolgov, S. Thrun, M. Montemerlo, J. Diebel,
Int. J. Robotics Research 29, 2010): poses keep their exact values, and one is kept in each cell. Curves of Reeds and
Shepp to the goal bound what is left from below, and end the search where they are clear.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import dataclass
from math import inf, pi, sqrt
from time import perf_counter

import numpy as np

from scp_planner.arrays import Array, Index, unit_vectors
from scp_planner.pauses import pause
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
    around: float = 4.0  # radii, beyond start and goal, of the ground that is searched where there are no bounds
    most_cells: int = 4_000_000
    most_nodes: int = 60_000
    more_nodes: int = 8_000  # after the first manoeuvre
    together: float = 4.0  # steps, by which poses that are looked at together differ
    slack: float = 0.25  # of the raster, by which what stands may be cut into: paths are moved out of it
    shots: int = 8  # poses of a round from which curves to the goal are tried
    of_each: int = 3  # curves of each of them
    slower: float = 1.1  # times the fastest manoeuvre so far: slower ones are not looked for
    most: int = 6  # manoeuvres, at most
    free_headings: int = 12  # tried at a goal that has none


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
        """Curvatures and lengths of the pieces between two stops, (q,) each."""
        cuts = np.flatnonzero(np.diff(np.sign(self.lengths))) + 1
        return tuple(zip(np.split(self.curvature, cuts), np.split(self.lengths, cuts), strict=True))


class Room:
    """Distance to all that stands, on a raster of places."""

    def __init__(self, scenario: Scenario, zones: ZoneBatch, low: Array, high: Array, step: float) -> None:
        """Take the zones that stand, already inflated by the vehicle's radius, in world coordinates."""
        self._low, self._step, self._discs = low, step, np.array(scenario.vehicle.discs)
        count = np.ceil((high - low) / step).astype(int) + 2
        x, y = (low[k] + step * np.arange(count[k]) for k in (0, 1))
        points = np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1).reshape(-1, 2)
        room = np.full(len(points), inf)
        if zones.size:
            room = zones.distances(np.zeros(len(points)), points).min(axis=1)
        if scenario.bounds is not None:
            inner = np.minimum(points - scenario.bounds.min, scenario.bounds.max - points).min(axis=1)
            room = np.minimum(room, inner - scenario.vehicle.radius)
        self._room = np.minimum(room, 1e3 * step).reshape(tuple(count))

    def least(self, poses: Array) -> Array:
        """Least room of the vehicle's discs at poses (..., 3), (...) m; negative beyond the raster."""
        heading = poses[..., 2, None]
        places = poses[..., None, :2] + self._discs[:, None] * unit_vectors(heading)
        at = (places - self._low) / self._step
        last = np.array(self._room.shape) - 2
        cell = np.clip(at.astype(int), 0, last)
        x, y = np.moveaxis(at - cell, -1, 0)
        i, j = np.moveaxis(cell, -1, 0)
        room = (1.0 - x) * ((1.0 - y) * self._room[i, j] + y * self._room[i, j + 1])
        room += x * ((1.0 - y) * self._room[i + 1, j] + y * self._room[i + 1, j + 1])
        outside = (at < 0.0).any(axis=-1) | (at > last + 1).any(axis=-1)
        least: Array = np.where(outside, -inf, room).min(axis=-1)
        return least


class ManoeuvreSearch:
    """Search for manoeuvres of a scenario, among zones in world coordinates that are inflated by the radius."""

    def __init__(self, scenario: Scenario, zones: ZoneBatch, curvature: float, deadline: float = inf) -> None:
        start, goal = scenario.start, scenario.goal
        assert start.heading is not None, "manoeuvres begin with a heading"
        self.deadline, self.drives = deadline, Drives.of(scenario, curvature)
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
        raster = max(SEARCH.raster * self.step, sqrt(float((high - low).prod()) / SEARCH.most_cells))
        self.room = Room(scenario, zones.subset(zones.standing), low, high, raster)
        self.slack, self._low = SEARCH.slack * raster, low
        self._count = np.ceil((high - low) / (SEARCH.cell * self.step)).astype(int) + 1
        # From the end that has less room: there are fewer ways out of it than into it
        self.swapped = len(goals) == 1 and not self.first_ahead and self._room_at(goals[0]) < self._room_at(first)
        self.first: Array
        self.first, self.goals = (goals[0], first[None]) if self.swapped else (first, goals)
        if self.swapped:
            drives = self.drives
            self.drives = Drives(drives.backwards, drives.ahead, drives.radius, drives.stop)

    def _room_at(self, pose: Array) -> float:
        return float(self.room.least(pose[None])[0])

    def run(self, known: float = inf, without: Collection[tuple[int, ...]] = ()) -> list[Manoeuvre]:
        """Find the fastest manoeuvre of each kind but for some, the fastest first, if a known time is not faster."""
        found: dict[tuple[int, ...], Manoeuvre] = {}
        nodes = _Nodes(self.first)
        best = np.full((*self._count, SEARCH.headings, 2), inf, dtype=np.float32)
        waiting: Index = np.zeros(1, dtype=np.intp)
        each = len(self.goals)  # Headings that all curves from a node are tried for
        most = SEARCH.most_nodes // each
        while len(waiting) and nodes.count < most and perf_counter() < self.deadline:
            guess = nodes.guess[waiting]
            least = float(guess.min())
            if least > SEARCH.slower * known:
                break
            now = guess <= least + SEARCH.together * self.step / max(self.drives.ahead, self.drives.backwards)
            chosen, waiting = waiting[now], waiting[~now]
            order = chosen[np.argsort(nodes.guess[chosen], kind="stable")]
            for made in self._shots(nodes, order[: SEARCH.shots]):
                if made.kind in without:
                    continue
                known = min(known, made.time)
                if made.kind not in found or made.time < found[made.kind].time:
                    found[made.kind] = made
            most = min(most, nodes.count + SEARCH.more_nodes // each) if found else most
            waiting = np.concatenate([waiting, self._expanded(nodes, chosen, best)])
            pause()
        return sorted(found.values(), key=lambda one: one.time)[: SEARCH.most]

    def _expanded(self, nodes: _Nodes, chosen: Index, best: Array) -> Index:
        """Add the poses a step on from some nodes; return those that are better than any before in their cells."""
        steps = [(turn, sign) for sign in (1.0, -1.0) for turn in (0.0, 1.0, -1.0) if self._speed(sign)]
        step, parent = np.repeat(np.array(steps), len(chosen), axis=0), np.tile(chosen, len(steps))
        if self.first_ahead:
            some = (nodes.sign[parent] != 0.0) | (step[:, 1] > 0.0)
            step, parent = step[some], parent[some]
        bend, length = step[:, 0] / self.drives.radius, step[:, 1] * self.step
        moved = np.stack([_moved(nodes.pose[parent], bend, share * length) for share in (0.5, 1.0)])
        clear = (self.room.least(moved) >= -self.slack).all(axis=0)
        poses, step, parent = moved[1][clear], step[clear], parent[clear]
        speed = np.where(step[:, 1] > 0.0, self.drives.ahead, self.drives.backwards)
        cost = nodes.cost[parent] + self.step / speed + self.drives.stop * (nodes.sign[parent] * step[:, 1] < 0.0)
        cell = ((poses[:, :2] - self._low) / (SEARCH.cell * self.step)).astype(int)
        heading = np.floor(poses[:, 2] / (2.0 * pi) * SEARCH.headings).astype(int) % SEARCH.headings
        flat = np.ravel_multi_index((*cell.T, heading, (step[:, 1] > 0.0).astype(int)), best.shape)
        order = np.lexsort((cost, flat))
        first = order[np.unique(flat[order], return_index=True)[1]]
        better = first[cost[first] < best.ravel()[flat[first]] - SAME * self.step]
        best.ravel()[flat[better]] = cost[better]
        left = self._least_left(poses[better], step[better, 1])
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
        """Time from poses to the goal over free ground, (n,) s."""
        least: Array = self._times(self._words(poses)[1], signs).min(axis=1)
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
        count = max(2, int(np.ceil(np.abs(lengths).max() / self.step * 2.0)))
        parts = np.repeat(lengths / count, count)
        poses = _driven(pose, np.repeat(curvature, count), parts)
        return bool((self.room.least(poses[1:]) >= -self.slack).all())

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
