"""The trip: two splines and one number, and everything that follows from them in closed form."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from math import isclose
from typing import Self

import numpy as np

from scp_planner.arrays import Array, Index, rows_of
from scp_planner.mathematics.polynomials import horner
from scp_planner.mathematics.splines import evaluate
from scp_planner.trips.path import Path, PathPoints
from scp_planner.trips.space import TimeTable, TripSpace
from scp_planner.trips.tolerances import SAME_TIME, STILL


@dataclass(frozen=True)
class ArrivalEffort:
    """Most work that is done to find when a trip arrives."""

    max_bisections: int = 60
    most_stretches: int = 8  # of accelerations with which a trip does not arrive


EFFORT = ArrivalEffort()


@dataclass(frozen=True)
class TripPoints:
    """A trip at n times."""

    table: TimeTable
    time: Array  # (n,) Seconds after the start
    distance: Array  # (n,) D in m, v in m/s and a in m/s^2, along the path
    speed: Array  # (n,) D in m, v in m/s and a in m/s^2, along the path
    acceleration: Array  # (n,) D in m, v in m/s and a in m/s^2, along the path
    parameter: Array  # (n,) Normalised station s / length
    path: PathPoints  # The path there

    def take(self, index: Index | slice) -> TripPoints:
        """Return some of the points."""
        return rows_of(self, index)


@dataclass(frozen=True)
class Arrivals:
    """Arrivals of a vehicle at places: normalised times (n,) and speeds (n,) in m/s."""

    sigma: Array
    speed: Array


@dataclass(frozen=True)
class DriveSamples:
    """A motion along a path at n times."""

    distance: Array  # (n,) m, m/s and m/s^2
    speed: Array  # (n,) m, m/s and m/s^2
    acceleration: Array  # (n,) m, m/s and m/s^2
    span: Index  # (n,)


class Trajectory:
    """A path and the motion along it."""

    def __init__(self, path: Path, beta: Array, travel_time: float) -> None:
        self.path = path
        self.beta = beta
        self.travel_time = travel_time
        self._kept: dict[int, TripPoints] = {}

    @classmethod
    def of(cls, space: TripSpace, theta: Array, beta: Array, near: float = 0.0) -> Self:
        """Return the trip with these control points, its travel time from the closed form."""
        path = Path(space, theta)
        return cls(path, np.asarray(beta, dtype=float), space.travel_time(path.arc_length, beta, near))

    @property
    def theta(self) -> Array:
        """Control points of the offset, (K1,) m."""
        return self.path.theta

    @property
    def space(self) -> TripSpace:
        """The space that the trip is of."""
        return self.path.space

    def in_units(self, length: float, time: float) -> Trajectory:
        """Return the trip where lengths are so many times as large, and times too."""
        path = Path(self.space.in_units(length, time), self.theta * length)
        beta, travel_time = self.beta * (length / (time * time)), self.travel_time * time
        moved = Trajectory(path, beta, travel_time)
        # To the bit what the closed form gives, if it is that: a stop on the way takes another time.
        return Trajectory(path, beta, moved.closed_time) if moved.arrives else moved

    @property
    def closed_time(self) -> float:
        """Travel time by the closed form from the arc length that is driven, s."""
        return self.space.travel_time(self.path.driven_length, self.beta, self.travel_time)

    @property
    def arrives(self) -> bool:
        """True if the trip takes the time of the closed form: a stop on the way takes another."""
        return isclose(self.closed_time, self.travel_time, rel_tol=SAME_TIME)

    def settled(self) -> Trajectory:
        """Return a trip to the end of its path with the travel time of the arc length that is driven."""
        path = self.path
        closed = self.travel_time if path.driven_length == path.arc_length else self.closed_time
        return self if closed == self.travel_time or not np.isfinite(closed) else Trajectory(path, self.beta, closed)

    @property
    def final_speed(self) -> float:
        """Speed on arrival, m/s."""
        return self.space.start_speed + self.travel_time * float(self.space.drive.final_speed @ self.beta)

    def speed_control_points(self) -> Array:
        """Control points of the speed, (K2 + 1,) m/s: its bounds for all times."""
        return self.space.start_speed + self.travel_time * (self.space.drive.speed_control @ self.beta)

    @cached_property
    def _distance(self) -> Array:
        """Local power coefficients of the distance as a function of normalised time, without v0 tau sigma."""
        basis = self.space.acceleration.antiderivative.antiderivative
        return basis.combine(self.travel_time**2 * self.beta)

    @cached_property
    def _speed(self) -> Array:
        """Local power coefficients of the speed less v0."""
        return self.space.acceleration.antiderivative.combine(self.travel_time * self.beta)

    def speed_at(self, sigma: Array) -> Array:
        """Speed at normalised times, (n,), in m/s."""
        span, x = self.space.acceleration.locate(sigma)
        return self.space.start_speed + evaluate(self._speed, span, x)

    def arrivals(self, distance: Array) -> Arrivals:
        """Normalised times and speeds at driven distances, (n,) m; one of the times where it stands."""
        tau, v0, tables = self.travel_time, self.space.start_speed, self.space.drive
        breaks = tables.breaks
        driven = (v0 * tau) * breaks.sigma + (tau * tau) * (breaks.distance @ self.beta)
        span = driven[1:-1].searchsorted(distance, "right")
        speeds = np.maximum(v0 + tau * (breaks.speed @ self.beta), 0.0)
        start, target = speeds[span], np.maximum(distance - driven[span], 0.0)
        if tables.constant:
            # D = v t + a t^2 / 2 from the span's start, in the form that loses no digits
            speed = np.sqrt(np.maximum(start * start + 2.0 * self.beta[span] * target, 0.0))
            elapsed = 2.0 * target / np.maximum(start + speed, STILL)
            sigma = breaks.sigma[span] + elapsed / tau
            return Arrivals(np.minimum(sigma, breaks.sigma[span + 1]), speed)
        sigma = self._bisected(distance, span)
        return Arrivals(sigma, self.speed_at(sigma))

    def _bisected(self, distance: Array, span: Index) -> Array:
        """Normalised times in given spans of the acceleration at which given distances have been driven."""
        tau, v0 = self.travel_time, self.space.start_speed
        base, width = self.space.acceleration.breakpoints[span], self.space.acceleration.widths[span]
        local, slope = self._distance[span].T, self._speed[span].T
        low, high = np.zeros_like(distance), np.ones_like(distance)
        x = np.full_like(distance, 0.5)
        for _ in range(EFFORT.max_bisections):
            excess = horner(local, x) + (v0 * tau) * (base + width * x) - distance
            if np.all(np.abs(excess) <= 1e-13 * self.path.arc_length):
                break
            low, high = np.where(excess <= 0.0, x, low), np.where(excess >= 0.0, x, high)
            rate = (tau * width) * (horner(slope, x) + v0)
            newton = x - excess / np.where(rate > 0.0, rate, np.inf)
            x = np.where((newton > low) & (newton < high), newton, 0.5 * (low + high))
        return base + width * x

    @cached_property
    def _acceleration(self) -> Array:
        """Local power coefficients of the acceleration."""
        return self.space.acceleration.combine(self.beta)

    def distance_at(self, sigma: Array) -> Array:
        """Distance driven up to normalised times, (n,), in m."""
        span, x = self.space.acceleration.locate(sigma)
        driven: Array = evaluate(self._distance, span, x) + (self.space.start_speed * self.travel_time) * sigma
        return driven

    @cached_property
    def top_speed(self) -> float:
        """Bound of the speed at all times, m/s."""
        return float(self.speed_control_points().max())

    @cached_property
    def driven_length(self) -> float:
        """Distance that is driven in all, m: less than the path is long if the trip stops on its way."""
        return float(self.distance_at(np.ones(1))[0])

    def drive_at(self, sigma: Array) -> DriveSamples:
        """Return the motion along the path at normalised times, (n,); as in :meth:`at`, but without a table."""
        span, x = self.space.acceleration.locate(sigma)
        return DriveSamples(
            evaluate(self._distance, span, x) + (self.space.start_speed * self.travel_time) * sigma,
            evaluate(self._speed, span, x) + self.space.start_speed,
            evaluate(self._acceleration, span, x),
            span,
        )

    def at(self, table: TimeTable) -> TripPoints:
        """Return the trip at the times of a table, as it is seen while trips are looked for; see :class:`Path`."""
        return self._points(table, self.path.parameter_at)

    def kept_at(self, table: TimeTable) -> TripPoints:
        """Return the same as :meth:`at`, and keep it: for tables that stay, which several limits look at."""
        kept = self._kept.get(id(table))
        if kept is None or kept.table is not table:
            kept = self._kept[id(table)] = self.at(table)
        return kept

    def driven(self, table: TimeTable) -> TripPoints:
        """Return the trip at the times of a table, as it is certified and driven."""
        return self._points(table, self.path.exact.parameter_at)

    def _points(self, table: TimeTable, parameter_at: Callable[[Array], Array]) -> TripPoints:
        """The trip at the times of a table, given the normalised stations of arc lengths."""
        tau, v0 = self.travel_time, self.space.start_speed
        distance = table.distance @ self.beta
        distance *= tau * tau
        distance += (v0 * tau) * table.sigma
        speed = table.speed @ self.beta
        speed *= tau
        speed += v0
        parameter = parameter_at(distance)
        return TripPoints(
            table,
            tau * table.sigma,
            distance,
            speed,
            table.acceleration @ self.beta,
            parameter,
            self.path.points(parameter),
        )


def arriving(space: TripSpace, theta: Array, beta: Array, acceleration: float, near: float = 0.0) -> Trajectory:
    """Return a trip that arrives, driven harder where it would not."""
    trip = Trajectory.of(space, theta, beta, near)
    for _ in range(EFFORT.most_stretches):
        if np.isfinite(trip.travel_time):
            return trip
        beta = 0.5 * (beta + acceleration)
        trip = Trajectory.of(space, theta, beta)
    return Trajectory.of(space, theta, np.full_like(beta, acceleration))
