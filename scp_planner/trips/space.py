"""Times at which a trip is looked at, and the splines there."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from scp_planner.arrays import Array, Index
from scp_planner.mathematics.splines import PiecewiseBasis, antiderivative_control_points, clamped_basis

QUADRATURE_ORDER = 6  # Gauss nodes a cell: 4 left jumps of 1e-5 m/s in the speed over ground between cells
CELLS_PER_SPAN = 5  # the ends of cells are the stations at which curvature is limited
_POWERS = np.arange(1, QUADRATURE_ORDER + 1)


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
