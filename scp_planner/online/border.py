"""Border of the ground as manoeuvres see it: the workspace box and the occupied cells of a map."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from math import ceil

import numpy as np

from scp_planner.arrays import Array
from scp_planner.mathematics.frames import PlanningFrame
from scp_planner.mathematics.occupancy import OccupancyMap, pooled
from scp_planner.scenario.limits import Box
from scp_planner.scenario.models import Scenario


@dataclass(frozen=True)
class CellWindowParameters:
    most_cells: int = 300  # To a side of a window; with more, several are one
    # Of what manoeuvres reach: a window serves until the vehicle has gone farther than the rest
    reaches: float = 1.5


CELL_WINDOW = CellWindowParameters()


@dataclass(frozen=True, eq=False)
class CellDistances:
    """Signed distances from the occupied cells of a map about a place, read off between the centres of cells."""

    ground: OccupancyMap
    cells: OccupancyMap  # of the window
    centre: Array  # (2,) m
    reach: float  # m

    @classmethod
    def about(cls, ground: OccupancyMap, place: Array, reach: float) -> CellDistances:
        """Look at the cells of a map within a reach of a place, (2,) m."""
        half = ceil(reach / ground.resolution) + 1
        middle = np.floor(ground.local(place))
        low = ground.clipped(middle - half)
        window = ground.window(low, ground.clipped(middle + half))
        corner = ground.world(low.astype(float))
        cells = OccupancyMap(window, ground.resolution, (corner[0], corner[1]), ground.yaw, ground.beyond)
        return cls(ground, pooled(cells, ceil(max(window.shape) / CELL_WINDOW.most_cells)), place, reach)

    @cached_property
    def _signed(self) -> Array:
        from scipy.ndimage import distance_transform_edt

        occupied = self.cells.occupied
        if not occupied.any():
            return np.full(occupied.shape, self.reach)
        # From the centre of a cell to the border of the nearest other one.
        outside, inside = distance_transform_edt(~occupied), distance_transform_edt(occupied)
        return np.asarray((outside - inside - 0.5 * np.sign(outside - inside)) * self.cells.resolution)

    def covers(self, ground: OccupancyMap, place: Array, reach: float) -> bool:
        return self.ground is ground and bool(np.hypot(*(place - self.centre)) + reach <= self.reach)

    def at(self, places: Array) -> Array:
        """Distances of places (..., 2), m, in m; of those outside of the window as at its edge."""
        from scipy.ndimage import map_coordinates

        columns, rows = np.moveaxis(self.cells.local(places) - 0.5, -1, 0)
        return map_coordinates(self._signed, [rows, columns], order=1, mode="nearest")


@dataclass(frozen=True)
class Border:
    """Border of the ground in the planning frame of a moment."""

    box: Box
    frame: PlanningFrame
    radius: float  # m, of the vehicle
    cells: CellDistances | None = None

    @classmethod
    def of(cls, scenario: Scenario, frame: PlanningFrame, cells: CellDistances | None) -> Border:
        return cls(Box.of(scenario, frame, 0.0), frame, scenario.vehicle.radius, cells)

    @property
    def is_there(self) -> bool:
        return len(self.box.offsets) > 0 or self.cells is not None

    def room(self, position: Array) -> Array:
        """Distances of the vehicle at positions (..., 2) to the border, m, negative beyond it; inf without any."""
        room = self.box.room(position)
        if self.cells is None:
            return room
        return np.minimum(room, self.cells.at(self.frame.to_world(position)) - self.radius)
