"""The filters that zones go by where motions are not what they are taken for, and the mixture that they make."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from scp_planner.arrays import Array, Index
from scp_planner.tracking.oscillators import SlotStates, Swings


@dataclass(frozen=True)
class FilterParameters:
    # Intensities of the filters with white jerk, as multiples of that of newcomers; the least free first
    jerks: tuple[float, ...] = (0.03, 0.3, 3.0)
    # Intensities of the filters with white acceleration, as multiples of that of newcomers
    swerves: tuple[float, ...] = (0.03, 0.1, 0.3, 1.0)


FILTERS = FilterParameters()


@dataclass(frozen=True)
class FilterModels:
    """The filters, and what they begin with."""

    velocity_deviation: float
    acceleration_deviation: float

    @cached_property
    def swings(self) -> Swings:
        """The filters of those that weave, which follow the others."""
        return Swings.of(self.velocity_deviation, self.acceleration_deviation)

    @property
    def size(self) -> int:
        """Number of filters in all."""
        return len(self.diffusions) + len(self.swings.rates)

    @cached_property
    def diffusions(self) -> Array:
        """Intensities of acceleration and jerk, (M, 2) m^2/s^3 and m^2/s^5.

        Noise that makes the spread of newcomers in the time that these need for it, and multiples.
        """
        time = self.velocity_deviation / self.acceleration_deviation
        jerk, swerve = self.acceleration_deviation**2 / time, self.velocity_deviation**2 / time
        return np.array(
            [[0.0, ratio * jerk] for ratio in FILTERS.jerks] + [[ratio * swerve, 0.0] for ratio in FILTERS.swerves]
        )

    @cached_property
    def priors(self) -> Array:
        """Variances of velocity and acceleration at first, (M, 2) m^2/s^2 and m^2/s^4."""
        squares = self.velocity_deviation**2, self.acceleration_deviation**2
        return np.array([[squares[0], squares[1] * (jerk > 0.0)] for jerk in self.diffusions[:, 1]])


_ROWS = np.array([[0, 1, 2], [1, 3, 4], [2, 4, 5]])
"""Place of each element of a symmetric matrix in `FilterStates.spread`."""


@dataclass
class FilterStates(SlotStates):
    """States of filters with white jerk and white acceleration."""

    diffusions: Array  # Intensities of acceleration and jerk, m^2/s^3 and m^2/s^5

    @classmethod
    def none(cls, diffusions: Array) -> FilterStates:
        return cls(np.zeros((3, 2, len(diffusions), 0)), np.zeros((6, len(diffusions), 0)), diffusions)

    @property
    def means(self) -> Array:
        """The mean with obstacles first, (K, M, 3, 2)."""
        return self.mean.transpose(3, 2, 0, 1)

    @property
    def spreads(self) -> Array:
        """The whole of the spread with obstacles first, (K, M, 3, 3)."""
        return np.asarray(self.spread[_ROWS].transpose(3, 2, 0, 1))

    def predict(self, lag: Array, unit: Array) -> None:
        same = len(np.unique(lag)) == 1  # as in a frame: one product of matrices then does it
        state, spread, noise = _moved(float(lag[0]) if same else lag, self.diffusions)
        self.mean, self.spread = _applied(state, self.mean), _applied(spread, self.spread)
        self.spread += noise * (1.0 / unit)

    def update(self, positions: Array, noise: float) -> tuple[Array, Array]:
        p = self.spread
        innovation = positions[:, None] - self.mean[0]
        variance = p[0] + noise
        gain = p[:3] / variance
        self.mean += gain[:, None] * innovation
        p[3:5] -= gain[1] * p[1:3]
        p[5] -= gain[2] * p[2]
        p[:3] *= noise / variance
        return innovation, variance


def _moved(t: Array | float, diffusions: Array) -> tuple[Array, Array, Array]:
    one, none = (np.ones_like(t), np.zeros_like(t)) if isinstance(t, np.ndarray) else (1.0, 0.0)
    square = t * t
    half, cube = 0.5 * square, square * t
    state = np.array([[one, t, half], [none, one, t], [none, none, one]])
    spread = np.array(
        [  # F P F' with F as that of the state, by the elements of the upper triangle of P
            [one, 2.0 * t, square, square, cube, half * half],
            [none, one, t, t, square + half, t * half],
            [none, none, one, none, t, half],
            [none, none, none, one, 2.0 * t, square],
            [none, none, none, none, one, t],
            [none, none, none, none, none, one],
        ]
    )
    swerve = np.array([cube / 3.0, half, none, t, none, none])
    jerk = np.array([cube * square / 20.0, 0.125 * square * square, cube / 6.0, cube / 3.0, half, t])
    noise = diffusions[:, :1] * swerve.reshape(6, 1, -1) + diffusions[:, 1:] * jerk.reshape(6, 1, -1)
    return state, spread, noise


def _applied(matrices: Array, values: Array) -> Array:
    """Matrices (p, p, K), or one for all (p, p), times values (p, ..., K)."""
    if matrices.ndim == 2:
        return np.asarray((matrices @ values.reshape(len(values), -1)).reshape(values.shape))
    return np.asarray(np.einsum("ijk,j...k->i...k", matrices, values, order="C"))


def even(blocks: Array) -> Array:
    """Symmetric parts of blocks (..., 2, 2)."""
    return np.asarray(0.5 * (blocks + blocks.swapaxes(-1, -2)))


@dataclass(frozen=True)
class Mixture:
    mean: Array  # Position, velocity, acceleration, m, m/s, m/s^2
    covariance: Array
    diffusion: Array  # Intensities of acceleration and jerk, m^2/s^3 and m^2/s^5
    shape: Array  # ...times this

    @cached_property
    def noises(self) -> Array:
        """Intensities of acceleration and jerk, (2, K, 2, 2)."""
        return np.asarray(self.diffusion.T[:, :, None, None] * self.shape)

    @cached_property
    def errors(self) -> Array:
        """Covariances of the positions from now on, coefficients (K, 6, 2, 2) of polynomials of time."""
        p, (swerve, jerk) = self.covariance, self.noises
        return np.stack(
            [
                p[:, 0, :, 0],
                2.0 * even(p[:, 0, :, 1]),
                p[:, 1, :, 1] + even(p[:, 0, :, 2]),
                even(p[:, 1, :, 2]) + swerve / 3.0,
                0.25 * p[:, 2, :, 2],
                jerk / 20.0,
            ],
            axis=1,
        )

    def of(self, some: Index | slice) -> Mixture:
        return Mixture(self.mean[some], self.covariance[some], self.diffusion[some], self.shape[some])

    def after(self, leads: Array) -> Mixture:
        moved = np.eye(3) + leads[:, None, None] * np.eye(3, k=1)
        moved[:, 0, 2] = 0.5 * leads * leads
        count = len(leads)
        mean = moved[:, None] @ self.mean
        pairs = self.covariance.transpose(0, 2, 4, 1, 3)  # (K, 2, 2, 3, 3)
        covariance = moved[:, None, None, None] @ pairs @ moved.transpose(0, 2, 1)[:, None, None, None]
        covariance = covariance.transpose(0, 1, 4, 2, 5, 3)
        return Mixture(
            mean.reshape(-1, *self.mean.shape[1:]),
            covariance.reshape(-1, *self.covariance.shape[1:]),
            np.tile(self.diffusion, (count, 1)),
            np.tile(self.shape, (count, 1, 1)),
        )

    def blended(self, some: Index, other: Mixture, share: Array) -> Mixture:
        """With another mixture for some obstacles (n,), which has shares (n,) of theirs and no noise of its own."""
        ours, theirs = (1.0 - share)[:, None, None], share[:, None, None]
        mean, covariance, diffusion = self.mean.copy(), self.covariance.copy(), self.diffusion.copy()
        apart = other.mean - mean[some]
        between = (share * (1.0 - share))[:, None, None, None, None]
        mean[some] = ours * mean[some] + theirs * other.mean
        parts = ours[..., None, None] * covariance[some] + theirs[..., None, None] * other.covariance
        covariance[some] = parts + between * (apart[:, :, :, None, None] * apart[:, None, None])
        diffusion[some] *= (1.0 - share)[:, None]
        return Mixture(mean, covariance, diffusion, self.shape)
