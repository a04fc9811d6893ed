"""How large a confidence region has to be for each level that a user can ask for.

A region at time t is the ellipse {z : z' C(t)^-1 z <= q} about the estimated centre, C(t) the covariance of
the estimated centre. This module gives q.

- ``per_time``: the true centre is inside at one chosen time. Exact: q is a quantile of chi-square with 2
  degrees of freedom if the noise covariance is known, of Hotelling's T^2 if it is estimated.
- ``per_obstacle``: it is inside at all times of a span at once. The error, standardised at each time, is a
  smooth process w(t) in the plane, and the probability that |w|^2 exceeds q somewhere is at most the
  probability that it does so at the first moment plus the expected number of times that it rises through q
  (Rice). That number is the *standardised length* of the error over the span
  (`MotionEstimate.standardised_length`) times a rate with a closed form. For a polynomial motion the length
  is that of a curve on a sphere, and the bound is Naiman's for simultaneous bands in curvilinear regression.
  It is never below the level, and above it only by the chance of two separate excursions. The largest root of
  a Wishart matrix, or Roy's if the covariance is estimated, bounds the same probability for *all* regressors,
  also those that belong to no time; the smaller of the two regions is used.
- ``joint``: inside at all times for all m estimated obstacles: each of them has the probability P^(1/m)
  (Sidak). Exact for independent obstacles. If the covariance is known it is also safe for dependent ones, by
  the Gaussian correlation inequality, since each event is a symmetric convex set of the errors. This is the
  default of the planner.

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
from scp_planner.estimation.error_laws import ErrorLaw

if TYPE_CHECKING:
    from scp_planner.estimation.motion_estimate import MotionEstimate

LEVELS = ("per_time", "per_obstacle", "joint")
LARGEST_ALPHA = 1.0 - 2.0**-53  # the largest number below 1: what holds with hardly any probability has some region
_SCALE_TOLERANCE = 1e-13  # of log q


def region_scale(
    level: str,
    probability: float,
    estimate: MotionEstimate,
    *,
    obstacles: int = 1,
    start: float = -math.inf,
    stop: float = math.inf,
) -> float:
    """Give q of the ellipse {z : z' C(t)^-1 z <= q}, with C(t) = ``estimate.covariance(t)``.

    Parameters
    ----------
    level : "per_time", "per_obstacle" or "joint"
        What the probability is about; see the head of this module.
    probability : float
        The level, between 0 and 1, such as 0.95.
    estimate : MotionEstimate
        Of the obstacle that the region is for.
    obstacles : int
        How many obstacles are *estimated* (those known exactly do not count). Only ``joint`` uses it.
    start, stop : float
        s, the span of time over which ``per_obstacle`` and ``joint`` hold. A polynomial motion allows all
        times, and a stop at infinity costs it little; a process-noise model needs both to be finite.

    Returns
    -------
    float
        q > 0.

    Raises
    ------
    EstimationError
        For an unknown level, a probability outside (0, 1), or a span over which no region holds.
    """
    if level not in LEVELS:
        raise EstimationError(f"level: {level!r} is not one of {', '.join(LEVELS)}")
    alpha = outside_probability(probability)
    if level == "per_time":
        return estimate.errors.pointwise_scale(alpha)
    if level == "joint":
        alpha = shared_alpha(alpha, obstacles)
    return uniform_scale(alpha, estimate.standardised_length(start, stop), estimate.errors, estimate.regressors)


def marginal_scale(level: str, probability: float, times: int, obstacles: int) -> float:
    """Give q for normal errors of known covariance at some times, of which no dependence is known.

    Parameters
    ----------
    level, probability
        As in :func:`region_scale`.
    times : int
        For how many times a covariance is given: at all of them at once by Sidak's inequality, see above.
    obstacles : int
        How many obstacles are not known exactly.

    Returns
    -------
    float
        q.

    Raises
    ------
    EstimationError
        If there is no such level, or the probability is not between 0 and 1.
    """
    return course_scale(level, alpha_of_one(level, probability, obstacles), times)


def alpha_of_one(level: str, probability: float, obstacles: int) -> float:
    """Give the probability that one obstacle may be outside its zone with, at one time or at any by the level.

    Parameters
    ----------
    level, probability
        As in :func:`region_scale`.
    obstacles : int
        How many obstacles are not known exactly.

    Returns
    -------
    float

    Raises
    ------
    EstimationError
        If there is no such level, or the probability is not between 0 and 1.
    """
    if level not in LEVELS:
        raise EstimationError(f"level: {level!r} is not one of {', '.join(LEVELS)}")
    alpha = outside_probability(probability)
    return shared_alpha(alpha, obstacles) if level == "joint" else alpha


def course_scale(level: str, alpha: float, times: int) -> float:
    """Give q for normal errors of known covariance at some times, with the probability to be outside.

    Parameters
    ----------
    level : "per_time", "per_obstacle" or "joint"
        Whether ``alpha`` is about one time or about all.
    alpha : float
        Of this obstacle.
    times : int
        As in :func:`marginal_scale`.

    Returns
    -------
    float
        q.
    """
    if level != "per_time":
        alpha = shared_alpha(alpha, times)
    return -2.0 * math.log(alpha)  # the quantile of chi-square with 2 degrees of freedom


def outside_probability(probability: float) -> float:
    """Give alpha, the probability to be outside of what holds with a probability.

    Parameters
    ----------
    probability : float
        Between 0 and 1.

    Returns
    -------
    float
        Below 1, however small the probability is.

    Raises
    ------
    EstimationError
        For a probability outside (0, 1).
    """
    if not 0.0 < probability < 1.0:
        raise EstimationError(f"probability: {probability!r} is not between 0 and 1")
    return min(1.0 - probability, LARGEST_ALPHA)


def shared_alpha(alpha: float, obstacles: int) -> float:
    """Give the alpha of each of m obstacles that makes it ``alpha`` for all of them jointly (Sidak)."""
    if obstacles < 1:
        raise EstimationError(f"obstacles: {obstacles} is not a positive number")
    # 1 - (1 - alpha)^(1 / m), without losing the digits of a small alpha
    return -math.expm1(math.log1p(-alpha) / obstacles)


@lru_cache(maxsize=4096)
def uniform_scale(alpha: float, length: float, errors: ErrorLaw, regressors: int | None = None) -> float:
    """Give q that |w|^2 exceeds anywhere in a span of time with probability at most alpha.

    Parameters
    ----------
    alpha : float
    length : float
        The standardised length of the error over the span.
    errors : ErrorLaw
    regressors : int or None
        p, if the error is that of a regression on p functions of time with one covariance for all
        observations; then the largest root bounds q.

    Returns
    -------
    float
        q.

    Raises
    ------
    EstimationError
        If the length is no number of at least 0, or the span has no end where that matters.
    """
    if not length >= 0.0:
        raise EstimationError(f"standardised length: {length!r} is not a number >= 0")
    floor = errors.pointwise_scale(alpha)
    if length == 0.0:
        return floor
    bounds = []
    if math.isfinite(length):
        bounds.append(_solve(lambda q: excursion_bound(q, length, errors), alpha, floor))
    if regressors is not None and errors.largest_root_exceedance(floor, regressors) is not None:
        bounds.append(_largest_root_scale(alpha, floor, errors, regressors))
    if not bounds:
        raise EstimationError("span of time: it is unbounded, and over it no region of this motion model holds")
    return min(bounds)


def excursion_bound(scale: float, length: float, errors: ErrorLaw) -> float:
    """Bound the probability that |w|^2 exceeds q anywhere in a span of the given standardised length."""
    return errors.exceedance(scale) + length * errors.exit_rate(scale)


@lru_cache(maxsize=1024)
def _largest_root_scale(alpha: float, floor: float, errors: ErrorLaw, regressors: int) -> float:
    return _solve(lambda q: errors.largest_root_exceedance(q, regressors) or 0.0, alpha, floor)


def _solve(tail: Callable[[float], float], alpha: float, floor: float) -> float:
    """Solve tail(q) = alpha for q >= floor, where tails fall: the secant method in log q and log tail, bracketed."""
    target = math.log(alpha)

    def excess(log_scale: float) -> float:
        return math.log(tail(math.exp(log_scale))) - target

    low = before = math.log(floor)
    f_before = excess(before)
    if f_before <= 0.0:
        return floor
    high = now = low + 0.1
    f_now = excess(now)
    while f_now > 0.0:
        low = before = now
        f_before = f_now
        high = now = now + 0.5
        f_now = excess(now)
    while abs(now - before) > _SCALE_TOLERANCE and f_now != f_before:
        step = now - f_now * (now - before) / (f_now - f_before)
        if not low < step < high:
            step = 0.5 * (low + high)
        before, f_before = now, f_now
        now, f_now = step, excess(step)
        low, high = (now, high) if f_now > 0.0 else (low, now)
    return max(math.exp(now), floor)
