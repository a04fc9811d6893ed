"""Power: the product a v of acceleration and speed, as of a motor: above some speed it can accelerate less."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import ClassVar, Self

import numpy as np

from scp_planner.arrays import Array, Index, joined
from scp_planner.constraints.constraint import Constraint, Limit
from scp_planner.constraints.setup import Setup
from scp_planner.constraints.speed_limits import BESIDE
from scp_planner.trips.space import TimeTable
from scp_planner.trips.trajectory import Trajectory


@dataclass(frozen=True)
class TimedLimit(Limit):
    """A limit that is looked at at fixed normalised times."""

    times: TimeTable

    def also_at(self, sigma: Array) -> Self:
        return replace(self, times=joined([self.times, self.setup.space.time_table(sigma)]))


class Power(TimedLimit):
    """Excess a v / limit - 1: da = C0 dbeta - 2 a rho, dv = tau C1 dbeta - (v - v0) rho."""

    name: ClassVar[str] = "power"
    near: ClassVar[float] = 0.6

    def excess(self, trip: Trajectory) -> Array:
        return self._acceleration(trip) * self._speed(trip) / self.limit - 1.0

    def gradient(self, trip: Trajectory, index: Index) -> Array:
        a, v = self._acceleration(trip)[index], self._speed(trip)[index]
        tau, v0 = trip.travel_time, self.setup.space.start_speed
        beta = v[:, None] * self.times.acceleration[index] + (tau * a)[:, None] * self.times.speed[index]
        return self.setup.of_drive(beta, -2.0 * a * v - a * (v - v0)) / self.limit

    def _acceleration(self, trip: Trajectory) -> Array:
        value: Array = self.times.acceleration @ trip.beta
        return value

    def _speed(self, trip: Trajectory) -> Array:
        value: Array = self.setup.space.start_speed + trip.travel_time * (self.times.speed @ trip.beta)
        return value


def drive_times(setup: Setup, samples: Array) -> TimeTable:
    """Return samples, normalised times (n,), and both sides of the acceleration's breakpoints."""
    breaks = setup.space.acceleration.breakpoints
    return setup.space.time_table(np.concatenate([samples, breaks[:-1] + BESIDE, breaks[1:] - BESIDE]))


def power(setup: Setup) -> Iterator[Constraint]:
    """Make the limit of a vehicle's motor."""
    if setup.vehicle.max_power is not None:
        # With constant accelerations a v is largest next to their breakpoints.
        samples = np.zeros(0) if setup.space.drive.constant else setup.equidistant
        yield Power(setup, setup.vehicle.max_power * setup.kept, drive_times(setup, samples))
