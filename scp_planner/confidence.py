"""How large a confidence region has to be for each level that a user can ask for.

A region at time t is the ellipse {z : z' C(t)^-1 z <= q} about the estimated centre, C(t) the covariance of the
estimated centre. This module gives q.

- ``per_time``: the true centre is inside at one chosen time. Exact: q is a quantile of chi-square with 2 degrees of
  freedom (noise covariance known), or of Hotelling's T^2 (noise covariance estimated with nu degrees of freedom).
- ``per_obstacle``: it is inside at all times of a span at once. The error, standardised at each time, is a smooth
  process w(t) in the plane, and P(|w|^2 exceeds q somewhere) is at most P(it does so at the first moment) plus the
  expected number of times that it rises through q (Rice). That number is the *standardised length* of the error (below)
  times a rate that has a closed form, for a known and for an estimated covariance. For a polynomial motion the length
  is that of a curve on a sphere, and the bound is the tube formula of Naiman for simultaneous bands.
  It is never below the level and above it only by the chance of two separate excursions. The largest root of a Wishart
  matrix (known covariance) or Roy's largest root (estimated) bounds the same probability for *all* regressors, also those that no
  time belongs to; the smaller of the two bounds is used.
- ``joint``: inside at all times for all m estimated obstacles: each of them has the probability P^(1/m). Exact for
  independent obstacles, and for a known covariance also safe for dependent ones (the Gaussian correlation inequality,
  since each event is a symmetric convex set). This is the default of the planner.

References
----------
D. Q. Naiman, *Conservative confidence bands in curvilinear regression*, Ann. Statist. 14 (1986);
S. O. Rice, *Mathematical analysis of random noise*, Bell Syst. Tech. J. 24 (1945);
S. N. Roy, *On a heuristic method of test construction*, Ann. Math. Statist. 24 (1953);
T. Royen, *A simple proof of the Gaussian correlation conjecture*, Far East J. Theor. Stat. 48 (2014).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import lru_cache
from typing import TYPE_CHECKING

from scp_planner.errors import EstimationError

if TYPE_CHECKING:
    from scp_planner.estimation import MotionEstimate

LEVELS = ("per_time", "per_obstacle", "joint")
_ROOT_TWO_PI = math.sqrt(2.0 * math.pi)
_SCALE_TOLERANCE = 1e-13  # relative, of q
_MINIMUM_DEGREES_OF_FREEDOM = 2  # with fewer, the estimated covariance of a point in the plane is singular


def region_scale(
    level: str,
    probability: float,
    estimate: MotionEstimate,
    *,
    obstacles: int = 1,
    start: float = -math.inf,
    stop: float = math.inf,
) -> float:
    """Give q of the ellipse z' C(t)^-1 z <= q, with C(t) = ``estimate.covariance(t)``.

    Parameters
    ----------
    level : "per_time", "per_obstacle" or "joint"
        What the probability is about; see the head of this module.
    probability : float
        The level, between 0 and 1, such as 0.95.
    estimate : MotionEstimate
        Of the obstacle that the region is for.
    obstacles : int
        How many obstacles are *estimated* (those known exactly do not count); only ``joint`` uses it.
    start, stop : float
        s, the span of time over which ``per_obstacle`` and ``joint`` hold; the default is all times, which for a polynomial
        motion costs little. A process-noise model needs a finite ``stop``.

    Returns
    -------
    float
        q > 0.

    Raises
    ------
    EstimationError
        For an unknown level, a probability outside (0, 1), or too few degrees of freedom for any region.
    """
    if level == "per_time":
        return pointwise_scale(probability, estimate.degrees_of_freedom)
    if level not in LEVELS:
        raise EstimationError(f"level: {level!r} is not one of {', '.join(LEVELS)}")
    if level == "joint":
        probability = shared_probability(probability, obstacles)
    length = estimate.standardised_length(start, stop)
    return uniform_scale(probability, length, estimate.degrees_of_freedom, estimate.regressors)


def shared_probability(probability: float, obstacles: int) -> float:
    """Give the probability that each of ``obstacles`` needs for all of them to have ``probability`` jointly (Sidak)."""
    if obstacles < 1:
        raise EstimationError(f"obstacles: {obstacles} is not a positive number")
    # not probability ** (1 / m): for probabilities near 1 that loses the digits of the small remainder
    return 1.0 + math.expm1(math.log(_checked(probability)) / obstacles)


@lru_cache(maxsize=1024)
def pointwise_scale(probability: float, degrees_of_freedom: int | None = None) -> float:
    """Give q of a region that holds at one time.

    The chi-square quantile with 2 degrees of freedom is -2 log(alpha); Hotelling's, 2 nu / (nu - 1) F(2, nu - 1), is
    nu (alpha^(-2 / (nu - 1)) - 1). With ``order`` + 1 = 3 regressors nu = n - 3.
    """
    log_alpha = math.log1p(-_checked(probability))
    if degrees_of_freedom is None:
        return -2.0 * log_alpha
    nu = _checked_degrees(degrees_of_freedom)
    return nu * math.expm1(-2.0 * log_alpha / (nu - 1))


def uniform_scale(
    probability: float, length: float, degrees_of_freedom: int | None = None, regressors: int | None = None
) -> float:
    """Give q of a region that holds over a whole span of time.

    Parameters
    ----------
    probability : float
        That the true centre is inside at all times of the span.
    length : float
        The standardised length of the error over the span, ``MotionEstimate.standardised_length``.
    degrees_of_freedom : int or None
        Of the estimated noise covariance; None if it is known.
    regressors : int or None
        p of the regression whose error is a p-vector times the square root of one covariance; None if the error has no such
        form. Bounds q by the largest root.
    """
    alpha = -math.expm1(math.log(_checked(probability)))
    if not length >= 0.0:
        raise EstimationError(f"standardised length: {length!r} is not a number >= 0")
    floor = pointwise_scale(probability, degrees_of_freedom)
    if length == 0.0:
        return floor
    caps = [] if math.isinf(length) else [_root(lambda q: excursion_tail(q, length, degrees_of_freedom), alpha, floor)]
    if regressors is not None:
        caps.append(_largest_root_scale(alpha, floor, regressors, degrees_of_freedom))
    if not caps:
        raise EstimationError("the span of time is unbounded, and over it no region of this motion model holds: give a finite stop")
    return min(caps)


def excursion_tail(scale: float, length: float, degrees_of_freedom: int | None = None) -> float:
    """Bound the probability that the standardised error leaves the region of scale q somewhere in a span.

    P(outside at the first moment) + expected number of exits. With an exit rate per unit of standardised length of
    sqrt(q / 2 pi) exp(-q / 2) for a known covariance. For an estimated one, averaged over the Wishart distribution of the estimate,
    sqrt(2 q / nu) / sqrt(2 pi) Gamma((nu + 1) / 2) / Gamma(nu / 2) (1 + q / nu)^(-nu / 2).
    """
    if degrees_of_freedom is None:
        return math.exp(-0.5 * scale) * (1.0 + length * math.sqrt(scale) / _ROOT_TWO_PI)
    nu = _checked_degrees(degrees_of_freedom)
    log_growth = math.log1p(scale / nu)
    gamma_ratio = math.exp(math.lgamma(0.5 * (nu + 1)) - math.lgamma(0.5 * nu))
    rate = math.sqrt(2.0 * scale / nu) / _ROOT_TWO_PI * gamma_ratio * math.exp(-0.5 * nu * log_growth)
    return math.exp(-0.5 * (nu - 1) * log_growth) + length * rate


def largest_root_tail(scale: float, regressors: int, degrees_of_freedom: int | None = None) -> float:
    """Give the exact probability that the largest root exceeds q.

    Known covariance: the larger eigenvalue of a Wishart(I_2, p). Estimated: nu times the larger root of H E^-1 with
    H ~ Wishart(I_2, p), E ~ Wishart(I_2, nu) (Roy). Both are double integrals over the two roots which in the plane reduce to
    incomplete gamma and beta functions.
    """
    from scipy import special

    p, q = regressors, scale
    if degrees_of_freedom is None:
        if p == 1:
            return math.exp(-0.5 * q)
        half = 0.5 * (p - 1)
        lower = special.gammainc(half, 0.5 * q) * math.exp(
            math.lgamma(half) - math.lgamma(p - 1) + half * math.log(2.0 * q) - 0.5 * q
        )
        return float(special.gammaincc(p - 1, q) + 0.5 * lower)
    nu = _checked_degrees(degrees_of_freedom)
    if p == 1:
        return math.exp(-0.5 * (nu - 1) * math.log1p(q / nu))
    a, b, c = 0.5 * (p - 1), 0.5 * (nu - 1), q / nu
    theta, rest = c / (1.0 + c), 1.0 / (1.0 + c)
    log_weight = a * math.log(theta) + b * math.log(rest) + special.betaln(a, b) - special.betaln(2 * a, 2 * b)
    return float(special.betaincc(2 * a, 2 * b, theta) + 0.5 * math.exp(log_weight) * special.betainc(a, b, theta))


@lru_cache(maxsize=1024)
def _largest_root_scale(alpha: float, floor: float, regressors: int, degrees_of_freedom: int | None) -> float:
    return _root(lambda q: largest_root_tail(q, regressors, degrees_of_freedom), alpha, floor)


def _root(tail: Callable[[float], float], alpha: float, floor: float) -> float:
    """Solve tail(q) = alpha for q >= floor: the tails fall there; regula falsi in log q and log tail (Illinois)."""
    target = math.log(alpha)
    low, high = math.log(floor), math.log(floor) + 0.5
    f_low, f_high = math.log(tail(floor)) - target, math.log(tail(math.exp(high))) - target
    if f_low <= 0.0:
        return floor
    while f_high > 0.0:
        low, f_low = high, f_high
        high += 1.0
        f_high = math.log(tail(math.exp(high))) - target
    for _ in range(200):
        if high - low <= _SCALE_TOLERANCE:
            break
        middle = high - f_high * (high - low) / (f_high - f_low)
        f_middle = math.log(tail(math.exp(middle))) - target
        if f_middle == 0.0:
            return math.exp(middle)
        if f_middle * f_high < 0.0:
            low, f_low = high, f_high
        else:
            f_low *= 0.5
        done = abs(middle - high) <= _SCALE_TOLERANCE
        high, f_high = middle, f_middle
        if done:
            break
    return math.exp(high)


def _checked(probability: float) -> float:
    if not 0.0 < probability < 1.0:
        raise EstimationError(f"probability: {probability!r} is not between 0 and 1")
    return probability


def _checked_degrees(degrees_of_freedom: int) -> int:
    if degrees_of_freedom < _MINIMUM_DEGREES_OF_FREEDOM:
        raise EstimationError(
            f"degrees of freedom: {degrees_of_freedom} leaves the noise covariance unknown; "
            f"at least {_MINIMUM_DEGREES_OF_FREEDOM} are needed: more observations, a lower order or a known covariance"
        )
    return degrees_of_freedom
