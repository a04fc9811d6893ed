"""Many vector-valued piecewise polynomials of time, evaluated together."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Index = NDArray[np.intp]


@dataclass(frozen=True)
class PiecewisePolynomials:
    """L piecewise polynomials with values in R^d.

    Attributes
    ----------
    breakpoints : (L, S + 1) array
        Increasing times, s; the first and the last piece go on outside them. The powers of a piece are those of
        ``t - left end``. Polynomials with fewer pieces are padded with pieces that begin at +inf.
    coefficients : (L, S, P, d) array
        Ascending powers.
    """

    breakpoints: Array
    coefficients: Array

    @classmethod
    def single(cls, origin: float, coefficients: Array) -> PiecewisePolynomials:
        """Return one polynomial of ``t - origin``, for all times, from (P, d) coefficients."""
        return cls(np.array([[origin, np.inf]]), np.asarray(coefficients, dtype=float)[None, None])

    @classmethod
    def stack(cls, items: Sequence[PiecewisePolynomials], width: int = 2) -> PiecewisePolynomials:
        """Return all polynomials of several batches as one."""
        if not items:
            return cls(np.zeros((0, 2)), np.zeros((0, 1, 1, width)))
        shapes = {item.coefficients.shape[1:] for item in items}
        if len(shapes) == 1:
            # np.concatenate of a thousand small arrays costs less than padding them one by one
            return cls(
                np.concatenate([item.breakpoints for item in items]),
                np.concatenate([item.coefficients for item in items]),
            )
        pieces = max(item.coefficients.shape[1] for item in items)
        powers = max(item.coefficients.shape[2] for item in items)
        breakpoints, coefficients = [], []
        for item in items:
            count, have, order, _ = item.coefficients.shape
            breaks = np.full((count, pieces + 1), np.inf)
            breaks[:, :have] = item.breakpoints[:, :have]  # the last piece goes on, padding never begins
            padded = np.zeros((count, pieces, powers, item.coefficients.shape[3]))
            padded[:, :have, :order] = item.coefficients
            breakpoints.append(breaks)
            coefficients.append(padded)
        return cls(np.concatenate(breakpoints), np.concatenate(coefficients))

    @property
    def size(self) -> int:
        """Number L of polynomials."""
        return int(self.coefficients.shape[0])

    def take(self, index: Index) -> PiecewisePolynomials:
        """Return some of the polynomials."""
        return PiecewisePolynomials(self.breakpoints[index], self.coefficients[index])

    def shifted(self, delay: float) -> PiecewisePolynomials:
        """Return the same functions of a clock that shows ``t - delay``."""
        return PiecewisePolynomials(self.breakpoints - delay, self.coefficients)

    def rebased(self, origin: float) -> PiecewisePolynomials:
        """Return the same functions with single pieces expanded about ``origin``; several pieces stay as they are."""
        if self.coefficients.shape[1] != 1:
            return self
        from math import comb

        shift = origin - self.breakpoints[:, 0]
        order = self.coefficients.shape[2]
        moved = np.zeros_like(self.coefficients)
        for low in range(order):
            for high in range(low, order):
                factor = comb(high, low) * shift ** (high - low)
                moved[:, 0, low] += factor[:, None] * self.coefficients[:, 0, high]
        breaks = self.breakpoints.copy()
        breaks[:, 0] = origin
        return PiecewisePolynomials(breaks, moved)

    def rounded(self, constant: int, others: int) -> PiecewisePolynomials:
        """Return polynomials with their constants, and their other coefficients, rounded to so many decimals."""
        coefficients = np.round(self.coefficients, others)
        coefficients[:, :, 0] = np.round(self.coefficients[:, :, 0], constant)
        return PiecewisePolynomials(self.breakpoints, coefficients)

    @cached_property
    def derivative(self) -> PiecewisePolynomials:
        """The derivatives with respect to time."""
        order = self.coefficients.shape[2]
        if order == 1:
            return PiecewisePolynomials(self.breakpoints, np.zeros_like(self.coefficients))
        factors = np.arange(1, order)[:, None]
        return PiecewisePolynomials(self.breakpoints, self.coefficients[:, :, 1:] * factors)

    @cached_property
    def _common_origin(self) -> float | None:
        """The one origin of all, if there is one piece each: then a grid is one matrix product."""
        if self.coefficients.shape[1] != 1 or self.size == 0:
            return None
        origins = self.breakpoints[:, 0]
        return float(origins[0]) if np.all(origins == origins[0]) else None

    @cached_property
    def _flat(self) -> Array:
        """Coefficients with the powers first, (P, L d)."""
        order = self.coefficients.shape[2]
        return np.ascontiguousarray(self.coefficients[:, 0].transpose(1, 0, 2).reshape(order, -1))

    def grid(self, times: Array) -> Array:
        """Values of all polynomials at all times: (n,) s to (n, L, d)."""
        order, width = self.coefficients.shape[2:]
        origin = self._common_origin
        if origin is not None:
            elapsed = times - origin
            powers = np.empty((len(times), order))
            powers[:, 0] = 1.0
            for power in range(1, order):
                np.multiply(powers[:, power - 1], elapsed, out=powers[:, power])
            return (powers @ self._flat).reshape(len(times), self.size, width)
        index = np.tile(np.arange(self.size), len(times))
        return self.at(index, np.repeat(times, self.size)).reshape(len(times), self.size, width)

    def at(self, index: Index, times: Array) -> Array:
        """Values of chosen polynomials, each at its own time: (n,) and (n,) s to (n, d)."""
        piece, elapsed = self.locate(index, times)
        local = self.coefficients[index, piece]
        value = local[:, -1].copy()
        for power in range(local.shape[1] - 2, -1, -1):
            value *= elapsed[:, None]
            value += local[:, power]
        return value

    def locate(self, index: Index, times: Array) -> tuple[Index, Array]:
        """Piece and time since its left end, of chosen polynomials at their times."""
        if self.coefficients.shape[1] == 1:
            piece = np.zeros(len(times), dtype=np.intp)
        else:
            piece = (times[:, None] >= self.breakpoints[index, 1:-1]).sum(axis=1)
        return piece, times - self.breakpoints[index, piece]
