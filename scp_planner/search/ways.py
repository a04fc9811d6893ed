"""The best way round: a search over (station, offset, delay) that returns several different ways, roughly driven.

A trip among moving obstacles has many local minima: in front of, behind, left, right, wait. On a grid of stations,
offsets, and delays behind the fastest profile, the obstacles block cells; dynamic programming finds the cheapest
path of free cells in one sweep over the stations. At any station and delay an obstacle blocks one interval of
offsets, and a way passes it above or below: in front, behind, left and right are all of this kind. Other ways are
found by closing the side that the last one used.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from heapq import heappop, heappush

import numpy as np
from numpy.typing import NDArray

from scp_planner.arrays import Array, Index, Mask
from scp_planner.problem.problem import Problem
from scp_planner.solvers import QuadraticProgram, SolverStatus, solver_named
from scp_planner.threat_zones.batch import ZoneBatch
from scp_planner.threat_zones.sections import sections
from scp_planner.trips.guide import GuideFrame
from scp_planner.trips.path import Path
from scp_planner.trips.trajectory import Trajectory

Cell = np.float32
"""Costs of cells: half the memory, and to a millionth of a unit of time."""
Cells = NDArray[np.float32]

STATION_STEP = 1.0  # units of length
MOST_COLUMNS = 4000  # stations are farther apart on trips that would need more
BETWEEN = 2  # cells of the same column, between stations, that are joined in it
OFFSET_STEP = 0.25  # units of length
REACH = 4.0  # units of length to each side
DELAYS = 64
DELAY_STEP = 0.05  # units of time
DELAY_MOVES = (0, 1, 2, 4, 8)  # of the delay, from one station to the next
OFFSET_MOVES = 2  # of the offset, from one station to the next
CLEARANCE = 0.0  # units of length, kept from every obstacle by the search
SIDEWAYS_COST = 0.002  # units of time for each step of the offset, besides the longer way
BLOCKED = 1e9
BRANCHES = 8  # obstacles of a way, the closest first, whose other side is tried
FOLD = 0.8  # of the guide's radius of curvature; offsets beyond it are no way
SMOOTHING = 1.0  # square units of length: weight of bending against offsets, in fitting a path to a way
CLOSE_SMOOTHING = 0.1  # the same; smooth paths start faster runs, close ones do not cut the corners of walls
ARRIVAL_WEIGHT = 10.0  # of arriving in time, against being in time on the way
DRIVE_SMOOTHING = 1e-2  # units of time to the fourth power


_NONE: Index = np.zeros(0, dtype=np.intp)
_NOWHERE: Array = np.zeros(0)


@dataclass(frozen=True)
class _Blocked:
    """Offsets that zones block on lines across the guide.

    Attributes
    ----------
    entry : (n,) array of int
        Which line at which time.
    zone : (n,) array of int
    lower, upper : (n,) arrays
        Ends of the blocked offsets, m.
    middle : (n,) array
        Offset of the zone's centre, m.
    """

    entry: Index
    zone: Index
    lower: Array
    upper: Array
    middle: Array

    @classmethod
    def of(
        cls, zones: ZoneBatch, index: Index, times: Array, stations: Array, line: Index, frame: GuideFrame | None
    ) -> _Blocked:
        """Find what some zones block on the lines across the guide at ``stations[line]`` at these times."""
        if len(index) == 0:
            return cls(_NONE, _NONE, _NOWHERE, _NOWHERE, _NOWHERE)
        some = zones if len(index) == zones.size else zones.subset(index)
        centers = some.centers.grid(times)
        if frame is None:
            ahead, middle = centers[:, :, 0] - stations[line, None], centers[:, :, 1]
        else:
            away = centers - frame.position[line, None]
            ahead = (away * frame.tangent[line, None]).sum(axis=2)
            middle = (away * frame.normal[line, None]).sum(axis=2)
        radius = some.reach(times) + CLEARANCE
        half = radius * radius - ahead * ahead
        entry, zone = np.nonzero(half > 0.0)
        half = np.sqrt(half[entry, zone])
        middle = middle[entry, zone]
        lower, upper = middle - half, middle + half
        if some.outlines is not None:
            rows = np.flatnonzero(some.outline_slot[zone] >= 0)
            at = line[entry[rows]]
            if frame is None:
                origins = np.stack([stations[at], np.zeros(len(at))], axis=1)
                tangents = np.broadcast_to([1.0, 0.0], origins.shape)
            else:
                origins, tangents = frame.position[at], frame.tangent[at]
            cut = sections(some, zone[rows], times[entry[rows]], origins, tangents)
            lower[rows], upper[rows] = cut.lower - CLEARANCE, cut.upper + CLEARANCE
            kept = lower <= upper
            entry, zone, lower, upper, middle = entry[kept], zone[kept], lower[kept], upper[kept], middle[kept]
        return cls(entry, index[zone], lower, upper, middle)


@dataclass(frozen=True)
class Way:
    """One way round, roughly.

    Attributes
    ----------
    travel_time : float
        Estimate, s.
    stations, offsets, times : (n,) arrays
        m, m and s.
    sides : tuple of (zone, +1 or -1)
        Which obstacles are met, and whether they are passed above or below.
    """

    travel_time: float
    stations: Array
    offsets: Array
    times: Array
    sides: tuple[tuple[int, int], ...] = field(default=())

    @property
    def sides_set(self) -> frozenset[tuple[int, int]]:
        """The sides in no order: what makes two ways the same."""
        return frozenset(self.sides)


class WaySearch:
    """The grid of a problem, and searches on it.

    Parameters
    ----------
    problem : Problem
    delay_step : float
        Resolution of the delays, s.
    """

    def __init__(self, problem: Problem, delay_step: float = DELAY_STEP) -> None:
        self.problem = problem
        space, limits = problem.space, problem.limits
        columns = min(max(8, round(space.length / STATION_STEP)), MOST_COLUMNS)
        self.stations = np.linspace(0.0, space.length, columns + 1)
        self.middle = round(REACH / OFFSET_STEP)
        self.offsets: Array = OFFSET_STEP * np.arange(-self.middle, self.middle + 1, dtype=np.float64)
        self.delays = delay_step * np.arange(DELAYS)
        self.speeds = (space.start_speed, limits.speed, limits.acceleration)
        self.fastest = self._times(self.stations)
        step = space.length / columns
        slower = np.hypot(step, OFFSET_STEP * np.arange(OFFSET_MOVES + 1)) - step
        self.move_cost = slower / limits.speed + SIDEWAYS_COST * np.arange(OFFSET_MOVES + 1)
        self.solver = solver_named("daqp")
        self._block()
        self.outside = self._outside_box()
        self._free = self._base_penalty()

    def _times(self, stations: Array) -> Array:
        """Earliest times at stations without obstacles, s."""
        profile = self.problem.profile
        return _fastest_times(stations, *self.speeds) if profile is None else profile.times_at(stations)

    def _block(self) -> None:
        """Find the offsets that each obstacle blocks at each station and delay."""
        zones, count = self.problem.zones, len(self.stations)
        # Each column stands for the stretch around its station.
        step = self.stations[1] / BETWEEN
        shifts = step * (np.arange(BETWEEN) - 0.5 * (BETWEEN - 1))
        station = np.maximum(self.stations[:, None] + shifts, 0.0).ravel()
        column = np.repeat(np.arange(count), BETWEEN)
        guide = self.problem.space.guide
        frame = None if guide.straight else guide.frame(station)
        times = (self._times(station)[:, None] + self.delays).ravel()
        line = np.repeat(np.arange(len(station)), DELAYS)
        moving = _Blocked.of(zones, zones.moving, times, station, line, frame)
        # What stands is looked at once a line, and is there at all delays.
        still = _Blocked.of(zones, zones.standing, np.zeros(len(station)), station, np.arange(len(station)), frame)
        every = np.arange(DELAYS)
        cells = [
            column[moving.entry // DELAYS] * DELAYS + moving.entry % DELAYS,
            (column[still.entry][:, None] * DELAYS + every).ravel(),
        ]
        lower, upper, middle, zone = (
            np.concatenate([some, np.repeat(other, DELAYS)])
            for some, other in (
                (moving.lower, still.lower),
                (moving.upper, still.upper),
                (moving.middle, still.middle),
                (moving.zone, still.zone),
            )
        )
        size = len(self.offsets)
        first = np.ceil((lower - self.offsets[0]) / OFFSET_STEP)
        last = np.floor((upper - self.offsets[0]) / OFFSET_STEP)
        met = (first < size) & (last >= 0)
        self.first = np.maximum(first[met], 0).astype(np.intp)
        self.last = np.minimum(last[met], size - 1).astype(np.intp)
        self.cell = np.concatenate(cells)[met]
        self.zone, self.center = zone[met], middle[met]

    def _outside_box(self) -> Mask:
        """Which cells lie outside the workspace box, (n, offsets)."""
        box, path = self.problem.box, Path(self.problem.space, np.zeros(self.problem.space.path_size))
        base = path.points(self.stations / self.problem.space.length)
        normal = np.broadcast_to(base.normal, (len(self.stations), 2))
        cells = base.position[:, None] + self.offsets[:, None] * normal[:, None]
        outside: Mask = np.any(cells @ box.normals.T > box.offsets, axis=2)
        if not self.problem.space.guide.straight:
            curvature = self.problem.space.guide.frame(self.stations).curvature
            outside |= curvature[:, None] * self.offsets > FOLD
        return outside

    def best(self, closed: tuple[tuple[int, int], ...] = ()) -> Way | None:
        """Return the cheapest way, without passing some obstacles on some sides.

        Parameters
        ----------
        closed : tuple of (zone, side)
            Sides that are closed: +1 above, -1 below.

        Returns
        -------
        Way or None
            None if there is no way on the grid.
        """
        costs = self._sweep(self._penalty(closed))
        final = costs[-1, self.middle] + self.delays
        end = int(np.argmin(final))
        if final[end] >= BLOCKED:
            return None
        return self._trace(costs, end, float(final[end]))

    def _penalty(self, closed: tuple[tuple[int, int], ...]) -> Cells:
        """BLOCKED in every blocked cell, else 0, (n, offsets, delays)."""
        if not closed:
            return self._free
        penalty = self._free.copy()
        size = len(self.offsets)
        for zone, side in closed:
            mine = np.flatnonzero(self.zone == zone)
            column, delay = np.divmod(self.cell[mine], DELAYS)
            edge = self.first[mine] if side > 0 else self.last[mine]
            # All from the edge on to that side; one offset after another, of which there are few.
            for offset in range(size):
                shut = edge <= offset if side > 0 else edge >= offset
                penalty[column[shut], offset, delay[shut]] = BLOCKED
        return penalty

    def _base_penalty(self) -> Cells:
        """BLOCKED in the cells that are blocked with all sides open, (n, offsets, delays)."""
        size = len(self.offsets)
        count, width = len(self.stations) * DELAYS, size + 1
        begin, end = self.cell * width + self.first, self.cell * width + self.last + 1
        edges = np.bincount(begin, minlength=count * width) - np.bincount(end, minlength=count * width)
        # Each cell's edges sum up to nothing, so that one sum runs over all of them.
        blocked = (np.cumsum(edges) > 0).reshape(count, width)[:, :size]
        blocked = blocked.reshape(len(self.stations), DELAYS, size) | self.outside[:, None, :]
        return np.ascontiguousarray(np.where(blocked, Cell(BLOCKED), Cell(0.0)).transpose(0, 2, 1))

    def _sweep(self, penalty: Cells) -> Cells:
        """Cheapest cost to every free cell, station by station, (n, offsets, delays)."""
        count, size, delays = penalty.shape
        costs = np.empty_like(penalty)
        costs[0] = BLOCKED
        costs[0, self.middle, 0] = 0.0
        padded = np.full((size + 2 * OFFSET_MOVES, delays), BLOCKED, dtype=penalty.dtype)
        inner = padded[OFFSET_MOVES : OFFSET_MOVES + size]
        work = np.empty((size, delays), dtype=penalty.dtype)
        shifted = [
            (padded[OFFSET_MOVES - move :][:size], padded[OFFSET_MOVES + move :][:size], cost)
            for move, cost in enumerate(self.move_cost.tolist())
        ][1:]
        for i in range(1, count):
            before, here = costs[i - 1], costs[i]
            inner[:] = before
            for move in DELAY_MOVES[1:]:
                later = inner[:, move:]
                np.minimum(later, before[:, :-move], out=later)
            here[:] = inner
            for down, up, cost in shifted:
                np.minimum(down, up, out=work)
                work += cost
                np.minimum(here, work, out=here)
            here += penalty[i]
            np.minimum(here, BLOCKED, out=here)
        return costs

    def _trace(self, costs: Cells, delay: int, total: float) -> Way:
        """Follow the cheapest path back."""
        offset = self.middle
        count, size = len(self.stations), len(self.offsets)
        path = np.empty((count, 2), dtype=np.intp)
        path[-1] = offset, delay
        for i in range(count - 1, 0, -1):
            best, choice = np.inf, (offset, delay)
            for shift in range(-OFFSET_MOVES, OFFSET_MOVES + 1):
                j = offset + shift
                if not 0 <= j < size:
                    continue
                for move in DELAY_MOVES:
                    d = delay - move
                    if d >= 0:
                        cost = costs[i - 1, j, d] + self.move_cost[abs(shift)]
                        if cost < best:
                            best, choice = cost, (j, d)
            offset, delay = choice
            path[i - 1] = choice
        offsets: Array = self.offsets[path[:, 0]]
        times: Array = self.fastest + self.delays[path[:, 1]]
        return Way(float(self.fastest[-1] + total), self.stations, offsets, times, self._sides(path))

    def _sides(self, path: Index) -> tuple[tuple[int, int], ...]:
        """Obstacles that a way meets, the closest first, and the sides it passes them on."""
        cells = np.arange(len(self.stations)) * DELAYS + path[:, 1]
        position = np.full(len(self.stations) * DELAYS, np.nan)
        position[cells] = self.offsets[path[:, 0]]
        gap = position[self.cell] - self.center
        met = np.flatnonzero(~np.isnan(gap))
        found: dict[int, tuple[float, int]] = {}
        for entry in met:
            zone, distance = int(self.zone[entry]), float(gap[entry])
            if zone not in found or abs(distance) < found[zone][0]:
                found[zone] = (abs(distance), 1 if distance > 0 else -1)
        order = sorted(found.items(), key=lambda item: (item[1][0], item[0]))
        return tuple((zone, side) for zone, (_, side) in order)

    def start(self, way: Way, smoothing: float = SMOOTHING) -> Trajectory:
        """Fit a trip to a way: a smooth path, and a drive within the limits that keeps the way's times.

        Parameters
        ----------
        way : Way
        smoothing : float
            Weight of bending against offsets, m^2.

        Returns
        -------
        Trajectory
        """
        space, ends = self.problem.space, self.problem.ends
        theta = ends.theta.copy()
        rows = space.path.rows(way.stations / space.length)
        smooth = space.tables.station_bends * (smoothing / space.length**2)
        free = ends.free
        matrix = np.concatenate([rows[:, free], smooth[:, free]])
        target = np.concatenate([way.offsets - rows @ theta, -smooth @ theta])
        theta[free] = np.linalg.solve(matrix.T @ matrix, matrix.T @ target)
        np.clip(theta[free], ends.lower[free], ends.upper[free], out=theta[free])
        path = Path(space, theta)
        driven = path.arc_length_at(way.stations / space.length)
        late = np.maximum(driven - way.stations, 0.0) / self.problem.limits.speed
        beta = self._drive(way.times + late, driven)
        fastest = self._fastest_drive(float(path.arc_length))
        trip = Trajectory.of(space, theta, beta, float(way.times[-1]))
        while not np.isfinite(trip.travel_time):  # the fit stops short of the goal
            beta = 0.5 * (beta + fastest)
            trip = Trajectory.of(space, theta, beta)
        return trip

    def _fastest_drive(self, length: float) -> Array:
        """Accelerations of a trip without obstacles and with a free goal speed, which always arrives."""
        space, (start_speed, top, acceleration) = self.problem.space, self.speeds
        time = float(_fastest_times(np.array([length]), *self.speeds)[0])
        rising = (max(top, start_speed) - start_speed) / acceleration
        sites = space.acceleration.breakpoints[:-1] * time
        beta = np.zeros(space.acceleration_size)
        beta[: len(sites)] = np.where(sites < rising, acceleration, 0.0)
        return beta

    def _drive(self, times: Array, driven: Array) -> Array:
        """Accelerations within the limits that come closest to having driven given distances at given times."""
        space, limits = self.problem.space, self.problem.limits
        tau = float(times[-1])
        table = space.time_table(times / tau)
        matrix = tau * tau * table.distance
        matrix[-1] *= ARRIVAL_WEIGHT
        wanted = driven - space.start_speed * times
        wanted[-1] *= ARRIVAL_WEIGHT
        goal_speed = self.problem.ends.goal_speed
        if goal_speed is not None:
            matrix = np.vstack([matrix, ARRIVAL_WEIGHT * tau * space.tables.final_speed])
            wanted = np.append(wanted, ARRIVAL_WEIGHT * (goal_speed - space.start_speed))
        size = space.acceleration_size
        speeds = tau * space.tables.speed_control[1:]
        program = QuadraticProgram(
            matrix.T @ matrix + DRIVE_SMOOTHING / self.problem.agility**2 * np.eye(size),
            -matrix.T @ wanted,
            self.problem.lowest_accelerations,
            self.problem.highest_accelerations,
            np.concatenate([speeds, -speeds]),
            np.concatenate(
                [
                    np.full(len(speeds), limits.speed - space.start_speed),
                    np.full(len(speeds), space.start_speed),
                ]
            ),
            0,
        )
        solution = self.solver.solve(program)
        if solution.status is SolverStatus.OPTIMAL:
            return solution.x
        return np.clip(np.zeros(size), -limits.deceleration, limits.acceleration)


def _fastest_times(stations: Array, start_speed: float, top: float, acceleration: float) -> Array:
    """Earliest time at each station without obstacles, s."""
    top = max(top, start_speed)
    ramp = (top * top - start_speed * start_speed) / (2.0 * acceleration)
    rising = (
        2.0 * stations / (start_speed + np.sqrt(start_speed * start_speed + 2.0 * acceleration * stations) + 1e-300)
    )
    cruising = (top - start_speed) / acceleration + (stations - ramp) / top
    return np.where(stations <= ramp, rising, cruising)


class WayTree:
    """Ways round, the fastest estimate first; each may be branched at obstacles whose side is then closed."""

    def __init__(self, search: WaySearch, most: int) -> None:
        """Search for the first way; at most so many sweeps in all."""
        self.search = search
        self.sweeps = most
        self.heap: list[tuple[float, int, Way, frozenset[tuple[int, int]]]] = []
        self.seen: set[frozenset[tuple[int, int]]] = set()
        self.tried: set[frozenset[tuple[int, int]]] = set()
        self.closed: frozenset[tuple[int, int]] = frozenset()
        self._look(self.closed)

    def next(self) -> Way | None:
        """The way with the fastest estimate that has not been taken."""
        if not self.heap:
            return None
        _, _, way, self.closed = heappop(self.heap)
        return way

    def branch(self, touched: tuple[tuple[int, int], ...]) -> None:
        """Look for ways that pass one of these obstacles on its other side than the way taken last."""
        for side in touched:
            self._look(self.closed | {side})

    def _look(self, closed: frozenset[tuple[int, int]]) -> None:
        if closed in self.tried or len(self.tried) >= self.sweeps:
            return
        self.tried.add(closed)
        way = self.search.best(tuple(sorted(closed)))
        if way is not None and way.sides_set not in self.seen:
            self.seen.add(way.sides_set)
            heappush(self.heap, (way.travel_time, len(self.tried), way, closed))


def ways(search: WaySearch, most: int) -> Iterator[Way]:
    """Yield different ways round, the fastest estimate first, found as they are asked for.

    Parameters
    ----------
    search : WaySearch
    most : int
        Sweeps at most.

    Yields
    ------
    Way
    """
    tree = WayTree(search, most)
    while (way := tree.next()) is not None:
        yield way
        tree.branch(way.sides[:BRANCHES])
