"""The border of the ground, as manoeuvres see it."""

from __future__ import annotations

import numpy as np
import pytest
from shapely import box, union_all
from shapely.affinity import rotate, translate
from shapely.geometry import Point

import scp_planner as sp
from scp_planner.mathematics.frames import PlanningFrame
from scp_planner.online.border import Border, CellDistances

ORIGIN, YAW, CELL = (3.0, -2.0), 0.4, 0.1


def made(seed: int) -> sp.OccupancyMap:
    cells = np.zeros((60, 80), dtype=bool)
    for column, row, wide, high in np.random.default_rng(seed).integers(0, [76, 56, 12, 12], (8, 4)):
        cells[row : row + high + 3, column : column + wide + 3] = True
    return sp.OccupancyMap(cells, CELL, ORIGIN, YAW, beyond=False)


@pytest.mark.parametrize("seed", range(4))
def test_distances_are_those_to_the_cells_but_for_a_part_of_one(seed: int) -> None:
    ground, rng = made(seed), np.random.default_rng(seed)
    rows, columns = np.nonzero(ground.occupied)
    local = union_all([box(x, y, x + 1, y + 1) for x, y in zip(columns, rows, strict=True)])
    local = rotate(translate(local, 0, 0), YAW, origin=(0, 0), use_radians=True)
    places = ground.world(rng.uniform([5.0, 5.0], [75.0, 55.0], (300, 2)))
    found = CellDistances.about(ground, ground.world(np.array([40.0, 30.0])), 6.0).at(places)
    for place, away in zip(places, found, strict=True):
        point = Point((place - ORIGIN) / CELL)
        exact = CELL * (local.distance(point) or -local.boundary.distance(point))
        assert away == pytest.approx(exact, abs=0.8 * CELL)
    assert np.mean(np.abs(found)) > CELL


def test_the_border_is_the_nearer_of_workspace_and_cells_for_the_vehicle() -> None:
    cells = np.zeros((40, 40), dtype=bool)
    cells[:, 30:] = True
    ground = sp.OccupancyMap(cells, 0.1)
    scenario = sp.Scenario(
        vehicle={"radius": 0.2, "max_speed": 1.0, "max_acceleration": 1.0, "max_deceleration": 1.0},
        start={"time": 0.0, "position": (1.0, 1.0), "speed": 0.0},
        goal={"position": (2.0, 3.0)},
        bounds={"min": (0.0, 0.0), "max": (4.0, 4.0)},
        ground={"map": ground},
    )
    frame = PlanningFrame.between((1.0, 1.0), (2.0, 3.0), 0.0)
    border = Border.of(scenario, frame, CellDistances.about(ground, np.array([1.0, 1.0]), 4.0))
    room = border.room(frame.to_frame(np.array([[0.5, 2.0], [2.5, 2.0], [2.9, 2.0]])))
    assert border.is_there
    assert room == pytest.approx([0.3, 0.3, -0.1], abs=0.02)
    assert not Border.of(scenario.model_copy(update={"bounds": None}), frame, None).is_there


def test_a_large_window_has_larger_cells_which_are_never_freer() -> None:
    cells = np.zeros((900, 900), dtype=bool)
    cells[::90, ::90] = True
    ground = sp.OccupancyMap(cells, 0.02)
    whole = CellDistances.about(ground, np.array([9.0, 9.0]), 9.0)
    small = CellDistances.about(ground, np.array([9.0, 9.0]), 2.0)
    places = np.random.default_rng(0).uniform(8.0, 10.0, (200, 2))
    assert np.all(whole.at(places) <= small.at(places) + 0.06)
    assert whole.cells.resolution > ground.resolution == small.cells.resolution
