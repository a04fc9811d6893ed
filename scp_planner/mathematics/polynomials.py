"""Many vector-valued piecewise polynomials of time, evaluated together."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from itertools import groupby
from math import comb

import numpy as np
from numpy.typing import ArrayLike

from scp_planner.arrays import Array, Index, joined

MOST_INSTANTS = 4  # times the pieces of one polynomial: of so many instants, where any begins a piece, there is a table


@dataclass(frozen=True)
class PiecewisePolynomials:
    """L piecewise polynomials with values in R^d."""

    breakpoints: Array  # (L, S + 1) Increasing times, s; the first and the last piece go on outside them
    coefficients: Array  # (L, S, P, d) Ascending powers

    @classmethod
    def single(cls, origin: float, coefficients: Array) -> PiecewisePolynomials:
        """Return one polynomial of ``t - origin``, for all times, from (P, d) coefficients."""
        return cls(np.array([[origin, np.inf]]), np.asarray(coefficients, dtype=float)[None, None])

    @classmethod
    def stack(cls, items: Sequence[PiecewisePolynomials], width: int = 2) -> PiecewisePolynomials:
        """Return all polynomials of several batches as one."""
        if not items:
            return cls(np.zeros((0, 2)), np.zeros((0, 1, 1, width)))
        # np.concatenate of a thousand small arrays costs less than padding them one by one
        alike = [list(some) for _, some in groupby(items, key=lambda item: item.coefficients.shape[1:])]
        items = [some[0] if len(some) == 1 else joined(some) for some in alike]
        if len(items) == 1:
            return items[0]
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

    def shifted(self, delay: float) -> PiecewisePolynomials:
        """Return the same functions of a clock that shows ``t - delay``."""
        return PiecewisePolynomials(self.breakpoints - delay, self.coefficients)

    def rebased(self, origin: float) -> PiecewisePolynomials:
        """Return the same functions with single pieces expanded about ``origin``; several pieces stay as they are."""
        if self.coefficients.shape[1] != 1:
            return self
        moved = expanded(self.coefficients[:, 0], origin - self.breakpoints[:, 0])[:, None]
        breaks = self.breakpoints.copy()
        breaks[:, 0] = origin
        return PiecewisePolynomials(breaks, moved)

    def in_units(self, value: float, time: float) -> PiecewisePolynomials:
        """Return the same functions where values are so many times as large, and times too."""
        powers = value / np.cumprod(np.r_[1.0, np.full(self.coefficients.shape[2] - 1, time)])
        return PiecewisePolynomials(self.breakpoints * time, self.coefficients * powers[:, None])

    def plus(self, constant: ArrayLike) -> PiecewisePolynomials:
        """Return the functions with a constant (d,) added."""
        coefficients = self.coefficients.copy()
        coefficients[:, :, 0] += np.asarray(constant)
        return PiecewisePolynomials(self.breakpoints, coefficients)

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
    def _common(self) -> bool:
        """True if all have the same breakpoints: then a grid is a matrix product or two."""
        breaks = self.breakpoints
        last = breaks.shape[1] - (1 if breaks.shape[1] == 2 else 0)  # a single piece goes on beyond its end
        return len(breaks) > 0 and bool((breaks[:, :last] == breaks[0, :last]).all())

    @cached_property
    def instants(self) -> Array:
        """All breakpoints between pieces, sorted, (u,) s."""
        inner = self.breakpoints[: 1 if self._common else None, 1:-1]
        return np.unique(inner[np.isfinite(inner)])

    @cached_property
    def _pieces(self) -> Index | None:
        """Piece of each polynomial after so many of these instants, (L, u + 1); None where that would be much."""
        inner, instants = self.breakpoints[:, 1:-1], self.instants
        if len(instants) > MOST_INSTANTS * max(inner.shape[1], 1):
            return None
        table = np.zeros((len(inner), len(instants) + 1), dtype=np.intp)
        for own, breaks in zip(table, inner, strict=True):
            own[1:] = breaks.searchsorted(instants, "right")
        return table

    @cached_property
    def _varying(self) -> Index:
        """Polynomials of several pieces, or that are not constant."""
        constant = ~np.any(self.coefficients[:, :, 1:], axis=(1, 2, 3))
        if self.coefficients.shape[1] > 1:
            constant &= ~np.isfinite(self.breakpoints[:, 1])
        return np.flatnonzero(~constant)

    @cached_property
    def _flat(self) -> Array:
        """Coefficients by pieces and powers, (S, P, L d)."""
        _, pieces, order, _ = self.coefficients.shape
        return np.ascontiguousarray(self.coefficients.transpose(1, 2, 0, 3).reshape(pieces, order, -1))

    @cached_property
    def _flat_with_rate(self) -> Array:
        """Coefficients, and beside them those of the derivatives, (S, P, 2 L d)."""
        flat = self._flat
        rate = np.zeros_like(flat)
        rate[:, :-1] = flat[:, 1:] * np.arange(1, flat.shape[1])[:, None]
        return np.concatenate([flat, rate], axis=2)

    def _product(self, flat: Array, times: Array) -> Array:
        """Values at all times of polynomials with the same breakpoints, (n, ...)."""
        if len(flat) == 1:
            return _powers(times - self.breakpoints[0, 0], flat.shape[1]) @ flat[0]
        breaks = self.breakpoints[0]
        piece = breaks[1:-1].searchsorted(times, "right")
        powers = _powers(times - breaks[piece], flat.shape[1])
        return np.matmul(powers[:, None], flat[piece])[:, 0]

    def grid(self, times: Array) -> Array:
        """Values of all polynomials at all times: (n,) s to (n, L, d)."""
        width = self.coefficients.shape[3]
        if self._common:
            return self._product(self._flat, times).reshape(len(times), self.size, width)
        values, varying = np.empty((len(times), self.size, width)), self._varying
        values[:] = self.coefficients[:, 0, 0]
        index = np.tile(varying, len(times))
        values[:, varying] = self.at(index, np.repeat(times, len(varying))).reshape(len(times), len(varying), width)
        return values

    def grid_with_rate(self, times: Array) -> tuple[Array, Array]:
        """Values of all polynomials at all times, and their derivatives: (n,) s to (n, L, d) each."""
        if not self._common:
            return self.grid(times), self.derivative.grid(times)
        both = self._product(self._flat_with_rate, times)
        both = both.reshape(len(times), 2, self.size, self.coefficients.shape[3])
        return both[:, 0], both[:, 1]

    def at(self, index: Index, times: Array) -> Array:
        """Values of chosen polynomials, each at its own time: (n,) and (n,) s to (n, d)."""
        piece, elapsed = self.locate(index, times)
        return horner(self.coefficients[index, piece].swapaxes(0, 1), elapsed[:, None])

    def at_with_rate(self, index: Index, times: Array) -> tuple[Array, Array]:
        """Values of chosen polynomials and their derivatives, each at its own time, (n, d) each."""
        piece, elapsed = self.locate(index, times)
        local, x = self.coefficients[index, piece], elapsed[:, None]
        value, rate = local[:, -1].copy(), np.zeros_like(local[:, -1])
        for power in range(local.shape[1] - 2, -1, -1):
            rate *= x
            rate += value
            value *= x
            value += local[:, power]
        return value, rate

    def taylor(self, index: Index, times: Array) -> Array:
        """Taylor coefficients of chosen polynomials, each about its own time: (n,) and (n,) s to (n, P, d)."""
        piece, elapsed = self.locate(index, times)
        return expanded(self.coefficients[index, piece], elapsed)

    def size_bounds(self, first: float, last: float) -> Array:
        """Bounds of the sizes of all polynomials on each of their pieces, as far as it is in a span of time."""
        count, pieces, order, width = self.coefficients.shape
        if pieces == 1:
            left, right = np.full(count, first), np.full(count, last)
        else:
            # padding begins, and the last piece ends, at inf
            left = np.minimum(np.maximum(self.breakpoints[:, :-1], first), last)
            left[:, 0] = first
            right = np.minimum(np.maximum(self.breakpoints[:, 1:], first), last)
            right[:, -1] = last
            left, right = left.ravel(), right.ravel()
        begins = self.breakpoints[:, :-1].ravel()
        shift = 0.5 * (left + right) - np.where(np.isfinite(begins), begins, 0.0)
        terms = expanded(self.coefficients.reshape(count * pieces, order, width), shift)
        squares = terms * terms
        if width == 3:
            squares[:, :, 1] *= 2.0
        # NUMPY-CALLS: a sum over so short an axis takes several times as long
        total = squares[:, :, 0]
        for part in range(1, width):
            total += squares[:, :, part]
        sizes = np.sqrt(total)
        radius = 0.5 * (right - left)
        return horner(sizes.T, radius).reshape(count, pieces)

    def of_pieces(self, values: Array, times: Array) -> Array:
        """Return what holds at times, (n,) s, of values of all pieces, (L, S): (n, L), or (1, L) of single pieces."""
        count, pieces = values.shape
        if pieces == 1:
            return values.T
        if self._common:
            found: Array = values[:, self.breakpoints[0, 1:-1].searchsorted(times, "right")].T
            return found
        every = np.tile(np.arange(count), len(times))
        piece, _ = self.locate(every, np.repeat(times, count))
        return values[every, piece].reshape(len(times), count)

    def locate(self, index: Index, times: Array) -> tuple[Index, Array]:
        """Piece and time since its left end, of chosen polynomials at their times."""
        if self.coefficients.shape[1] == 1:
            return np.zeros(len(times), dtype=np.intp), times - self.breakpoints[index, 0]
        if self._common:
            breaks = self.breakpoints[0]
            piece = breaks[1:-1].searchsorted(times, "right")
            return piece, times - breaks[piece]
        if self._pieces is None:
            piece = self._bisected(index, times)
        else:
            piece = self._pieces[index, self.instants.searchsorted(times, "right")]
        return piece, times - self.breakpoints[index, piece]

    def _bisected(self, index: Index, times: Array) -> Index:
        """Piece of chosen polynomials at their times, by halves: comparing with all breakpoints takes much memory."""
        first = np.zeros(len(times), dtype=np.intp)
        beyond = np.full(len(times), self.coefficients.shape[1], dtype=np.intp)
        for _ in range(self.coefficients.shape[1].bit_length()):
            middle = (first + beyond) // 2
            begun = self.breakpoints[index, middle] <= times
            begun |= middle == 0  # the first piece is that of earlier times, too
            first, beyond = np.where(begun, middle, first), np.where(begun, beyond, middle)
        return first


def expanded(coefficients: Array, shift: Array) -> Array:
    """Coefficients (n, P, d) of ascending powers of x to those of powers of x - shift, (n,)."""
    if coefficients.shape[1] == 1:
        return coefficients
    return np.matmul(shift_matrices(coefficients.shape[1], shift), coefficients)


def horner(coefficients: Array, x: Array) -> Array:
    """Values of polynomials with ascending coefficients along the first axis, (P, ...), at x."""
    value: Array = coefficients[-1].copy()
    for part in coefficients[-2::-1]:
        value *= x
        value += part
    return value


def shift_matrices(order: int, shift: Array) -> Array:
    """Matrices from ascending coefficients of powers of x to those of powers of x - shift, (n,) to (n, P, P)."""
    factors, exponents = _shift_table(order)
    matrices: Array = _powers(shift, order)[:, exponents]
    matrices *= factors
    return matrices


def _powers(x: Array, order: int) -> Array:
    """Powers 0, 1, ... order - 1 of numbers, (n, order)."""
    powers = np.empty((len(x), order))
    powers[:, 0] = 1.0
    for power in range(1, order):
        np.multiply(powers[:, power - 1], x, out=powers[:, power])
    return powers


@lru_cache(maxsize=16)
def _shift_table(order: int) -> tuple[Array, Index]:
    """Factors binomial(k, j), 0 for k < j, and exponents k - j of the shift, (P, P) each, with j first."""
    factors = np.array([[comb(k, j) for k in range(order)] for j in range(order)], dtype=float)
    exponents = np.maximum(np.arange(order) - np.arange(order)[:, None], 0)
    return factors, exponents
