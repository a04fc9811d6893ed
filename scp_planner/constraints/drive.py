from __future__ import annotations

from collections.abc import Iterator
from typing import ClassVar

import numpy as np

from scp_planner.arrays import Array, Index
from scp_planner.constraints.constraint import Constraint, Limit
from scp_planner.constraints.setup import Setup
from scp_planner.trips.trajectory import Trajectory

STANDS = 2e-6  # m/s, less than a stop at the goal: who waits moves on so slowly, lest rounding lead to speeds below 0


class DriveRows:
    """Arrival, speed and acceleration rows: linear in (b, tau), made once and scaled at each iterate."""

    def __init__(self, setup: Setup) -> None:
        space, limits = setup.space, setup.limits
        self.setup = setup
        self.theta_size = setup.free_size
        count = space.acceleration_size
        self.equalities = 1
        speeds = space.drive.speed_control[1:]
        self._moves = moves = np.flatnonzero(np.abs(speeds).sum(axis=1) > 0)
        self._speeds = speeds[moves]
        # Speeds that are fixed at 0, as at a start from rest, stay as they are
        free = (self._speeds @ setup.highest_accelerations > 0.0) | (space.start_speed > 0.0)
        self._still = np.where(free, STANDS, 0.0)
        eye = np.eye(count)
        self._beta = slice(self.theta_size, self.theta_size + count)
        first = self.equalities
        self._upper = slice(first, first + len(moves))
        self._lower = slice(self._upper.stop, self._upper.stop + len(moves))
        self._up = slice(self._lower.stop, self._lower.stop + count)
        self._down = slice(self._up.stop, self._up.stop + count)
        # What is the same at every iterate
        self._fixed = np.zeros((self._down.stop, setup.step_size))
        self._fixed[self._upper, -1] = space.start_speed - limits.speed
        self._fixed[self._lower, -1] = -space.start_speed
        self._fixed[self._up, self._beta] = eye
        self._fixed[self._up, -1] = -2.0 * setup.highest_accelerations
        self._fixed[self._down, self._beta] = -eye
        self._fixed[self._down, -1] = 2.0 * setup.lowest_accelerations
        self.count, self.width = self._fixed.shape

    def _highest(self, tau: float) -> Array:
        return self.setup.highest_speeds(self.setup.limits.speed, tau)[self._moves]

    def matrix(self, trip: Trajectory) -> Array:
        """Return the rows of the step from a trip, (count, width): the first ``equalities`` hold with equality."""
        setup, tau, matrix = self.setup, trip.travel_time, self._fixed.copy()
        # Arrival: v0 tau + C2(1) b = L(theta)
        matrix[0, : self.theta_size] = -trip.path.final_gradient[setup.ends.free]
        matrix[0, self._beta] = tau * tau * setup.space.drive.final_distance
        matrix[0, -1] = setup.space.start_speed * tau
        np.multiply(self._speeds, tau, out=matrix[self._upper, self._beta])
        matrix[self._upper, -1] = setup.space.start_speed - self._highest(tau)
        np.multiply(self._speeds, -tau, out=matrix[self._lower, self._beta])
        return matrix

    def bounds(self, trip: Trajectory) -> Array:
        """Return the bounds of the rows, (count,): m for the arrival, then m/s of speeds, m/s^2 of accelerations."""
        setup = self.setup
        v0 = setup.space.start_speed
        tau, beta, path = trip.travel_time, trip.beta, trip.path
        bound = np.empty(self.count)
        bound[0] = path.arc_length - v0 * tau - tau * tau * float(setup.space.drive.final_distance @ beta)
        speeds = v0 + tau * (self._speeds @ beta)
        bound[self._upper] = self._highest(tau) - speeds
        bound[self._lower] = speeds - self._still
        bound[self._up] = setup.highest_accelerations - beta
        bound[self._down] = beta - setup.lowest_accelerations
        return bound

    def excess(self, trip: Trajectory) -> float:
        """Largest excess over the bounds of speed (m/s) and acceleration (m/s^2), 0 where there is none."""
        return max(0.0, -float(self.bounds(trip)[self.equalities :].min()))

    def timing_curvature(self, prices: Array) -> float:
        """Second derivative of the bounds b_k <= a tau^2 with respect to rho, times the multipliers of all rows."""
        up, down = prices[self._up], prices[self._down]
        return float(2.0 * (down @ self.setup.lowest_accelerations - up @ self.setup.highest_accelerations))


class TopSpeed(Limit):
    """Excess v / limit - 1 at the control points of the speed after the first; no rows, as `DriveRows` has them."""

    name: ClassVar[str] = "speed"
    near: ClassVar[float] = -np.inf

    def excess(self, trip: Trajectory) -> Array:
        return trip.speed_control_points()[1:] / self.setup.highest_speeds(self.limit, trip.travel_time) - 1.0

    def gradient(self, trip: Trajectory, index: Index) -> Array:
        limits = self.setup.highest_speeds(self.limit, trip.travel_time)[index]
        return _speed_gradient(self.setup, trip, index) / limits[:, None]


class Forwards(Constraint):
    """Excess -v / top speed at the control points of the speed after the first."""

    name: ClassVar[str] = "reverse"
    near: ClassVar[float] = -np.inf

    def excess(self, trip: Trajectory) -> Array:
        return -trip.speed_control_points()[1:] / self.setup.limits.speed

    def gradient(self, trip: Trajectory, index: Index) -> Array:
        return _speed_gradient(self.setup, trip, index) / -self.setup.limits.speed


class AccelerationBounds(Constraint):
    """Excess a / limit - 1, then -a / limit - 1 with that of the deceleration, at the control points."""

    name: ClassVar[str] = "acceleration"
    near: ClassVar[float] = -np.inf

    def excess(self, trip: Trajectory) -> Array:
        limits, beta = self.setup.limits, trip.beta
        return np.concatenate([beta / limits.acceleration, -beta / limits.deceleration]) - 1.0

    def gradient(self, trip: Trajectory, index: Index) -> Array:
        limits, count = self.setup.limits, len(trip.beta)
        scale = np.where(index < count, 1.0 / limits.acceleration, -1.0 / limits.deceleration)
        found = self.setup.of_drive(np.eye(count)[index % count], -2.0 * trip.beta[index % count])
        return scale[:, None] * found


class OffsetBounds(Constraint):
    """Free control points of the offset beyond their bounds, m: over a bent guide they keep the path from folding."""

    name: ClassVar[str] = "offset"
    near: ClassVar[float] = -np.inf

    def excess(self, trip: Trajectory) -> Array:
        ends = self.setup.ends
        theta = trip.theta[ends.free]
        return np.concatenate([theta - ends.upper[ends.free], ends.lower[ends.free] - theta])

    def gradient(self, trip: Trajectory, index: Index) -> Array:
        del trip  # they are linear
        side, place = np.divmod(index, self.setup.free_size)
        return self.setup.of_path(np.where(side, -1.0, 1.0)[:, None] * np.eye(self.setup.free_size)[place])


def _speed_gradient(setup: Setup, trip: Trajectory, index: Index) -> Array:
    """Gradient of the control points of the speed after the first: dv = tau C1 d beta - (v - v0) rho."""
    rows = setup.space.drive.speed_control[1:][index]
    rise = trip.travel_time * (rows @ trip.beta)
    return setup.of_drive(trip.travel_time * rows, -rise)


def top_speed(setup: Setup) -> Iterator[Constraint]:
    """Make the limit of the speed."""
    yield TopSpeed(setup, setup.limits.speed)


def kept_by_every_step(setup: Setup) -> tuple[Constraint, ...]:
    """Return what the rows and bounds of a step keep and the merit does not price."""
    return Forwards(setup), AccelerationBounds(setup), OffsetBounds(setup)
