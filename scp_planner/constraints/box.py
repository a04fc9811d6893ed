"""The workspace box: the vehicle's discs stay inside, at the fixed stations of the path."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import ClassVar, Self

import numpy as np

from scp_planner.arrays import Array, Index
from scp_planner.constraints.constraint import Constraint
from scp_planner.constraints.setup import Setup
from scp_planner.constraints.swing import Swing, disc_positions
from scp_planner.scenario.limits import Box
from scp_planner.threat_zones.nearness import NEARNESS
from scp_planner.trips.trajectory import Trajectory


@dataclass(frozen=True)
class InBox(Constraint):
    name: ClassVar[str] = "workspace bounds"
    near: ClassVar[float] = NEARNESS.near

    box: Box

    def tightened(self, more: float) -> Self:
        return replace(self, box=replace(self.box, offsets=self.box.offsets - more)) if more else self

    def excess(self, trip: Trajectory) -> Array:
        return (trip.path.station_positions @ self.box.normals.T - self.box.offsets).ravel()

    def gradient(self, trip: Trajectory, index: Index) -> Array:
        station, side = np.divmod(index, len(self.box.offsets))
        return self.setup.of_path(self._rows(trip, station, self.box.normals[side])[:, self.setup.ends.free])

    def _rows(self, trip: Trajectory, station: Index, normal: Array) -> Array:
        del trip
        frame = self.setup.space.station_frame
        across = np.array([[0.0, 1.0]]) if frame is None else frame.normal[station]
        outward = np.einsum("ij,ij->i", np.broadcast_to(across, normal.shape), normal)
        rows: Array = outward[:, None] * self.setup.space.tables.station_rows[station]
        return rows


@dataclass(frozen=True)
class DiscInBox(InBox):
    ahead: float

    def excess(self, trip: Trajectory) -> Array:
        points = trip.path.points(self.setup.space.tables.station_parameters)
        return (disc_positions(points, self.ahead) @ self.box.normals.T - self.box.offsets).ravel()

    def _rows(self, trip: Trajectory, station: Index, normal: Array) -> Array:
        points = trip.path.points(self.setup.space.tables.station_parameters[station])
        return Swing.of(points).rows(trip.path, points, normal, self.ahead)


def workspace(setup: Setup) -> Iterator[Constraint]:
    """Make the constraints of a workspace box, if there is one."""
    if len(setup.box.offsets):
        yield InBox(setup, setup.box)
