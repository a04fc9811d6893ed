"""Estimates that a few wrong observations cannot spoil: gating and Huber weights."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from sys import float_info

import numpy as np

from scp_planner.arrays import Array
from scp_planner.errors import EstimationError
from scp_planner.tracking.error_laws import (
    FEWEST_DEGREES_OF_FREEDOM,
    ErrorLaw,
    HotellingErrors,
    NormalErrors,
    StudentErrors,
)
from scp_planner.tracking.least_squares import MotionFit, MotionProblem, Noise, fit_motion
from scp_planner.tracking.motion_estimate import PolynomialEstimate
from scp_planner.tracking.observations import CheckedObservations
from scp_planner.tracking.tolerances import RESIDUAL_TOLERANCE


@dataclass(frozen=True)
class HuberSettings:
    """Weights of Huber's estimate."""

    # Mahalanobis distance beyond which Huber's weights fall; 13.5 % of normal observations lie beyond it
    distance: float = 2.0
    steps: int = 200


HUBER = HuberSettings()


def gated(problem: MotionProblem, seen: CheckedObservations, probability: float) -> PolynomialEstimate:
    """Leave out the observations that the others call improbable."""
    # Rosner, Technometrics 25, 1983, with Bonferroni's bound for the least of n chances and for the rounds).
    fits = [fit_motion(problem, seen)]
    improbable = 0
    spare = len(seen.times) - problem.order - 1 - (0 if seen.covariance is not None else FEWEST_DEGREES_OF_FREEDOM)
    rounds = max(min(len(seen.times) // 3, spare), 0)
    for taken in range(1, rounds + 1):
        chances = _chances(fits[-1])
        worst = int(np.argmin(chances))
        if chances[worst] * len(chances) * rounds < probability:
            improbable = taken
        seen = _without(seen, worst)
        try:
            fits.append(fit_motion(problem, seen))
        except EstimationError:  # what is left does not determine the motion
            break
    return fits[min(improbable, len(fits) - 1)].estimate()


def _without(seen: CheckedObservations, place: int) -> CheckedObservations:
    kept = np.arange(len(seen.times)) != place
    sigma = seen.covariance
    return replace(
        seen,
        times=seen.times[kept],
        positions=seen.positions[kept],
        covariance=sigma[kept] if sigma is not None and sigma.ndim == 3 else sigma,
        rows=seen.rows[kept],
        rejected=tuple(sorted((*seen.rejected, int(seen.rows[place])))),
    )


def huber(problem: MotionProblem, seen: CheckedObservations) -> PolynomialEstimate:
    """Weigh observations beyond `HUBER_DISTANCE` down until the weights and the fit agree."""
    plain = fit_motion(problem, seen)
    forgotten = problem.forgetting ** np.arange(len(plain.rows) - 1, -1, -1.0)
    degrees = len(plain.rows) - problem.order - 1
    sigma, residuals = plain.noise, plain.residuals
    for _ in range(HUBER.steps):
        distances = _distances(residuals, sigma)
        fit = fit_motion(problem, seen, forgotten * np.minimum(1.0, HUBER.distance / distances))
        if seen.covariance is None:
            sigma = _scatter(fit.residuals, distances, degrees, problem.noise)
        moved = float(np.max(_distances(fit.residuals - residuals, sigma)))
        residuals = fit.residuals
        if moved <= RESIDUAL_TOLERANCE:
            break
    known = replace(seen, covariance=sigma) if seen.covariance is None else seen
    errors: ErrorLaw = NormalErrors()
    if seen.covariance is None:
        errors = StudentErrors(2.0 * degrees) if problem.noise is Noise.ISOTROPIC else HotellingErrors(degrees)
    spread = _spread_factor(_distances(residuals, sigma), degrees) * fit_motion(problem, known).covariance
    return replace(fit, covariance=spread, noise=sigma, errors=errors, regressors=None).estimate()


def _chances(fit: MotionFit) -> Array:
    """Give each observation's probability of being as far from where the others put it, or farther."""
    explained = np.einsum("nj,jakb,nk->nab", fit.rows, fit.covariance, fit.rows)
    if isinstance(fit.errors, NormalErrors):
        return np.exp(-0.5 * _distances(fit.residuals, fit.noise - explained) ** 2)
    # Deleted residuals: the covariance is estimated without the observation that is judged. Their squared
    # distance is (nu - 1) u / (1 - u), u the observation's share of all squared residuals, and its law has a
    # closed form.
    degrees = len(fit.rows) - fit.problem.order - 1
    unexplained = 1.0 - 0.5 * np.trace(np.linalg.solve(fit.noise, explained), axis1=1, axis2=2)
    shares = _distances(fit.residuals, fit.noise) ** 2 / np.maximum(degrees * unexplained, float_info.min)
    if fit.problem.noise is Noise.ISOTROPIC:
        return np.maximum(1.0 - 0.5 * shares, 0.0) ** (degrees - 1)
    if degrees <= FEWEST_DEGREES_OF_FREEDOM:
        return np.ones(len(shares))
    return np.maximum(1.0 - shares, 0.0) ** (0.5 * (degrees - 2))


def _distances(residuals: Array, sigma: Array) -> Array:
    """Give the residuals' Mahalanobis distances, at least a tiny one; sigma is common or one for each."""
    solved = np.linalg.solve(np.broadcast_to(sigma, (len(residuals), 2, 2)), residuals[:, :, None])[:, :, 0]
    return np.sqrt(np.maximum(np.einsum("na,na->n", residuals, solved), float_info.min))


def _scatter(residuals: Array, distances: Array, degrees: int, noise: Noise) -> Array:
    shares = np.minimum(1.0, (HUBER.distance / distances) ** 2)
    consistency = -math.expm1(-0.5 * HUBER.distance**2)
    scatter = residuals.T @ (shares[:, None] * residuals) / (degrees * consistency)
    return 0.5 * np.trace(scatter) * np.eye(2) if noise is Noise.ISOTROPIC else scatter


def _spread_factor(distances: Array, degrees: int) -> float:
    """Give E[psi^2] / 2 over (E[psi' + psi / d] / 2)^2, psi(d) = min(d, k); at least that of normal noise."""
    k = HUBER.distance
    inside = -math.expm1(-0.5 * k**2)
    beyond = k * math.sqrt(0.5 * math.pi) * math.erfc(k / math.sqrt(2.0))
    normal = inside / (inside + 0.5 * beyond) ** 2
    psi = np.minimum(distances, k)
    slope = 0.5 * float(np.mean((distances < k) + psi / distances))
    return max(normal, float(np.sum(psi**2)) / (2.0 * degrees) / slope**2) if degrees > 0 else normal
