"""The arc length of a path to within a proven distance: what trips are driven by."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from sys import float_info

import numpy as np

from scp_planner.arrays import Array, Index
from scp_planner.mathematics.polynomials import horner
from scp_planner.mathematics.quadrature import gauss_rule
from scp_planner.trips.tolerances import ARC_ROUNDING, SPEED_ERROR


@dataclass(frozen=True)
class ArcTable:
    """Size of the table of a path's arc length."""

    most_halvings: int = 24  # of a cell
    most_cells: int = 20_000  # after which no cell is halved any more
    order: int = 8  # Gauss nodes a cell
    # Chebyshev's: so many coefficients s^2 has, and |r'|^2 with offsets of degree 5 over a curved guide
    points: int = 15
    most_steps: int = 80  # of Newton or of bisection


TABLE = ArcTable()

Speeds = Callable[[Array], Array]
"""Speeds over the station |r'| at normalised stations, (n,)."""


@dataclass(frozen=True)
class _Rule:
    """Nodes and weights that a cell is fitted and judged by, its stations taken from -1 to 1."""

    nodes: Array  # (ORDER,) Gauss'
    to_powers: Array  # (ORDER, ORDER) From values at the nodes, in rows, to coefficients of the polynomial through them
    points: Array  # (POINTS,) Chebyshev's
    to_values: Array  # (ORDER, POINTS) From coefficients to values there
    to_coefficients: Array  # (POINTS, POINTS) From values there to coefficients of Chebyshev polynomials


@cache
def _rule() -> _Rule:
    nodes = gauss_rule(TABLE.order).nodes
    angles = np.pi * (np.arange(TABLE.points) + 0.5) / TABLE.points
    to_coefficients = (2.0 / TABLE.points) * np.cos(np.arange(TABLE.points)[:, None] * angles)
    to_coefficients[0] *= 0.5
    to_powers: Array = np.linalg.inv(np.vander(nodes, TABLE.order, increasing=True)).astype(np.float64)
    to_values = np.vander(np.cos(angles), TABLE.order, increasing=True)
    return _Rule(nodes, to_powers.T, np.cos(angles), to_values.T, to_coefficients.T)


class ArcLength:
    """Arc lengths of a path up to stations, and back."""

    def __init__(self, speeds: Speeds, length: float, edges: Array) -> None:
        self._speeds = speeds
        left, width = edges[:-1], np.diff(edges)
        cells = self._fitted(left, width)
        off = self._strays(left, width, cells)
        for _ in range(TABLE.most_halvings):
            bad = ~(off <= SPEED_ERROR)
            if not bad.any() or len(left) > TABLE.most_cells:
                break
            half = 0.5 * width[bad]
            begins, halves = np.concatenate([left[bad], left[bad] + half]), np.concatenate([half, half])
            fitted = self._fitted(begins, halves)
            left, width = np.concatenate([left[~bad], begins]), np.concatenate([width[~bad], halves])
            cells = np.concatenate([cells[~bad], fitted])
            off = np.concatenate([off[~bad], self._strays(begins, halves, fitted)])
        order = np.argsort(left, kind="stable")
        self._left, self._width = left[order], width[order]
        self._rates = cells[order] * (0.5 * length * self._width)[:, None]
        self._driven = np.zeros((len(order), TABLE.order + 1))
        self._driven[:, 1:] = self._rates / np.arange(1, TABLE.order + 1)
        self._driven[:, 0] = -horner(self._driven.T, np.full(len(order), -1.0))
        self.until = np.zeros(len(order) + 1)
        self._lengths = self._driven.sum(axis=1)
        np.cumsum(self._lengths, out=self.until[1:])
        self.error = float(off[order] @ self._lengths) if bool(np.all(off <= SPEED_ERROR)) else float("inf")

    @property
    def total(self) -> float:
        """Arc length of the whole path, m."""
        return float(self.until[-1])

    def _at(self, left: Array, width: Array, points: Array) -> Array:
        """Speeds over the station at points of cells, given from -1 to 1, (cells, points)."""
        stations = left[:, None] + (0.5 * width)[:, None] * (1.0 + points)
        return self._speeds(stations.ravel()).reshape(stations.shape)

    def _fitted(self, left: Array, width: Array) -> Array:
        """Coefficients of what interpolates the speed on cells, (cells, ORDER)."""
        rule = _rule()
        fitted: Array = self._at(left, width, rule.nodes) @ rule.to_powers
        return fitted

    def _strays(self, left: Array, width: Array, cells: Array) -> Array:
        """By which share of itself the interpolated speed is off at most, anywhere on each cell; inf if unknown."""
        rule = _rule()
        speeds, fitted = self._at(left, width, rule.points), cells @ rule.to_values
        difference = np.abs((speeds * speeds - fitted * fitted) @ rule.to_coefficients).sum(axis=1)
        shape = fitted @ rule.to_coefficients
        least = shape[:, 0] - np.abs(shape[:, 1:]).sum(axis=1)
        known = least > 0.0
        return np.where(known, difference / np.where(known, least * least, 1.0), np.inf)

    def at(self, parameters: Array) -> Array:
        """Arc length up to normalised stations, (n,), in m."""
        parameters = np.clip(np.asarray(parameters, dtype=float), 0.0, 1.0)
        cell = self._left[1:].searchsorted(parameters, "right")
        x = 2.0 * (parameters - self._left[cell]) / self._width[cell] - 1.0
        return self.until[cell] + horner(self._driven.T[:, cell], x)

    def parameter_at(self, distance: Array) -> Array:
        """Normalised stations up to which the arc length is ``distance``, (n,) m, to rounding; clamped at the ends."""
        distance = np.minimum(np.maximum(distance, 0.0), self.total)
        cell = self.until[1:-1].searchsorted(distance, "right")
        x = self._found(cell, distance - self.until[cell])
        return self._left[cell] + (0.5 * self._width[cell]) * (1.0 + x)

    def _found(self, cell: Index, target: Array) -> Array:
        """Places in cells, from -1 to 1, where arc lengths reach targets, (n,): by Newton's steps, or bisection."""
        if len(target) == 1:
            return np.array([self._found_one(int(cell[0]), float(target[0]))])
        driven, rates = self._driven.T[:, cell], self._rates.T[:, cell]
        low, high = np.full_like(target, -1.0), np.ones_like(target)
        x = 2.0 * target / np.maximum(driven.sum(axis=0), float_info.min) - 1.0
        for _ in range(TABLE.most_steps):
            excess = horner(driven, x) - target
            if bool(np.all(np.abs(excess) <= ARC_ROUNDING * self.total)):
                break
            low, high = np.where(excess <= 0.0, x, low), np.where(excess >= 0.0, x, high)
            rate = horner(rates, x)
            newton = x - excess / np.where(rate > 0.0, rate, np.inf)
            x = np.where((newton >= low) & (newton <= high), newton, 0.5 * (low + high))
        return x

    def _found_one(self, cell: int, target: float) -> float:
        """Station of one target in plain numbers, with the bits of the batch: NUMPY-CALLS."""
        driven, rates = self._driven[cell, ::-1].tolist(), self._rates[cell, ::-1].tolist()
        low, high, close = -1.0, 1.0, ARC_ROUNDING * self.total
        x = 2.0 * target / max(float(self._lengths[cell]), float_info.min) - 1.0
        for _ in range(TABLE.most_steps):
            excess = _in_numbers(driven, x) - target
            if abs(excess) <= close:
                break
            low, high = x if excess <= 0.0 else low, x if excess >= 0.0 else high
            rate = _in_numbers(rates, x)
            newton = x - (excess / rate if rate > 0.0 else 0.0)
            x = newton if low <= newton <= high else 0.5 * (low + high)
        return x


def _in_numbers(coefficients: Sequence[float], x: float) -> float:
    """Value of a polynomial, its coefficients from the highest power down."""
    value = 0.0
    for coefficient in coefficients:
        value = value * x + coefficient
    return value
