"""The splines of a trip over a given guide, with all that can be known of them before there is a trip."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from math import sqrt

import numpy as np

from scp_planner.arrays import Array, Index
from scp_planner.errors import TooLargeError
from scp_planner.mathematics.quadrature import gauss_rule
from scp_planner.mathematics.splines import PiecewiseBasis, antiderivative_control_points, clamped_basis
from scp_planner.trips.guide import Guide

QUADRATURE_ORDER = 6  # Gauss nodes a cell: 4 left jumps of 1e-5 m/s in the speed over ground between cells
CELLS_PER_SPAN = 5  # the ends of cells are the stations at which curvature is limited


@dataclass(frozen=True)
class TableSize:
    """Size of the tables of a spline."""

    many_cells: int = 100  # up to here a product with a triangle is quicker than a cumulative sum along the first axis
    most_bytes: int = 512_000_000  # of the tables of one spline
    entry_bytes: int = 8
    # A span and a control point: two rows a node, three a station, the running sum, and the bases themselves
    path_entries: int = 2 * CELLS_PER_SPAN * QUADRATURE_ORDER + 3 * CELLS_PER_SPAN + CELLS_PER_SPAN**2 + 50
    acceleration_entries: int = 50  # A span and a control point: the bases, alone and side by side


SIZE = TableSize()
_POWERS = np.arange(1, QUADRATURE_ORDER + 1)


def check_size(path_spans: int, acceleration_spans: int) -> None:
    """Refuse splines whose tables would not fit into memory, before anything is allocated."""
    for what, spans, each in (
        ("path", path_spans, SIZE.path_entries),
        ("acceleration", acceleration_spans, SIZE.acceleration_entries),
    ):
        needed = each * SIZE.entry_bytes * spans * spans
        if needed > SIZE.most_bytes:
            most = int(sqrt(SIZE.most_bytes / (each * SIZE.entry_bytes)))
            raise TooLargeError(
                f"{what}: {spans} spans of its spline would take {needed / 1e6:.0f} MB; at most {most} spans,"
                f" {SIZE.most_bytes / 1e6:.0f} MB, are allowed"
            )


@dataclass(frozen=True)
class TimeTable:
    """Rows of the acceleration basis and its antiderivatives at fixed normalised times."""

    sigma: Array  # (n,) Normalised times in [0, 1]
    acceleration: Array  # (n, K2) The basis C0, its antiderivative C1 and its second antiderivative C2
    speed: Array  # (n, K2) The basis C0, its antiderivative C1 and its second antiderivative C2
    distance: Array  # (n, K2) The basis C0, its antiderivative C1 and its second antiderivative C2


@lru_cache(maxsize=64)
def _gauss_cell(order: int) -> tuple[Array, Array]:
    """Gauss nodes on [0, 1], and the matrix from node values to the coefficients of the antiderivative."""
    nodes = 0.5 * (gauss_rule(order).nodes + 1.0)
    interpolation = np.linalg.inv(np.vander(nodes, order, increasing=True))
    return nodes, interpolation / np.arange(1, order + 1)[:, None]


class _PathTables:
    """Tables that depend on the spline of the path only: shared between all plans of a process."""

    def __init__(self, degree: int, spans: int) -> None:
        self.path = clamped_basis(degree, tuple(float(s) for s in np.linspace(0.0, 1.0, spans + 1)))
        # The offset's basis and its first two derivatives
        self.bending = _side_by_side(self.path, self.path.derivative, self.path.derivative.derivative)
        self.cells = spans * CELLS_PER_SPAN
        nodes, self.antiderivative = _gauss_cell(QUADRATURE_ORDER)
        self.weights = self.antiderivative.sum(axis=0)
        self.node_weights = np.tile(self.weights, self.cells)
        few = self.cells <= SIZE.many_cells
        self._running_sum = np.tri(self.cells + 1, self.cells, -1) if few else None
        self.node_parameters = ((np.arange(self.cells)[:, None] + nodes) / self.cells).ravel()
        self.node_rows = self.path.rows(self.node_parameters)
        self.node_slopes = self.path.derivative.rows(self.node_parameters)
        self._slope_pairs, self._pair_places = _pairs_of(self.node_slopes, degree, spans)
        self.station_parameters = np.linspace(0.0, 1.0, self.cells + 1)
        self.station_rows = self.path.rows(self.station_parameters)
        self.station_slopes = self.path.derivative.rows(self.station_parameters)
        self.station_bends = self.path.derivative.derivative.rows(self.station_parameters)
        self.leverage = _leverage(degree, spans)

    def running_sum(self, parts: Array) -> Array:
        """Sums of what cells contribute, (cells, n), up to their ends and from nothing, (cells + 1, n)."""
        if self._running_sum is not None:
            product: Array = self._running_sum @ parts
            return product
        sums = np.zeros((self.cells + 1, parts.shape[1]))
        np.add.accumulate(parts, axis=0, out=sums[1:])
        return sums

    def located(self, parameters: Array) -> tuple[Index, Array]:
        """Cells of normalised stations, and the weights of the cells' nodes in integrals up to there."""
        scaled = np.minimum(np.maximum(parameters, 0.0), 1.0) * self.cells
        cell = np.minimum(scaled.astype(np.intp), self.cells - 1)
        powers = (scaled - cell)[:, None] ** _POWERS
        return cell, powers @ self.antiderivative

    def slopes_squared(self, weights: Array) -> Array:
        """Sum of the squared slopes at the nodes, weighted (n,), as a quadratic form of the control points (K1, K1)."""
        spans, _, pairs = self._slope_pairs.shape
        local = np.matmul(weights.reshape(spans, 1, -1), self._slope_pairs)
        size = self.path.size
        form = np.bincount(self._pair_places, local.reshape(spans * pairs), size * size)
        return np.asarray(form, dtype=float).reshape(size, size)


class _DriveTables:
    """Tables that depend on the spline of the acceleration only."""

    def __init__(self, degree: int, breakpoints: tuple[float, ...]) -> None:
        self.acceleration: PiecewiseBasis = clamped_basis(degree, breakpoints)
        basis = self.acceleration
        self._time_basis = _side_by_side(basis, basis.antiderivative, basis.antiderivative.antiderivative)
        self.speed_control = antiderivative_control_points(degree, breakpoints)
        self.breaks = self.time_table(self.acceleration.breakpoints)
        self.constant = degree == 0  # the acceleration, between its breakpoints
        self.final_distance = self.acceleration.antiderivative.antiderivative.rows(np.ones(1))[0]
        self.final_speed = self.acceleration.antiderivative.rows(np.ones(1))[0]

    def time_table(self, sigma: Array) -> TimeTable:
        sigma = np.asarray(sigma, dtype=float)
        span, x = self.acceleration.locate(sigma)
        rows, size = self._time_basis.rows_at(span, x), self.acceleration.size
        return TimeTable(sigma, rows[:, :size], rows[:, size : 2 * size], rows[:, 2 * size :])


def _pairs_of(slopes: Array, degree: int, spans: int) -> tuple[Array, Index]:
    each, size = len(slopes) // spans, slopes.shape[1]
    local = np.stack([slopes[each * k : each * (k + 1), k : k + degree + 1] for k in range(spans)])
    first, among = np.arange(spans)[:, None], np.arange(degree + 1)
    places = (first + among)[:, :, None] * size + (first + among)[:, None, :]
    return (local[:, :, :, None] * local[:, :, None, :]).reshape(spans, each, -1), places.ravel()


def _side_by_side(*parts: PiecewiseBasis) -> PiecewiseBasis:
    """Several bases over the same breakpoints as one: evaluated with one gather."""
    order = max(part.coefficients.shape[1] for part in parts)
    padded = [np.pad(part.coefficients, ((0, 0), (0, order - part.coefficients.shape[1]), (0, 0))) for part in parts]
    return PiecewiseBasis(parts[0].breakpoints, np.concatenate(padded, axis=2))


def _leverage(degree: int, spans: int) -> Array:
    """Distance between neighbouring Greville abscissae, relative to the inner ones."""
    knots = np.concatenate([np.zeros(degree), np.arange(spans + 1), np.full(degree, spans)])
    greville = np.array([knots[k + 1 : k + degree + 1].mean() for k in range(spans + degree)])
    gaps = np.diff(greville)
    return np.minimum(np.concatenate([gaps[:1], gaps]), np.concatenate([gaps, gaps[-1:]]))


@lru_cache(maxsize=32)
def _path_tables(degree: int, spans: int) -> _PathTables:
    return _PathTables(degree, spans)


@lru_cache(maxsize=32)
def _drive_tables(degree: int, breakpoints: tuple[float, ...]) -> _DriveTables:
    return _DriveTables(degree, breakpoints)


class TripSpace:
    """The set of trips with given splines over a given guide: all that stays the same from step to step."""

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
        self.tables = _path_tables(path_degree, path_spans)
        self.drive = _drive_tables(acceleration_degree, tuple(float(s) for s in acceleration_breakpoints))
        self.path = self.tables.path
        self.acceleration = self.drive.acceleration
        self.frame = None if guide.straight else guide.frame(self.tables.node_parameters * self.length)
        self.station_frame = None if guide.straight else guide.frame(self.tables.station_parameters * self.length)

    def in_units(self, length: float, time: float) -> TripSpace:
        """Return the space of trips where lengths are so many times as large, and times too."""
        return TripSpace(
            self.guide.in_units(length),
            self.start_speed * (length / time),
            self.path.coefficients.shape[1] - 1,
            len(self.path.widths),
            self.acceleration.coefficients.shape[1] - 1,
            tuple(self.acceleration.breakpoints.tolist()),
        )

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
        return self.drive.time_table(sigma)

    def travel_time(self, arc_length: float, beta: Array, near: float = 0.0) -> float:
        """Closed form of the travel time ([ZS] section 2)."""
        gain = float(self.drive.final_distance @ beta)
        discriminant = self.start_speed**2 + 4.0 * gain * arc_length
        if discriminant < 0.0:
            return float("inf")
        denominator = self.start_speed + sqrt(discriminant)
        least = 2.0 * arc_length / denominator if denominator > 0.0 else float("inf")
        if near > least and gain < 0.0:
            other = denominator / (-2.0 * gain)
            return other if abs(other - near) < near - least else least
        return least
