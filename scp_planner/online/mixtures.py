"""The filters that zones go by where motions are not what they are taken for, and the mixture that they make.

With white jerk and with white acceleration, of different sizes, in units of the noise of what is observed: one filter
serves both components and any shape of the noise.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from scp_planner.arrays import Array
from scp_planner.scenario.process_model import RandomWalkAcceleration, RandomWalkVelocity

JERKS = (0.03, 0.3, 3.0)
"""Intensities of the filters with white jerk, as multiples of that of newcomers; the least free first."""
SWERVES = (0.03, 0.1, 0.3, 1.0)
"""Intensities of the filters with white acceleration, as multiples of that of newcomers."""


@dataclass(frozen=True)
class Widening:
    """The filters, and what they begin with.

    Attributes
    ----------
    velocity_deviation, acceleration_deviation : float
        Of each component, before anything was seen, m/s and m/s^2.
    """

    velocity_deviation: float
    acceleration_deviation: float

    @cached_property
    def filters(self) -> tuple[RandomWalkAcceleration | RandomWalkVelocity, ...]:
        """Their motions: noise that makes the spread of newcomers in the time that these need for it, and multiples."""
        time = self.velocity_deviation / self.acceleration_deviation
        jerk, swerve = self.acceleration_deviation**2 / time, self.velocity_deviation**2 / time
        return (
            *(
                RandomWalkAcceleration(diffusion=ratio * jerk, acceleration_deviation=self.acceleration_deviation)
                for ratio in JERKS
            ),
            *(RandomWalkVelocity(diffusion=ratio * swerve) for ratio in SWERVES),
        )

    @cached_property
    def diffusions(self) -> Array:
        """Intensities of acceleration and jerk, (M, 2) m^2/s^3 and m^2/s^5."""
        jerks = [isinstance(motion, RandomWalkAcceleration) for motion in self.filters]
        return np.array(
            [[0.0, m.diffusion] if jerk else [m.diffusion, 0.0] for m, jerk in zip(self.filters, jerks, strict=True)]
        )

    @cached_property
    def priors(self) -> Array:
        """Variances of velocity and acceleration at first, (M, 2) m^2/s^2 and m^2/s^4."""
        squares = self.velocity_deviation**2, self.acceleration_deviation**2
        return np.array([[squares[0], squares[1] * (jerk > 0.0)] for jerk in self.diffusions[:, 1]])


@dataclass
class FilterStates:
    """States of filters, position, velocity, acceleration, in units of the covariance of the noise.

    Attributes
    ----------
    mean : (..., 3, 2)
        m, m/s, m/s^2.
    spread : (..., 3, 3)
        The covariance of the state is this times that of the noise that is declared.
    """

    mean: Array
    spread: Array

    def predict(self, lag: Array, intensity: Array) -> None:
        """Move on by lags (...), s, with intensities of acceleration and jerk (..., 2) in units of the noise."""
        dt = lag[..., None]
        x, p = self.mean, self.spread
        x[..., 0, :] += dt * (x[..., 1, :] + 0.5 * dt * x[..., 2, :])
        x[..., 1, :] += dt * x[..., 2, :]
        half = 0.5 * dt * dt
        # F P F' row by row, then column by column, with F = [[1, t, t^2 / 2], [0, 1, t], [0, 0, 1]].
        p[..., 0, :] += dt * p[..., 1, :] + half * p[..., 2, :]
        p[..., 1, :] += dt * p[..., 2, :]
        p[..., :, 0] += dt * p[..., :, 1] + half * p[..., :, 2]
        p[..., :, 1] += dt * p[..., :, 2]
        swerve, jerk = lag * intensity[..., 0], lag * intensity[..., 1]
        square = lag * lag
        p[..., 0, 0] += square * (swerve / 3.0 + square * jerk / 20.0)
        p[..., 1, 1] += swerve + square * jerk / 3.0
        p[..., 2, 2] += jerk
        for (i, j), added in {
            (0, 1): lag * (0.5 * swerve + square * jerk / 8.0),
            (0, 2): square * jerk / 6.0,
            (1, 2): 0.5 * lag * jerk,
        }.items():
            p[..., i, j] += added
            p[..., j, i] += added

    def update(self, positions: Array, noise: float) -> tuple[Array, Array]:
        """Take in positions (..., 2) m; return what they differ by, m, and its variance in units of the noise."""
        x, p = self.mean, self.spread
        innovation = positions - x[..., 0, :]
        variance = p[..., 0, 0] + noise
        gain = p[..., :, 0] / variance[..., None]
        x += gain[..., :, None] * innovation[..., None, :]
        p -= gain[..., :, None] * p[..., None, 0, :].copy()
        return innovation, variance


@dataclass(frozen=True)
class Mixture:
    """What several filters together predict of K obstacles: mean and covariance of their mixture.

    Attributes
    ----------
    mean : (K, 3, 2)
        Position, velocity, acceleration, m, m/s, m/s^2.
    covariance : (K, 3, 2, 3, 2)
        Of these.
    diffusion : (K, 2)
        Intensities of acceleration and jerk, m^2/s^3 and m^2/s^5...
    shape : (K, 2, 2)
        ...times this.
    """

    mean: Array
    covariance: Array
    diffusion: Array
    shape: Array
