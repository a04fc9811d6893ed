"""Polynomial motions of many obstacles at once, and how far their standardised errors go."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from scp_planner.arrays import Array
from scp_planner.mathematics.polynomials import shift_matrices
from scp_planner.tracking.change_hypotheses import ChangeHypotheses
from scp_planner.tracking.futures import Future, length_rule
from scp_planner.tracking.motion_estimate import HORIZON, least_variances, sums_of_powers
from scp_planner.tracking.recursive import SquareRoots


@dataclass(frozen=True)
class PolynomialMotions:
    """K motions as they are estimated, in powers of the time since the middle of what was seen of each."""

    coefficients: Array  # (K, p, 2) Relative to their origins, m/s^k
    spread: Array  # (K, p, p) Covariance of each component of them, over that of the noise
    noise: Array  # (K, 3) Elements xx, xy, yy of the covariance of every observation, m^2
    origin: Array  # (K, 2) m
    first: Array  # (K,) s
    last: Array  # (K,) s
    middle: Array  # (K,) s

    @classmethod
    def of(
        cls,
        roots: SquareRoots,
        sigma: Array,
        manoeuvre: float = 0.0,
        change_hypotheses: ChangeHypotheses | None = None,
    ) -> PolynomialMotions:
        """Return motions of one order, as they are estimated from observations with covariances (K, 2, 2), m^2."""
        middle, first, last = roots.center, roots.first, roots.last
        inverse = np.linalg.inv(roots.factor)
        spread, coefficients = inverse @ inverse.transpose(0, 2, 1), inverse @ roots.right
        if manoeuvre > 0.0:
            change = manoeuvre**2 / least_variances(sigma)
            spread, coefficients = _with_manoeuvre(spread, coefficients, last - middle, change)
        if change_hypotheses is not None and change_hypotheses.probability.any():
            spread = _padded(spread, 3) + change_hypotheses.spread
            coefficients = _padded(coefficients, 2) + change_hypotheses.shift
        return cls(coefficients, spread, sigma[:, [0, 0, 1], [0, 1, 1]], roots.origin, first, last, middle)

    @property
    def terms(self) -> int:
        """Number p of coefficients."""
        return int(self.coefficients.shape[1])

    def future(self, start: float) -> Future:
        """Predictions from a time on, s."""
        count, terms = self.coefficients.shape[:2]
        shift = shift_matrices(terms, start - self.middle)
        center = shift @ self.coefficients
        center[:, 0] += self.origin
        local = shift @ self.spread @ shift.transpose(0, 2, 1)
        growth = local.reshape(count, -1) @ sums_of_powers(terms).T
        covariance = growth[:, :, None] * self.noise[:, None]
        rates = self.noise[:, [0, 1, 1, 2]].reshape(-1, 2, 2)
        rates = local[:, 1:, 1:][:, :1, :1] * rates if terms > 1 else np.zeros((count, 2, 2))
        return Future(np.array([start, start + HORIZON]), center[:, None], covariance[:, None], rates)

    def lengths(self, start: float) -> Array:
        """Standardised lengths over `HORIZON` from a time on, s: (K,)."""
        clocks = np.stack([self.first, self.last, self.middle])
        # if all were seen at the same times
        alike = bool((clocks == clocks[:, :1]).all() and (self.spread == self.spread[0]).all())
        some = slice(1 if alike else None)
        (first, last, middle), spread = clocks[:, some], self.spread[some]
        half, about = np.where(last > first, 0.5 * (last - first), 1.0), 0.5 * (first + last)
        shift = shift_matrices(self.terms, about - middle)  # u = about + half s
        shift *= half[:, None, None] ** np.arange(self.terms)[:, None]
        local = shift @ spread @ shift.transpose(0, 2, 1)
        found = _lengths(local, (start - about) / half, (start + HORIZON - about) / half)
        return np.repeat(found, len(self.first)) if alike else found


def _with_manoeuvre(spread: Array, coefficients: Array, last: Array, change: Array) -> tuple[Array, Array]:
    """Allow for changes of acceleration at times ``last``; see `PolynomialEstimate.with_manoeuvre`."""
    shift = np.empty((len(last), 3))
    shift[:, 0], shift[:, 1], shift[:, 2] = 0.5 * (last * last), -last, 0.5
    return _padded(spread, 3) + change[:, None, None] * shift[:, :, None] * shift[:, None], _padded(coefficients, 2)


def _padded(values: Array, width: int) -> Array:
    """Values (K, p, ...) of motions of any order as those of order 2, (K, 3, width)."""
    count, terms, given = values.shape
    if terms == 3:
        return values
    padded = np.zeros((count, 3, width))
    padded[:, :terms, :given] = values
    return padded


def _lengths(spread: Array, start: Array, stop: Array) -> Array:
    """Standardised lengths of K polynomial motions over spans of normalised time, (K,)."""
    order = spread.shape[1] - 1
    if order == 0:
        return np.zeros(len(spread))
    nodes, weights = length_rule()
    low, high = np.arctan(start), np.arctan(stop)
    angles = low[:, None] + (high - low)[:, None] * nodes
    sine, cosine = np.sin(angles), np.cos(angles)
    x, y = np.empty((2, *angles.shape, order + 1))
    if order == 1:
        x[..., 0], x[..., 1] = cosine, sine
        y[..., 0], y[..., 1] = -sine, cosine
    else:
        both, squares = sine * cosine, (cosine * cosine, sine * sine)
        x[..., 0], x[..., 1], x[..., 2] = squares[0], both, squares[1]
        y[..., 0], y[..., 1], y[..., 2] = -2.0 * both, squares[0] - squares[1], 2.0 * both
    weighted = x @ spread
    error, cross, rate = _summed(weighted * x), _summed(weighted * y), _summed((y @ spread) * y)
    speed = np.sqrt(np.maximum(rate * error - cross * cross, 0.0)) / error
    return (high - low) * (speed @ weights)


def _summed(terms: Array) -> Array:
    """Sums over the last axis of two or three: a sum of numpy over so short an axis takes several times as long."""
    total: Array = terms[..., 0] + terms[..., 1]
    for term in range(2, terms.shape[-1]):
        total += terms[..., term]
    return total
