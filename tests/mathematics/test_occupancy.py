"""Maps of cells, against a look at every cell."""

from __future__ import annotations

import numpy as np
import pytest
from memory import MEGABYTE, traced

from scp_planner.mathematics.occupancy import OccupancyMap

FAR = np.stack(np.meshgrid(np.arange(-15, 20), np.arange(-15, 20)), axis=-1)
"""Cells of a grid and far around it, column and row."""


@pytest.mark.parametrize("beyond", [False, True])
def test_the_distance_is_that_of_the_nearest_occupied_cell(beyond: bool) -> None:
    rng = np.random.default_rng(5)
    for _ in range(200):
        cells = rng.random(rng.integers(1, 7, 2)) < 0.2
        ground = OccupancyMap(cells, float(rng.choice([0.1, 3.0])), (1.0, -2.0), float(rng.uniform(-3.0, 3.0)), beyond)
        place = rng.uniform(-4.0, 10.0, 2)
        x, y = (ground.world(place) - 1e-12).tolist()
        away = np.maximum(np.maximum(FAR - place, place - FAR - 1.0), 0.0)[ground.at(FAR)]
        nearest = ground.resolution * float(np.hypot(*away.T).min(initial=np.inf))
        within = ground.resolution * float(rng.choice([0.5, 2.0, 50.0]))
        found = ground.distance((x, y), within)
        assert found == pytest.approx(nearest, abs=1e-9) or min(found, nearest) > within


def test_a_distance_of_many_cells_takes_the_memory_of_the_map_alone() -> None:
    ground = OccupancyMap(np.eye(50, dtype=bool), 1e-7)
    distance, taken = traced(lambda: ground.distance((1e-6, 2e-6), 0.3))
    assert distance == pytest.approx(1e-7 * np.hypot(4.0, 5.0)) and taken < MEGABYTE
