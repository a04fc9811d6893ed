"""The published estimators, as the appendix of Zambom and Seguin (2021) has them: power sums and substitution."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

AnyArray = NDArray[Any]


@dataclass(frozen=True)
class Substitution:
    """Power sums of times, and the coefficients that the substitution leaves, as printed."""

    count: Any  # T, the number of times, as a number of their own type
    c1: Any  # c_j = sum_i t_i^j in s^j
    c2: Any  # c_j = sum_i t_i^j in s^j
    c3: Any  # c_j = sum_i t_i^j in s^j
    c4: Any  # c_j = sum_i t_i^j in s^j
    a: Any  # c1 c2 / T - c3 in s^3: less what W has for a factor in the second equation, without eta0
    b: Any  # c2 - c1^2 / T in s^2: what V has for a factor there
    d: Any  # c4 - c2^2 / T - a^2 / b in s^4: what W has for a factor in the third equation, without eta0 and V


@dataclass(frozen=True)
class PublishedEstimate:
    """Estimates of one motion."""

    position: AnyArray  # (2,) eta0 in m, at time 0
    velocity: AnyArray  # (2,) V in m/s, at time 0
    half_acceleration: AnyArray  # (2,) W in m/s^2; the acceleration is 2 W
    noise_covariance: AnyArray  # (2, 2) S = E'E / (n - 3) in m^2, E the residuals
    times: AnyArray  # (n,) s

    def center(self, t: Any) -> AnyArray:
        """Estimated centre at a time, (2,) m."""
        center: AnyArray = self.position + self.velocity * t + self.half_acceleration * (t * t)
        return center

    def covariance(self, t: Any) -> AnyArray:
        """Estimated covariance of the estimated centre at a time, h(t) S, (2, 2) m^2."""
        covariance: AnyArray = variance_factor(self.times, t) * self.noise_covariance
        return covariance


def published_estimate(times: ArrayLike, positions: ArrayLike) -> PublishedEstimate:
    """Estimate eta0, V and W from the power sums."""
    t, seen = np.asarray(times), np.asarray(positions)
    sums = substitution(t)
    s0, s1, s2 = (np.sum(t[:, None] ** power * seen, axis=0) for power in range(3))
    # The right sides of the second and the third equation, with eta0 of the first in them.
    second, third = s1 - sums.c1 * s0 / sums.count, s2 - sums.c2 * s0 / sums.count
    half_acceleration = (third + sums.a * second / sums.b) / sums.d
    velocity = (second + sums.a * half_acceleration) / sums.b
    position = (s0 - sums.c1 * velocity - sums.c2 * half_acceleration) / sums.count
    fitted = position + t[:, None] * velocity + (t * t)[:, None] * half_acceleration
    residuals = seen - fitted
    noise = residuals.T @ residuals / (len(t) - 3)  # three parameters: eta0, V and W
    return PublishedEstimate(position, velocity, half_acceleration, noise, t)


def variance_factor(times: ArrayLike, t: Any) -> Any:
    """Give h(t), with Var(eta_hat(t)) = h(t) Sigma."""
    sums = substitution(times)
    q = t - sums.c1 / sums.count
    p = t * t - sums.c2 / sums.count + sums.a * q / sums.b
    return 1 / sums.count + q * q / sums.b + p * p / sums.d


def substitution(times: ArrayLike) -> Substitution:
    """Sum the powers of times, and give what the substitution makes of the sums."""
    seen = np.asarray(times)
    count, c1, c2, c3, c4 = (np.sum(seen**power) for power in range(5))
    a, b = c1 * c2 / count - c3, c2 - c1 * c1 / count
    return Substitution(count, c1, c2, c3, c4, a, b, c4 - c2 * c2 / count - a * a / b)
