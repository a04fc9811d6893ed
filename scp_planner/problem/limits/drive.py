"""What a drive may ask of tyres and motor: optional limits of the vehicle.

Total acceleration. Along the path a, across it v^2 k with the curvature k: a^2 + (v^2 k)^2 is limited, as by friction.

Power. The product a v of acceleration and speed is limited, as by a motor: above some speed it can accelerate less.

Both are looked at at fixed normalised times, before and after each jump of the acceleration. With b = tau^2 beta, there

    da = C0 dbeta - 2 a rho,        dv = tau C1 dbeta - (v - v0) rho,
    d(v^2 k) = 2 v k dv + v^2 (dk at the station + k' (dD - dS) / |r'|).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import ClassVar, Self

import numpy as np

from scp_planner.arrays import Array, Index
from scp_planner.problem.limits.inputs import LimitInputs
from scp_planner.problem.limits.limit import OptionalLimit
from scp_planner.problem.limits.speed import BESIDE
from scp_planner.trips.space import TimeTable, TripSpace
from scp_planner.trips.trajectory import Trajectory, TripPoints

BESIDE_DIRECTION = (0.0, -0.6, -0.3, 0.3, 0.6)
"""rad; a step turns accelerations, from along to across, which a single tangent does not see."""

SLIGHT = 1e-9  # of the limit; below that the root has no derivative worth the name


def drive_times(space: TripSpace, samples: Array) -> TimeTable:
    """Return the times at which drives are looked at: samples (n,), and both sides of the acceleration's breakpoints.

    Parameters
    ----------
    space : TripSpace
    samples : (n,) array
        Normalised times.

    Returns
    -------
    TimeTable
    """
    breaks = space.acceleration.breakpoints
    beside = np.concatenate([breaks[:-1] + BESIDE, breaks[1:] - BESIDE])
    return space.time_table(np.concatenate([samples, beside]))


@dataclass(frozen=True)
class _DriveLimit(OptionalLimit):
    """An upper limit of something, at given times."""

    limit: float
    times: TimeTable
    space: TripSpace

    def tightened(self, more: float) -> Self:
        """Return a lower limit."""
        return replace(self, limit=self.limit * (1.0 - more))

    def also_at(self, sigma: Array) -> Self:
        """Return the limit at further times as well."""
        return replace(self, times=TimeTable.joined([self.times, self.space.time_table(sigma)]))


@dataclass(frozen=True)
class PowerLimit(_DriveLimit):
    """Excess a v / limit - 1 at given times.

    Attributes
    ----------
    limit : float
        m^2/s^3.
    times : TimeTable
    space : TripSpace
    free_size : int
        Number of free control points of the offset.
    """

    name: ClassVar[str] = "power"
    near: ClassVar[float] = 0.6

    free_size: int

    def excess(self, trajectory: Trajectory) -> Array:
        """Return a v / limit - 1."""
        return self._acceleration(trajectory) * self._speed(trajectory) / self.limit - 1.0

    def gradient(self, trajectory: Trajectory, index: Index) -> Array:
        """Return the gradient of a v / limit."""
        a, v = self._acceleration(trajectory)[index], self._speed(trajectory)[index]
        tau, v0 = trajectory.travel_time, self.space.start_speed
        beta = v[:, None] * self.times.acceleration[index] + (tau * a)[:, None] * self.times.speed[index]
        rho = -2.0 * a * v - a * (v - v0)
        return np.concatenate([np.zeros((len(index), self.free_size)), beta, rho[:, None]], axis=1) / self.limit

    def _acceleration(self, trajectory: Trajectory) -> Array:
        value: Array = self.times.acceleration @ trajectory.beta
        return value

    def _speed(self, trajectory: Trajectory) -> Array:
        value: Array = self.space.start_speed + trajectory.travel_time * (self.times.speed @ trajectory.beta)
        return value


@dataclass(frozen=True)
class TotalAccelerationLimit(_DriveLimit):
    """Excess sqrt(a^2 + (v^2 k)^2) / limit - 1 at given times.

    Attributes
    ----------
    limit : float
        m/s^2.
    times : TimeTable
    space : TripSpace
    free : slice
        The free control points of the offset.
    beside : tuple of float
        rad; tangents to the circle of accelerations, by how far they are beside the one in its direction.
    """

    name: ClassVar[str] = "total_acceleration"
    near: ClassVar[float] = 0.6

    free: slice
    beside: tuple[float, ...] = (0.0,)

    def excess(self, trajectory: Trajectory) -> Array:
        """Return sqrt(a^2 + (v^2 k)^2) / limit - 1, and its parts in directions beside that, which are less."""
        points = trajectory.kept_at(self.times)
        lateral = points.speed**2 * trajectory.path.bend(points.path).curvature
        total = np.hypot(points.acceleration, lateral) / self.limit
        return np.concatenate([total * np.cos(turn) for turn in self.beside]) - 1.0

    def gradient(self, trajectory: Trajectory, index: Index) -> Array:
        """Return the gradients of the parts, their directions fixed, at fixed normalised times."""
        direction, place = np.divmod(index, len(self.times.sigma))
        turn = np.array(self.beside)[direction]
        points = trajectory.kept_at(self.times).take(place)
        a, v = points.acceleration, points.speed
        lateral = v * v * trajectory.path.bend(points.path).curvature
        total = np.maximum(np.hypot(a, lateral), SLIGHT * self.limit)
        along = a * np.cos(turn) - lateral * np.sin(turn)
        across = lateral * np.cos(turn) + a * np.sin(turn)
        gradient = self._lateral_gradient(trajectory, points)
        gradient *= (across / total)[:, None]
        count = self.free.stop - self.free.start
        gradient[:, count:-1] += (along / total)[:, None] * points.table.acceleration
        gradient[:, -1] -= 2.0 * a * along / total
        gradient /= self.limit
        return gradient

    def _lateral_gradient(self, trajectory: Trajectory, points: TripPoints) -> Array:
        """Gradient of v^2 k with respect to a step at fixed normalised times, (m, step) m/s^2."""
        path, place, table = trajectory.path, points.path, points.table
        basis, length, v, tau = self.space.path, self.space.length, points.speed, trajectory.travel_time
        bend = path.bend(place)
        theta = (bend.slope / length)[:, None] * basis.derivative.rows_at(place.span, place.local)
        theta += (bend.bend / length**2)[:, None] * basis.derivative.derivative.rows_at(place.span, place.local)
        theta += np.broadcast_to(bend.value, v.shape)[:, None] * basis.rows_at(place.span, place.local)
        theta *= (v * v)[:, None]
        driven = v * v * path.curvature_rate(place) / place.speed
        theta -= driven[:, None] * path.arc_length_gradient(points.parameter)
        faster = 2.0 * v * bend.curvature
        beta = (tau * faster)[:, None] * table.speed + (tau * tau * driven)[:, None] * table.distance
        v0 = self.space.start_speed
        rho = driven * (v0 * tau) * table.sigma - faster * (v - v0)
        return np.concatenate([theta[:, self.free], beta, rho[:, None]], axis=1)


def power_limit(inputs: LimitInputs) -> Iterator[OptionalLimit]:
    """Make the limit of a vehicle's motor."""
    limit, space = inputs.vehicle.max_power, inputs.space
    if limit is not None:
        # With constant accelerations a v is largest next to their breakpoints.
        times = drive_times(space, np.zeros(0) if space.tables.constant else inputs.equidistant)
        yield PowerLimit(limit * inputs.kept, times, space, inputs.free_size)


def total_acceleration_limit(inputs: LimitInputs) -> Iterator[OptionalLimit]:
    """Make the limit of a vehicle's tyres."""
    limit, space = inputs.vehicle.max_total_acceleration, inputs.space
    if limit is not None:
        times = drive_times(space, inputs.equidistant)
        # What is steered at a limited rate turns its acceleration slowly: one tangent does, and steps are cheaper.
        beside = BESIDE_DIRECTION if inputs.vehicle.max_curvature_rate is None else (0.0,)
        yield TotalAccelerationLimit(limit * inputs.kept, times, space, inputs.free, beside)
