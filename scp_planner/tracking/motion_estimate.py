"""Estimated motion of an obstacle: expected centre and its covariance at any time."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike

from scp_planner.arrays import Array
from scp_planner.errors import EstimationError
from scp_planner.mathematics.polynomials import shift_matrices
from scp_planner.mathematics.quadrature import gauss_rule
from scp_planner.tracking.confidence import ErrorLaw, HotellingErrors, alpha_of_one, uniform_scale
from scp_planner.tracking.tolerances import EQUAL_EIGENVALUES, PLACE_TOLERANCE

HORIZON = 120.0  # units of time; longest trip that motions are predicted for
POLYNOMIAL_TERMS = 5  # degree 4: the covariance of a quadratic motion
PANEL_NODES, MOST_PANELS = 12, 1024  # of the quadrature of standardised lengths


@dataclass(frozen=True)
class MotionPolynomials:
    """The estimated centre and its covariance over a span of time, as piecewise polynomials."""

    breakpoints: Array  # Increasing
    center: Array  # Coefficient of power k of the estimated centre
    covariance: Array  # Coefficient of power k of the entries xx, xy, yy of the covariance of the estimated centre
    center_error: float = 0.0  # Bound on the distance from `MotionEstimate.position`; 0 where the polynomials are exact


class MotionEstimate(ABC):
    """A predicted centre and the covariance of its error at any time.

    Attributes
    ----------
    reference_time : float, s
        Time of the last observation; ``velocity`` and ``acceleration`` are at this time.
    order : int
        What the prediction keeps up: 0 the position, 1 the velocity, 2 the acceleration.
    observations : int
        How many the estimate is made from.
    noise_covariance : (2, 2) m^2
        Of one observation, as given or as estimated; the mean of those used where each has its own.
    errors : ErrorLaw
        The distribution of the standardised error.
    regressors : int or None
        p, if the error is that of a regression on p functions of time with one covariance for all
        observations.
    """

    reference_time: float
    order: int
    observations: int
    noise_covariance: Array
    errors: ErrorLaw
    regressors: int | None

    @property
    def degrees_of_freedom(self) -> float | None:
        """Degrees of freedom of the estimated noise covariance, a number; None if the covariance is known."""
        return self.errors.degrees_of_freedom if isinstance(self.errors, HotellingErrors) else None

    @property
    def earliest(self) -> float:
        """Earliest time that it tells of, s."""
        return -math.inf

    @property
    @abstractmethod
    def velocity(self) -> Array:
        """Estimated velocity at the reference time: (2,) m/s."""

    @property
    @abstractmethod
    def acceleration(self) -> Array:
        """Estimated acceleration at the reference time: (2,) m/s^2."""

    @abstractmethod
    def position(self, t: ArrayLike) -> Array:
        """Estimated centre at times t (...), s: (..., 2) m."""

    @abstractmethod
    def covariance(self, t: ArrayLike) -> Array:
        """Covariance of the error of the estimated centre at times t (...), s: (..., 2, 2) m^2."""

    @abstractmethod
    def rate(self, t: float) -> tuple[Array, Array]:
        """Estimated velocity at a time, s, (2,) m/s, and the covariance of its error, (2, 2) m^2/s^2."""

    @abstractmethod
    def polynomials(self, start: float, stop: float) -> MotionPolynomials:
        """Centre and covariance over [start, stop], s, as piecewise polynomials in time."""

    @abstractmethod
    def standardised_length(self, start: float, stop: float) -> float:
        """Path length of the standardised error over [start, stop], a number: a region's scale depends on it.

        With w(t) = C(t)^-1/2 e(t), and Lambda(t) the covariance of dw/dt given w(t), it is the integral over
        time of E[(u' Lambda u)^1/2], u uniform on the unit circle. If C(t) = h(t) Sigma, it is the length of
        the curve x_t / |x_t| on the sphere, lengths measured by (X'X)^-1.
        """


def region_scale(
    level: str,
    probability: float,
    estimate: MotionEstimate,
    *,
    obstacles: int = 1,
    start: float = -math.inf,
    stop: float = math.inf,
) -> float:
    """Give q of the ellipse {z : z' C(t)^-1 z <= q}, with C(t) = ``estimate.covariance(t)``."""
    alpha = alpha_of_one(level, probability, obstacles)
    if level == "per_time":
        return estimate.errors.pointwise_scale(alpha)
    return uniform_scale(alpha, estimate.standardised_length(start, stop), estimate.errors, estimate.regressors)


@dataclass(frozen=True)
class PolynomialEstimate(MotionEstimate):
    """An estimated polynomial motion, in powers of s = (t - ``center_time``) / ``time_scale``."""

    reference_time: float
    order: int
    observations: int
    noise_covariance: Array
    errors: ErrorLaw
    regressors: int | None
    center_time: float
    time_scale: float
    coefficients: Array
    coefficient_covariance: Array  # Covariance of their errors

    @property
    def velocity(self) -> Array:
        return self._rows(self.reference_time, 1) @ self.coefficients

    @property
    def acceleration(self) -> Array:
        return self._rows(self.reference_time, 2) @ self.coefficients

    def position(self, t: ArrayLike) -> Array:
        return self._rows(t) @ self.coefficients

    def covariance(self, t: ArrayLike) -> Array:
        rows = self._rows(t)
        return np.einsum("...j,jakb,...k->...ab", rows, self.coefficient_covariance, rows)

    def rate(self, t: float) -> tuple[Array, Array]:
        rows = self._rows(t, 1)
        return rows @ self.coefficients, np.einsum("j,jakb,k->ab", rows, self.coefficient_covariance, rows)

    def with_manoeuvre(self, deviation: float) -> PolynomialEstimate:
        """Allow for a change of the acceleration that begins with the last observation."""
        if deviation == 0.0:
            return self
        last, p = (self.reference_time - self.center_time) / self.time_scale, 3
        coefficients, covariance = np.zeros((p, 2)), np.zeros((p, 2, p, 2))
        coefficients[: self.order + 1] = self.coefficients
        covariance[: self.order + 1, :, : self.order + 1] = self.coefficient_covariance
        shift = 0.5 * self.time_scale**2 * np.array([last * last, -2.0 * last, 1.0])
        # in proportion to the noise, so that zones keep their shape
        change = deviation**2 / least_variances(self.noise_covariance) * self.noise_covariance
        covariance += np.einsum("j,ab,k->jakb", shift, change, shift)
        return replace(
            self,
            order=p - 1,
            regressors=None if self.regressors is None else p,
            coefficients=coefficients,
            coefficient_covariance=covariance,
        )

    def polynomials(self, start: float, stop: float) -> MotionPolynomials:
        check_span(start, stop)
        p = self.order + 1
        to_local = shift_powers(p, (start - self.center_time) / self.time_scale, self.time_scale)
        center = np.zeros((1, POLYNOMIAL_TERMS, 2))
        center[0, :p] = to_local @ self.coefficients
        pairs = self.coefficient_covariance.transpose(0, 2, 1, 3).reshape(p, p, 4)
        local = np.tensordot(to_local, np.tensordot(to_local, pairs, (1, 1)), (1, 1))
        xx, xy, yx, yy = (sums_of_powers(p) @ local.reshape(p * p, 4)).T
        covariance = np.stack([xx, 0.5 * (xy + yx), yy], axis=1)[None]
        return MotionPolynomials(np.array([start, stop], dtype=float), center, covariance)

    def standardised_length(self, start: float = -math.inf, stop: float = math.inf) -> float:
        if not start <= stop:
            raise EstimationError(f"span of time: its start {start!r} is after its stop {stop!r}")
        if self.order == 0 or start == stop:
            return 0.0
        # With s = tan(angle) the row (1, s, s^2) is (cos^2, sin cos, sin^2) but for a factor, which
        # standardising removes. So infinite times are as good as any other.
        begin, end = (math.atan((t - self.center_time) / self.time_scale) for t in (start, stop))

        def speeds(angles: Array) -> Array:
            products = row_products(*turning_rows(self.order, angles))
            error, cross, rate = error_blocks(products, self.coefficient_covariance[None])
            if self.regressors is None:
                return standardised_speed(error, cross, rate)
            # the covariance is a spread (p, p) times a matrix that standardising removes
            error, cross, rate = (one[..., 0, 0] for one in (error, cross, rate))
            return np.asarray(np.sqrt(np.maximum(rate * error - cross**2, 0.0)) / error)

        return float(integrate(speeds, begin, end)[0])

    def _rows(self, t: ArrayLike, derivative: int = 0) -> Array:
        """Give the derivative in time of the powers of s: t (...), s, to (..., p)."""
        s = (np.asarray(t, dtype=float) - self.center_time) / self.time_scale
        rows = np.zeros((*s.shape, self.order + 1))
        for k in range(derivative, self.order + 1):
            rows[..., k] = math.perm(k, derivative) / self.time_scale**derivative * s ** (k - derivative)
        return rows


def row_products(rows: Array, slopes: Array) -> Array:
    """Products of the entries of rows (L, p), of rows and slopes (L, p), and of slopes: (3 L, p p)."""
    pairs = (rows, rows), (rows, slopes), (slopes, slopes)
    return np.concatenate([one[:, :, None] * other[:, None] for one, other in pairs]).reshape(3 * len(rows), -1)


def errors_of(products: Array, covariance: Array) -> Array:
    """Covariances (n, L, 2, 2) of errors, by products of the entries of rows (L, p p) that give them from states."""
    states = covariance.transpose(0, 1, 3, 2, 4).reshape(len(covariance), -1, 4)
    return (products @ states).reshape(len(covariance), -1, 2, 2)


def error_blocks(products: Array, covariance: Array) -> tuple[Array, Array, Array]:
    """Covariances of errors, of them with their rates, and of these, where rows and slopes give both from states."""
    blocks = errors_of(products, covariance).reshape(len(covariance), 3, -1, 2, 2)
    return blocks[:, 0], blocks[:, 1], blocks[:, 2]


def turning_rows(order: int, angles: Array) -> tuple[Array, Array]:
    """Rows (cos, sin) or (cos^2, sin cos, sin^2) at angles (...), and their derivatives: (..., p) each."""
    sine, cosine = np.sin(angles), np.cos(angles)
    if order == 1:
        return np.stack([cosine, sine], axis=-1), np.stack([-sine, cosine], axis=-1)
    both, squares = sine * cosine, (cosine * cosine, sine * sine)
    slopes = [-2.0 * both, squares[0] - squares[1], 2.0 * both]
    return np.stack([squares[0], both, squares[1]], axis=-1), np.stack(slopes, axis=-1)


@lru_cache(maxsize=8)
def sums_of_powers(count: int) -> Array:
    """Matrix (POLYNOMIAL_TERMS, count^2) from coefficients of products of powers to those of powers."""
    powers = np.add.outer(np.arange(count), np.arange(count)).ravel()
    return np.asarray(np.arange(POLYNOMIAL_TERMS)[:, None] == powers, dtype=float)


def least_variances(sigma: Array) -> Array:
    """Smaller eigenvalues of covariances (..., 2, 2)."""
    mean, half = 0.5 * (sigma[..., 0, 0] + sigma[..., 1, 1]), 0.5 * (sigma[..., 0, 0] - sigma[..., 1, 1])
    return np.asarray(mean - np.hypot(half, sigma[..., 0, 1]))


@np.errstate(invalid="ignore", divide="ignore")  # of what is no covariance, by rounding, it is not a number
def standardised_speed(error: Array, cross: Array, rate: Array) -> Array:
    """Give E[(u' Lambda u)^1/2], with Lambda the covariance of the standardised error's rate given the error."""
    # Lambda = L^-1 (rate - cross' error^-1 cross) L^-T with Cholesky's factor L = ((a, 0), (b, c)) of the error,
    # written out: calls of LAPACK for so many matrices of two rows cost three times as much.
    a = np.sqrt(error[..., 0, 0])
    b = error[..., 0, 1] / a
    c = np.sqrt(error[..., 1, 1] - b * b)
    first = cross[..., 0, :] / a[..., None]
    second = (cross[..., 1, :] - b[..., None] * first) / c[..., None]
    xx = rate[..., 0, 0] - first[..., 0] ** 2 - second[..., 0] ** 2
    xy = rate[..., 0, 1] - first[..., 0] * first[..., 1] - second[..., 0] * second[..., 1]
    yy = rate[..., 1, 1] - first[..., 1] ** 2 - second[..., 1] ** 2
    along, beside = xx / (a * a), (xy - b * xx / a) / (a * c)
    across = (yy - 2.0 * b * xy / a + b * b * xx / (a * a)) / (c * c)
    half_trace = np.maximum(0.5 * (along + across), 0.0)
    spread = np.minimum(np.hypot(0.5 * (along - across), beside), half_trace)
    large, small = half_trace + spread, half_trace - spread
    if np.all(large - small <= EQUAL_EIGENVALUES * large):
        return np.sqrt(half_trace)
    from scipy.special import ellipe

    flatness = np.divide(large - small, large, out=np.zeros_like(large), where=large > 0.0)
    return 2.0 / math.pi * np.sqrt(large) * np.asarray(ellipe(flatness))


def integrate(speed: Callable[[Array], Array], start: float, stop: float) -> Array:
    """Integrate smooth functions >= 0, of times (L,) to (..., L), by Gauss-Legendre panels until two answers agree."""
    panels, rule = 2, gauss_rule(PANEL_NODES)
    answer = np.array(np.inf)
    while True:
        edges = np.linspace(start, stop, panels + 1)
        half = 0.5 * (stop - start) / panels
        values = speed((edges[:-1, None] + half * (1.0 + rule.nodes)).ravel())
        total = np.asarray(half * (values.reshape(*values.shape[:-1], panels, -1).sum(axis=-2) @ rule.weights))
        if panels >= MOST_PANELS or np.all(np.abs(total - answer) <= PLACE_TOLERANCE * total):
            return total
        answer, panels = total, 2 * panels


def shift_powers(count: int, shift: float, scale: float) -> Array:
    """Give the square matrix from coefficients of powers of s to those of u, where s = shift + u / scale."""
    return np.asarray(shift_matrices(count, np.array([shift]))[0] / scale ** np.arange(count)[:, None])


def check_span(start: float, stop: float) -> None:
    """Refuse a span of time that polynomials cannot be given over."""
    if not (math.isfinite(start) and math.isfinite(stop) and start < stop):
        raise EstimationError(f"span of time: [{start!r}, {stop!r}] is not finite and increasing")
