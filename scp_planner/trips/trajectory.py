"""The trip: two splines and one number, and everything that follows from them in closed form.

Path. Over a guide g(s) with unit normal n(s), r(s) = g(s) + f(s) n(s) with the offset f a clamped B-spline with control
points theta. With p = 1 - k f (k the guide's curvature), r' = p T + f' n.

Motion. The acceleration along the path is a B-spline with control points beta in normalised time
sigma = t / tau, so with b = tau^2 beta the speed and the distance driven are

    v(sigma) = v0 + C1(sigma) b / tau,        D(sigma) = v0 tau sigma + C2(sigma) b,

C1 and C2 the first and second antiderivatives of the basis: no quadrature. The vehicle arrives when D(1) = L(theta).
The position at time t is r(s) with S(s; theta) = D, S the arc length of the path up to station s.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from math import sqrt

import numpy as np

from scp_planner.arrays import Array, Index
from scp_planner.errors import TooLargeError
from scp_planner.mathematics.splines import evaluate
from scp_planner.trips.guide import Guide
from scp_planner.trips.path import Path, PathBend, PathPoints, _curvature
from scp_planner.trips.space import CELLS_PER_SPAN, QUADRATURE_ORDER, TimeTable, _tables

MAX_BISECTIONS = 60
STILL = 1e-150  # m/s; slower it does not get there: small enough for nothing, and no quotient by it overflows
MOST_BYTES = 512_000_000  # of the tables of one spline
_ENTRY_BYTES = 8
PATH_ENTRIES = 2 * CELLS_PER_SPAN * QUADRATURE_ORDER + 3 * CELLS_PER_SPAN + CELLS_PER_SPAN**2 + 50
"""A span and a control point: two rows a node, three a station, the running sum, and the bases themselves."""
ACCELERATION_ENTRIES = 50
"""A span and a control point: the bases, alone and side by side."""


def check_size(path_spans: int, acceleration_spans: int) -> None:
    """Refuse splines whose tables would not fit into memory, before anything is allocated.

    The tables are dense: so many cells, nodes and control points grow with the square of the number of spans.

    Parameters
    ----------
    path_spans, acceleration_spans : int

    Raises
    ------
    TooLargeError
        Naming what would be needed and what is allowed.
    """
    for what, spans, each in (
        ("path", path_spans, PATH_ENTRIES),
        ("acceleration", acceleration_spans, ACCELERATION_ENTRIES),
    ):
        needed = each * _ENTRY_BYTES * spans * spans
        if needed > MOST_BYTES:
            most = int(sqrt(MOST_BYTES / (each * _ENTRY_BYTES)))
            raise TooLargeError(
                f"{what}: {spans} spans of its spline would take {needed / 1e6:.0f} MB; at most {most} spans,"
                f" {MOST_BYTES / 1e6:.0f} MB, are allowed"
            )


class TripSpace:
    """The set of trips with given splines over a given guide: all that stays the same from step to step.

    Parameters
    ----------
    guide : Guide
    start_speed : float
        v0 in m/s.
    path_degree, path_spans : int
        B-spline of the offset, on equal spans of the guide.
    acceleration_degree : int
        0 (piecewise constant) to 2.
    acceleration_breakpoints : tuple of float
        In normalised time, from 0 to 1.

    Raises
    ------
    TooLargeError
        If their tables would take more memory than is allowed; see :func:`check_size`.
    """

    def __init__(
        self,
        guide: Guide,
        start_speed: float,
        path_degree: int,
        path_spans: int,
        acceleration_degree: int,
        acceleration_breakpoints: tuple[float, ...],
    ) -> None:
        check_size(path_spans, len(acceleration_breakpoints) - 1)
        self.guide = guide
        self.length = guide.length
        self.start_speed = float(start_speed)
        self.tables = _tables(
            path_degree, path_spans, acceleration_degree, tuple(float(s) for s in acceleration_breakpoints)
        )
        self.path = self.tables.path
        self.acceleration = self.tables.acceleration
        self.frame = None if guide.straight else guide.frame(self.tables.node_parameters * self.length)
        self.station_frame = None if guide.straight else guide.frame(self.tables.station_parameters * self.length)

    @property
    def path_size(self) -> int:
        """Number K1 of control points of the offset."""
        return self.path.size

    @property
    def acceleration_size(self) -> int:
        """Number K2 of control points of the acceleration."""
        return self.acceleration.size

    def time_table(self, sigma: Array) -> TimeTable:
        """Return the rows of the acceleration bases at normalised times, (n,)."""
        return self.tables.time_table(sigma)

    def travel_time(self, arc_length: float, beta: Array, near: float = 0.0) -> float:
        """Closed form of the travel time ([ZS] section 2).

        The least positive root of v0 tau + A tau^2 = L in the form that loses no digits,
        tau = 2 L / (v0 + sqrt(v0^2 + 4 A L)), A = C2(1) beta. If A < 0 there is another one, above 2 L / v0: of trips
        that wait for long.

        Parameters
        ----------
        arc_length : float
            m.
        beta : (K2,) array
            m/s^2.
        near : float
            s; of two roots the one that is nearer to this.

        Returns
        -------
        float
            Seconds; inf where the vehicle never arrives.
        """
        gain = float(self.tables.final_distance @ beta)
        discriminant = self.start_speed**2 + 4.0 * gain * arc_length
        if discriminant < 0.0:
            return float("inf")
        denominator = self.start_speed + sqrt(discriminant)
        least = 2.0 * arc_length / denominator if denominator > 0.0 else float("inf")
        if near > least and gain < 0.0:
            other = denominator / (-2.0 * gain)
            return other if abs(other - near) < near - least else least
        return least

    def station_bend(self, theta: Array) -> PathBend:
        """Return the curvature at the fixed stations, with its derivatives, of one path (K1,) or of several (K, K1)."""
        tables = self.tables
        slope = theta @ tables.station_slopes.T
        slope /= self.length
        bend = theta @ tables.station_bends.T
        bend /= self.length**2
        if self.station_frame is None:
            return _curvature(None, slope, slope, bend, np.sqrt(1.0 + slope * slope))
        offset = theta @ tables.station_rows.T
        speed = np.hypot(1.0 - self.station_frame.curvature * offset, slope)
        return _curvature(self.station_frame, offset, slope, bend, speed)

    def trajectory(self, theta: Array, beta: Array, near: float = 0.0) -> Trajectory:
        """Return the trip with these control points (m and m/s^2), its travel time from the closed form."""
        path = Path(self, theta)
        return Trajectory(path, np.asarray(beta, dtype=float), self.travel_time(path.arc_length, beta, near))


def _horner(coefficients: Array, x: Array) -> Array:
    """Values of n polynomials, (n, P) ascending coefficients, each at its own x."""
    value = coefficients[:, -1].copy()
    for power in range(coefficients.shape[1] - 2, -1, -1):
        value *= x
        value += coefficients[:, power]
    return value


@dataclass(frozen=True)
class TripPoints:
    """A trip at n times.

    Attributes
    ----------
    time : (n,) array
        Seconds after the start.
    distance, speed, acceleration : (n,) arrays
        D in m, v in m/s and a in m/s^2, along the path.
    parameter : (n,) array
        Normalised station s / length.
    path : PathPoints
        The path there.
    """

    table: TimeTable
    time: Array
    distance: Array
    speed: Array
    acceleration: Array
    parameter: Array
    path: PathPoints

    def take(self, index: Index | slice) -> TripPoints:
        """Return some of the points."""
        return self.part(index, self.table.take(index))

    def part(self, index: Index | slice, table: TimeTable) -> TripPoints:
        """Return some of the points, given the table of their times."""
        return TripPoints(
            table,
            self.time[index],
            self.distance[index],
            self.speed[index],
            self.acceleration[index],
            self.parameter[index],
            self.path.take(index),
        )

    @classmethod
    def joined(cls, parts: Sequence[TripPoints], table: TimeTable | None = None) -> TripPoints:
        """Return several sets of points as one; with the table of one of them if that is given."""
        if len(parts) == 1:
            return parts[0]
        if table is None:
            table = TimeTable.joined([part.table for part in parts])
        return cls(
            table,
            np.concatenate([part.time for part in parts]),
            np.concatenate([part.distance for part in parts]),
            np.concatenate([part.speed for part in parts]),
            np.concatenate([part.acceleration for part in parts]),
            np.concatenate([part.parameter for part in parts]),
            PathPoints.joined([part.path for part in parts]),
        )


@dataclass(frozen=True)
class Arrivals:
    """When and how fast a vehicle gets somewhere: normalised times (n,) and speeds (n,) in m/s."""

    sigma: Array
    speed: Array


@dataclass(frozen=True)
class Drive:
    """A motion along a path at n times.

    Attributes
    ----------
    distance, speed, acceleration : (n,) arrays
        m, m/s and m/s^2.
    span : (n,) array
        Where the times lie in the acceleration's basis.
    """

    distance: Array
    speed: Array
    acceleration: Array
    span: Index


class Trajectory:
    """A path and the motion along it.

    Parameters
    ----------
    path : Path
    beta : (K2,) array
        Control points of the acceleration, m/s^2.
    travel_time : float
        tau in s. Consistent (D(1) = L) when it comes from :meth:`TripSpace.travel_time`.
    """

    def __init__(self, path: Path, beta: Array, travel_time: float) -> None:
        self.path = path
        self.beta = beta
        self.travel_time = travel_time

    @property
    def theta(self) -> Array:
        """Control points of the offset, (K1,) m."""
        return self.path.theta

    @property
    def space(self) -> TripSpace:
        """The space that the trip is of."""
        return self.path.space

    @property
    def final_speed(self) -> float:
        """Speed on arrival, m/s."""
        return self.space.start_speed + self.travel_time * float(self.space.tables.final_speed @ self.beta)

    def speed_control_points(self) -> Array:
        """Control points of the speed, (K2 + 1,) m/s: its bounds for all times."""
        return self.space.start_speed + self.travel_time * (self.space.tables.speed_control @ self.beta)

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
        """When, and how fast, the vehicle has driven given distances, (n,) m; one of the times where it stands."""
        tau, v0, tables = self.travel_time, self.space.start_speed, self.space.tables
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
        local, slope = self._distance[span], self._speed[span]
        low, high = np.zeros_like(distance), np.ones_like(distance)
        x = np.full_like(distance, 0.5)
        for _ in range(MAX_BISECTIONS):
            excess = _horner(local, x) + (v0 * tau) * (base + width * x) - distance
            if np.all(np.abs(excess) <= 1e-13 * max(self.path.arc_length, 1.0)):
                break
            low, high = np.where(excess <= 0.0, x, low), np.where(excess >= 0.0, x, high)
            rate = (tau * width) * (_horner(slope, x) + v0)
            newton = x - excess / np.where(rate > 0.0, rate, np.inf)
            x = np.where((newton > low) & (newton < high), newton, 0.5 * (low + high))
        return base + width * x

    @cached_property
    def _acceleration(self) -> Array:
        """Local power coefficients of the acceleration."""
        return self.space.acceleration.combine(self.beta)

    def drive_at(self, sigma: Array) -> Drive:
        """Return the motion along the path at normalised times, (n,); as in :meth:`at`, but without a table."""
        span, x = self.space.acceleration.locate(sigma)
        return Drive(
            evaluate(self._distance, span, x) + (self.space.start_speed * self.travel_time) * sigma,
            evaluate(self._speed, span, x) + self.space.start_speed,
            evaluate(self._acceleration, span, x),
            span,
        )

    def at(self, table: TimeTable) -> TripPoints:
        """Return the trip at the times of a table."""
        tau, v0 = self.travel_time, self.space.start_speed
        distance = table.distance @ self.beta
        distance *= tau * tau
        distance += (v0 * tau) * table.sigma
        speed = table.speed @ self.beta
        speed *= tau
        speed += v0
        parameter = self.path.parameter_at(distance)
        return TripPoints(
            table,
            tau * table.sigma,
            distance,
            speed,
            table.acceleration @ self.beta,
            parameter,
            self.path.points(parameter),
        )
