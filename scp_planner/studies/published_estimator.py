"""The published estimators, in the form of the appendix of Zambom and Seguin (2021): power sums and substitution.

They estimate eta(t) = eta0 + V t + W t^2 from observations N_i at times t_i by least squares, with the power sums
c_j = sum_i t_i^j and s_j = sum_i t_i^j N_i, one after the other from the three normal equations

    n eta0 + c1 V + c2 W = s0,    c1 eta0 + c2 V + c3 W = s1,    c2 eta0 + c3 V + c4 W = s2.

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
    n = len(t)
    c1, c2, c3, c4 = _power_sums(t)
    s0, s1, s2 = (np.sum(t[:, None] ** power * seen, axis=0) for power in range(3))
    # eta0 out of the second and third equation, then V out of the third
    a, b, d = n * c2 - c1 * c1, n * c3 - c1 * c2, n * c4 - c2 * c2
    first, second = n * s1 - c1 * s0, n * s2 - c2 * s0
    half_acceleration = (a * second - b * first) / (a * d - b * b)
    velocity = (first - b * half_acceleration) / a
    position = (s0 - c1 * velocity - c2 * half_acceleration) / n
    fitted = position + t[:, None] * velocity + (t * t)[:, None] * half_acceleration
    residuals = seen - fitted
    noise = residuals.T @ residuals / (n - PARAMETERS)
    return PublishedEstimate(position, velocity, half_acceleration, noise, t)


def variance_factor(times: ArrayLike, t: Any) -> Any:
    """Give h(t), with Var(eta_hat(t)) = h(t) Sigma: x_t' (X'X)^-1 x_t by the cofactors of the power sums.

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
    seen = np.asarray(times)
    n = len(seen)
    c1, c2, c3, c4 = _power_sums(seen)
    determinant = n * (c2 * c4 - c3 * c3) - c1 * (c1 * c4 - c2 * c3) + c2 * (c1 * c3 - c2 * c2)
    return (
        (c2 * c4 - c3 * c3)
        + 2 * t * (c2 * c3 - c1 * c4)
        + t**2 * (n * c4 - c2 * c2 + 2 * (c1 * c3 - c2 * c2))
        + 2 * t**3 * (c1 * c2 - n * c3)
        + t**4 * (n * c2 - c1 * c1)
    ) / determinant


def _power_sums(times: AnyArray) -> tuple[Any, ...]:
    return tuple(np.sum(times**power) for power in range(1, 5))
