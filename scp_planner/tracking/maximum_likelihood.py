"""Maximum likelihood of an obstacle's motion from noisy observations of its position: polynomials in scaled time."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from numpy.typing import ArrayLike

from scp_planner.arrays import Array
from scp_planner.errors import EstimationError
from scp_planner.scenario.tolerances import DEFINITE, SYMMETRY
from scp_planner.settings.knobs import word_of
from scp_planner.tracking.confidence import ErrorLaw, HotellingErrors, NormalErrors, StudentErrors
from scp_planner.tracking.motion_estimate import PolynomialEstimate
from scp_planner.tracking.tolerances import LAST_DIGITS

HIGHEST_ORDER = 2


@dataclass(frozen=True)
class NoiseBounds:
    least: float = 1e-6  # standard deviation, relative to how far the observed positions are apart
    least_ratio: float = 1e-2  # of the smaller standard deviation to the larger one


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
class CheckedObservations:
    """Finite observations in order of time, none of them twice."""

    times: Array  # (n,) s
    positions: Array  # (n, 2) m
    covariance: Array | None = None  # (2, 2) or (n, 2, 2) m^2


def check_observations(
    times: ArrayLike, positions: ArrayLike, covariance: ArrayLike | None = None
) -> CheckedObservations:
    t, z = _numbers(times, "time"), _numbers(positions, "position")
    if t.ndim != 1 or z.shape != (len(t), 2):
        raise EstimationError(f"observations: time has shape {t.shape}, position {z.shape}; must be (n,) and (n, 2)")
    sigma = None if covariance is None else check_covariance(covariance, len(t))
    for name, values, finite in (("time", t, np.isfinite(t)), ("position", z, np.isfinite(z).all(axis=1))):
        if not finite.all():
            i = int(np.argmin(finite))
            raise EstimationError(f"observations.{name}[{i}]: {values[i].tolist()} is not finite")
    rows = np.lexsort((z[:, 1], z[:, 0], t))
    same = (t[rows[1:]] == t[rows[:-1]]) & (z[rows[1:]] == z[rows[:-1]]).all(axis=1)
    if same.any():
        first, again = rows[int(np.argmax(same)) :][:2].tolist()
        raise EstimationError(
            f"observations[{again}]: time {float(t[again])!r} with position {z[again].tolist()} is there twice,"
            f" first as observations[{first}]"
        )
    order = np.argsort(t, kind="stable")
    return CheckedObservations(t[order], z[order], sigma if sigma is None or sigma.ndim == 2 else sigma[order])


def check_covariance(covariance: ArrayLike, count: int) -> Array:
    """Check a noise covariance: (2, 2), or (count, 2, 2), m^2."""
    sigma = _numbers(covariance, "covariance")
    if sigma.shape not in ((2, 2), (count, 2, 2)):
        raise EstimationError(f"observations.covariance: its shape is {sigma.shape}; must be (2, 2) or ({count}, 2, 2)")
    xx, xy, yx, yy = (sigma[..., a, b] for a in range(2) for b in range(2))
    size = np.sqrt(np.maximum(xx, 0.0)) * np.sqrt(np.maximum(yy, 0.0))
    with np.errstate(invalid="ignore", over="ignore"):
        faults = (
            ("finite", ~np.isfinite(sigma).all(axis=(-2, -1))),
            ("symmetric", np.abs(xy - yx) > SYMMETRY * size),
            ("positive definite", ~((size > 0.0) & (xy**2 < (1.0 - DEFINITE) * size**2))),
        )
    for what, bad in faults:
        if np.any(bad):
            i = int(np.argmax(bad))
            place, matrix = ("", sigma) if sigma.ndim == 2 else (f"[{i}]", sigma[i])
            raise EstimationError(f"observations.covariance{place}: {matrix.tolist()} is not {what}")
    return 0.5 * (sigma + np.swapaxes(sigma, -1, -2))


def _numbers(values: ArrayLike, name: str) -> Array:
    try:
        return np.asarray(values, dtype=float)
    except (TypeError, ValueError, OverflowError) as error:
        raise EstimationError(f"observations.{name}: it is not an array of numbers ({error})") from None


def estimate_motion(
    times: ArrayLike,
    positions: ArrayLike,
    covariance: ArrayLike | None = None,
    order: int = 2,
    prior: MotionPrior | None = None,
    *,
    noise: Noise | str = Noise.GENERAL,
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
    form = word_of(Noise, noise, "noise")
    seen = check_observations(times, positions, covariance)
    _check_enough(seen, int(order), prior, form)
    t, z, p = seen.times, seen.positions, int(order) + 1
    center = float(t[0] + np.average(t - t[0]))
    scale = math.sqrt(float(np.average((t - center) ** 2))) or 1.0
    rows = ((t - center) / scale)[:, None] ** np.arange(p)
    origin, sigma = z[0], seen.covariance  # coordinates of a map lose no digits either
    errors: ErrorLaw = NormalErrors()
    known = prior_rows(prior, (t[-1] - center) / scale, scale, p)
    regressors = p if known is None and (sigma is None or sigma.ndim == 2) else None
    if sigma is None or regressors is not None:
        q, r = np.linalg.qr(rows)
        inverse = np.linalg.inv(r)
        coefficients = inverse @ (q.T @ (z - origin))
        if sigma is None:
            residuals = z - origin - rows @ coefficients
            extent = Extent(float(np.sum((z - origin) ** 2)), origin)
            sigma, errors = estimated_noise(residuals.T @ residuals, float(len(t) - p), form, extent)
        spread = np.einsum("jk,ab->jakb", inverse @ inverse.T, sigma)
    if regressors is None:
        coefficients, spread = _general_fit(rows, z - origin, sigma, known)
    coefficients[0] += origin
    return PolynomialEstimate(
        reference_time=float(t[-1]),
        order=p - 1,
        observations=len(t),
        noise_covariance=sigma if sigma.ndim == 2 else sigma.mean(axis=0),
        errors=errors,
        regressors=regressors,
        center_time=center,
        time_scale=scale,
        coefficients=coefficients,
        coefficient_covariance=spread,
    )


def _check_enough(seen: CheckedObservations, order: int, prior: MotionPrior | None, noise: Noise) -> None:
    n, p = len(seen.times), order + 1
    if seen.covariance is None:
        least, why = p + (2 if noise is Noise.GENERAL else 1), "a covariance to be estimated"
    else:
        least, why = (p if prior is None else 1), "a known covariance"
    if n < least:
        raise EstimationError(f"observations: {n} are too few for order {order} and {why}; at least {least} are needed")
    distinct = 1 + int(np.count_nonzero(np.diff(seen.times)))
    if distinct < p and (prior is None or seen.covariance is None):
        raise EstimationError(
            f"observations.time: {distinct} different times are too few for order {order}; at least {p} are needed"
        )


@dataclass(frozen=True)
class Extent:
    """Size of the observed positions, by which the noise that residuals show is told from rounding."""

    square: float  # Sum of their squared distances from the origin, m^2
    origin: Array  # (2,) One of them, m
    known: float = 0.0  # Least standard deviation that is known otherwise, m

    def least_variance(self, count: float) -> float:
        """Smallest variance that can be estimated from so many observations, m^2."""
        rounding = LAST_DIGITS * float(np.abs(self.origin).max())
        return NOISE_BOUNDS.least**2 * self.square / count + rounding * rounding + self.known * self.known


def estimated_noise(scatter: Array, degrees: float, noise: Noise, extent: Extent) -> tuple[Array, ErrorLaw]:
    """Estimate the noise covariance from E'E, the scatter of the residuals; tell the law of the errors."""
    if not extent.square > 0.0:
        raise EstimationError(
            "observations.position: they lie exactly on a motion, at one place, so that their covariance cannot be"
            " estimated; give it"
        )
    sigma = scatter / degrees
    if noise is Noise.ISOTROPIC:
        sigma = 0.5 * np.trace(sigma) * np.eye(2)
    sigma = _at_least(sigma, extent.least_variance(degrees))
    if noise is Noise.ISOTROPIC:
        return sigma, StudentErrors(2.0 * degrees)
    return sigma, HotellingErrors(degrees)


def _at_least(sigma: Array, least: float) -> Array:
    """Covariance (2, 2) whose smaller variance is raised to a least one, and to a share of the larger one."""
    mean, half = 0.5 * (sigma[0, 0] + sigma[1, 1]), 0.5 * (sigma[0, 0] - sigma[1, 1])
    spread = math.hypot(float(half), float(sigma[0, 1]))
    least = max(least, NOISE_BOUNDS.least_ratio**2 * float(mean + spread))
    if float(mean - spread) >= least:
        return sigma
    values, vectors = np.linalg.eigh(0.5 * (sigma + sigma.T))
    return (vectors * np.maximum(values, least)) @ vectors.T


def _general_fit(rows: Array, z: Array, sigma: Array, prior: tuple[Array, Array] | None) -> tuple[Array, Array]:
    """Fit all 2 p coefficients together: each observation whitened by its covariance, the prior appended."""
    n, p = rows.shape
    whiten = np.linalg.inv(np.linalg.cholesky(np.broadcast_to(sigma, (n, 2, 2))))
    design = np.einsum("nj,nab->najb", rows, whiten).reshape(2 * n, 2 * p)
    target = np.einsum("nab,nb->na", whiten, z).reshape(2 * n)
    if prior is not None:
        design, target = np.vstack([design, prior[0]]), np.concatenate([target, prior[1]])
    if np.linalg.matrix_rank(design) < 2 * p:
        raise EstimationError(
            f"observations: {n} and the prior do not determine a motion of order {p - 1}; try a lower order"
        )
    q, r = np.linalg.qr(design)
    inverse = np.linalg.inv(r)
    return (inverse @ (q.T @ target)).reshape(p, 2), (inverse @ inverse.T).reshape(p, 2, p, 2)


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
