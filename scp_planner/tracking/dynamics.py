"""Linear systems driven by white noise: how one component of an obstacle's motion can change its mind."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from scp_planner.arrays import Array
from scp_planner.mathematics.quadrature import gauss_rule
from scp_planner.scenario.process_model import (
    MeanRevertingVelocity,
    ProcessModel,
    RandomWalkAcceleration,
    RandomWalkVelocity,
    SingerAcceleration,
)


@dataclass(frozen=True)
class ShortLags:
    """Series and quadrature in place of closed forms that lose digits at short lags."""

    series: float = 0.05  # below this many time constants a series is used
    terms: int = 10
    lag_digits: int = 12  # after the point, s, that tell lags apart
    quadrature: float = 1.0  # below this many time constants quadrature is used
    nodes: int = 10  # of Gauss' rule: exact to rounding for lags that short


SHORT = ShortLags()


@dataclass(frozen=True)
class StatePrior:
    """State from position, velocity and perhaps acceleration."""

    matrix: Array  # From those n to the expected state
    variance: Array


class Dynamics(ABC):
    """One component of a motion: position, velocity and what else the noise needs."""

    states: int  # d: position, velocity,
    order: int

    @abstractmethod
    def transition(self, lag: Array) -> Array:
        """State after a lag: (...) s to (..., d, d)."""

    @abstractmethod
    def process_noise(self, lag: Array) -> Array:
        """Covariance of what the noise adds to the state in a lag: (...) s to (..., d, d)."""

    @abstractmethod
    def prior(self, velocity_variance: float) -> Array:
        """Covariance of all states but the position before anything was seen: (d, d), of the position 0."""

    def from_kinematics(self, known: int, velocity_variance: float) -> StatePrior:
        """Begin with what somebody else knows: position, velocity and, if 3 are ``known``, acceleration."""
        variance = np.diag(self.prior(velocity_variance)).copy()
        variance[:known] = 0.0
        return StatePrior(np.eye(self.states, known), variance)

    @abstractmethod
    def acceleration(self, state: Array) -> Array:
        """Expected acceleration in a state: (d, 2) to (2,) m/s^2."""


@dataclass(frozen=True)
class RandomWalk(Dynamics):
    """Acceleration is white noise of intensity ``diffusion``, m^2/s^3."""

    diffusion: float
    states = 2
    order = 1

    def transition(self, lag: Array) -> Array:
        """Keep the velocity."""
        f = np.zeros((*lag.shape, 2, 2))
        f[..., 0, 0] = f[..., 1, 1] = 1.0
        f[..., 0, 1] = lag
        return f

    def process_noise(self, lag: Array) -> Array:
        """Grow with the cube of the lag in position."""
        q = np.empty((*lag.shape, 2, 2))
        q[..., 0, 0] = self.diffusion * lag**3 / 3.0
        q[..., 0, 1] = q[..., 1, 0] = self.diffusion * lag**2 / 2.0
        q[..., 1, 1] = self.diffusion * lag
        return q

    def prior(self, velocity_variance: float) -> Array:
        """Know nothing but the spread of velocities."""
        return np.diag([0.0, velocity_variance])

    def acceleration(self, state: Array) -> Array:
        """Expect none."""
        return np.zeros_like(state[0])


@dataclass(frozen=True)
class WhiteJerk(Dynamics):
    """Jerk is white noise of intensity ``diffusion``, m^2/s^5; the prior of the acceleration in m/s^2; x, v, a."""

    diffusion: float
    acceleration_deviation: float
    states = 3
    order = 2

    def transition(self, lag: Array) -> Array:
        """Keep the acceleration."""
        f = np.zeros((*lag.shape, 3, 3))
        f[..., 0, 0] = f[..., 1, 1] = f[..., 2, 2] = 1.0
        f[..., 0, 1] = f[..., 1, 2] = lag
        f[..., 0, 2] = 0.5 * lag**2
        return f

    def process_noise(self, lag: Array) -> Array:
        """Grow with the fifth power of the lag in position."""
        q = np.empty((*lag.shape, 3, 3))
        for (i, j), (power, divisor) in _JERK_NOISE.items():
            q[..., i, j] = q[..., j, i] = self.diffusion * lag**power / divisor
        return q

    def prior(self, velocity_variance: float) -> Array:
        """Know nothing but the spread of velocities and accelerations."""
        return np.diag([0.0, velocity_variance, self.acceleration_deviation**2])

    def acceleration(self, state: Array) -> Array:
        """Expect the estimated one."""
        return state[2]


_JERK_NOISE = {
    (0, 0): (5, 20.0),
    (0, 1): (4, 8.0),
    (0, 2): (3, 6.0),
    (1, 1): (3, 3.0),
    (1, 2): (2, 2.0),
    (2, 2): (1, 1.0),
}
"""Power of the lag and divisor of each entry of the noise of `WhiteJerk`: integrals of products of s^k / k!."""


@dataclass(frozen=True)
class MeanReverting(Dynamics):
    """d velocity = -(velocity - kept velocity) / time_constant dt + white noise; states: x, v, kept v."""

    diffusion: float
    time_constant: float
    states = 3
    order = 1

    def transition(self, lag: Array) -> Array:
        """Return to the kept velocity."""
        return _once(self._transition, lag)

    def process_noise(self, lag: Array) -> Array:
        """Grow as the integrated Ornstein-Uhlenbeck process."""
        return _once(self._process_noise, lag)

    def _transition(self, lag: Array) -> Array:
        z = lag / self.time_constant
        stay, drift = np.exp(-z), lag * _phi1(z)
        f = np.zeros((*lag.shape, 3, 3))
        f[..., 0, 0] = f[..., 2, 2] = 1.0
        f[..., 0, 1], f[..., 0, 2] = drift, lag - drift
        f[..., 1, 1], f[..., 1, 2] = stay, -np.expm1(-z)
        return f

    def _process_noise(self, lag: Array) -> Array:
        z = lag / self.time_constant
        tau, fall = self.time_constant, -np.expm1(-z)
        q = np.zeros((*lag.shape, 3, 3))
        # (z - 2 (1 - e^-z) + (1 - e^-2z) / 2) tau^3, by series where it cancels
        long = tau**3 * (z - 2.0 * fall - 0.5 * np.expm1(-2.0 * z))
        near = z < SHORT.quadrature
        q[..., 0, 0] = long
        q[near, 0, 0] = _quadrature(lambda s: (s * _phi1(s / tau)) ** 2, lag[near])
        q[..., 0, 1] = q[..., 1, 0] = 0.5 * (tau * fall) ** 2
        q[..., 1, 1] = -0.5 * tau * np.expm1(-2.0 * z)
        return self.diffusion * q

    def prior(self, velocity_variance: float) -> Array:
        """Spread the kept velocities; the present one wanders about its own."""
        own = 0.5 * self.diffusion * self.time_constant
        p = np.zeros((3, 3))
        p[1:, 1:] = velocity_variance
        p[1, 1] += own
        return p

    def from_kinematics(self, known: int, velocity_variance: float) -> StatePrior:
        """Tell the kept velocity from the present one, which wanders about it: the regression of one on the other."""
        own = 0.5 * self.diffusion * self.time_constant
        share = velocity_variance / (velocity_variance + own)
        matrix = np.eye(3, known)
        matrix[2] = 0.0
        matrix[2, 1] = share
        return StatePrior(matrix, np.array([0.0, 0.0, share * own]))

    def acceleration(self, state: Array) -> Array:
        """Expect the return to the kept velocity."""
        return (state[2] - state[1]) / self.time_constant


@dataclass(frozen=True)
class Singer(Dynamics):
    """Acceleration is an Ornstein-Uhlenbeck process; deviation in m/s^2, time constant in s; x, v, a."""

    deviation: float
    time_constant: float
    states = 3
    order = 2

    def transition(self, lag: Array) -> Array:
        """Let the acceleration die out."""
        return _once(self._transition, lag)

    def process_noise(self, lag: Array) -> Array:
        """Add what new manoeuvres do."""
        return _once(self._process_noise, lag)

    def _transition(self, lag: Array) -> Array:
        z = lag / self.time_constant
        f = np.zeros((*lag.shape, 3, 3))
        f[..., 0, 0] = f[..., 1, 1] = 1.0
        f[..., 0, 1] = lag
        f[..., 0, 2] = lag**2 * _phi2(z)
        f[..., 1, 2] = lag * _phi1(z)
        f[..., 2, 2] = np.exp(-z)
        return f

    def _process_noise(self, lag: Array) -> Array:
        tau = self.time_constant
        z = lag / tau
        e, e2 = np.exp(-z), np.exp(-2.0 * z)
        closed = {
            (0, 0): tau**5 * (1.0 - e2 + 2.0 * z + 2.0 / 3.0 * z**3 - 2.0 * z**2 - 4.0 * z * e),
            (0, 1): tau**4 * (e2 + 1.0 - 2.0 * e + 2.0 * z * e - 2.0 * z + z**2),
            (0, 2): tau**3 * (1.0 - e2 - 2.0 * z * e),
            (1, 1): tau**3 * (4.0 * e - 3.0 - e2 + 2.0 * z),
            (1, 2): tau**2 * (e2 + 1.0 - 2.0 * e),
            (2, 2): tau * (1.0 - e2),
        }
        q = np.empty((*lag.shape, 3, 3))
        for (i, j), twice in closed.items():
            q[..., i, j] = q[..., j, i] = 0.5 * twice
        near = z < SHORT.quadrature  # where the closed form cancels
        half, rule = 0.5 * lag[near][:, None], gauss_rule(SHORT.nodes)
        responses = self._responses(half * (1.0 + rule.nodes))
        q[near] = ((half * rule.weights)[:, None] * responses) @ np.swapaxes(responses, -1, -2)
        return 2.0 * self.deviation**2 / tau * q

    def _responses(self, since: Array) -> Array:
        """Respond to a unit impulse on the acceleration, times since (n, K) ago: states (n, 3, K)."""
        z = since / self.time_constant
        return np.stack((since**2 * _phi2(z), since * _phi1(z), np.exp(-z)), axis=1)

    def prior(self, velocity_variance: float) -> Array:
        """Spread the velocities; accelerations as always."""
        return np.diag([0.0, velocity_variance, self.deviation**2])

    def acceleration(self, state: Array) -> Array:
        """Expect the estimated one."""
        return state[2]


def dynamics_of(model: ProcessModel) -> Dynamics:
    """Make the dynamics that a model's parameters describe."""
    process = model.process
    if isinstance(process, RandomWalkVelocity):
        return RandomWalk(process.diffusion)
    if isinstance(process, MeanRevertingVelocity):
        return MeanReverting(process.diffusion, process.time_constant)
    if isinstance(process, RandomWalkAcceleration):
        return WhiteJerk(process.diffusion, process.acceleration_deviation)
    assert isinstance(process, SingerAcceleration)
    return Singer(process.deviation, process.time_constant)


def _once(matrices: Callable[[Array], Array], lag: Array) -> Array:
    """Compute the matrices of lags that come many times, but for rounding, only once."""
    if lag.ndim == 0:
        return matrices(lag)
    lags, places = np.unique(np.round(lag, SHORT.lag_digits), return_inverse=True)
    return matrices(lags)[places.reshape(lag.shape)]


def _phi1(z: Array) -> Array:
    """(1 - e^-z) / z for z >= 0."""
    safe = np.where(z > 0.0, z, 1.0)
    return np.where(z > 0.0, -np.expm1(-safe) / safe, 1.0)


def _phi2(z: Array) -> Array:
    """(z - 1 + e^-z) / z^2 for z >= 0."""
    safe = np.maximum(z, SHORT.series)
    series = np.zeros_like(z)
    for k in range(SHORT.terms, 1, -1):  # sum of (-z)^(k - 2) / k!
        series = 1.0 - z / (k + 1) * series if k < SHORT.terms else np.ones_like(z)
    return np.where(z < SHORT.series, 0.5 * series, (safe + np.expm1(-safe)) / safe**2)


def _quadrature(integrand: Callable[[Array], Array], lag: Array) -> Array:
    """Integrate over [0, lag] for each lag."""
    half, rule = 0.5 * lag[..., None], gauss_rule(SHORT.nodes)
    return np.sum(half * rule.weights * integrand(half * (1.0 + rule.nodes)), axis=-1)
