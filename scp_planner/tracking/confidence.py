"""Sizes of confidence regions: laws of the error of an estimated motion, and the levels that a user can ask for."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import ClassVar

import numpy as np

from scp_planner.arrays import Array
from scp_planner.errors import EstimationError
from scp_planner.tracking.tolerances import LEAST_RISK_SHARE, SCALE_TOLERANCE

LEVELS = ("per_time", "per_obstacle", "joint")
LARGEST_ALPHA = math.nextafter(1.0, 0.0)  # below 1: what holds with hardly any probability has some region
FEWEST_DEGREES_OF_FREEDOM = 2  # with fewer, an estimated covariance in the plane is singular
_ROOT_TWO_PI = math.sqrt(2.0 * math.pi)


class ErrorLaw(ABC):
    """The distribution of the squared standardised error |w|^2, and of its excursions over time."""

    @abstractmethod
    def pointwise_scale(self, alpha: float) -> float:
        """Give q that |w|^2 exceeds at one time with probability alpha."""

    @abstractmethod
    def exceedance(self, scale: float) -> float:
        """Give the probability that |w|^2 exceeds q at one time."""

    @abstractmethod
    def exit_rate(self, scale: float) -> float:
        """Give the expected number of rises of |w|^2 through q, per unit of standardised length (Rice's formula)."""

    def largest_root_exceedance(self, scale: float, regressors: int) -> float | None:  # noqa: ARG002 - of other laws
        """Give the probability that the largest root for p regressors exceeds q; None if it is unknown."""
        return None


@dataclass(frozen=True)
class NormalErrors(ErrorLaw):
    """w(t) is standard normal: the noise covariance is known."""

    def pointwise_scale(self, alpha: float) -> float:
        return -2.0 * math.log(alpha)  # chi-square with 2 degrees of freedom

    def exceedance(self, scale: float) -> float:
        return math.exp(-0.5 * scale)

    def exit_rate(self, scale: float) -> float:
        return math.sqrt(scale) / _ROOT_TWO_PI * math.exp(-0.5 * scale)

    def largest_root_exceedance(self, scale: float, regressors: int) -> float:
        """Give the probability that the larger eigenvalue of a Wishart(I_2, p) matrix exceeds q."""
        from scipy.special import gammainc, gammaincc

        p, q = regressors, scale
        if p == 1:
            return self.exceedance(q)
        half = 0.5 * (p - 1)
        log_weight = math.lgamma(half) - math.lgamma(p - 1) + half * math.log(2.0 * q) - 0.5 * q
        return float(gammaincc(p - 1, q) + 0.5 * math.exp(log_weight) * gammainc(half, 0.5 * q))


@dataclass(frozen=True)
class _EstimatedErrors(ErrorLaw):
    """|w|^2 exceeds q with probability (1 + q / nu)^(-k / 2)."""

    degrees_of_freedom: float  # nu
    lost: ClassVar[int]  # nu - k

    @property
    def _power(self) -> float:
        return self.degrees_of_freedom - self.lost

    def pointwise_scale(self, alpha: float) -> float:
        return self.degrees_of_freedom * math.expm1(-2.0 * math.log(alpha) / self._power)

    def exceedance(self, scale: float) -> float:
        return math.exp(-0.5 * self._power * math.log1p(scale / self.degrees_of_freedom))

    def exit_rate(self, scale: float) -> float:
        """Rice's formula, averaged over the distribution of the estimated covariance."""
        nu = self.degrees_of_freedom
        gammas = math.exp(math.lgamma(0.5 * (nu + 1.0)) - math.lgamma(0.5 * nu))
        growth = math.exp(-0.5 * (self._power + 1.0) * math.log1p(scale / nu))
        return math.sqrt(2.0 * scale / nu) / _ROOT_TWO_PI * gammas * growth


@dataclass(frozen=True)
class HotellingErrors(_EstimatedErrors):
    """w(t) is standardised by an estimated covariance: Wishart with nu >= 2 degrees of freedom, divided by nu."""

    lost = 1

    def __post_init__(self) -> None:
        if not self.degrees_of_freedom >= FEWEST_DEGREES_OF_FREEDOM:
            raise EstimationError(
                f"degrees of freedom: {self.degrees_of_freedom:g} leave the noise covariance"
                f" unknown; at least {FEWEST_DEGREES_OF_FREEDOM} are needed: more observations, a lower"
                " order or a known covariance"
            )

    def largest_root_exceedance(self, scale: float, regressors: int) -> float:
        """Give the probability that nu times Roy's largest root exceeds q."""
        from scipy.special import betainc, betaincc, betaln

        if regressors == 1:
            return self.exceedance(scale)
        a, b = 0.5 * (regressors - 1), 0.5 * (self.degrees_of_freedom - 1.0)
        ratio = scale / self.degrees_of_freedom
        theta, log_rest = ratio / (1.0 + ratio), -math.log1p(ratio)
        log_weight = a * math.log(theta) + b * log_rest + betaln(a, b) - betaln(2.0 * a, 2.0 * b)
        return float(betaincc(2.0 * a, 2.0 * b, theta) + 0.5 * math.exp(log_weight) * betainc(a, b, theta))


@dataclass(frozen=True)
class StudentErrors(_EstimatedErrors):
    """w(t) is standard normal times one common random factor, sqrt(nu / chi2_nu): a Student process."""

    lost = 0

    def __post_init__(self) -> None:
        if not self.degrees_of_freedom > 0.0:
            raise EstimationError(f"degrees of freedom: {self.degrees_of_freedom!r} is not a positive number")


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
    return NormalErrors().pointwise_scale(alpha)


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
        bounds.append(_solve(lambda q: errors.largest_root_exceedance(q, regressors) or 0.0, alpha, floor))
    if not bounds:
        raise EstimationError("span of time: it is unbounded, and over it no region of this motion model holds")
    return min(bounds)


def excursion_bound(scale: float, length: float, errors: ErrorLaw) -> float:
    """Bound the probability that |w|^2 exceeds q anywhere in a span of the given standardised length."""
    return errors.exceedance(scale) + length * errors.exit_rate(scale)


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


def alpha_of_mixture(level: str, alpha: float, obstacles: int) -> float:
    """Give the probability that an obstacle of several futures may be outside with."""
    return alpha * (1.0 - alpha) ** (obstacles - 1) if level == "joint" else alpha


def sizes_of(spreads: Array, scales: Array, radius: float) -> Array:
    """Give what the areas of zones of futures gain by a little more of the budget, up to a common factor."""
    return spreads * (spreads + radius / np.sqrt(scales))


def shared_risk(weights: Array, sizes: Array, alpha: float) -> Array:
    """Give the probability with which each future may be outside its zone."""
    if not 0.0 < alpha < 1.0:
        raise EstimationError(f"alpha: {alpha!r} is not between 0 and 1")
    for name, values in (("weights", weights), ("sizes", sizes)):
        if not np.all((values >= 0.0) & np.isfinite(values)):
            raise EstimationError(f"{name}: {values!r} are not all numbers >= 0")
    risk = np.where(weights > 0.0, 0.0, 1.0)
    shares = np.where(sizes > 0.0, np.maximum(sizes, LEAST_RISK_SHARE * sizes.max(initial=0.0)), 0.0)
    sharing = np.flatnonzero((weights > 0.0) & (sizes > 0.0))
    budget = alpha
    while len(sharing):
        paid = budget * shares[sharing] / shares[sharing].sum()
        out = paid >= weights[sharing]
        if not out.any():
            risk[sharing] = paid / weights[sharing]
            break
        risk[sharing[out]] = 1.0
        budget -= float(weights[sharing[out]].sum())
        sharing = sharing[~out]
    return risk
