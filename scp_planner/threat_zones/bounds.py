"""Bounds of motions and of their sizes on intervals of time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from scp_planner.arrays import Array, Index, Mask
from scp_planner.mathematics.intervals import Interval
from scp_planner.mathematics.polynomials import PiecewisePolynomials


@dataclass(frozen=True)
class MovingPoint:
    """A point on intervals of time.

    Attributes
    ----------
    time, half : (n,) arrays
        Middles on the planning clock and half widths of the intervals, s.
    position, velocity : (n, 2) arrays
        In the middles, planning frame, m and m/s.
    acceleration : (n,) array
        Bounds of the size of the second derivative on the intervals, m/s^2.
    """

    time: Array
    half: Array
    position: Array
    velocity: Array
    acceleration: Array

    def take(self, part: slice) -> MovingPoint:
        """Return some of the intervals."""
        return MovingPoint(
            self.time[part], self.half[part], self.position[part], self.velocity[part], self.acceleration[part]
        )


@dataclass(frozen=True)
class DistanceBounds:
    """Distances in the middles of intervals of time and lower bounds on whole intervals, (n,) m each."""

    value: Array
    lower: Array


def _ranges(polynomials: PiecewisePolynomials, index: Index, times: Array, half: Array) -> tuple[Interval, Interval]:
    """Ranges of both components of chosen polynomials on intervals."""
    terms = _taylor(polynomials, index, times)
    radius = np.zeros((len(index), 2))
    for order, term in enumerate(terms[1:], start=1):
        radius += np.abs(term) * (half**order)[:, None]
    lower, upper = terms[0] - radius, terms[0] + radius
    return Interval(lower[:, 0], upper[:, 0]), Interval(lower[:, 1], upper[:, 1])


def _size_bound(polynomials: PiecewisePolynomials, index: Index, times: Array, half: Array) -> Array:
    """Bound of the norm of packed symmetric matrices on intervals."""
    bound = np.zeros(len(index))
    for order, term in enumerate(_taylor(polynomials, index, times)):
        bound += np.sqrt(term[:, 0] ** 2 + 2.0 * term[:, 1] ** 2 + term[:, 2] ** 2) * half**order
    return bound


def _taylor(polynomials: PiecewisePolynomials, index: Index, times: Array) -> Array:
    """Taylor coefficients of chosen polynomials about their times, by their orders, (P, n, d)."""
    return polynomials.taylor(index, times).transpose(1, 0, 2)


def _broken(polynomials: PiecewisePolynomials, first: float, last: float) -> Mask:
    """Whether each has a breakpoint between two times, (L,)."""
    inner = polynomials.breakpoints[:, 1:-1]
    broken: Mask = np.any((inner > first) & (inner < last), axis=1)
    return broken


def _magnitude_bound(polynomials: PiecewisePolynomials, index: Index, times: Array, half: Array) -> Array:
    bound = np.zeros(len(index))
    for order, term in enumerate(_taylor(polynomials, index, times)):
        bound += np.hypot(term[:, 0], term[:, 1]) * half**order
    return bound


def _second_bound(sizes: Array, half: Array) -> Array:
    """Bound of a second derivative on intervals by the sizes of Taylor's coefficients in the middles, (n, P)."""
    bound = np.zeros(len(half))
    for order in range(sizes.shape[1] - 1, 1, -1):
        bound *= half
        bound += (order * (order - 1)) * sizes[:, order]
    return bound


def _root_bounds(terms: Array, half: Array) -> tuple[Array, Array]:
    """The derivative of sqrt(s) in the middles of intervals, and upper bounds of the second one on all of them.

    (sqrt s)'' <= max(s'', 0) / (2 sqrt s), since the other term is negative. ``terms`` are Taylor's coefficients of s
    in the middles, (n, P).
    """
    sizes = np.abs(terms)
    spread = np.zeros(len(half))
    for order in range(terms.shape[1] - 1, 0, -1):
        spread += sizes[:, order]
        spread *= half
    least = terms[:, 0] - spread
    upper = np.zeros(len(half))
    if terms.shape[1] > 2:
        sizes[:, 2] = 0.0
        upper = np.maximum(2.0 * terms[:, 2] + _second_bound(sizes, half), 0.0)
    bend = upper / (2.0 * np.sqrt(np.maximum(least, 1e-300)))
    bend[~(least > 0.0)] = np.inf
    bend[(upper == 0.0)] = 0.0
    rate = np.zeros(len(half))
    if terms.shape[1] > 1:
        rate = terms[:, 1] / np.maximum(2.0 * np.sqrt(np.maximum(terms[:, 0], 0.0)), 1e-300)
    return rate, bend


def _directed_range(
    polynomials: PiecewisePolynomials, index: Index, times: Array, half: Array, weights: Array
) -> Interval:
    terms = [np.einsum("ij,ij->i", weights, term) for term in _taylor(polynomials, index, times)]
    radius = np.zeros(len(index))
    for order, term in enumerate(terms[1:], start=1):
        radius += np.abs(term) * half**order
    return Interval.around(terms[0], radius)
