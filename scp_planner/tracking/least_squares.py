"""Least squares behind `scp_planner.tracking.estimate`: polynomials in scaled time, with weights and a prior."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from scp_planner.arrays import Array
from scp_planner.errors import EstimationError
from scp_planner.tracking.error_laws import ErrorLaw, HotellingErrors, NormalErrors, StudentErrors
from scp_planner.tracking.motion_estimate import PolynomialEstimate
from scp_planner.tracking.observations import CheckedObservations
from scp_planner.tracking.tolerances import LAST_DIGITS


@dataclass(frozen=True)
class NoiseBounds:
    """Least noise that is estimated."""

    # Least standard deviation of a noise that is estimated, relative to how far the observed positions are apart
    least: float = 1e-6
    # Least ratio of the standard deviations of a noise that is estimated, of the smaller one to the larger one
    least_ratio: float = 1e-2


NOISE_BOUNDS = NoiseBounds()


class Noise(StrEnum):
    """Structure of a noise covariance that is to be estimated."""

    GENERAL = "general"
    """Nothing: any covariance."""
    ISOTROPIC = "isotropic"
    """A multiple of the identity."""


@dataclass(frozen=True)
class MotionPrior:
    """Independent normal priors of an obstacle's velocity and acceleration at its last observation.

    They keep far zones finite: the error of an acceleration that is known to 0.1 m/s^2 is 1.25 m after 5 s,
    whatever the observations. The level of a region then holds on average over obstacles that are as the
    prior says.

    Attributes
    ----------
    velocity, acceleration : (2,) m/s and m/s^2
        Means.
    velocity_deviation, acceleration_deviation : float, m/s and m/s^2
        Standard deviations of each component; infinity says nothing about that quantity.
    """

    velocity: tuple[float, float] = (0.0, 0.0)
    velocity_deviation: float = math.inf
    acceleration: tuple[float, float] = (0.0, 0.0)
    acceleration_deviation: float = math.inf

    def __post_init__(self) -> None:
        for name in ("velocity", "acceleration"):
            deviation, mean = getattr(self, f"{name}_deviation"), np.asarray(getattr(self, name), dtype=float)
            if not deviation > 0.0:
                raise EstimationError(f"prior.{name}_deviation: {deviation!r} is not a positive number")
            if mean.shape != (2,) or not np.isfinite(mean).all():
                raise EstimationError(f"prior.{name}: {getattr(self, name)!r} is not two finite numbers")


@dataclass(frozen=True)
class MotionProblem:
    """An estimation problem apart from its observations."""

    order: int
    prior: MotionPrior | None
    noise: Noise
    forgetting: float


@dataclass(frozen=True)
class MotionFit:
    """A weighted least-squares fit of polynomials in s = (t - center) / scale."""

    problem: MotionProblem
    seen: CheckedObservations
    center: float
    scale: float
    rows: Array  # (n, p)
    residuals: Array  # (n, 2) m
    coefficients: Array  # (p, 2) m, with the origin added
    covariance: Array  # (p, 2, p, 2) m^2
    noise: Array  # (2, 2) or (n, 2, 2) m^2
    errors: ErrorLaw
    regressors: int | None

    def estimate(self) -> PolynomialEstimate:
        """Give what is of interest to others."""
        return PolynomialEstimate(
            reference_time=float(self.seen.times[-1]),
            order=self.problem.order,
            observations=len(self.rows),
            noise_covariance=self.noise if self.noise.ndim == 2 else self.noise.mean(axis=0),
            errors=self.errors,
            regressors=self.regressors,
            center_time=self.center,
            time_scale=self.scale,
            coefficients=self.coefficients,
            coefficient_covariance=self.covariance,
            rejected=self.seen.rejected,
        )


def fit_motion(problem: MotionProblem, seen: CheckedObservations, weights: Array | None = None) -> MotionFit:
    """Fit with given weights; those of forgetting if none are given."""
    t, z = seen.times, seen.positions
    _check_enough(problem, seen)
    if weights is None and problem.forgetting < 1.0:
        weights = problem.forgetting ** np.arange(len(t) - 1, -1, -1.0)
    # where the weight is: what is forgotten must not spoil the conditioning
    center = float(t[0] + np.average(t - t[0], weights=weights))
    scale = math.sqrt(float(np.average((t - center) ** 2, weights=weights))) or 1.0
    p = problem.order + 1
    rows = ((t - center) / scale)[:, None] ** np.arange(p)
    origin = z[0]  # coordinates of a map lose no digits either
    sigma = seen.covariance
    errors: ErrorLaw = NormalErrors()
    regressors: int | None = p
    prior = prior_rows(problem.prior, (t[-1] - center) / scale, scale, p)
    if sigma is None or (sigma.ndim == 2 and prior is None):
        coefficients, spread, residuals, moments = _common_fit(rows, z - origin, weights)
        if sigma is None:
            weighted = residuals if weights is None else weights[:, None] * residuals
            scatter = residuals.T @ weighted
            size = float(np.sum((z - origin) ** 2 if weights is None else weights[:, None] * (z - origin) ** 2))
            sigma, errors = estimated_noise(scatter, moments, problem.noise, Extent(size, origin))
        covariance = np.einsum("jk,ab->jakb", spread, sigma)
    if sigma.ndim == 3 or prior is not None:
        regressors = None
        coefficients, covariance = _general_fit(rows, z - origin, sigma, weights, prior)
        residuals = z - origin - rows @ coefficients
    coefficients[0] += origin
    return MotionFit(problem, seen, center, scale, rows, residuals, coefficients, covariance, sigma, errors, regressors)


def _check_enough(problem: MotionProblem, seen: CheckedObservations) -> None:
    n, p = len(seen.times), problem.order + 1
    if seen.covariance is None:
        least, why = p + (2 if problem.noise is Noise.GENERAL else 1), "a covariance to be estimated"
    else:
        least, why = (p if problem.prior is None else 1), "a known covariance"
    if n < least:
        raise EstimationError(
            f"observations: {n} are too few for order {problem.order} and {why}; at least {least} are needed"
        )
    distinct = 1 + int(np.count_nonzero(np.diff(seen.times)))
    if distinct < p and (problem.prior is None or seen.covariance is None):
        raise EstimationError(
            f"observations.time: {distinct} different times are too few for order {problem.order}; "
            f"at least {p} are needed"
        )


@dataclass(frozen=True)
class Moments:
    """Traces that say how much the weighted residuals tell of the noise covariance."""

    expected: float  # E[residuals' W residuals] = expected * Sigma
    degrees_of_freedom: float


def _common_fit(rows: Array, z: Array, weights: Array | None) -> tuple[Array, Array, Array, Moments]:
    """Fit with one covariance for all: coefficients, their covariance in units of it, residuals, moments."""
    if weights is None:
        q, r = np.linalg.qr(rows)
        inverse = np.linalg.inv(r)
        coefficients = inverse @ (q.T @ z)
        degrees = float(rows.shape[0] - rows.shape[1])
        return coefficients, inverse @ inverse.T, z - rows @ coefficients, Moments(degrees, degrees)
    q, r = np.linalg.qr(np.sqrt(weights)[:, None] * rows)
    inverse = np.linalg.inv(r)
    coefficients = inverse @ (q.T @ (np.sqrt(weights)[:, None] * z))
    second = q.T @ (weights[:, None] * q)
    spread = inverse @ second @ inverse.T
    third = q.T @ (weights[:, None] ** 2 * q)
    expected = float(weights.sum() - np.trace(second))
    square = float((weights**2).sum() - 2.0 * np.trace(third) + np.sum(second * second))
    return coefficients, spread, z - rows @ coefficients, Moments(expected, expected**2 / square)


@dataclass(frozen=True)
class Extent:
    """Size of the observed positions, by which the noise that residuals show is told from rounding."""

    square: float  # Weighted sum of their squared distances from the origin, m^2
    origin: Array  # (2,) One of them, m
    known: float = 0.0  # Least standard deviation that is known otherwise, m

    def least_variance(self, count: float) -> float:
        """Smallest variance that can be estimated from so many observations, m^2."""
        rounding = LAST_DIGITS * float(np.abs(self.origin).max())
        return NOISE_BOUNDS.least**2 * self.square / count + rounding * rounding + self.known * self.known


def estimated_noise(scatter: Array, moments: Moments, noise: Noise, extent: Extent) -> tuple[Array, ErrorLaw]:
    """Estimate the noise covariance from E'WE, the scatter of the residuals; tell the law of the errors."""
    if not extent.square > 0.0:
        raise EstimationError(
            "observations.position: they lie exactly on a motion, at one place, so that their covariance cannot be"
            " estimated; give it"
        )
    sigma = scatter / moments.expected
    if noise is Noise.ISOTROPIC:
        sigma = 0.5 * np.trace(sigma) * np.eye(2)
    sigma = _at_least(sigma, extent.least_variance(moments.expected))
    if noise is Noise.ISOTROPIC:
        return sigma, StudentErrors(2.0 * moments.degrees_of_freedom)
    return sigma, HotellingErrors(moments.degrees_of_freedom)


def _at_least(sigma: Array, least: float) -> Array:
    """Covariance (2, 2) whose smaller variance is raised to a least one, and to a share of the larger one."""
    mean, half = 0.5 * (sigma[0, 0] + sigma[1, 1]), 0.5 * (sigma[0, 0] - sigma[1, 1])
    spread = math.hypot(float(half), float(sigma[0, 1]))
    least = max(least, NOISE_BOUNDS.least_ratio**2 * float(mean + spread))
    if float(mean - spread) >= least:
        return sigma
    values, vectors = np.linalg.eigh(0.5 * (sigma + sigma.T))
    raised: Array = (vectors * np.maximum(values, least)) @ vectors.T
    return raised


def _general_fit(
    rows: Array, z: Array, sigma: Array, weights: Array | None, prior: tuple[Array, Array] | None
) -> tuple[Array, Array]:
    """Fit all 2 p coefficients together: each observation whitened by its covariance, the prior appended."""
    n, p = rows.shape
    whiten = np.linalg.inv(np.linalg.cholesky(np.broadcast_to(sigma, (n, 2, 2))))
    root = np.ones(2 * n) if weights is None else np.repeat(np.sqrt(weights), 2)
    design = root[:, None] * np.einsum("nj,nab->najb", rows, whiten).reshape(2 * n, 2 * p)
    target = root * np.einsum("nab,nb->na", whiten, z).reshape(2 * n)
    if prior is not None:
        design, target = np.vstack([design, prior[0]]), np.concatenate([target, prior[1]])
        root = np.concatenate([root, np.ones(len(prior[1]))])
    if np.linalg.matrix_rank(design) < 2 * p:
        raise EstimationError(
            f"observations: {n} and the prior do not determine a motion of order {p - 1}; try a lower order"
        )
    q, r = np.linalg.qr(design)
    inverse = np.linalg.inv(r)
    weighted = root[:, None] * q
    covariance = inverse @ (weighted.T @ weighted) @ inverse.T
    return (inverse @ (q.T @ target)).reshape(p, 2), covariance.reshape(p, 2, p, 2)


def prior_rows(prior: MotionPrior | None, last: float, scale: float, p: int) -> tuple[Array, Array] | None:
    """Give the prior as whitened observations of the coefficients; ``last`` is s at the last observation."""
    if prior is None:
        return None
    velocity = np.array([0.0, 1.0, 2.0 * last])[:p] / scale
    acceleration = np.array([0.0, 0.0, 2.0])[:p] / scale**2
    design: list[Array] = []
    target: list[float] = []
    for functional, mean, deviation in (
        (velocity, prior.velocity, prior.velocity_deviation),
        (acceleration, prior.acceleration, prior.acceleration_deviation),
    ):
        if math.isinf(deviation) or not functional.any():
            continue
        for axis in range(2):
            row = np.zeros((p, 2))
            row[:, axis] = functional / deviation
            design.append(row.ravel())
            target.append(mean[axis] / deviation)
    return (np.array(design), np.array(target)) if design else None
