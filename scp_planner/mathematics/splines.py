"""Clamped B-spline bases as piecewise polynomials: exact values, derivatives and antiderivatives."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property, lru_cache
from math import factorial

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BSpline

from scp_planner.arrays import Array, Index
from scp_planner.mathematics.polynomials import horner

MOST_GATHERED = 4_000_000  # coefficients at once, for values at many parameters


@dataclass(frozen=True)
class PiecewiseBasis:
    """K piecewise polynomials on [0, 1] that share their breakpoints."""

    breakpoints: Array  # (M + 1,) Ends of the M spans, increasing, from 0 to 1
    coefficients: Array  # (M, P, K) Coefficients of ascending powers of the local parameter x in [0, 1] of each span

    @cached_property
    def widths(self) -> Array:
        """Widths of the spans, (M,)."""
        return np.diff(self.breakpoints)

    @property
    def size(self) -> int:
        """Number K of basis functions."""
        return int(self.coefficients.shape[2])

    @cached_property
    def _uniform(self) -> float:
        """Number of spans if they are all equally wide, else 0 (then spans are found by bisection)."""
        spans = len(self.widths)
        return float(spans) if np.allclose(self.widths, 1.0 / spans, rtol=0, atol=1e-13) else 0.0

    def locate(self, parameters: Array) -> tuple[Index, Array]:
        """Span index and local parameter of each parameter; outside [0, 1] the end spans continue."""
        last = len(self.widths) - 1
        if self._uniform:
            scaled = parameters * self._uniform
            span = np.minimum(np.maximum(scaled.astype(np.intp), 0), last)
            return span, scaled - span
        span = np.minimum(np.maximum(np.searchsorted(self.breakpoints, parameters, "right") - 1, 0), last)
        return span, (parameters - self.breakpoints[span]) / self.widths[span]

    def rows(self, parameters: Array) -> Array:
        """Values of all basis functions: (n,) parameters to an (n, K) matrix."""
        span, x = self.locate(np.asarray(parameters, dtype=float))
        return self.rows_at(span, x)

    def rows_at(self, span: Index, x: Array) -> Array:
        """Values of all basis functions at located parameters, (n, K)."""
        _, order, size = self.coefficients.shape
        powers = x[:, None] ** _exponents(order)
        at_once = max(1, MOST_GATHERED // (order * size))
        if len(span) <= at_once:
            return np.matmul(powers[:, None, :], self.coefficients[span])[:, 0, :]
        rows = np.empty((len(span), size))
        for begin in range(0, len(span), at_once):
            part = slice(begin, begin + at_once)
            rows[part] = np.matmul(powers[part, None, :], self.coefficients[span[part]])[:, 0, :]
        return rows

    def weights_at(self, span: NDArray[np.intp], x: Array) -> Iterator[tuple[NDArray[np.intp], Array]]:
        """Give the values of `rows_at` without those that are zero in all of a span, at located parameters."""
        order = self.coefficients.shape[1]
        powers = x[:, None] ** _exponents(order)
        for further in range(order):
            index = span + further
            yield index, np.einsum("np,np->n", powers, self.coefficients[span, :, index])

    @cached_property
    def derivative(self) -> PiecewiseBasis:
        """The basis of the first derivatives."""
        order = self.coefficients.shape[1]
        if order == 1:
            return PiecewiseBasis(self.breakpoints, np.zeros_like(self.coefficients))
        factors = np.arange(1, order)[None, :, None] / self.widths[:, None, None]
        return PiecewiseBasis(self.breakpoints, self.coefficients[:, 1:] * factors)

    @cached_property
    def antiderivative(self) -> PiecewiseBasis:
        """The basis of the antiderivatives that vanish at 0; continuous, one degree higher."""
        spans, order, size = self.coefficients.shape
        integrated = np.zeros((spans, order + 1, size))
        factors = self.widths[:, None, None] / np.arange(1, order + 1)[None, :, None]
        integrated[:, 1:] = self.coefficients * factors
        integrated[1:, 0] = np.cumsum(integrated.sum(axis=1), axis=0)[:-1]
        return PiecewiseBasis(self.breakpoints, integrated)

    def combine(self, weights: Array) -> Array:
        """Local power coefficients, (M, P), of the one spline with these weights, (K,)."""
        return self.coefficients @ weights


def evaluate(coefficients: Array, span: Index, x: Array) -> Array:
    """Value of a spline given by local power coefficients, (M, P), at located parameters, (n,)."""
    return horner(coefficients[span].T, x)


@lru_cache(maxsize=64)
def _exponents(order: int) -> NDArray[np.int64]:
    return np.arange(order)


@lru_cache(maxsize=256)
def clamped_basis(degree: int, breakpoints: tuple[float, ...]) -> PiecewiseBasis:
    """B-spline basis of a degree over breakpoints in [0, 1], full multiplicity at both ends."""
    breaks = np.asarray(breakpoints, dtype=float)
    knots = clamped_knots(degree, breaks)
    size = len(knots) - degree - 1
    spline = BSpline(knots, np.eye(size), degree)
    widths = np.diff(breaks)
    coefficients = np.empty((len(widths), degree + 1, size))
    for power in range(degree + 1):
        # The spline is smooth inside a span: its Taylor coefficients at the middle, shifted to the left end,
        # avoid the one-sided limits at knots.
        coefficients[:, power] = (
            spline(breaks[:-1] + 0.5 * widths, nu=power) * ((widths**power / factorial(power))[:, None])
        )
    return PiecewiseBasis(breaks, np.einsum("pq,mqk->mpk", _shift_matrix(degree + 1, -0.5), coefficients))


def clamped_knots(degree: int, breakpoints: Array) -> Array:
    """Knot vector with the end breakpoints repeated ``degree + 1`` times."""
    return np.concatenate([np.full(degree, breakpoints[0]), breakpoints, np.full(degree, breakpoints[-1])])


@lru_cache(maxsize=64)
def antiderivative_control_points(degree: int, breakpoints: tuple[float, ...]) -> Array:
    """Matrix from control points of a spline on [0, 1] to those of its antiderivative that vanishes at 0."""
    knots = clamped_knots(degree, np.asarray(breakpoints, dtype=float))
    size = len(knots) - degree - 1
    raised = BSpline(knots, np.eye(size), degree).antiderivative()
    points = np.zeros((size + 1, size))
    points[:] = raised.c[: size + 1]
    return points


def _shift_matrix(order: int, shift: float) -> Array:
    """Matrix that re-expands ascending powers of x about another origin: p(x + shift)."""
    matrix = np.zeros((order, order))
    for row in range(order):
        for column in range(row, order):
            matrix[row, column] = (
                factorial(column) / (factorial(row) * factorial(column - row)) * shift ** (column - row)
            )
    return matrix


@lru_cache(maxsize=64)
def greville_sites(breakpoints: tuple[float, ...], degree: int) -> Array:
    """Sites in normalised time that the control points of a clamped spline belong to."""
    breaks = np.array(breakpoints)
    if degree == 0:
        return 0.5 * (breaks[1:] + breaks[:-1])
    knots = np.concatenate([np.full(degree, breaks[0]), breaks, np.full(degree, breaks[-1])])
    count = len(knots) - degree - 1
    return np.array([knots[k + 1 : k + degree + 1].mean() for k in range(count)])
