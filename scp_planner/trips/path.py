"""A path: offsets from a guide, by arc length."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from math import factorial, perm

import numpy as np

from scp_planner.arrays import Array, Index
from scp_planner.mathematics.intervals import Interval
from scp_planner.mathematics.polynomials import expanded
from scp_planner.mathematics.splines import evaluate
from scp_planner.trips.arc_length import ArcLength
from scp_planner.trips.space import QUADRATURE_ORDER, TripSpace
from scp_planner.trips.tolerances import SAME_LENGTH, SAME_STATION

NEWTON_STEPS = 3  # from a quadratic guess inside a cell: to rounding


@dataclass(frozen=True)
class PathPoints:
    """A path at n stations."""

    span: Index  # (n,)
    local: Array  # (n,)
    station: Array  # (n,) s in m; f(s) in m; f'(s)
    offset: Array  # (n,) s in m; f(s) in m; f'(s)
    slope: Array  # (n,) s in m; f(s) in m; f'(s)
    stretch: Array  # (n,) p = 1 - k f, the tangential part of r'
    position: Array  # (n, 2) r in m; r' (not normalised); the guide's normal
    direction: Array  # (n, 2) r in m; r' (not normalised); the guide's normal
    normal: Array  # (n, 2) r in m; r' (not normalised); the guide's normal
    speed: Array  # (n,) |r'|
    turning: Array  # (n, 3) The guide's curvature and its first two derivatives, 1/m and so on


@dataclass(frozen=True)
class PathBend:
    """Curvature of a path at n stations and how it depends on the offset."""

    curvature: Array  # (n,) 1/m, positive to the left
    value: Array  # (n,) Partial derivatives with respect to f, f' and f''; (1,) where it is 0 everywhere
    slope: Array  # (n,) Partial derivatives with respect to f, f' and f''; (1,) where it is 0 everywhere
    bend: Array  # (n,) Partial derivatives with respect to f, f' and f''; (1,) where it is 0 everywhere


@dataclass(frozen=True)
class BendEnclosure:
    """Ranges on intervals of the station: |r'|, and d curvature / ds in 1/m^2."""

    speed: Interval
    curvature_rate: Interval


class Path:
    """One path of a :class:`TripSpace`: where, without when."""

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

    @cached_property
    def exact(self) -> ArcLength:
        """The arc length by which trips are driven, to within a distance that it tells."""
        tables, guide = self.space.tables, self.space.guide
        edges = tables.station_parameters
        if tables.cells % guide.pieces:
            # Only in plan files of other origin: |r'|^2 is one polynomial inside of a piece of the guide.
            edges = np.union1d(edges, np.linspace(0.0, 1.0, guide.pieces + 1))
            edges = np.append(edges[:-1][np.diff(edges) > SAME_STATION], 1.0)
        return ArcLength(self._speeds, self.space.length, edges)

    @property
    def driven_length(self) -> float:
        """Arc length of the whole path as it is driven, m."""
        total = self.exact.total
        return self.arc_length if abs(total - self.arc_length) <= SAME_LENGTH * total else total

    def _speeds(self, parameters: Array) -> Array:
        """Speeds over the station |r'| at normalised stations, (n,)."""
        span, x = self.space.path.locate(parameters)
        slope = evaluate(self._slope_coefficients, span, x)
        if self.space.frame is None:
            speeds: Array = np.sqrt(1.0 + slope * slope)
            return speeds
        bend = self.space.guide.curvature(parameters * self.space.length)
        return np.hypot(1.0 - bend * evaluate(self.offset_coefficients, span, x), slope)

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
        return tables.running_sum(np.matmul(tables.weights, nodes)), nodes

    @cached_property
    def offset_coefficients(self) -> Array:
        """Local power coefficients of the offset, (spans, P) m."""
        return self.space.path.combine(self.theta)

    @cached_property
    def _slope_coefficients(self) -> Array:
        """Local power coefficients of the offset's derivative, (spans, P - 1)."""
        return self.space.path.derivative.combine(self.theta) / self.space.length

    @cached_property
    def bend_coefficients(self) -> Array:
        """Local power coefficients of the offset's second derivative, (spans, P - 2) 1/m."""
        return self.space.path.derivative.derivative.combine(self.theta) / (self.space.length * self.space.length)

    @cached_property
    def third_coefficients(self) -> Array:
        """Local power coefficients of the offset's third derivative, (spans, P - 3) 1/m^2."""
        return self.space.path.derivative.derivative.derivative.combine(self.theta) / self.space.length**3

    def points(self, parameters: Array) -> PathPoints:
        """Return the path at normalised stations, (n,)."""
        span, x = self.space.path.locate(parameters)
        return points_from(self.space, parameters, span, x, self.offset_coefficients.T[:, span])

    def places(self, parameters: Array) -> Array:
        """Positions at normalised stations, (n,): (n, 2) m."""
        span, x = self.space.path.locate(parameters)
        station, offset = parameters * self.space.length, evaluate(self.offset_coefficients, span, x)
        if self.space.frame is None:  # straight guides lie along the x axis
            return np.stack([station, offset], axis=1)
        frame = self.space.guide.frame(station)
        position: Array = frame.position + offset[:, None] * frame.normal
        return position

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
        return station_bend(self.space, self.theta)

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
        """Enclose |r'| and the rate of the curvature on intervals of the station around points of the path."""
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
        normal, turning = _UP, _STRAIGHT
        speed = np.sqrt(1.0 + slope * slope)
    else:
        frame = space.guide.frame(station)
        stretch = 1.0 - frame.curvature * offset
        position = frame.position + offset[:, None] * frame.normal
        direction = stretch[:, None] * frame.tangent + slope[:, None] * frame.normal
        normal = frame.normal
        turning = np.stack([frame.curvature, frame.curvature_rate, frame.second_rate], axis=1)
        speed = np.sqrt(stretch**2 + slope**2)
    return PathPoints(span, x, station, offset, slope, stretch, position, direction, normal, speed, turning)


def bend_from(space: TripSpace, points: PathPoints, bend: Array) -> PathBend:
    """Return the curvature at points of a path, with its derivatives, given that of the offset's slope, (n,) 1/m."""
    turning = None if space.frame is None else points.turning
    return _curvature(turning, points.offset, points.slope, bend, points.speed)


def curvature_rate_from(space: TripSpace, points: PathPoints, bend: Array, third: Array) -> Array:
    """Return the rate of the curvature along the station, (n,) 1/m^2, given two derivatives of the slope."""
    q, squared = points.slope, points.speed * points.speed
    if space.frame is None:
        return (third - 3.0 * q * bend * bend / squared) / (squared * points.speed)
    f, (k, rate, second) = points.offset, points.turning.T
    p = points.stretch
    p_rate = -rate * f - k * q
    along, across = -rate * f - 2.0 * k * q, bend + k * p
    along_rate = -second * f - 3.0 * rate * q - 2.0 * k * bend
    across_rate = third + rate * p + k * p_rate
    turn = p * across - q * along
    turn_rate = p_rate * across + p * across_rate - bend * along - q * along_rate
    return (turn_rate - 3.0 * turn * (p * p_rate + q * bend) / squared) / (squared * points.speed)


def station_bend(space: TripSpace, theta: Array) -> PathBend:
    """Return the curvature at the fixed stations, with its derivatives, given theta, (K1,)."""
    tables = space.tables
    slope = theta @ tables.station_slopes.T
    slope /= space.length
    bend = theta @ tables.station_bends.T
    bend /= space.length**2
    if space.station_frame is None:
        return _curvature(None, slope, slope, bend, np.sqrt(1.0 + slope * slope))
    offset = theta @ tables.station_rows.T
    speed = np.hypot(1.0 - space.station_frame.curvature * offset, slope)
    frame = space.station_frame
    return _curvature(np.stack([frame.curvature, frame.curvature_rate], axis=1), offset, slope, bend, speed)


def _curvature(turning: Array | None, offset: Array, slope: Array, bend: Array, speed: Array) -> PathBend:
    """Curvature of g + f n from f, f', f'' and |r'|, with its derivatives; of the guide k, dk/ds and more, or None."""
    squared = speed * speed
    cubed = squared * speed
    if turning is None:
        inverse = 1.0 / cubed
        curvature = bend * inverse
        return PathBend(curvature, _ZERO, -3.0 * curvature * slope / squared, inverse)
    k, rate = turning[:, 0], turning[:, 1]
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
_STRAIGHT = np.zeros((1, 3))
