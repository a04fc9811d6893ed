"""Laws of the error of an estimated motion, as numbers of standard deviations."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass

from scp_planner.errors import EstimationError

_ROOT_TWO_PI = math.sqrt(2.0 * math.pi)
FEWEST_DEGREES_OF_FREEDOM = 2  # with fewer, an estimated covariance in the plane is singular


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
        """Give the expected number of rises of |w|^2 through q, per unit of standardised length."""

    def largest_root_exceedance(
        self,
        scale: float,  # noqa: ARG002 - for laws of which it is known
        regressors: int,  # noqa: ARG002
    ) -> float | None:
        """Give the probability that the largest root for p regressors exceeds q; None if it is unknown."""
        return None


@dataclass(frozen=True)
class NormalErrors(ErrorLaw):
    """w(t) is standard normal: the noise covariance is known."""

    def pointwise_scale(self, alpha: float) -> float:
        """Give the chi-square quantile with 2 degrees of freedom, -2 log(alpha)."""
        return -2.0 * math.log(alpha)

    def exceedance(self, scale: float) -> float:
        """Give exp(-q / 2)."""
        return math.exp(-0.5 * scale)

    def exit_rate(self, scale: float) -> float:
        """Give sqrt(q / 2 pi) exp(-q / 2): Rice's formula for the length of a standard normal vector."""
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
class HotellingErrors(ErrorLaw):
    """w(t) is standardised by an estimated covariance: Wishart with nu degrees of freedom, divided by nu."""

    degrees_of_freedom: float  # nu >= 2

    def __post_init__(self) -> None:
        if not self.degrees_of_freedom >= FEWEST_DEGREES_OF_FREEDOM:
            raise EstimationError(
                f"degrees of freedom: {self.degrees_of_freedom:g} leave the noise covariance"
                f" unknown; at least {FEWEST_DEGREES_OF_FREEDOM} are needed: more observations, a lower"
                " order or a known covariance"
            )

    def pointwise_scale(self, alpha: float) -> float:
        """Give the quantile of Hotelling's T^2, 2 nu / (nu - 1) F(2, nu - 1), elementary in the plane."""
        nu = self.degrees_of_freedom
        return nu * math.expm1(-2.0 * math.log(alpha) / (nu - 1.0))

    def exceedance(self, scale: float) -> float:
        """Give (1 + q / nu)^(-(nu - 1) / 2)."""
        nu = self.degrees_of_freedom
        return math.exp(-0.5 * (nu - 1.0) * math.log1p(scale / nu))

    def exit_rate(self, scale: float) -> float:
        """Give Rice's formula for the ellipse of the estimated covariance, averaged over its distribution."""
        nu = self.degrees_of_freedom
        gammas = math.exp(math.lgamma(0.5 * (nu + 1.0)) - math.lgamma(0.5 * nu))
        growth = math.exp(-0.5 * nu * math.log1p(scale / nu))
        return math.sqrt(2.0 * scale / nu) / _ROOT_TWO_PI * gammas * growth

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
class StudentErrors(ErrorLaw):
    """w(t) is standard normal times one common random factor, sqrt(nu / chi2_nu): a Student process."""

    degrees_of_freedom: float  # nu > 0

    def __post_init__(self) -> None:
        if not self.degrees_of_freedom > 0.0:
            raise EstimationError(f"degrees of freedom: {self.degrees_of_freedom!r} is not a positive number")

    def pointwise_scale(self, alpha: float) -> float:
        """Give the quantile 2 F(2, nu)."""
        nu = self.degrees_of_freedom
        return nu * math.expm1(-2.0 * math.log(alpha) / nu)

    def exceedance(self, scale: float) -> float:
        """Give (1 + q / nu)^(-nu / 2)."""
        nu = self.degrees_of_freedom
        return math.exp(-0.5 * nu * math.log1p(scale / nu))

    def exit_rate(self, scale: float) -> float:
        """Give Rice's formula for the normal process, averaged over the common factor."""
        nu = self.degrees_of_freedom
        gammas = math.exp(math.lgamma(0.5 * (nu + 1.0)) - math.lgamma(0.5 * nu))
        growth = math.exp(-0.5 * (nu + 1.0) * math.log1p(scale / nu))
        return math.sqrt(2.0 * scale / nu) / _ROOT_TWO_PI * gammas * growth
