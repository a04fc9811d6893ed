"""The best way round: searches on the grid, and other ways with sides of obstacles closed."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from heapq import heappop, heappush

import numpy as np

from scp_planner.arrays import Array, cross
from scp_planner.constraints.arrival import EarliestArrival
from scp_planner.pauses import pause
from scp_planner.problem.problem import Problem
from scp_planner.search.blocked import Cells
from scp_planner.search.grid import DELAYS, EACH_STATION, Fineness, Grid, Words
from scp_planner.search.sweep import Begun, Counts, States, Sweep, WayEnds

Closed = tuple[tuple[int, int], ...]


@dataclass(frozen=True)
class WaySettings:
    """Delays and number of ways that are looked for."""

    # of all delays; sweeps for few are quicker, and are enough if there is a way
    windows: tuple[float, ...] = (0.08, 0.25, 1.0)
    rounded_up: float = 2.0  # delays by which a window may be wider than it is, at most
    likely: float = 3.0  # delays after the fastest way that other ways have
    quicker: float = 0.25  # of the delays that they may have: it is worth while to look for fewer before
    # cells of the cases of one sweep; with more their memory would be slower than their calls
    most_together: int = 100_000
    branches: int = 8  # obstacles of a way, the closest first, whose other side is tried


WAYS = WaySettings()


@dataclass(frozen=True)
class Way:
    """One way round, roughly."""

    travel_time: float  # Estimate, s: the last of the times
    stations: Array  # (n,) m, m and s
    offsets: Array  # (n,) m, m and s
    times: Array  # (n,) m, m and s
    sides: tuple[tuple[int, int], ...] = field(default=())

    @property
    def sides_set(self) -> frozenset[tuple[int, int]]:
        """The sides in no order: what makes two ways the same."""
        return frozenset(self.sides)


@dataclass(frozen=True)
class _Base:
    """A sweep, and the sides that were closed in it: where fewer cells are free, others go on from it."""

    sweep: Sweep
    closed: frozenset[tuple[int, int]]

    def until(self, line: int) -> Begun:
        """The sweep up to the last station before a line; up to the first one, where all ways begin, before none."""
        return Begun(self.sweep, max(line - 1, 0) // EACH_STATION)


class WaySearch:
    """The grid of a problem, and searches on it."""

    def __init__(
        self,
        problem: Problem,
        coarseness: float = 1.0,
        fineness: Fineness | None = None,
        deadline: float = np.inf,
    ) -> None:
        self.problem = problem
        self.grid = Grid.of(problem, fineness or Fineness(), coarseness)
        self.cells = Cells(problem, self.grid, deadline)
        self._fastest = np.inf  # arrival of the ways that were found, s
        self._least = 0  # delays at the goal of the fastest way with no side closed; none has fewer
        self.ends = WayEnds(self._slopes(0), self._slopes(-1), self._goal())

    @property
    def deadline(self) -> float:
        """Value of :func:`time.perf_counter` after which no further zones are looked at, and no way is found."""
        return self.cells.deadline

    def go_on_until(self, deadline: float) -> None:
        """Set another deadline; a search that has been cut off has ended."""
        self.cells.deadline = deadline

    def _slopes(self, end: int) -> slice:
        """Slopes that the heading at an end allows."""
        ends, space, grid = self.problem.ends, self.problem.space, self.grid
        fixed = ends.free.start == 2 if end == 0 else self.problem.scenario.goal.heading is not None
        if not fixed:
            return slice(0, len(grid.slopes))
        leg = space.length / (space.path.coefficients.shape[1] - 1) / len(space.path.widths)
        slope = ends.theta[1] / leg if end == 0 else (ends.theta[-1] - ends.theta[-2]) / leg
        nearest = int(np.argmin(np.abs(grid.slopes - slope)))
        spread = 0 if end == 0 else int(grid.turns[0])
        return slice(max(nearest - spread, 0), nearest + spread + 1)

    def _goal(self) -> Words:
        """Offsets and delays that are an arrival, (O,) words."""
        problem, grid = self.problem, self.grid
        goal = np.zeros(2 * grid.middle + 1, dtype=np.uint64)
        delays = 2**DELAYS - 1
        for limit in problem.constraints:
            if isinstance(limit, EarliestArrival):
                early = int(np.ceil((limit.travel_time - grid.fastest[-1]) / grid.delay_step))
                delays &= delays << min(max(early, 0), DELAYS)
        last = problem.space.path_size - 1
        low = high = 0.0
        if problem.ends.free.stop > last:
            low, high = float(problem.ends.lower[last]), float(problem.ends.upper[last])
        near = (grid.offsets >= low - 0.5 * grid.offset_step) & (grid.offsets <= high + 0.5 * grid.offset_step)
        goal[near] = np.uint64(delays)
        return goal

    def best(self, closed: Closed = (), within: float = np.inf) -> Way | None:
        """Return the fastest way, without passing some obstacles on some sides."""
        return self.best_of([closed], within)[0]

    def best_of(self, cases: Sequence[Closed], within: float = np.inf) -> list[Way | None]:
        """Return the fastest way of each of several cases, which differ in the sides that are closed."""
        found: list[Way | None] = [None] * len(cases)
        left = [k for k, closed in enumerate(cases) if not self.cells.shut(closed)]
        for latest in self._windows(within) if left else ():
            pause()
            if self.cells.out_of_time:
                return found
            reached, all_known = self._reached([cases[k] for k in left], self._in_time(latest), within)
            for k, way in reached.items():
                found[left[k]] = way
            left = [case for k, case in enumerate(left) if k not in reached]
            if not (left and all_known):
                break
        return found

    def _reached(self, cases: Sequence[Closed], in_time: Counts, within: float) -> tuple[dict[int, Way | None], bool]:
        """The ways of the cases that reach the goal in time, and whether all are known: the time may be up before."""
        together = max(1, WAYS.most_together // (len(self.grid.lines) * len(self.grid.half_offsets)))
        base = self._base(cases, in_time) if together == 1 < len(cases) else None
        reached: dict[int, Way | None] = {}
        for begin in range(0, len(cases), together):
            some = cases[begin : begin + together]
            sweep = self._sweep(some, in_time, base)
            if sweep is None or sweep.cut_off:
                return reached, False
            arrivals = [(begin + case, case, sweep.first_arrival(case)) for case in range(len(some))]
            self._least = max([self._least, *(delay for k, _, delay in arrivals if delay is not None and not cases[k])])
            traced = [(k, delay, sweep.trace(delay, case)) for k, case, delay in arrivals if delay is not None]
            del sweep  # before anything else is made: nothing that is kept is larger
            reached |= {k: self._way(states, delay, within) for k, delay, states in traced}
        return reached, True

    def _sweep(self, cases: Sequence[Closed], in_time: Counts, base: _Base | None) -> Sweep | None:
        """One sweep of several cases, from where it differs from a base; None where the time is up before."""
        free = self.cells.without_each(cases, int(in_time[-1].max()))
        if self.cells.cut_off or self.cells.out_of_time:
            return None
        known = None if base is None else base.until(self.cells.first_line(cases[0], base.closed))
        return Sweep(self.grid, free, self.ends, in_time, self.deadline, known)

    def _base(self, cases: Sequence[Closed], in_time: Counts) -> _Base:
        """A sweep with those sides closed that are in all of several cases, which are swept one at a time."""
        closed = frozenset(cases[0]).intersection(*cases[1:])
        free = self.cells.without_each([tuple(sorted(closed))], int(in_time[-1].max()))
        return _Base(Sweep(self.grid, free, self.ends, in_time, self.deadline), closed)

    def _windows(self, within: float) -> list[float]:
        """Times at the goal up to which ways are looked for in turn, s."""
        first, all_delays = float(self.grid.fastest[-1]), DELAYS * self.grid.delay_step
        if within == np.inf:
            # As sides are closed no way gets faster
            useful = [window for window in WAYS.windows if self._least <= window * DELAYS + WAYS.rounded_up]
            return [first + window * all_delays for window in useful]
        last = min(within + self._longest_bends, first + all_delays)
        # Other ways are hardly slower than the fastest
        likely = self._fastest + WAYS.likely * self.grid.delay_step
        return [likely, last] if likely - first < WAYS.quicker * (last - first) else [last]

    def _way(self, states: States, delay: int, within: float) -> Way | None:
        """The way of states with a delay at the goal; None if it takes too long."""
        grid = self.grid
        offsets = grid.offsets[states.offset]
        legs = grid.durations[np.arange(grid.columns), states.speed[1:], states.slope[1:]]
        times = np.concatenate([[0.0], np.cumsum(legs + grid.delay_step * states.waited)])
        # Windows are of the grid's delays, and over many legs their rounding adds up.
        arrival, by_the_grid = float(times[-1]), float(grid.fastest[-1]) + grid.delay_step * delay
        apart = arrival - by_the_grid > WAYS.likely * grid.delay_step
        self._fastest = min(self._fastest, by_the_grid if apart else arrival)
        estimate = arrival + self._in_bends(offsets, legs)
        if estimate > within:
            return None
        return Way(estimate, grid.stations, offsets, times, self._sides(offsets, times))

    @cached_property
    def _turns(self) -> Array:
        """By how much the guide turns from one station to the next, (n,) rad."""
        frame = self.cells.lines.frame
        if frame is None:
            return np.zeros(self.grid.columns)
        before, after = frame.tangent[:-EACH_STATION:EACH_STATION], frame.tangent[EACH_STATION::EACH_STATION]
        turns: Array = np.arctan2(cross(before, after), (before * after).sum(axis=-1))
        return turns

    @cached_property
    def _longest_bends(self) -> float:
        """By how much a way may take less than its delays tell, s: inside of all bends, as far as the grid goes."""
        grid = self.grid
        return float(np.abs(self._turns).sum() * grid.offsets[-1] / grid.speeds[0])

    def _in_bends(self, offsets: Array, legs: Array) -> float:
        """By how much legs take longer than along a straight guide, s; negative for those inside of its bends."""
        if self.cells.lines.frame is None:
            return 0.0
        step, aside = self.grid.step, np.diff(offsets)
        along = np.maximum(step - self._turns * 0.5 * (offsets[1:] + offsets[:-1]), 0.0)
        longer = np.hypot(along, aside) / np.hypot(step, aside) - 1.0
        return float((legs * longer).sum())

    @cached_property
    def _earliest(self) -> Array:
        """Least time to the goal for each class of speed, relative to its station's, (n + 1, K, O to one side)."""
        grid, acceleration = self.grid, self.problem.limits.acceleration
        speed, top = grid.speeds[:, None], float(grid.speeds[0])
        ramp = (top * top - speed * speed) / (2.0 * acceleration)
        aside = grid.offsets[grid.middle :]
        earliest: Array = np.empty((len(grid.stations), len(speed), len(aside)))
        for some in self._some_stations():
            left = grid.lines[-1] - grid.stations[some]
            far = np.hypot(left[:, None], aside)[:, None, :]
            reached = np.sqrt(speed * speed + 2.0 * acceleration * np.minimum(far, ramp))
            least = (reached - speed) / acceleration + np.maximum(far - ramp, 0.0) / top
            earliest[some] = least + grid.fastest[::EACH_STATION][some, None, None]
        return earliest

    def _some_stations(self) -> Iterator[slice]:
        """Yield parts of the stations that take little memory."""
        grid = self.grid
        at_once = max(1, WAYS.most_together // (len(grid.speeds) * len(grid.offsets)))
        for begin in range(0, len(grid.stations), at_once):
            yield slice(begin, begin + at_once)

    def _in_time(self, within: float) -> Counts:
        """With how many delays each class of speed may reach the goal in time, (n + 1, K, O)."""
        grid = self.grid
        latest = min(within, float(grid.fastest[-1]) + DELAYS * grid.delay_step)
        counts: Counts = np.empty((*self._earliest.shape[:2], len(grid.offsets)), dtype=np.uint8)
        for some in self._some_stations():
            # Rounding takes a delay
            delays = np.floor((latest - self._earliest[some]) / grid.delay_step) + 2.0
            counts[some, :, grid.middle :] = np.clip(delays, 0, DELAYS)
        counts[:, :, : grid.middle] = counts[:, :, : grid.middle : -1]
        return counts

    def _sides(self, offsets: Array, times: Array) -> tuple[tuple[int, int], ...]:
        """Obstacles that a way meets, the closest first, and the sides it passes them on."""
        grid, zones = self.grid, self.problem.zones
        if zones.size == 0:
            return ()
        count = len(grid.lines)
        line = np.arange(count)
        position = np.interp(grid.lines, grid.stations, offsets)
        when = np.interp(grid.lines, grid.stations, times)
        ahead, middle = self.cells.lines.seen(line[:, None], zones.centers.grid(when))
        met, zone = np.nonzero(np.abs(ahead) < zones.reach(when))
        gap = position[met] - middle[met, zone]
        farthest_first = np.argsort(-np.abs(gap), kind="stable")
        found: dict[int, float] = dict(zip(zone[farthest_first].tolist(), gap[farthest_first].tolist(), strict=True))
        order = sorted(found.items(), key=lambda item: (abs(item[1]), item[0]))
        return tuple((zone, 1 if distance > 0.0 else -1) for zone, distance in order)


class WayTree:
    """Ways round, the fastest estimate first; each may be branched at obstacles whose side is then closed."""

    def __init__(self, search: WaySearch, most: int, within: float = np.inf) -> None:
        """Search for the first way, if its estimate is not longer than ``within``, s; for at most so many in all."""
        self.search = search
        self.most = most
        self.heap: list[tuple[float, int, Way, frozenset[tuple[int, int]]]] = []
        self.seen: set[frozenset[tuple[int, int]]] = set()
        self.tried: set[frozenset[tuple[int, int]]] = set()
        self.closed: frozenset[tuple[int, int]] = frozenset()
        self._look([self.closed], within)

    def next(self) -> Way | None:
        """The way with the fastest estimate that has not been taken."""
        if not self.heap:
            return None
        _, _, way, self.closed = heappop(self.heap)
        return way

    def branch(self, touched: Closed, within: float = np.inf) -> None:
        """Look for ways that pass one of these obstacles on its other side than the way taken last."""
        self._look([self.closed | {side} for side in touched], within)

    def _look(self, cases: Iterable[frozenset[tuple[int, int]]], within: float) -> None:
        new = [closed for closed in dict.fromkeys(cases) if closed not in self.tried]
        new = new[: max(self.most - len(self.tried), 0)]
        self.tried.update(new)
        if not new:
            return
        found = self.search.best_of([tuple(sorted(closed)) for closed in new], within)
        for number, (closed, way) in enumerate(zip(new, found, strict=True)):
            if way is not None and way.sides_set not in self.seen:
                self.seen.add(way.sides_set)
                heappush(self.heap, (way.travel_time, len(self.tried) - len(new) + number, way, closed))


def ways(search: WaySearch, most: int, within: Callable[[], float] = lambda: np.inf) -> Iterator[Way]:
    """Yield different ways round, the fastest estimate first, found as they are asked for."""
    return (way for way in ways_in_parts(search, most, within, WAYS.branches) if way is not None)


def ways_in_parts(search: WaySearch, most: int, within: Callable[[], float], part: int) -> Iterator[Way | None]:
    """Yield ways as :func:`ways` does, and None in between: after each so many branches that have been looked for."""
    tree = WayTree(search, most, within())
    while (way := tree.next()) is not None and way.travel_time <= within():
        yield way
        touched = way.sides[: WAYS.branches]
        for first in range(0, len(touched), part):
            if first:
                yield None
            tree.branch(touched[first : first + part], within())
