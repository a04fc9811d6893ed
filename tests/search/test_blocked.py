"""Blocked cells against zones looked at one cell at a time."""

from __future__ import annotations

import numpy as np
import pytest
from scenes import CROSSERS, disc, scene

from scp_planner.problem.build import build_problem
from scp_planner.problem.problem import Problem
from scp_planner.scenario.models import Scenario
from scp_planner.search.blocked import Cells
from scp_planner.search.grid import DELAYS, Fineness, Grid
from scp_planner.search.ways import WaySearch
from scp_planner.settings.planning import Settings
from scp_planner.threat_zones.of_scenario import zones

WALL = {
    "id": "wall",
    "shape": {"polygon": [[-0.3, -3.0], [0.3, -3.0], [0.3, 1.0], [-0.3, 1.0]]},
    "motion": {"position": (12.0, 0.0), "velocity": (0.0, 0.0)},
}


def problem_of(scenario: Scenario) -> Problem:
    return build_problem(scenario, zones(scenario), Settings())


def depths(problem: Problem, grid: Grid, delay: int) -> np.ndarray:
    """Least distance of each cell to the zones at one delay, (lines, half offsets)."""
    frame = problem.space.guide.frame(grid.lines)
    found = np.empty((len(grid.lines), len(grid.half_offsets)))
    for line in range(len(grid.lines)):
        points = frame.position[line] + grid.half_offsets[:, None] * frame.normal[line]
        times = np.full(len(points), grid.fastest[line] + delay * grid.delay_step)
        found[line] = problem.zones.distances(times, points).min(axis=1)
    return found


@pytest.mark.parametrize(
    "scenario",
    [
        scene(*CROSSERS),
        scene(*CROSSERS, WALL),
        scene(*CROSSERS, WALL, guide=[[0.0, 0.0], [9.0, 2.0], [20.0, 0.0]]),
        scene(disc("along", (3.0, 0.5), (2.0, 0.0)), disc("still", (9.0, -0.5))),
    ],
)
def test_cells_are_blocked_where_zones_are(scenario: Scenario) -> None:
    problem = problem_of(scenario)
    grid = Grid.of(problem, Fineness())
    cells = Cells(problem, grid)
    outside = ~np.any(cells.free != 0, axis=0)
    assert not outside.all()
    blocked_cells = 0
    for delay in range(0, DELAYS, 9):
        free = (cells.free >> np.uint64(delay) & np.uint64(1)).astype(bool)
        depth = depths(problem, grid, delay)
        inside_guide = np.abs(grid.half_offsets) < 1.5
        # A line across a disc at its rim is cut by less than the shrinking; polygons are cut from both sides.
        deep = (depth < -2.5 * grid.shrunk) & inside_guide
        assert not free[deep].any()
        assert free[(depth > 1e-9) & inside_guide].mean() > 0.995
        blocked_cells += int(deep.sum())
    assert blocked_cells > 20


def test_closed_sides_shut_all_beyond() -> None:
    problem = problem_of(scene(*CROSSERS))
    grid = Grid.of(problem, Fineness())
    cells = Cells(problem, grid)
    one = Cells(problem.among(problem.zones.subset(np.array([1]))), grid)
    for side in (1, -1):
        closed = cells.without(((1, side),))
        blocked = ~one.free
        assert np.any(blocked)
        for line in np.flatnonzero(np.any(blocked != 0, axis=1))[::3]:
            for delay in range(0, DELAYS, 13):
                hit = np.flatnonzero(blocked[line] >> np.uint64(delay) & np.uint64(1))
                if len(hit):
                    beyond = slice(hit[0], None) if side > 0 else slice(None, hit[-1] + 1)
                    assert not np.any(closed[line, beyond] >> np.uint64(delay) & np.uint64(1))
        assert np.all((closed & ~cells.free) == 0)
        assert cells.without(((1, 1), (1, -1)))[0].any(), "far from the obstacle all stays open"


def wall(x: float, low: float, high: float, half: float = 1.0) -> list[list[float]]:
    return [[x - half, low], [x + half, low], [x + half, high], [x - half, high]]


def test_sides_are_shut_where_walls_leave_nothing_free_and_no_way_leads_there() -> None:
    """A street with a block in the middle: what overlaps in its wall above does not reach beyond the grid by itself."""
    above = [wall(10.0, 1.5, 4.0, 9.0), wall(10.0, 3.5, 30.0, 9.0)]
    scenario = scene(walls=[*above, wall(10.0, -30.0, -1.5, 9.0), wall(12.0, -0.2, 0.2)])
    search = WaySearch(problem_of(scenario))
    assert search.best() is not None
    shut = {(zone, side) for zone in range(4) for side in (1, -1) if search.cells.shut([(zone, side)])}
    # The walls themselves are passed on one side alone, the block on both.
    assert shut == {(0, -1), (1, -1), (2, 1)}
    assert search.cells.shut([(3, 1), (0, -1)])
    for zone in range(4):
        for side in (1, -1):
            beyond = search.best(((zone, side),))
            assert (beyond is None) == ((zone, side) in shut)


def test_the_workspace_is_kept() -> None:
    problem = problem_of(scene(*CROSSERS, bounds={"min": [-1.0, -1.5], "max": [21.0, 2.5]}))
    grid = Grid.of(problem, Fineness())
    free = Cells(problem, grid).free
    assert not free[:, grid.half_offsets > 2.5].any()
    assert not free[:, grid.half_offsets < -1.5].any()
    assert free[:, np.abs(grid.half_offsets) < 0.5].any()
