"""Sweeps of words against plain enumeration of states, one after another."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest
from scenes import scene

from scp_planner.problem.build import build_problem
from scp_planner.search.grid import DELAYS, EACH_STATION, Fineness, Grid
from scp_planner.search.sweep import Sweep, WayEnds
from scp_planner.settings.planning import Settings
from scp_planner.threat_zones.of_scenario import zones

State = tuple[int, int, int, int]
ALL = ~np.uint64(0)
TINY = Fineness(slope_step=0.5, slopes=(1, 3), turns=2, speeds=3, delays=4.0)


def small_grid(fineness: Fineness = TINY) -> Grid:
    """A grid of a trip without obstacles, cut down to eight columns."""
    scenario = scene()
    problem = build_problem(scenario, zones(scenario), Settings(max_offset=3.0))
    return Grid.of(problem, fineness)


def free_cells(grid: Grid, rng: np.random.Generator, cases: int) -> np.ndarray:
    """Random free cells: of each offset, a stretch of the delays, so that there is something to wait for."""
    shape = (len(grid.lines), len(grid.half_offsets), cases)
    first = rng.integers(0, 24, shape)
    length = rng.integers(1, 20, shape)
    blocked = ((np.uint64(1) << length.astype(np.uint64)) - np.uint64(1)) << first.astype(np.uint64)
    return np.where(rng.random(shape) < 0.6, ~blocked, ALL)


class Rules:
    """The rules in words, one state at a time, on plain numbers: looking up single entries of arrays takes long."""

    def __init__(self, grid: Grid, free: np.ndarray, case: int) -> None:
        self.grid = grid
        self.cells: list[list[int]] = free[..., case].tolist()
        self.shifts: list[list[list[int]]] = grid.shifts.tolist()
        self.turns: list[int] = grid.turns.tolist()
        self.slowest = len(grid.speeds) - 1

    def is_free(self, line: int, half_offset: int, delay: int) -> bool:
        """True if one cell is free."""
        inside = 0 <= half_offset < len(self.cells[line]) and 0 <= delay < DELAYS
        return inside and bool(self.cells[line][half_offset] >> delay & 1)

    def followers(self, i: int, state: State) -> Iterator[State]:
        """States at the next station."""
        k, m, o, d = state
        sidesteps = (-3, -1, 0, 1, 3)
        for speed in range(max(k - self.grid.rises, 0), min(k + self.grid.falls, self.slowest) + 1):
            turns = self.turns[speed]
            for slope in range(max(m - turns, 0), min(m + turns, len(sidesteps) - 1) + 1):
                half = 2 * o + sidesteps[slope]
                offset = o + sidesteps[slope]
                delay = d + self.shifts[EACH_STATION * i][speed][slope]
                if not self.is_free(EACH_STATION * i + 1, half, delay):
                    continue
                delay += self.shifts[EACH_STATION * i + 1][speed][slope]
                while self.is_free(EACH_STATION * i + 2, 2 * offset, delay):
                    yield speed, slope, offset, delay
                    if speed < self.slowest:
                        break
                    delay += 1

    def enumerated(self, ends: WayEnds) -> list[set[State]]:
        """States at each station, found one by one."""
        grid = self.grid
        speeds = range(len(grid.speeds))[grid.first_speeds]
        reached = [{(k, m, grid.middle, 0) for k in speeds for m in range(len(grid.slopes))[ends.first_slopes]}]
        for i in range(grid.columns):
            reached.append({after for state in reached[-1] for after in self.followers(i, state)})
        return reached


def as_states(sweep: Sweep, case: int) -> list[set[State]]:
    """States of a sweep as tuples."""
    layout, found = sweep.layout, []
    for reached in sweep.reached:
        assert reached is not None
        states: set[State] = set()
        for k, some in enumerate(reached):
            for m, bits in some.items():
                words = layout.words(bits)[case]
                free = words[:, None] >> np.arange(DELAYS, dtype=np.uint64) & np.uint64(1)
                states |= {(k, m, layout.first + o, d) for o, d in np.argwhere(free).tolist()}
        found.append(states)
    return found


def always(grid: Grid) -> np.ndarray:
    """All delays are in time."""
    return np.full((grid.columns + 1, len(grid.speeds), 2 * grid.middle + 1), DELAYS, dtype=np.uint8)


def ends_of(grid: Grid) -> WayEnds:
    goal = np.zeros(2 * grid.middle + 1, dtype=np.uint64)
    goal[grid.middle - 1 : grid.middle + 2] = ALL
    return WayEnds(slice(2, 3), slice(1, 4), goal)


@pytest.mark.parametrize(
    ("seed", "case"), [(0, 1), *(pytest.param(*both, marks=pytest.mark.slow) for both in ((0, 0), (1, 0), (1, 1)))]
)
def test_sweeps_reach_what_enumeration_reaches(seed: int, case: int) -> None:
    grid = small_grid()
    free, ends = free_cells(grid, np.random.default_rng(seed), 2), ends_of(grid)
    sweep = Sweep(grid, free, ends, always(grid))
    expected = Rules(grid, free, case).enumerated(ends)
    found = as_states(sweep, case)
    assert found == expected[: len(found)]
    assert all(not some for some in expected[len(found) :])
    arrivals = [s[3] for s in expected[-1] if abs(s[2] - grid.middle) <= 1 and 1 <= s[1] <= 3]
    assert sweep.first_arrival(case) == (min(arrivals) if arrivals else None)
    assert len(expected[4]) > 50, "the scenes must have ways to be told apart"


@pytest.mark.parametrize("seed", range(2))
def test_traces_are_ways_of_the_enumeration(seed: int) -> None:
    grid = small_grid()
    free, ends = free_cells(grid, np.random.default_rng(seed), 2), ends_of(grid)
    sweep = Sweep(grid, free, ends, always(grid))
    for case in range(2):
        delay = sweep.first_arrival(case)
        assert delay is not None
        states = sweep.trace(delay, case)
        rules = Rules(grid, free, case)
        way = list(zip(*(x.tolist() for x in (states.speed, states.slope, states.offset, states.delay)), strict=True))
        assert way[0][2:] == (grid.middle, 0)
        assert way[-1][3] == delay
        for i in range(grid.columns):
            assert way[i + 1] in set(rules.followers(i, way[i]))
            driven = grid.shifts[EACH_STATION * i : EACH_STATION * i + 2, way[i + 1][0], way[i + 1][1]].sum()
            assert way[i + 1][3] - way[i][3] == driven + states.waited[i]


def test_waiting_lasts_as_long_as_the_cell_is_free() -> None:
    """A wall that opens late: the way stands before it, and leaves when it opens."""
    grid = small_grid()
    free = np.full((len(grid.lines), len(grid.half_offsets), 1), ALL)
    wall, opens = 5 * EACH_STATION, 40
    free[wall] = ALL << np.uint64(opens)
    ends = ends_of(grid)
    sweep = Sweep(grid, free, ends, always(grid))
    delay = sweep.first_arrival()
    assert delay is not None
    assert delay >= opens
    states = sweep.trace(delay)
    assert states.waited.sum() > 0
    assert states.delay[5] >= opens
    assert states.speed[np.flatnonzero(states.waited)[0] + 1] == len(grid.speeds) - 1


def test_rounding_of_shifts_does_not_add_up() -> None:
    grid = small_grid(Fineness())
    exact = np.cumsum(grid.durations - np.diff(grid.fastest[::EACH_STATION])[:, None, None], axis=0) / grid.delay_step
    rounded = np.cumsum(grid.shifts.astype(float), axis=0)[1::EACH_STATION]
    cruising = slice(grid.columns // 2, None)  # where the fastest drive has the same speed everywhere
    error = np.diff(rounded[cruising] - exact[cruising], axis=0).cumsum(axis=0)
    few = exact[-1] - exact[grid.columns // 2] < DELAYS
    assert np.abs(error[:, few]).max() <= 1.0 + 1e-9
    assert few.sum() > 5
