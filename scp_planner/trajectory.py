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
from dataclasses import dataclass, fields
from functools import cached_property, lru_cache
from math import factorial, perm, sqrt

import numpy as np
from numpy.typing import NDArray

from scp_planner.guide import Guide, GuideFrame
from scp_planner.intervals import Interval
from scp_planner.polynomials import expanded
from scp_planner.splines import (
    PiecewiseBasis,
    antiderivative_control_points,
    clamped_basis,
    evaluate,
)

Array = NDArray[np.float64]
Index = NDArray[np.intp]

QUADRATURE_ORDER = 6  # Gauss nodes a cell: 4 left jumps of 1e-5 m/s in the speed over ground between cells
CELLS_PER_SPAN = 5  # the ends of cells are the stations at which curvature is limited
MAX_BISECTIONS = 60
_POWERS = np.arange(1, QUADRATURE_ORDER + 1)
NEWTON_STEPS = 3  # from a quadratic guess inside a cell: to rounding


@dataclass(frozen=True)
class TimeTable:
    """Rows of the acceleration basis and its antiderivatives at fixed normalised times.

    Attributes
    ----------
    sigma : (n,) array
        Normalised times in [0, 1].
    acceleration, speed, distance : (n, K2) arrays
        The basis C0, its antiderivative C1 and its second antiderivative C2.
    """

    sigma: Array
    acceleration: Array
    speed: Array
    distance: Array

    def take(self, index: Index | slice) -> TimeTable:
        """Return the table of some of the times."""
        return TimeTable(self.sigma[index], self.acceleration[index], self.speed[index], self.distance[index])

    @classmethod
    def joined(cls, parts: Sequence[TimeTable]) -> TimeTable:
        """Return several tables as one."""
        return cls(
            np.concatenate([part.sigma for part in parts]),
            np.concatenate([part.acceleration for part in parts]),
            np.concatenate([part.speed for part in parts]),
            np.concatenate([part.distance for part in parts]),
        )


@lru_cache(maxsize=64)
def _gauss_cell(order: int) -> tuple[Array, Array]:
    """Gauss nodes on [0, 1], and the matrix from node values to the coefficients of the antiderivative.

    The coefficients are those of x, x^2, ... x^order of the interpolating polynomial's integral from 0.
    """
    nodes, _ = np.polynomial.legendre.leggauss(order)
    nodes = 0.5 * (nodes + 1.0)
    interpolation = np.linalg.inv(np.vander(nodes, order, increasing=True))
    return nodes, interpolation / np.arange(1, order + 1)[:, None]


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


class _Tables:
    """What depends on the splines only, not on guide or vehicle: shared between all plans of a process."""

    def __init__(
        self, path_degree: int, path_spans: int, acceleration_degree: int, breakpoints: tuple[float, ...]
    ) -> None:
        self.path = clamped_basis(path_degree, tuple(float(s) for s in np.linspace(0.0, 1.0, path_spans + 1)))
        self.acceleration: PiecewiseBasis = clamped_basis(acceleration_degree, breakpoints)
        basis = self.acceleration
        self._time_basis = _side_by_side(basis, basis.antiderivative, basis.antiderivative.antiderivative)
        # The offset's basis and its first two derivatives
        self.bending = _side_by_side(self.path, self.path.derivative, self.path.derivative.derivative)
        self.speed_control = antiderivative_control_points(acceleration_degree, breakpoints)
        self.cells = path_spans * CELLS_PER_SPAN
        nodes, self.antiderivative = _gauss_cell(QUADRATURE_ORDER)
        self.weights = self.antiderivative.sum(axis=0)
        self.node_weights = np.tile(self.weights, self.cells)
        # A product with this matrix is quicker than a cumulative sum along the first axis.
        self.running_sum = np.tri(self.cells + 1, self.cells, -1)
        self.node_parameters = ((np.arange(self.cells)[:, None] + nodes) / self.cells).ravel()
        self.node_rows = self.path.rows(self.node_parameters)
        self.node_slopes = self.path.derivative.rows(self.node_parameters)
        self.station_parameters = np.linspace(0.0, 1.0, self.cells + 1)
        self.station_rows = self.path.rows(self.station_parameters)
        self.station_slopes = self.path.derivative.rows(self.station_parameters)
        self.station_bends = self.path.derivative.derivative.rows(self.station_parameters)
        self.breaks = self.time_table(self.acceleration.breakpoints)
        self.constant = acceleration_degree == 0  # the acceleration, between its breakpoints
        self.leverage = _leverage(path_degree, path_spans)
        self.final_distance = self.acceleration.antiderivative.antiderivative.rows(np.ones(1))[0]
        self.final_speed = self.acceleration.antiderivative.rows(np.ones(1))[0]

    def located(self, parameters: Array) -> tuple[Index, Array]:
        """Cells of normalised stations, and the weights of the cells' nodes in integrals up to there."""
        scaled = np.minimum(np.maximum(parameters, 0.0), 1.0) * self.cells
        cell = np.minimum(scaled.astype(np.intp), self.cells - 1)
        powers = (scaled - cell)[:, None] ** _POWERS
        return cell, powers @ self.antiderivative

    def time_table(self, sigma: Array) -> TimeTable:
        sigma = np.asarray(sigma, dtype=float)
        span, x = self.acceleration.locate(sigma)
        rows, size = self._time_basis.rows_at(span, x), self.acceleration.size
        return TimeTable(sigma, rows[:, :size], rows[:, size : 2 * size], rows[:, 2 * size :])


def _horner(coefficients: Array, x: Array) -> Array:
    """Values of n polynomials, (n, P) ascending coefficients, each at its own x."""
    value = coefficients[:, -1].copy()
    for power in range(coefficients.shape[1] - 2, -1, -1):
        value *= x
        value += coefficients[:, power]
    return value


def _side_by_side(*parts: PiecewiseBasis) -> PiecewiseBasis:
    """Several bases over the same breakpoints as one: evaluated with one gather."""
    order = max(part.coefficients.shape[1] for part in parts)
    padded = [np.pad(part.coefficients, ((0, 0), (0, order - part.coefficients.shape[1]), (0, 0))) for part in parts]
    return PiecewiseBasis(parts[0].breakpoints, np.concatenate(padded, axis=2))


def _leverage(degree: int, spans: int) -> Array:
    """Distance between neighbouring Greville abscissae, relative to the inner ones.

    Near the clamped ends control points lie closer together, so that a step of one turns the path more.
    """
    knots = np.concatenate([np.zeros(degree), np.arange(spans + 1), np.full(degree, spans)])
    greville = np.array([knots[k + 1 : k + degree + 1].mean() for k in range(spans + degree)])
    gaps = np.diff(greville)
    return np.minimum(np.concatenate([gaps[:1], gaps]), np.concatenate([gaps, gaps[-1:]]))


@lru_cache(maxsize=32)
def _tables(path_degree: int, path_spans: int, acceleration_degree: int, breakpoints: tuple[float, ...]) -> _Tables:
    return _Tables(path_degree, path_spans, acceleration_degree, breakpoints)


@dataclass(frozen=True)
class PathPoints:
    """A path at n stations.

    Attributes
    ----------
    span, local : (n,) arrays
        Where the stations lie in the offset's basis.
    station, offset, slope : (n,) arrays
        s in m; f(s) in m; f'(s).
    stretch : (n,) array
        p = 1 - k f, the tangential part of r'.
    position, direction, normal : (n, 2) arrays
        r in m; r' (not normalised); the guide's normal.
    speed : (n,) array
        |r'|.
    """

    span: Index
    local: Array
    station: Array
    offset: Array
    slope: Array
    stretch: Array
    position: Array
    direction: Array
    normal: Array
    speed: Array

    def take(self, index: Index | slice) -> PathPoints:
        """Return some of the points."""
        return PathPoints(
            self.span[index],
            self.local[index],
            self.station[index],
            self.offset[index],
            self.slope[index],
            self.stretch[index],
            self.position[index],
            self.direction[index],
            self.normal[index] if len(self.normal) == len(self.station) else self.normal,
            self.speed[index],
        )

    @classmethod
    def joined(cls, parts: Sequence[PathPoints]) -> PathPoints:
        """Return several sets of points as one."""
        if len(parts) == 1:
            return parts[0]
        shared = any(len(part.normal) != len(part.station) for part in parts)
        normal = _UP if shared else np.concatenate([part.normal for part in parts])
        joined = {name: np.concatenate([getattr(part, name) for part in parts]) for name in _POINT_FIELDS}
        return cls(**joined, normal=normal)


_POINT_FIELDS = tuple(field.name for field in fields(PathPoints) if field.name != "normal")


@dataclass(frozen=True)
class PathBend:
    """Curvature of a path at n stations and how it depends on the offset.

    ``d curvature = value d f + slope d f' + bend d f''`` at a fixed station.

    Attributes
    ----------
    curvature : (n,) array
        1/m, positive to the left.
    value, slope, bend : (n,) arrays
        Partial derivatives with respect to f, f' and f''; (1,) where it is 0 everywhere.
    """

    curvature: Array
    value: Array
    slope: Array
    bend: Array

    def take(self, index: Index | slice | int) -> PathBend:
        """Return some of the points."""
        value = self.value[index] if len(self.value) == len(self.curvature) else self.value
        return PathBend(self.curvature[index], value, self.slope[index], self.bend[index])

    @classmethod
    def joined(cls, parts: Sequence[PathBend]) -> PathBend:
        """Return several sets of points as one."""
        if len(parts) == 1:
            return parts[0]
        shared = any(len(part.value) != len(part.curvature) for part in parts)
        return cls(
            np.concatenate([part.curvature for part in parts]),
            _ZERO if shared else np.concatenate([part.value for part in parts]),
            np.concatenate([part.slope for part in parts]),
            np.concatenate([part.bend for part in parts]),
        )


@dataclass(frozen=True)
class BendEnclosure:
    """Ranges on intervals of the station: |r'|, and d curvature / ds in 1/m^2."""

    speed: Interval
    curvature_rate: Interval


class Path:
    """One path of a :class:`TripSpace`: where, without when.

    Parameters
    ----------
    space : TripSpace
    theta : (K1,) array
        Control points of the offset, m.
    """

    def __init__(self, space: TripSpace, theta: Array) -> None:
        self.space = space
        self.theta = np.asarray(theta, dtype=float)
        tables = space.tables
        self._slope = tables.node_slopes @ self.theta
        self._slope *= 1.0 / space.length
        if space.frame is None:
            self.node_stretch = None
            speed = np.sqrt(1.0 + self._slope * self._slope)
        else:
            self.node_stretch = 1.0 - space.frame.curvature * (tables.node_rows @ self.theta)
            speed = np.sqrt(self.node_stretch**2 + self._slope**2)
        self.node_speed = speed
        cell = space.length / tables.cells
        self.cells = (speed.reshape(tables.cells, QUADRATURE_ORDER) * cell) @ tables.antiderivative.T
        self.until = np.zeros(tables.cells + 1)
        np.cumsum(self.cells.sum(axis=1), out=self.until[1:])
        self.arc_length = float(self.until[-1])

    def arc_length_at(self, parameters: Array) -> Array:
        """Arc length S up to normalised stations s / length, (n,), in m."""
        scaled = np.clip(np.asarray(parameters, dtype=float), 0.0, 1.0) * self.space.tables.cells
        cell = np.minimum(scaled.astype(np.intp), self.space.tables.cells - 1)
        x = scaled - cell
        return self.until[cell] + x * evaluate(self.cells, cell, x)

    def parameter_at(self, distance: Array) -> Array:
        """Normalised station s / length where the arc length equals ``distance``, (n,) m; clamped at the ends."""
        distance = np.minimum(np.maximum(distance, 0.0), self.arc_length)
        cell = self.until[1:-1].searchsorted(distance, "right")
        x = inverted(self.cells.T[:, cell], distance - self.until[cell])
        return (cell + x) / self.space.tables.cells

    def arc_length_gradient(self, parameters: Array) -> Array:
        """Derivative of the arc length up to normalised stations with respect to theta, (n, K1)."""
        cell, weights = self.space.tables.located(parameters)
        until, nodes = self.gradients
        return until[cell] + np.matmul(weights[:, None, :], nodes[cell])[:, 0, :]

    @cached_property
    def final_gradient(self) -> Array:
        """Derivative of the arc length with respect to theta, (K1,)."""
        gradient: Array = self.gradients[0][-1]
        return gradient

    @cached_property
    def gradients(self) -> tuple[Array, Array]:
        """D S / d theta at the ends of cells, and d |r'| / d theta at the nodes of each cell, times its width."""
        space, tables = self.space, self.space.tables
        rate = (self._slope / (self.node_speed * tables.cells))[:, None] * tables.node_slopes
        if space.frame is not None and self.node_stretch is not None:
            factor = -self.node_stretch * space.frame.curvature / self.node_speed * (space.length / tables.cells)
            rate += factor[:, None] * tables.node_rows
        nodes = rate.reshape(tables.cells, QUADRATURE_ORDER, -1)
        return tables.running_sum @ np.matmul(tables.weights, nodes), nodes

    @cached_property
    def offset_coefficients(self) -> Array:
        """Local power coefficients of the offset, (spans, P) m."""
        return self.space.path.combine(self.theta)

    @cached_property
    def bend_coefficients(self) -> Array:
        """Local power coefficients of the offset's second derivative, (spans, P - 2) 1/m."""
        return self.space.path.derivative.derivative.combine(self.theta) / self.space.length**2

    @cached_property
    def third_coefficients(self) -> Array:
        """Local power coefficients of the offset's third derivative, (spans, P - 3) 1/m^2."""
        return self.space.path.derivative.derivative.derivative.combine(self.theta) / self.space.length**3

    def points(self, parameters: Array) -> PathPoints:
        """Return the path at normalised stations, (n,)."""
        span, x = self.space.path.locate(parameters)
        return points_from(self.space, parameters, span, x, self.offset_coefficients.T[:, span])

    def bend(self, points: PathPoints) -> PathBend:
        """Return the curvature at points of the path, with its derivatives."""
        return bend_from(self.space, points, evaluate(self.bend_coefficients, points.span, points.local))

    def curvature_rate(self, points: PathPoints) -> Array:
        """Rate of the curvature along the station at points of the path, (n,) 1/m^2; to the right at breakpoints."""
        return curvature_rate_from(
            self.space,
            points,
            evaluate(self.bend_coefficients, points.span, points.local),
            evaluate(self.third_coefficients, points.span, points.local),
        )

    @cached_property
    def station_bend(self) -> PathBend:
        """Curvature at the fixed stations, with its derivatives."""
        return self.space.station_bend(self.theta)

    @cached_property
    def station_positions(self) -> Array:
        """Positions at the fixed stations, (M, 2) m."""
        tables, frame = self.space.tables, self.space.station_frame
        offset = tables.station_rows @ self.theta
        if frame is None:
            return np.stack([tables.station_parameters * self.space.length, offset], axis=1)
        return frame.position + offset[:, None] * frame.normal

    @property
    def station_arc_lengths(self) -> Array:
        """Arc length up to the fixed stations, m."""
        return self.until

    @property
    def station_gradients(self) -> Array:
        """Derivative of the arc length up to the fixed stations with respect to theta, (M, K1)."""
        return self.gradients[0]

    def bend_enclosure(self, points: PathPoints, width: Array) -> BendEnclosure:
        """Enclose |r'| and the rate of the curvature on intervals of the station around points of the path.

        Parameters
        ----------
        points : PathPoints
            Middles of the intervals.
        width : (n,) array
            Half widths in m of station; no interval may cross a breakpoint of the offset.

        Returns
        -------
        BendEnclosure
        """
        f, q, bend, third = self._offset_ranges(points, width)
        if self.space.frame is None:
            squared = q.squared()
            speed = Interval(np.sqrt(1.0 + squared.lower), np.sqrt(1.0 + squared.upper))
            steepness = bend.squared().times_positive(speed.power(-5.0))
            bulge = q.times_positive(steepness).scaled(3.0)
            return BendEnclosure(speed, third.times_positive(speed.power(-3.0)) - bulge)
        one = Interval(np.ones_like(width), np.ones_like(width))
        k, rate, second = self.space.guide.curvature_ranges(points.station, width)
        p = one - k * f
        p_rate = -(rate * f) - k * q
        along = -(rate * f) - (k * q).scaled(2.0)
        across = bend + k * p
        along_rate = -(second * f) - (rate * q).scaled(3.0) - (k * bend).scaled(2.0)
        across_rate = third + rate * p + k * p_rate
        squared = p.squared() + q.squared()
        squared = Interval(np.maximum(squared.lower, 1e-12), np.maximum(squared.upper, 1e-12))
        numerator = p * across - q * along
        numerator_rate = p_rate * across + p * across_rate - bend * along - q * along_rate
        speed = Interval(np.sqrt(squared.lower), np.sqrt(squared.upper))
        curvature_rate = numerator_rate * speed.power(-3.0) - (
            numerator * speed.power(-5.0) * (p * p_rate + q * bend)
        ).scaled(3.0)
        return BendEnclosure(speed, curvature_rate)

    def _offset_ranges(self, points: PathPoints, width: Array) -> list[Interval]:
        """Ranges of the offset and its first three derivatives on intervals of the station, by Taylor's polynomial."""
        spans = self.space.path.widths[points.span] * self.space.length
        terms = expanded(self.offset_coefficients[points.span][:, :, None], points.local)[:, :, 0]
        order = terms.shape[1]
        sizes, local = np.abs(terms), width / spans
        ranges, scale = [], np.ones_like(spans)
        for derivative in range(4):
            if derivative >= order:
                ranges.append(Interval(np.zeros_like(width), np.zeros_like(width)))
                continue
            # d^j/dx^j sum_k c_k x^k = sum_k k! / (k - j)! c_k x^(k - j)
            radius = np.zeros_like(width)
            for power in range(order - 1, derivative, -1):
                radius += sizes[:, power] * perm(power, derivative)
                radius *= local
            middle = terms[:, derivative] * factorial(derivative)
            ranges.append(Interval((middle - radius) * scale, (middle + radius) * scale))
            scale = scale / spans
        return ranges


def inverted(local: Array, target: Array) -> Array:
    """Parameters x in [0, 1] at which the arc lengths sum_k local[k] x^(k + 1), (order, n), reach targets, (n,)."""
    # From the inverse of the parabola: the speed |r'| hardly bends within a cell.
    x = target / local.sum(axis=0)
    x += (local[1] / local[0]) * x * (1.0 - x)
    for _ in range(NEWTON_STEPS):
        value = local[-1] * x
        slope = value + local[-2]
        value += local[-2]
        slope += value
        slope -= local[-2]
        for power in range(QUADRATURE_ORDER - 3, -1, -1):
            value *= x
            value += local[power]
            slope *= x
            slope += value
        # value is the polynomial over x, and slope the derivative of value * x
        value *= x
        value -= target
        value /= slope
        x -= value
    return x


def points_from(space: TripSpace, parameters: Array, span: Index, x: Array, local: Array) -> PathPoints:
    """The path at normalised stations, given the local power coefficients of the offset there, (P, n)."""
    station = parameters * space.length
    offset = local[-1] * x
    slope = local[-1].copy()
    offset += local[-2]
    for power in range(len(local) - 3, -1, -1):
        slope *= x
        slope += offset
        offset *= x
        offset += local[power]
    slope *= len(space.path.widths) / space.length
    if space.frame is None:
        # Straight guides lie along the x axis of the planning frame, see problem.py.
        stretch = np.ones_like(station)
        position = np.empty((len(station), 2))
        position[:, 0] = station
        position[:, 1] = offset
        direction = np.empty_like(position)
        direction[:, 0] = 1.0
        direction[:, 1] = slope
        normal = _UP
        speed = np.sqrt(1.0 + slope * slope)
    else:
        frame = space.guide.frame(station)
        stretch = 1.0 - frame.curvature * offset
        position = frame.position + offset[:, None] * frame.normal
        direction = stretch[:, None] * frame.tangent + slope[:, None] * frame.normal
        normal = frame.normal
        speed = np.sqrt(stretch**2 + slope**2)
    return PathPoints(span, x, station, offset, slope, stretch, position, direction, normal, speed)


def bend_from(space: TripSpace, points: PathPoints, bend: Array) -> PathBend:
    """Return the curvature at points of a path, with its derivatives, given that of the offset's slope, (n,) 1/m."""
    frame = None if space.frame is None else space.guide.frame(points.station)
    return _curvature(frame, points.offset, points.slope, bend, points.speed)


def curvature_rate_from(space: TripSpace, points: PathPoints, bend: Array, third: Array) -> Array:
    """Return the rate of the curvature along the station, (n,) 1/m^2, given two derivatives of the slope."""
    q, squared = points.slope, points.speed * points.speed
    if space.frame is None:
        return (third - 3.0 * q * bend * bend / squared) / (squared * points.speed)
    guide = space.guide
    frame = guide.frame(points.station)
    k, rate, f = frame.curvature, frame.curvature_rate, points.offset
    second = guide.curvature_ranges(points.station, np.zeros_like(points.station))[2].lower
    p = points.stretch
    p_rate = -rate * f - k * q
    along, across = -rate * f - 2.0 * k * q, bend + k * p
    along_rate = -second * f - 3.0 * rate * q - 2.0 * k * bend
    across_rate = third + rate * p + k * p_rate
    turn = p * across - q * along
    turn_rate = p_rate * across + p * across_rate - bend * along - q * along_rate
    return (turn_rate - 3.0 * turn * (p * p_rate + q * bend) / squared) / (squared * points.speed)


def _curvature(frame: GuideFrame | None, offset: Array, slope: Array, bend: Array, speed: Array) -> PathBend:
    """Curvature of g + f n from f, f', f'' and |r'|, with its derivatives."""
    squared = speed * speed
    cubed = squared * speed
    if frame is None:
        inverse = 1.0 / cubed
        curvature = bend * inverse
        return PathBend(curvature, _ZERO, -3.0 * curvature * slope / squared, inverse)
    k, rate = frame.curvature, frame.curvature_rate
    p = 1.0 - k * offset
    tangential = -(rate * offset + 2.0 * k * slope)
    normal = bend + k * p
    curvature = (p * normal - slope * tangential) / cubed
    return PathBend(
        curvature,
        (-k * normal - k * k * p + rate * slope) / cubed + 3.0 * curvature * k * p / squared,
        (-tangential + 2.0 * k * slope) / cubed - 3.0 * curvature * slope / squared,
        p / cubed,
    )


_ZERO = np.zeros(1)
_UP = np.array([[0.0, 1.0]])


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
            elapsed = 2.0 * target / np.maximum(start + speed, 1e-300)
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
