"""Size of a confidence region for each level that a user can ask for."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import lru_cache
from typing import TYPE_CHECKING

from scp_planner.errors import EstimationError
from scp_planner.tracking.error_laws import ErrorLaw
from scp_planner.tracking.tolerances import SCALE_TOLERANCE

if TYPE_CHECKING:
    from scp_planner.tracking.motion_estimate import MotionEstimate

LEVELS = ("per_time", "per_obstacle", "joint")
LARGEST_ALPHA = math.nextafter(1.0, 0.0)  # below 1: what holds with hardly any probability has some region


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
    if level not in LEVELS:
        raise EstimationError(f"level: {level!r} is not one of {', '.join(LEVELS)}")
    alpha = outside_probability(probability)
    if level == "per_time":
        return estimate.errors.pointwise_scale(alpha)
    if level == "joint":
        alpha = shared_alpha(alpha, obstacles)
    return uniform_scale(alpha, estimate.standardised_length(start, stop), estimate.errors, estimate.regressors)


def marginal_scale(level: str, probability: float, times: int, obstacles: int) -> float:
    """Give q for normal errors of known covariance at some times, of which no dependence is known."""
    return course_scale(level, alpha_of_one(level, probability, obstacles), times)


def alpha_of_one(level: str, probability: float, obstacles: int) -> float:
    """Give the probability that one obstacle may be outside its zone with, at one time or at any by the level."""
    if level not in LEVELS:
        raise EstimationError(f"level: {level!r} is not one of {', '.join(LEVELS)}")
    alpha = outside_probability(probability)
    return shared_alpha(alpha, obstacles) if level == "joint" else alpha


def course_scale(level: str, alpha: float, times: int) -> float:
    """Give q for normal errors of known covariance at some times, with the probability to be outside."""
    if level != "per_time":
        alpha = shared_alpha(alpha, times)
    return -2.0 * math.log(alpha)  # the quantile of chi-square with 2 degrees of freedom


def outside_probability(probability: float) -> float:
    """Give alpha, the probability to be outside of what holds with a probability."""
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
    """Give q that |w|^2 exceeds anywhere in a span of time with probability at most alpha."""
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
    while abs(now - before) > SCALE_TOLERANCE and f_now != f_before:
        step = now - f_now * (now - before) / (f_now - f_before)
        if not low < step < high:
            step = 0.5 * (low + high)
        before, f_before = now, f_now
        now, f_now = step, excess(step)
        low, high = (now, high) if f_now > 0.0 else (low, now)
    return max(math.exp(now), floor)
