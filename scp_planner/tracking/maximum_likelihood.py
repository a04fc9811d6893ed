"""Maximum likelihood of an obstacle's motion from noisy observations of its position: polynomials in scaled time."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from enum import StrEnum
from sys import float_info

import numpy as np
from numpy.typing import ArrayLike

from scp_planner.arrays import Array
from scp_planner.errors import EstimationError
from scp_planner.settings.knobs import word_of
from scp_planner.tracking.confidence import (
    FEWEST_DEGREES_OF_FREEDOM,
    ErrorLaw,
    HotellingErrors,
    NormalErrors,
    StudentErrors,
)
from scp_planner.tracking.motion_estimate import PolynomialEstimate
from scp_planner.tracking.observations import CheckedObservations, Outliers, Screening, check_observations
from scp_planner.tracking.tolerances import LAST_DIGITS, RESIDUAL_TOLERANCE

HIGHEST_ORDER = 2


@dataclass(frozen=True)
class NoiseBounds:
    """Least noise that is estimated."""

    least: float = 1e-6  # standard deviation, relative to how far the observed positions are apart
    least_ratio: float = 1e-2  # of the smaller standard deviation to the larger one


@dataclass(frozen=True)
class HuberSettings:
    """Weights of Huber's estimate."""

    distance: float = 2.0  # Mahalanobis, beyond which weights fall; 13.5 % of normal observations lie beyond it
    steps: int = 200


NOISE_BOUNDS, HUBER = NoiseBounds(), HuberSettings()


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


def estimate_motion(
    times: ArrayLike,
    positions: ArrayLike,
    covariance: ArrayLike | None = None,
    order: int = 2,
    prior: MotionPrior | None = None,
    *,
    noise: Noise | str = Noise.GENERAL,
    forgetting: float = 1.0,
    screening: Screening | None = None,
) -> PolynomialEstimate:
    """Estimate position, velocity and acceleration by maximum likelihood; with a prior, maximum a posteriori.

    Parameters
    ----------
    times : (n,) s
        In any order and spacing, on any clock.
    positions : (n, 2) m
    covariance : (2, 2) or (n, 2, 2) m^2, or None
        Of one observation, common or for each; None: estimated from the residuals.
    order : 0, 1 or 2
        Standing, constant velocity, constant acceleration.
    prior : MotionPrior, optional
        With one, and a known covariance, fewer observations than order + 1 can be enough.
    noise : Noise
        The form of a covariance that is to be estimated.
    forgetting : float
        Each observation weighs this many times what the next one does, 0 < forgetting <= 1: the estimate
        follows an obstacle that manoeuvres. The covariance stays that of the estimate for a motion that does
        not. With a covariance that is estimated, its degrees of freedom are Satterthwaite's, an
        approximation.
    screening : Screening, optional
        What may be wrong with the observations and what to do about it; the default refuses missing and
        repeated ones and believes all others. With Huber weights the covariance is the asymptotic one.

    Returns
    -------
    PolynomialEstimate

    Raises
    ------
    EstimationError
        For what is not finite, there twice, of the wrong shape, not a covariance, or not enough to determine
        the motion.
    """
    if order not in range(HIGHEST_ORDER + 1):
        raise EstimationError(f"order: {order!r} is not 0, 1 or 2")
    if not 0.0 < forgetting <= 1.0:
        raise EstimationError(f"forgetting: {forgetting!r} is not in (0, 1]")
    screening = screening or Screening()
    if forgetting < 1.0 and covariance is None and screening.outliers is not Outliers.KEEP:
        raise EstimationError(f"forgetting: with outliers {screening.outliers.value!r} the covariance must be given")
    seen = check_observations(times, positions, covariance, screening)
    problem = MotionProblem(int(order), prior, word_of(Noise, noise, "noise"), forgetting)
    if screening.outliers is Outliers.GATE:
        return _gated(problem, seen, screening.gate_probability)
    if screening.outliers is Outliers.HUBER:
        return _huber(problem, seen)
    return fit_motion(problem, seen).estimate


@dataclass(frozen=True)
class MotionProblem:
    """An estimation problem apart from its observations."""

    order: int
    prior: MotionPrior | None
    noise: Noise
    forgetting: float


@dataclass(frozen=True)
class MotionFit:
    """A weighted least-squares fit, with what robust estimates are made from."""

    estimate: PolynomialEstimate
    residuals: Array  # (n, 2) m
    noise: Array  # (2, 2) or (n, 2, 2) m^2


def fit_motion(problem: MotionProblem, seen: CheckedObservations, weights: Array | None = None) -> MotionFit:
    """Fit with given weights; those of forgetting if none are given."""
    t, z, p = seen.times, seen.positions, problem.order + 1
    _check_enough(problem, seen)
    if weights is None and problem.forgetting < 1.0:
        weights = problem.forgetting ** np.arange(len(t) - 1, -1, -1.0)
    # where the weight is: what is forgotten must not spoil the conditioning
    center = float(t[0] + np.average(t - t[0], weights=weights))
    scale = math.sqrt(float(np.average((t - center) ** 2, weights=weights))) or 1.0
    rows = ((t - center) / scale)[:, None] ** np.arange(p)
    origin = z[0]  # coordinates of a map lose no digits either
    sigma = seen.covariance
    errors: ErrorLaw = NormalErrors()
    regressors: int | None = p
    prior = prior_rows(problem.prior, (t[-1] - center) / scale, scale, p)
    if sigma is None or (sigma.ndim == 2 and prior is None):
        coefficients, spread, moments = _common_fit(rows, z - origin, weights)
        if sigma is None:
            residuals = z - origin - rows @ coefficients
            weighted = residuals if weights is None else weights[:, None] * residuals
            size = float(np.sum((z - origin) ** 2 if weights is None else weights[:, None] * (z - origin) ** 2))
            sigma, errors = estimated_noise(residuals.T @ weighted, moments, problem.noise, Extent(size, origin))
        covariance = np.einsum("jk,ab->jakb", spread, sigma)
    if sigma.ndim == 3 or prior is not None:
        regressors = None
        coefficients, covariance = _general_fit(rows, z - origin, sigma, weights, prior)
    residuals = z - origin - rows @ coefficients
    coefficients[0] += origin
    estimate = PolynomialEstimate(
        reference_time=float(t[-1]),
        order=problem.order,
        observations=len(t),
        noise_covariance=sigma if sigma.ndim == 2 else sigma.mean(axis=0),
        errors=errors,
        regressors=regressors,
        center_time=center,
        time_scale=scale,
        coefficients=coefficients,
        coefficient_covariance=covariance,
        rejected=seen.rejected,
    )
    return MotionFit(estimate, residuals, sigma)


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


def _common_fit(rows: Array, z: Array, weights: Array | None) -> tuple[Array, Array, Moments]:
    """Fit with one covariance for all: coefficients, their covariance in units of it, moments."""
    if weights is None:
        q, r = np.linalg.qr(rows)
        inverse = np.linalg.inv(r)
        coefficients = inverse @ (q.T @ z)
        degrees = float(rows.shape[0] - rows.shape[1])
        return coefficients, inverse @ inverse.T, Moments(degrees, degrees)
    q, r = np.linalg.qr(np.sqrt(weights)[:, None] * rows)
    inverse = np.linalg.inv(r)
    coefficients = inverse @ (q.T @ (np.sqrt(weights)[:, None] * z))
    second = q.T @ (weights[:, None] * q)
    spread = inverse @ second @ inverse.T
    third = q.T @ (weights[:, None] ** 2 * q)
    expected = float(weights.sum() - np.trace(second))
    square = float((weights**2).sum() - 2.0 * np.trace(third) + np.sum(second * second))
    return coefficients, spread, Moments(expected, expected**2 / square)


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


def _gated(problem: MotionProblem, seen: CheckedObservations, probability: float) -> PolynomialEstimate:
    """Leave out the observations that the others call improbable."""
    # Rosner, Technometrics 25, 1983, with Bonferroni's bound for the least of n chances and for the rounds.
    fits, improbable = [fit_motion(problem, seen)], 0
    spare = len(seen.times) - problem.order - 1 - (0 if seen.covariance is not None else FEWEST_DEGREES_OF_FREEDOM)
    rounds = max(min(len(seen.times) // 3, spare), 0)
    for taken in range(1, rounds + 1):
        chances = _chances(fits[-1], seen.times)
        worst = int(np.argmin(chances))
        if chances[worst] * len(chances) * rounds < probability:
            improbable = taken
        seen = seen.without(worst)
        try:
            fits.append(fit_motion(problem, seen))
        except EstimationError:  # what is left does not determine the motion
            break
    return fits[min(improbable, len(fits) - 1)].estimate


def _chances(fit: MotionFit, times: Array) -> Array:
    """Give each observation's probability of being as far from the position that the others give, or farther."""
    explained = fit.estimate.covariance(times)
    if isinstance(fit.estimate.errors, NormalErrors):
        return np.exp(-0.5 * _distances(fit.residuals, fit.noise - explained) ** 2)
    # Deleted residuals: the covariance is estimated without the observation that is judged. Their squared
    # distance is (nu - 1) u / (1 - u), u the observation's share of all squared residuals, and its law has a
    # closed form.
    degrees = len(times) - fit.estimate.order - 1
    unexplained = 1.0 - 0.5 * np.trace(np.linalg.solve(fit.noise, explained), axis1=1, axis2=2)
    shares = _distances(fit.residuals, fit.noise) ** 2 / np.maximum(degrees * unexplained, float_info.min)
    if isinstance(fit.estimate.errors, StudentErrors):
        return np.maximum(1.0 - 0.5 * shares, 0.0) ** (degrees - 1)
    if degrees <= FEWEST_DEGREES_OF_FREEDOM:
        return np.ones(len(shares))
    return np.maximum(1.0 - shares, 0.0) ** (0.5 * (degrees - 2))


def _huber(problem: MotionProblem, seen: CheckedObservations) -> PolynomialEstimate:
    """Weigh observations beyond ``HUBER.distance`` down until the weights and the fit agree."""
    fit, count, isotropic = fit_motion(problem, seen), len(seen.times), problem.noise is Noise.ISOTROPIC
    forgotten = problem.forgetting ** np.arange(count - 1, -1, -1.0)
    degrees = count - problem.order - 1
    sigma, residuals = fit.noise, fit.residuals
    for _ in range(HUBER.steps):
        distances = _distances(residuals, sigma)
        weights = np.minimum(1.0, HUBER.distance / distances)
        fit = fit_motion(problem, seen, forgotten * weights)
        if seen.covariance is None:
            scatter = fit.residuals.T @ (weights[:, None] ** 2 * fit.residuals)
            scatter /= degrees * -math.expm1(-0.5 * HUBER.distance**2)
            sigma = 0.5 * np.trace(scatter) * np.eye(2) if isotropic else scatter
        moved = float(np.max(_distances(fit.residuals - residuals, sigma)))
        residuals = fit.residuals
        if moved <= RESIDUAL_TOLERANCE:
            break
    errors: ErrorLaw = NormalErrors()
    if seen.covariance is None:
        errors = StudentErrors(2.0 * degrees) if isotropic else HotellingErrors(degrees)
    plain = fit_motion(problem, replace(seen, covariance=sigma)).estimate
    spread = _spread_factor(_distances(residuals, sigma), degrees) * plain.coefficient_covariance
    return replace(
        fit.estimate,
        coefficient_covariance=spread,
        noise_covariance=plain.noise_covariance,
        errors=errors,
        regressors=None,
    )


def _distances(residuals: Array, sigma: Array) -> Array:
    """Mahalanobis distances of residuals, at least a tiny one; the covariance is common or one for each."""
    solved = np.linalg.solve(np.broadcast_to(sigma, (len(residuals), 2, 2)), residuals[:, :, None])[:, :, 0]
    return np.sqrt(np.maximum(np.einsum("na,na->n", residuals, solved), float_info.min))


def _spread_factor(distances: Array, degrees: int) -> float:
    """Give E[psi^2] / 2 over (E[psi' + psi / d] / 2)^2, psi(d) = min(d, k); at least that of normal noise."""
    k = HUBER.distance
    inside = -math.expm1(-0.5 * k**2)
    beyond = k * math.sqrt(0.5 * math.pi) * math.erfc(k / math.sqrt(2.0))
    normal = inside / (inside + 0.5 * beyond) ** 2
    psi = np.minimum(distances, k)
    slope = 0.5 * float(np.mean((distances < k) + psi / distances))
    return max(normal, float(np.sum(psi**2)) / (2.0 * degrees) / slope**2) if degrees > 0 else normal
