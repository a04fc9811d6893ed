"""Jerk: with b = tau^2 beta the control points of da/dt are R b / tau^3, R those of the derivative of a spline."""

from __future__ import annotations

from collections.abc import Iterator
from typing import ClassVar

import numpy as np

from scp_planner.arrays import Array
from scp_planner.constraints.constraint import Constraint, TwoSidedLimit
from scp_planner.constraints.setup import Setup
from scp_planner.mathematics.splines import clamped_knots
from scp_planner.trips.space import TripSpace
from scp_planner.trips.trajectory import Trajectory


class Jerk(TwoSidedLimit):
    """Excess |da/dt| / limit - 1 at the control points of the jerk, which bound it at all times by convexity."""

    name: ClassVar[str] = "jerk"

    def use(self, trip: Trajectory) -> Array:
        return (jerk_matrix(self.setup.space) @ trip.beta) / (self.limit * trip.travel_time)

    def slopes(self, trip: Trajectory) -> Array:
        rows = jerk_matrix(self.setup.space) / (self.limit * trip.travel_time)
        return self.setup.of_drive(rows, -3.0 * self.use(trip))

    def tightened(self, more: float) -> Jerk:
        del more  # nothing is missed between control points
        return self


def jerk_matrix(space: TripSpace) -> Array:
    """Control points of the acceleration's derivative in normalised time from those of the acceleration."""
    degree = space.acceleration.coefficients.shape[1] - 1
    knots = clamped_knots(degree, space.acceleration.breakpoints)
    count = space.acceleration_size - 1
    weights = degree / (knots[degree + 1 : degree + 1 + count] - knots[1 : 1 + count])
    return weights[:, None] * (np.eye(count, count + 1, 1) - np.eye(count, count + 1))


def jerk(setup: Setup) -> Iterator[Constraint]:
    """Make the limit of a vehicle's jerk."""
    if setup.vehicle.max_jerk is not None:
        yield Jerk(setup, setup.vehicle.max_jerk * setup.kept)
