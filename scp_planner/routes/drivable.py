"""Routes over free cells that a vehicle can follow: a search over poses ahead, slower in tighter bends.

The search is best first over places and headings, and keeps exact poses, one in each cell (hybrid A*: D. Dolgov, S.
Thrun, M. Montemerlo, J. Diebel, Int. J. Robotics Research 29, 2010). All poses whose guess is about the least are
followed together. The shortest way over cells bounds what is left.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import inf, pi

import numpy as np

from scp_planner.arrays import Array, Index, Mask, unit_vectors
from scp_planner.pauses import Budget
from scp_planner.scenario.limits import Limits
from scp_planner.scenario.models import Scenario


@dataclass(frozen=True)
class DrivableSettings:
    """Steps, cells and work of a search."""

    turn: float = 0.6  # rad, of a step at the smallest radius
    longest: float = 1.0  # radii of the vehicle, of a step
    checks: int = 4  # places on a step where it has to be free
    headings: int = 48  # cells of a turn
    cell: float = 0.5  # steps, of places
    bends: tuple[float, ...] = (0.0, 0.5, 1.0)  # steps, on a geometric scale, from full speed to the tightest bend
    kept: float = 0.97  # of the largest curvature
    left: float = 1.05  # of the shortest way over cells: with more the search is quicker, and may miss faster routes
    near: float = 1.0  # steps from the goal, if that is ahead
    at_goal: float = 0.1  # and if it is not
    askew: float = 0.4  # rad, between headings, and from what is ahead
    behind: float = 20.0  # steps, by which poses are farther from the goal than the nearest one and still followed
    better: float = 1e-6  # relative: a pose that gains less takes no other's place
    most: int = 1_000_000  # poses


DRIVABLE = DrivableSettings()


def drivable_route(
    scenario: Scenario,
    radius: float,
    ends: tuple[Array, Array, float],
    free: Mask,
    left: Array,
    size: float,
    budget: Budget,
) -> Array | None:
    """Return places (n, 2), cells, of a route that the vehicle may follow over free cells; None if none is found.

    Start and goal are places in cells of a size, m, whose grid is turned by an angle, rad; ``left`` is the shortest way
    to the goal from each cell, cells.
    """
    start, goal, yaw = ends
    steps = _Steps.of(scenario, radius, size)
    cells = _PoseCells(free, max(1, round(DRIVABLE.cell * steps.length)))
    best = np.full(cells.count, inf, dtype=np.float32)
    rate = DRIVABLE.left * size / scenario.vehicle.max_speed
    first = scenario.start.heading
    headings = 2.0 * pi * np.arange(DRIVABLE.headings) / DRIVABLE.headings if first is None else np.array([first - yaw])
    poses = [np.column_stack([np.tile(start, (len(headings), 1)), headings])]
    parents: list[Index] = [np.full(len(headings), -1, dtype=np.intp)]
    none = np.zeros(len(headings))
    # Numbers of poses, poses, their costs and guesses, s, what is left, cells, and their cells
    waiting: tuple[np.ndarray, ...] = np.arange(len(headings)), poses[0], none, none, none, none.astype(np.intp)
    made, nearest = len(headings), inf
    while len(waiting[0]) and made < DRIVABLE.most:
        budget.check()
        now = waiting[3] <= waiting[3].min() + steps.pace[0]
        later = ~now & (waiting[4] <= nearest + DRIVABLE.behind * steps.length)
        number, pose, cost, _, _, cell = (each[now] for each in waiting)
        waiting = tuple(each[later] for each in waiting)
        arrived = _arrived(scenario, pose, goal, yaw, steps.length, size)
        if arrived.any():
            last = int(number[arrived][np.argmin(cost[arrived])])
            return _traced(np.concatenate(poses), np.concatenate(parents), last, goal)
        live = (number < len(headings)) | (cost <= best[cell])
        begin, pose, bend = steps.ahead_of(pose[live], free)
        cost, parent = cost[live][begin] + steps.pace[bend], number[live][begin]
        spot = pose[:, :2].astype(np.intp)
        rest, cell = left[spot[:, 1], spot[:, 0]], cells.of(spot, pose[:, 2])
        order = np.lexsort((cost, cell))
        order = order[np.unique(cell[order], return_index=True)[1]]
        order = order[(cost[order] < best[cell[order]] * (1.0 - DRIVABLE.better)) & np.isfinite(rest[order])]
        best[cell[order]] = cost[order]
        cost, rest = cost[order].astype(np.float32), rest[order]
        nearest = min(nearest, float(rest.min(initial=inf)))
        fresh = np.arange(made, made + len(order)), pose[order], cost, cost + rate * rest, rest, cell[order]
        made += len(order)
        poses.append(pose[order])
        parents.append(parent[order])
        waiting = tuple(np.concatenate(pair) for pair in zip(waiting, fresh, strict=True))
    return None


@dataclass(frozen=True)
class _Steps:
    """Steps ahead, each along one bend, that are looked at in some places: lengths in cells, times in s."""

    length: float
    pace: Array  # (bends,) s
    half: Array  # (checks, bends) rad, half of the turn up to each place
    ahead: Array  # (checks, bends) cells, to each place as the crow flies
    discs: tuple[float, ...]

    @classmethod
    def of(cls, scenario: Scenario, radius: float, size: float) -> _Steps:
        limits = Limits.of(scenario)
        tightest = DRIVABLE.kept * min(limits.curvature, 1.0 / radius)
        step = min(DRIVABLE.turn / tightest, DRIVABLE.longest * radius)
        fastest = min(limits.lateral_acceleration / limits.speed**2, tightest)
        bends = [fastest ** (1.0 - share) * tightest**share for share in DRIVABLE.bends]
        curvature = np.array([0.0, *bends, *(-bend for bend in bends)])
        with np.errstate(divide="ignore"):
            pace = step / np.minimum(limits.speed, np.sqrt(limits.lateral_acceleration / np.abs(curvature)))
        at = np.arange(1, DRIVABLE.checks + 1)[:, None] / DRIVABLE.checks
        half = 0.5 * at * curvature * step
        discs = tuple(disc / size for disc in scenario.vehicle.discs)
        return cls(step / size, pace, half, at * step / size * np.sinc(half / pi), discs)

    def ahead_of(self, pose: Array, free: Mask) -> tuple[Index, Array, Index]:
        """Return the steps over free cells: from which of some poses (n, 3), to which poses, and along which bends."""
        chord = pose[:, 2, None, None] + self.half  # (n, checks, bends)
        place = pose[:, None, None, :2] + self.ahead[..., None] * unit_vectors(chord)
        heading = chord + self.half
        nose = unit_vectors(heading)
        clear = np.ones((len(pose), len(self.pace)), dtype=bool)
        most = np.array(free.shape[::-1]) - 1
        for disc in self.discs:
            spot = np.floor(place + disc * nose).astype(np.intp)
            held = np.clip(spot, 0, most)
            clear &= ((spot == held).all(axis=-1) & free[held[..., 1], held[..., 0]]).all(axis=1)
        n, k = np.nonzero(clear)
        return n, np.column_stack([place[n, -1, k], heading[n, -1, k]]), k


def _arrived(scenario: Scenario, pose: Array, goal: Array, yaw: float, step: float, size: float) -> Mask:
    """Poses from which the goal is straight ahead, or hardly away."""
    to_goal = goal - pose[:, :2]
    away = np.hypot(to_goal[:, 0], to_goal[:, 1])
    straight = to_goal[:, 0] * np.cos(pose[:, 2]) + to_goal[:, 1] * np.sin(pose[:, 2])
    found: Mask = (away <= DRIVABLE.near * step) & (straight >= np.cos(DRIVABLE.askew) * away)
    found |= away <= max(scenario.goal.radius / size, DRIVABLE.at_goal * step)
    if scenario.goal.heading is not None:
        found &= np.cos(pose[:, 2] + yaw - scenario.goal.heading) >= np.cos(DRIVABLE.askew)
    return found


class _PoseCells:
    """Numbers of the cells of poses, on squares of so many free cells each way."""

    def __init__(self, free: Mask, side: int) -> None:
        rows, columns = free.shape
        side = min(side, max(rows, columns))
        padded = np.pad(free, ((0, -rows % side), (0, -columns % side)))
        shape = padded.shape[0] // side, side, padded.shape[1] // side, side
        used = padded.reshape(shape).any(axis=(1, 3))
        self.side, self.count = side, int(used.sum()) * DRIVABLE.headings
        self._number = np.cumsum(used.ravel(), dtype=np.intp).reshape(used.shape) - 1

    def of(self, places: Index, heading: Array) -> Index:
        """Return the cells of places, (n, 2), column and row, with headings, rad."""
        turned = np.floor(heading / (2.0 * pi) * DRIVABLE.headings).astype(np.intp) % DRIVABLE.headings
        column, row = (places // self.side).T
        found: Index = self._number[row, column] * DRIVABLE.headings + turned
        return found


def _traced(poses: Array, parents: Index, last: int, goal: Array) -> Array:
    """Places on the way to a pose, and the goal."""
    found = [goal]
    while last >= 0:
        found.append(poses[last, :2])
        last = int(parents[last])
    return np.array(found[::-1])
