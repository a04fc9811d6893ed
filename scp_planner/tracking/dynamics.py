"""Linear systems driven by white noise: motions of one coordinate that change as time goes by."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np

from scp_planner.arrays import Array, Index
from scp_planner.mathematics.quadrature import gauss_rule
from scp_planner.scenario.process_model import (
    MeanRevertingVelocity,
    ProcessModel,
    RandomWalkAcceleration,
    RandomWalkVelocity,
)
from scp_planner.tracking.tolerances import LAG_DIGITS, SERIES_TERMS, SHORT_LAG

NODES = 10  # of Gauss' rule: exact to rounding over one time constant


class Dynamics(ABC):
    """State of one coordinate, (d,): position, velocity and what else the noise needs."""

    states: int  # d
    order: int  # of the expected motion: 1 keeps the velocity, 2 the acceleration

    @abstractmethod
    def transition(self, lag: Array) -> Array:
        """Map of the state over lags (...), s: (..., d, d)."""

    @abstractmethod
    def noise(self, lag: Array) -> Array:
        """Covariance of what the noise adds to the state in lags (...), s: (..., d, d)."""

    @abstractmethod
    def prior(self, velocity_variance: float) -> Array:
        """Covariance (d, d) of the state before anything was seen; 0 of the position."""

    def from_kinematics(self, known: int, velocity_variance: float) -> tuple[Array, Array]:
        """Map (d, n) from the first n of position, velocity and acceleration to the state; variances (d,) left open."""
        variance = np.diag(self.prior(velocity_variance)).copy()
        variance[:known] = 0.0
        return np.eye(self.states, known), variance

    def acceleration(self, state: Array) -> Array:
        """Expected acceleration (2,), m/s^2, in a state (d, 2)."""
        return state[2] if self.order == 2 else np.zeros_like(state[0])


@dataclass(frozen=True)
class Integrator(Dynamics):
    """White noise integrated d times; states: x and its derivatives."""

    diffusion: float  # intensity of the noise

    def transition(self, lag: Array) -> Array:
        """Taylor's polynomials: lag^(j - i) / (j - i)!."""
        f = np.zeros((*np.shape(lag), self.states, self.states))
        for i in range(self.states):
            for j in range(i, self.states):
                f[..., i, j] = lag ** (j - i) / math.factorial(j - i)
        return f

    def noise(self, lag: Array) -> Array:
        """Integrals of products of s^k / k!."""
        q = np.empty((*np.shape(lag), self.states, self.states))
        for i in range(self.states):
            for j in range(self.states):
                k, m = self.states - 1 - i, self.states - 1 - j
                divisor = math.factorial(k) * math.factorial(m) * (k + m + 1)
                q[..., i, j] = self.diffusion * lag ** (k + m + 1) / divisor
        return q


@dataclass(frozen=True)
class RandomWalk(Integrator):
    """Acceleration is white noise of intensity ``diffusion``, m^2/s^3."""

    states = 2
    order = 1

    def prior(self, velocity_variance: float) -> Array:
        return np.diag([0.0, velocity_variance])


@dataclass(frozen=True)
class WhiteJerk(Integrator):
    """Jerk is white noise of intensity ``diffusion``, m^2/s^5."""

    acceleration_deviation: float  # before anything was seen, m/s^2
    states = 3
    order = 2

    def prior(self, velocity_variance: float) -> Array:
        return np.diag([0.0, velocity_variance, self.acceleration_deviation**2])


class Fading(Dynamics):
    """Three states; the noise drives one of them that decays with a time constant."""

    time_constant: float  # s
    intensity: float  # of the noise
    driven: int
    states = 3

    def transition(self, lag: Array) -> Array:
        lags, places = _distinct(lag)
        return self._transition(lags)[places]

    @abstractmethod
    def _transition(self, lags: Array) -> Array:
        """Map of the state over lags (n,), s."""

    def noise(self, lag: Array) -> Array:
        """Gauss' rule over less than a time constant, which is then doubled: Q(2 h) = F(h) Q(h) F(h)' + Q(h)."""
        lags, places = _distinct(lag)
        doublings = np.ceil(np.log2(np.maximum(lags / self.time_constant, 1.0)))
        step, rule = lags * 0.5**doublings, gauss_rule(NODES)
        half = 0.5 * step[:, None]
        responses = self._transition((half * (1.0 + rule.nodes)).ravel())[:, :, self.driven].reshape(-1, NODES, 3)
        q = np.swapaxes(responses, 1, 2) @ (self.intensity * (half * rule.weights)[..., None] * responses)
        for done in range(int(doublings.max(initial=0.0))):
            more = doublings > done
            f = self._transition(step[more])
            q[more] += f @ q[more] @ np.swapaxes(f, 1, 2)
            step[more] *= 2.0
        return q[places]


@dataclass(frozen=True)
class MeanReverting(Fading):
    """d velocity = -(velocity - kept velocity) / time_constant dt + white noise; states: x, v, kept v."""

    intensity: float  # m^2/s^3
    time_constant: float
    order = 1
    driven = 1

    @property
    def own(self) -> float:
        """Variance of the velocity about the kept one, m^2/s^2."""
        return 0.5 * self.intensity * self.time_constant

    def _transition(self, lags: Array) -> Array:
        z, tau = lags / self.time_constant, self.time_constant
        f = np.zeros((len(lags), 3, 3))
        f[:, 0, 0] = f[:, 2, 2] = 1.0
        f[:, 0, 1], f[:, 0, 2] = -tau * np.expm1(-z), tau * _second(z)
        f[:, 1, 1], f[:, 1, 2] = np.exp(-z), -np.expm1(-z)
        return f

    def prior(self, velocity_variance: float) -> Array:
        p = np.zeros((3, 3))
        p[1:, 1:] = velocity_variance
        p[1, 1] += self.own
        return p

    def from_kinematics(self, known: int, velocity_variance: float) -> tuple[Array, Array]:
        """Regression of the kept velocity on the present one."""
        share = velocity_variance / (velocity_variance + self.own)
        matrix = np.eye(3, known)
        matrix[2] = 0.0
        matrix[2, 1] = share
        return matrix, np.array([0.0, 0.0, share * self.own])

    def acceleration(self, state: Array) -> Array:
        return (state[2] - state[1]) / self.time_constant


@dataclass(frozen=True)
class Singer(Fading):
    """Acceleration is an Ornstein-Uhlenbeck process (R. A. Singer, 1970); states: x, v, a."""

    deviation: float  # m/s^2
    time_constant: float
    order = 2
    driven = 2

    @property
    def intensity(self) -> float:  # type: ignore[override]
        return 2.0 * self.deviation**2 / self.time_constant

    def _transition(self, lags: Array) -> Array:
        z, tau = lags / self.time_constant, self.time_constant
        f = np.zeros((len(lags), 3, 3))
        f[:, 0, 0] = f[:, 1, 1] = 1.0
        f[:, 0, 1], f[:, 0, 2] = lags, tau**2 * _second(z)
        f[:, 1, 2], f[:, 2, 2] = -tau * np.expm1(-z), np.exp(-z)
        return f

    def prior(self, velocity_variance: float) -> Array:
        return np.diag([0.0, velocity_variance, self.deviation**2])


def dynamics_of(model: ProcessModel) -> Dynamics:
    process = model.process
    if isinstance(process, RandomWalkVelocity):
        return RandomWalk(process.diffusion)
    if isinstance(process, MeanRevertingVelocity):
        return MeanReverting(process.diffusion, process.time_constant)
    if isinstance(process, RandomWalkAcceleration):
        return WhiteJerk(process.diffusion, process.acceleration_deviation)
    return Singer(process.deviation, process.time_constant)


def _distinct(lag: Array) -> tuple[Array, Index]:
    """Lags that differ by more than rounding, and the place of each given one among them."""
    lags, places = np.unique(np.round(lag, LAG_DIGITS), return_inverse=True)
    return lags, np.asarray(places, dtype=np.intp).reshape(np.shape(lag))


def _second(z: Array) -> Array:
    """Z - 1 + e^-z for z >= 0, by its series where that cancels."""
    series = np.polynomial.polynomial.polyval(-z, [1.0 / math.factorial(k) for k in range(2, SERIES_TERMS)]) * z * z
    return np.where(z < SHORT_LAG, series, z + np.expm1(-z))
