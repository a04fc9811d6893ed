"""Total acceleration: along the path a, across it v^2 k; a^2 + (v^2 k)^2 is limited, as by friction."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from scp_planner.arrays import Array, Index
from scp_planner.constraints.constraint import Constraint
from scp_planner.constraints.lateral import gradient_at_times
from scp_planner.constraints.power import TimedLimit, drive_times
from scp_planner.constraints.setup import Setup
from scp_planner.trips.trajectory import Trajectory

BESIDE_DIRECTION = (0.0, -0.6, -0.3, 0.3, 0.6)
"""rad; a step turns accelerations, from along to across, which a single tangent does not see."""

SLIGHT = 1e-9  # of the limit; below that the root has no derivative worth the name


@dataclass(frozen=True)
class TotalAcceleration(TimedLimit):
    """Excess sqrt(a^2 + (v^2 k)^2) / limit - 1, and its parts in directions so many rad beside that."""

    name: ClassVar[str] = "total_acceleration"
    near: ClassVar[float] = 0.6

    beside: tuple[float, ...]

    def excess(self, trip: Trajectory) -> Array:
        points = trip.kept_at(self.times)
        lateral = points.speed**2 * trip.path.bend(points.path).curvature
        total = np.hypot(points.acceleration, lateral) / self.limit
        return np.concatenate([total * np.cos(turn) for turn in self.beside]) - 1.0

    def gradient(self, trip: Trajectory, index: Index) -> Array:
        direction, place = np.divmod(index, len(self.times.sigma))
        turn = np.array(self.beside)[direction]
        points = trip.kept_at(self.times).take(place)
        bend, a = trip.path.bend(points.path), points.acceleration
        lateral = points.speed * points.speed * bend.curvature
        total = np.maximum(np.hypot(a, lateral), SLIGHT * self.limit)
        along = a * np.cos(turn) - lateral * np.sin(turn)
        across = lateral * np.cos(turn) + a * np.sin(turn)
        gradient = gradient_at_times(self.setup, trip, points, bend)
        gradient *= (across / total)[:, None]
        gradient[:, self.setup.free_size : -1] += (along / total)[:, None] * points.table.acceleration
        gradient[:, -1] -= 2.0 * a * along / total
        gradient /= self.limit
        return gradient


def total_acceleration(setup: Setup) -> Iterator[Constraint]:
    """Make the limit of a vehicle's tyres."""
    limit = setup.vehicle.max_total_acceleration
    if limit is not None:
        # What is steered at a limited rate turns its acceleration slowly: one tangent does, and steps are cheaper.
        beside = BESIDE_DIRECTION if setup.vehicle.max_curvature_rate is None else (0.0,)
        yield TotalAcceleration(setup, limit * setup.kept, drive_times(setup, setup.equidistant), beside)
