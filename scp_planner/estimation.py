r"""Maximum likelihood of an obstacle's motion from noisy observations of its position.

The true centre moves along eta(t) = sum_k c_k t^k, k = 0..order (2: constant acceleration, 1: constant velocity,
0: standing). Observation i at t_i is eta(t_i) + e_i, e_i ~ N(0, Sigma_i) independent. Then maximum likelihood is weighted least
squares, unbiased and normal, and the error of the estimated centre at any time t is normal with a covariance C(t) that is a
polynomial of degree 2 * order in t:

- one Sigma for all: C(t) = h(t) Sigma with h(t) = x_t' (X'X)^-1 x_t, x_t = (1, t, t^2). If Sigma is not given it is
  estimated without bias by S = E'E / (n - p), E the residuals, p = order + 1, with n - p degrees of freedom;
- a Sigma for each observation: the 2 p coefficients are estimated together, and C(t) is of the general form.

C(t) is about the *mean* position, the true centre; a new noisy observation would scatter by C(t) + Sigma.

Times are centred and scaled before solving, so that a clock that reads 1e9 s loses nothing. The source of the model is A. Z. Zambom and B. Seguin,
Comp. Appl. Math. 40, 119 (2021), with velocity V and acceleration 2 W in their notation.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from scp_planner.errors import EstimationError

if TYPE_CHECKING:
    from scp_planner.scenario import Obstacle

Array = NDArray[np.float64]

POLYNOMIAL_COEFFICIENTS = 5  # degree 4: the square of a quadratic
_MAXIMUM_ORDER = 2
_LENGTH_TOLERANCE = 1e-8  # relative, of a standardised length
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(16)
_MAXIMUM_PANELS = 4096


@dataclass(frozen=True)
class MotionPolynomials:
    """The estimated centre and its covariance over a span of time as piecewise polynomials.

    Segment i covers ``breakpoints[i] <= t <= breakpoints[i + 1]`` in powers of ``t - breakpoints[i]``.

    Attributes
    ----------
    breakpoints : (S + 1,) s, increasing
    center : (S, 5, 2) m/s^k
        Coefficient of power k of the estimated centre.
    covariance : (S, 5, 3) m^2/s^k
        Coefficient of power k of the entries xx, xy, yy of the covariance of the estimated centre, not scaled by any
        confidence level.
    center_error : float, m
        Bound on the distance between this centre and ``MotionEstimate.position``; 0 where the polynomials are exact.
    covariance_error : float
        Bound on the relative excess of this covariance, which is never below that of ``MotionEstimate.covariance``; 0 where exact.
    """

    breakpoints: Array
    center: Array
    covariance: Array
    center_error: float = 0.0
    covariance_error: float = 0.0


class MotionEstimate(ABC):
    """What is known of one obstacle's motion: a predicted centre and the covariance of its error, at any time.

    Attributes
    ----------
    reference_time : float, s
        The time of the last observation; ``velocity`` and ``acceleration`` are at this time.
    order : int
        0 standing, 1 velocity, 2 acceleration: the motion that the prediction follows.
    observations : int
        How many were used.
    noise_covariance : (2, 2) m^2
        Of one observation, as given or as estimated; the mean one where each has its own.
    degrees_of_freedom : int or None
        Of the estimated ``noise_covariance``; None if it is known.
    regressors : int or None
        p where the error is a p-vector times a square root of the noise covariance, else None.
    """

    reference_time: float
    order: int
    observations: int
    noise_covariance: Array
    degrees_of_freedom: int | None
    regressors: int | None

    @property
    @abstractmethod
    def velocity(self) -> Array:
        """Estimated velocity at ``reference_time``: (2,) m/s."""

    @property
    @abstractmethod
    def acceleration(self) -> Array:
        """Estimated acceleration at ``reference_time``: (2,) m/s^2."""

    @abstractmethod
    def position(self, t: ArrayLike) -> Array:
        """Estimated centre at times t: t.shape + (2,) m."""

    @abstractmethod
    def covariance(self, t: ArrayLike) -> Array:
        """Covariance of the error of the estimated centre at times t: t.shape + (2, 2) m^2."""

    @abstractmethod
    def polynomials(self, start: float, stop: float) -> MotionPolynomials:
        """Give the centre and its covariance over [start, stop] as piecewise polynomials in time."""

    @abstractmethod
    def standardised_length(self, start: float = -math.inf, stop: float = math.inf) -> float:
        """Give the length that the standardised error travels over a span; `confidence` turns it into a region's scale.

        With w(t) = C(t)^-1/2 e(t) the error standardised at each time, and Lambda(t) the covariance of dw/dt given w, it is
        the integral over time of E[(u' Lambda u)^1/2], u uniform on the unit circle. If C(t) = h(t) Sigma it is the length of the curve
        x_t / |x_t| on the sphere, with lengths measured by (X'X)^-1.
        """


@dataclass(frozen=True)
class MotionPrior:
    """Independent normal priors of an obstacle's velocity and acceleration at the time of the last observation.

    A standard deviation of infinity says nothing about that quantity.

    Attributes
    ----------
    velocity, acceleration : (2,) m/s and m/s^2
        Means.
    velocity_deviation, acceleration_deviation : float, m/s and m/s^2
        Standard deviation of each component.
    """

    velocity: tuple[float, float] = (0.0, 0.0)
    velocity_deviation: float = math.inf
    acceleration: tuple[float, float] = (0.0, 0.0)
    acceleration_deviation: float = math.inf

    def __post_init__(self) -> None:
        for name in ("velocity", "acceleration"):
            deviation = getattr(self, f"{name}_deviation")
            if not deviation > 0.0:
                raise EstimationError(f"prior.{name}_deviation: {deviation!r} is not a positive number")
            if not np.isfinite(getattr(self, name)).all():
                raise EstimationError(f"prior.{name}: {getattr(self, name)!r} is not finite")


@dataclass(frozen=True)
class PolynomialEstimate(MotionEstimate):
    """An estimated polynomial motion, in powers of s = (t - ``center_time``) / ``time_scale``.

    Attributes
    ----------
    center_time, time_scale : float, s
    coefficients : (p, 2) m
        Of the powers of s, p = order + 1.
    coefficient_covariance : (p, 2, p, 2) m^2
        Covariance of their error.
    """

    reference_time: float
    order: int
    observations: int
    noise_covariance: Array
    degrees_of_freedom: int | None
    regressors: int | None
    center_time: float
    time_scale: float
    coefficients: Array
    coefficient_covariance: Array

    def _scaled(self, t: ArrayLike) -> Array:
        return (np.asarray(t, dtype=float) - self.center_time) / self.time_scale

    def _powers(self, t: ArrayLike, derivative: int = 0) -> Array:
        """Give the rows d^j/dt^j (1, s, s^2) at times t: t.shape + (p,)."""
        s = self._scaled(t)
        rows = np.zeros((*s.shape, self.order + 1))
        for k in range(derivative, self.order + 1):
            rows[..., k] = math.perm(k, derivative) * s ** (k - derivative) / self.time_scale**derivative
        return rows

    @property
    def velocity(self) -> Array:
        return self._powers(self.reference_time, 1) @ self.coefficients

    @property
    def acceleration(self) -> Array:
        return self._powers(self.reference_time, 2) @ self.coefficients

    def position(self, t: ArrayLike) -> Array:
        return self._powers(t) @ self.coefficients

    def covariance(self, t: ArrayLike) -> Array:
        rows = self._powers(t)
        return np.einsum("...j,jakb,...k->...ab", rows, self.coefficient_covariance, rows)

    def polynomials(self, start: float, stop: float) -> MotionPolynomials:
        _check_span(start, stop)
        shift, p = float(self._scaled(start)), self.order + 1
        # s = shift + (t - start) / scale; to_local[k, j]: what power j of s gives to power k of (t - start)
        to_local = np.zeros((p, p))
        for j in range(p):
            for k in range(j + 1):
                to_local[k, j] = math.comb(j, k) * shift ** (j - k) / self.time_scale**k
        center = np.zeros((1, POLYNOMIAL_COEFFICIENTS, 2))
        center[0, :p] = to_local @ self.coefficients
        local = np.einsum("ki,iajb,lj->kalb", to_local, self.coefficient_covariance, to_local)
        covariance = np.zeros((1, POLYNOMIAL_COEFFICIENTS, 3))
        for k in range(p):
            for m in range(p):
                block = local[k, :, m, :]
                covariance[0, k + m] += (block[0, 0], 0.5 * (block[0, 1] + block[1, 0]), block[1, 1])
        return MotionPolynomials(np.array([start, stop], dtype=float), center, covariance)

    def standardised_length(self, start: float = -math.inf, stop: float = math.inf) -> float:
        if not start <= stop:
            raise EstimationError(f"span of time: start {start!r} is after stop {stop!r}")
        if self.order == 0 or start == stop:
            return 0.0
        # with s = tan(angle) the rows are (cos^2, sin cos, sin^2) up to a factor, which standardising removes: smooth and finite up to
        # infinite times
        angles = np.arctan((np.array([start, stop]) - self.center_time) / self.time_scale)
        return integrate(self._angular_speed, float(angles[0]), float(angles[1]))

    def _angular_speed(self, angles: Array) -> Array:
        sine, cosine = np.sin(angles), np.cos(angles)
        d = self.order
        rows = np.stack([sine**k * cosine ** (d - k) for k in range(d + 1)], axis=-1)
        slopes = np.stack(
            [
                (k * sine ** max(k - 1, 0) * cosine ** (d - k + 1) if k else 0.0)
                - ((d - k) * sine ** (k + 1) * cosine ** max(d - k - 1, 0) if k < d else np.zeros_like(sine))
                for k in range(d + 1)
            ],
            axis=-1,
        )
        cross = np.einsum("nj,jakb->nakb", rows, self.coefficient_covariance)
        return standardised_speed(
            np.einsum("nakb,nk->nab", cross, rows),
            np.einsum("nakb,nk->nab", cross, slopes),
            np.einsum("nj,jakb,nk->nab", slopes, self.coefficient_covariance, slopes),
        )


def standardised_speed(error: Array, error_rate: Array, rate: Array) -> Array:
    """Give E[(u' Lambda u)^1/2] for u uniform on the circle, Lambda the covariance of the rate of the standardised error.

    Parameters
    ----------
    error, error_rate, rate : (n, 2, 2)
        Covariance of the error e, of e with its derivative e', and of e'.

    Returns
    -------
    (n,) per unit of what the derivative is with respect to
    """
    whiten = np.linalg.inv(np.linalg.cholesky(error))
    coupling = whiten @ error_rate
    given = whiten @ (rate - np.swapaxes(error_rate, -1, -2) @ np.linalg.solve(error, error_rate)) @ np.swapaxes(whiten, -1, -2)
    del coupling
    half_trace = 0.5 * (given[:, 0, 0] + given[:, 1, 1])
    spread = np.hypot(0.5 * (given[:, 0, 0] - given[:, 1, 1]), 0.5 * (given[:, 0, 1] + given[:, 1, 0]))
    large = np.maximum(half_trace + spread, 0.0)
    small = np.clip(half_trace - spread, 0.0, large)
    if np.all(large - small <= 1e-9 * large):
        return np.asarray(np.sqrt(half_trace.clip(0.0)))
    from scipy.special import ellipe

    flatness = np.divide(large - small, large, out=np.zeros_like(large), where=large > 0.0)
    return np.asarray(2.0 / math.pi * np.sqrt(large) * ellipe(flatness))


def integrate(speed: Any, start: float, stop: float) -> float:
    """Integrate a smooth non-negative function by Gauss-Legendre panels, doubled until two answers agree."""
    previous, panels = math.nan, 1
    while panels <= _MAXIMUM_PANELS:
        edges = np.linspace(start, stop, panels + 1)
        half = 0.5 * np.diff(edges)
        nodes = (edges[:-1, None] + half[:, None] * (1.0 + _NODES)).ravel()
        total = float(np.sum(half[:, None] * _WEIGHTS * speed(nodes).reshape(panels, -1)))
        if abs(total - previous) <= _LENGTH_TOLERANCE * max(total, 1e-12):
            return total
        previous, panels = total, 2 * panels
    return previous


def estimate_motion(
    times: ArrayLike,
    positions: ArrayLike,
    covariance: ArrayLike | None = None,
    order: int = 2,
    prior: MotionPrior | None = None,
) -> PolynomialEstimate:
    """Estimate position, velocity and acceleration by maximum likelihood (with a prior: maximum a posteriori).

    Parameters
    ----------
    times : (n,) s
        In any order and spacing, any clock.
    positions : (n, 2) m
    covariance : (2, 2) or (n, 2, 2) m^2 or None
        Of one observation, common or for each; None: estimated from the residuals.
    order : 0, 1 or 2
        Standing, constant velocity, constant acceleration.
    prior : MotionPrior or None
        With it fewer observations than order + 1 are enough, if the covariance is known.

    Returns
    -------
    PolynomialEstimate

    Raises
    ------
    EstimationError
        For anything that is not finite, of the wrong shape, not a covariance, or too few observations for the order.
    """
    t, z = _checked_observations(times, positions)
    if order not in range(_MAXIMUM_ORDER + 1):
        raise EstimationError(f"order: {order!r} is not 0, 1 or 2")
    n, p = len(t), order + 1
    sigma = None if covariance is None else _checked_covariance(covariance, n)
    needed = p + 2 if sigma is None else (1 if prior is not None else p)
    if n < needed:
        why = "with the covariance estimated" if sigma is None else "with the covariance known"
        raise EstimationError(f"observations: {n} are too few for order {order} {why}: at least {needed} are needed")
    distinct = len(np.unique(t))
    if distinct < p and (prior is None or sigma is None):
        raise EstimationError(f"observations.time: {distinct} distinct times are too few for order {order}: at least {p} are needed")

    center = float(t[0] + np.mean(t - t[0]))
    scale = float(np.abs(t - center).max()) or 1.0
    s = (t - center) / scale
    rows = s[:, None] ** np.arange(p)
    origin = z[0]  # positions on a map grid lose no digits either
    last = float(t.max())
    degrees: int | None = None
    regressors: int | None = p
    if sigma is None or (sigma.ndim == 2 and prior is None):
        q, r = np.linalg.qr(rows)
        coefficients = np.linalg.solve(r, q.T @ (z - origin))
        if sigma is None:
            residuals = z - origin - rows @ coefficients
            degrees = n - p
            sigma = residuals.T @ residuals / degrees
        inverse = np.linalg.inv(r)
        spread = np.einsum("jk,ab->jakb", inverse @ inverse.T, sigma)
    if prior is not None or sigma.ndim == 3:
        regressors = None
        coefficients, spread = _general_fit(rows, z - origin, sigma, _prior_rows(prior, origin, (last - center) / scale, scale, p))
    coefficients[0] += origin
    noise = sigma if sigma.ndim == 2 else sigma.mean(axis=0)
    return PolynomialEstimate(last, order, n, noise, degrees, regressors, center, scale, coefficients, spread)


def _general_fit(rows: Array, z: Array, sigma: Array, prior: tuple[Array, Array] | None) -> tuple[Array, Array]:
    """Fit all 2 p coefficients together: each observation whitened by its own covariance, prior rows appended."""
    n, p = rows.shape
    whiten = np.linalg.inv(np.linalg.cholesky(np.broadcast_to(sigma, (n, 2, 2))))
    design = np.einsum("nj,nab->najb", rows, whiten).reshape(2 * n, 2 * p)
    target = np.einsum("nab,nb->na", whiten, z).reshape(2 * n)
    if prior is not None:
        design, target = np.vstack([design, prior[0]]), np.concatenate([target, prior[1]])
    if np.linalg.matrix_rank(design) < 2 * p:
        raise EstimationError("observations: they and the prior together do not determine the motion; a lower order would be")
    q, r = np.linalg.qr(design)
    inverse = np.linalg.inv(r)
    coefficients = (inverse @ (q.T @ target)).reshape(p, 2)
    return coefficients, (inverse @ inverse.T).reshape(p, 2, p, 2)


def _prior_rows(prior: MotionPrior | None, origin: Array, s_last: float, scale: float, p: int) -> tuple[Array, Array] | None:
    if prior is None:
        return None
    design, target = [], []
    functionals = [
        (np.array([0.0, 1.0, 2.0 * s_last])[:p] / scale, prior.velocity, prior.velocity_deviation, 1),
        (np.array([0.0, 0.0, 2.0])[:p] / scale**2, prior.acceleration, prior.acceleration_deviation, 2),
    ]
    for functional, mean, deviation, lowest in functionals:
        if p <= lowest or math.isinf(deviation):
            continue
        for axis in range(2):
            row = np.zeros((p, 2))
            row[:, axis] = functional / deviation
            design.append(row.ravel())
            target.append(mean[axis] / deviation)
    return np.array(design).reshape(-1, 2 * p), np.array(target)


def estimate_obstacle(obstacle: Obstacle) -> MotionEstimate:
    """Estimate the motion of a scenario's obstacle from its ``observations`` with its ``model``."""
    seen, model = obstacle.observations, obstacle.model
    if seen is None:
        raise EstimationError(f"obstacle {obstacle.id!r}: it has no observations, its motion is given")
    try:
        return estimate_motion(seen.time, seen.position, seen.covariance, model.order, model.prior)
    except EstimationError as error:
        raise EstimationError(f"obstacle {obstacle.id!r}: {error}") from error


def _checked_observations(times: ArrayLike, positions: ArrayLike) -> tuple[Array, Array]:
    t, z = np.asarray(times, dtype=float), np.asarray(positions, dtype=float)
    if t.ndim != 1 or z.shape != (len(t), 2):
        raise EstimationError(f"observations: times of shape {t.shape} and positions of shape {z.shape} are not (n,) and (n, 2)")
    if not len(t):
        raise EstimationError("observations: there are none")
    for name, bad in (("time", ~np.isfinite(t)), ("position", ~np.isfinite(z).all(axis=1))):
        if bad.any():
            i = int(np.argmax(bad))
            value = t[i] if name == "time" else z[i].tolist()
            raise EstimationError(f"observations.{name}[{i}]: {value} is not finite")
    return t, z


def _checked_covariance(covariance: ArrayLike, n: int) -> Array:
    sigma = np.asarray(covariance, dtype=float)
    if sigma.shape not in ((2, 2), (n, 2, 2)):
        raise EstimationError(f"observations.covariance: its shape {sigma.shape} is neither (2, 2) nor ({n}, 2, 2)")
    if not np.isfinite(sigma).all():
        raise EstimationError("observations.covariance: it is not finite")
    each = sigma.reshape(-1, 2, 2)
    for i, matrix in enumerate(each):
        where = "observations.covariance" + (f"[{i}]" if sigma.ndim == 3 else "")
        if abs(matrix[0, 1] - matrix[1, 0]) > 1e-9 * np.abs(matrix).max():
            raise EstimationError(f"{where}: {matrix.tolist()} is not symmetric")
        if matrix[0, 0] <= 0.0 or np.linalg.det(matrix) <= 0.0:
            raise EstimationError(f"{where}: {matrix.tolist()} is not positive definite")
    return sigma


def _check_span(start: float, stop: float) -> None:
    if not (math.isfinite(start) and math.isfinite(stop) and start < stop):
        raise EstimationError(f"span of time: [{start!r}, {stop!r}] is not finite and increasing")
