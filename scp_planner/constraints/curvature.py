"""Curvature of the path, at its fixed stations: it peaks at breakpoints of a cubic offset or close to them."""

from __future__ import annotations

from collections.abc import Iterator
from typing import ClassVar

import numpy as np

from scp_planner.arrays import Array
from scp_planner.constraints.constraint import Constraint, TwoSidedLimit
from scp_planner.constraints.setup import Setup
from scp_planner.trips.path import PathBend
from scp_planner.trips.trajectory import Trajectory

OPPOSITE = 0.5  # of a limit; where more is used on one side, no step is expected to reach the other


class Curvature(TwoSidedLimit):
    """Excess |curvature| / limit - 1 at the fixed stations."""

    name: ClassVar[str] = "curvature"
    near: ClassVar[float] = 1.0 + OPPOSITE

    def use(self, trip: Trajectory) -> Array:
        return trip.path.station_bend.curvature / self.limit

    def slopes(self, trip: Trajectory) -> Array:
        tables = self.setup.space.tables
        rows, slopes, bends = tables.station_rows, tables.station_slopes, tables.station_bends
        theta = curvature_gradient(self.setup, trip.path.station_bend, rows, slopes, bends)
        return self.setup.of_path(theta / self.limit)


def curvature_gradient(setup: Setup, bend: PathBend, rows: Array, slopes: Array, bends: Array) -> Array:
    """Gradient of the curvature at fixed stations by the free offsets, (m, free), given their basis (B, B', B'')."""
    length, free = setup.space.length, setup.ends.free
    gradient = (bend.slope / length)[:, None] * slopes[:, free]
    gradient += (bend.bend / length**2)[:, None] * bends[:, free]
    if not setup.space.guide.straight:
        gradient += bend.value[:, None] * rows[:, free]
    return gradient


def curvature(setup: Setup) -> Iterator[Constraint]:
    """Make the limit of a vehicle that cannot turn on the spot."""
    if np.isfinite(setup.limits.curvature):
        yield Curvature(setup, setup.limits.curvature)
