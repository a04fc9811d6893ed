"""The published estimators, as the appendix of Zambom and Seguin (2021) has them: power sums and substitution.

They estimate eta(t) = eta0 + V t + W t^2 from observations N_i at T times t_i by least squares, with the power sums
c_j = sum_i t_i^j and s_j = sum_i t_i^j N_i, from the three normal equations

    T eta0 + c1 V + c2 W = s0,    c1 eta0 + c2 V + c3 W = s1,    c2 eta0 + c3 V + c4 W = s2.

As printed there: the power sums c_j, over the times 1 to T (any times here); the order, which puts eta0 of the first
equation into the second, and the V of that into the third; and, of the variance of an estimated centre,

    a = c1 c2 / T - c3,    b = c2 - c1^2 / T,    d = c4 - c2^2 / T - a^2 / b.

With these the substitution reads, from the last to the first,

    d W = s2 - c2 s0 / T + (a / b) (s1 - c1 s0 / T),    b V = s1 - c1 s0 / T + a W,    T eta0 = s0 - c1 V - c2 W.

What these three lines and the variance look like in print the page that we have does not show: it lost its displayed
formulas. They are derived here, from the order and from a, b and d. The divisor n - 3 of the noise is ours, too.

This is a test oracle and a reading aid, not what the planner uses: power sums of a clock that does not start near zero
lose most digits (`scp_planner.estimation.estimate` centres and scales time, and solves by QR). Nothing here converts
its arguments to floating point, so that with arrays of :class:`fractions.Fraction` the results are exact.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

AnyArray = NDArray[Any]

PARAMETERS = 3  # eta0, V and W


@dataclass(frozen=True)
class Substitution:
    """Power sums of times, and the coefficients that the substitution leaves, as printed.

    Attributes
    ----------
    count
        T, the number of times, as a number of their own type.
    c1, c2, c3, c4
        c_j = sum_i t_i^j in s^j.
    a
        c1 c2 / T - c3 in s^3: less what W has for a factor in the second equation, without eta0.
    b
        c2 - c1^2 / T in s^2: what V has for a factor there.
    d
        c4 - c2^2 / T - a^2 / b in s^4: what W has for a factor in the third equation, without eta0 and V.
    """

    count: Any
    c1: Any
    c2: Any
    c3: Any
    c4: Any
    a: Any
    b: Any
    d: Any


@dataclass(frozen=True)
class PublishedEstimate:
    """Estimates of one motion.

    Attributes
    ----------
    position : (2,) array
        eta0 in m, at time 0.
    velocity : (2,) array
        V in m/s, at time 0.
    half_acceleration : (2,) array
        W in m/s^2; the acceleration is 2 W.
    noise_covariance : (2, 2) array
        S = E'E / (n - 3) in m^2, E the residuals.
    times : (n,) array
        Of the observations, s.
    """

    position: AnyArray
    velocity: AnyArray
    half_acceleration: AnyArray
    noise_covariance: AnyArray
    times: AnyArray

    def center(self, t: Any) -> AnyArray:
        """Estimated centre at a time, (2,) m."""
        center: AnyArray = self.position + self.velocity * t + self.half_acceleration * (t * t)
        return center

    def covariance(self, t: Any) -> AnyArray:
        """Estimated covariance of the estimated centre at a time, h(t) S, (2, 2) m^2."""
        covariance: AnyArray = variance_factor(self.times, t) * self.noise_covariance
        return covariance


def published_estimate(times: ArrayLike, positions: ArrayLike) -> PublishedEstimate:
    """Estimate eta0, V and W from the power sums.

    Parameters
    ----------
    times : (n,) s
        At least four, three of them different.
    positions : (n, 2) m

    Returns
    -------
    PublishedEstimate
    """
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
    noise = residuals.T @ residuals / (len(t) - PARAMETERS)
    return PublishedEstimate(position, velocity, half_acceleration, noise, t)


def variance_factor(times: ArrayLike, t: Any) -> Any:
    """Give h(t), with Var(eta_hat(t)) = h(t) Sigma.

    1, q and p, of the times of the observations, are at right angles to each other, and T, b and d their squared
    lengths, where q(t) = t - c1 / T and p(t) = t^2 - c2 / T + (a / b) q(t). So

        h(t) = 1 / T + q(t)^2 / b + p(t)^2 / d.

    Parameters
    ----------
    times : (n,) s
        Of the observations.
    t : s
        When the centre is predicted for.

    Returns
    -------
    (...) array
        h at each t.
    """
    sums = substitution(times)
    q = t - sums.c1 / sums.count
    p = t * t - sums.c2 / sums.count + sums.a * q / sums.b
    return 1 / sums.count + q * q / sums.b + p * p / sums.d


def substitution(times: ArrayLike) -> Substitution:
    """Sum the powers of times, and give what the substitution makes of the sums.

    Parameters
    ----------
    times : (n,) s
        Of the observations; three of them different.

    Returns
    -------
    Substitution
    """
    seen = np.asarray(times)
    count, c1, c2, c3, c4 = (np.sum(seen**power) for power in range(5))
    a, b = c1 * c2 / count - c3, c2 - c1 * c1 / count
    return Substitution(count, c1, c2, c3, c4, a, b, c4 - c2 * c2 / count - a * a / b)
