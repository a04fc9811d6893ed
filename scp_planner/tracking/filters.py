"""Filters of many obstacles whose motions are not what they are taken for, and the mixtures that they make.

Each obstacle is in a slot. Filters with white jerk and white acceleration run always, those of obstacles that weave,
with a course and a swing about it, after an alarm.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from itertools import combinations_with_replacement
from typing import Self

import numpy as np

from scp_planner.arrays import Array, Index, grown, run_of
from scp_planner.tracking.dynamics import WhiteJerk


@dataclass(frozen=True)
class FilterParameters:
    # Intensities of the filters with white jerk, as multiples of that of newcomers; the least free first
    jerks: tuple[float, ...] = (0.03, 0.3, 3.0)
    # Intensities of the filters with white acceleration, as multiples of that of newcomers
    swerves: tuple[float, ...] = (0.03, 0.1, 0.3, 1.0)
    # Periods of the oscillator models, as multiples of a new track's time from acceleration to velocity
    periods: tuple[float, ...] = (0.83, 1.17, 1.6, 2.2)
    # Standard deviation of a swing, as a multiple of how far newcomers' velocities lead in that time
    swing: float = 0.09
    damping: float = 0.03  # Damping ratio: after so many swings, 1 / (2 pi) over it, little is known of how it goes on
    course_jerk: float = 0.003  # Intensity of the course's jerk, as a multiple of that of newcomers
    ticks: float = 1e9  # Per unit of time: lags of one frame differ by rounding only


# Among obstacles that weave trips take 1.28 +- 0.16 times as long without the oscillator models, and 5.8 +- 4.0 points
# more of the replans are unsafe (`benchmarks.online noticing`, weaving, seeds 500 to 510).
FILTERS = FilterParameters()


@dataclass
class SlotStates(ABC):
    """States of M filters of each of K obstacles, in units of the covariance of the noise."""

    mean: Array  # Position first, m
    spread: Array  # The covariance of the state is this times that of the noise that is declared

    @abstractmethod
    def predict(self, lag: Array, unit: Array) -> None:
        """Move on by lags (K,), s, of obstacles whose noise has variances (K,), m^2."""

    @abstractmethod
    def update(self, positions: Array, noise: float) -> tuple[Array, Array]:
        """Take in positions (2, K) m; return what they differ by (2, M, K) m, and its variance over the noise."""

    def of(self, slots: Index) -> Self:
        """A copy of the states of some obstacles, (n,)."""
        return replace(self, mean=_taken(self.mean, slots), spread=_taken(self.spread, slots))

    def put(self, slots: Index, part: Self) -> None:
        run = run_of(slots)
        self.mean[..., run], self.spread[..., run] = part.mean, part.spread

    def predicted(self, slots: Index, lag: Array, unit: Array) -> Self:
        """States of some obstacles after lags (n,)."""
        part = self.of(slots)
        part.predict(lag, unit)
        return part

    def take_in(self, slots: Index, lag: Array, unit: Array, positions: Array, noise: float) -> tuple[Array, Array]:
        """Update those of some obstacles after lags (n,)."""
        part = self.predicted(slots, lag, unit)
        found = part.update(positions, noise)
        self.put(slots, part)
        return found

    def grow(self, size: int) -> None:
        self.mean, self.spread = grown(self.mean, size), grown(self.spread, size)


def _taken(values: Array, slots: Index) -> Array:
    run = run_of(slots)
    return values[..., run].copy() if isinstance(run, slice) else values.take(slots, axis=-1)


_ROWS = np.array([[0, 1, 2], [1, 3, 4], [2, 4, 5]])
"""Place of each element of a symmetric matrix in `FilterStates.spread`."""


@dataclass
class FilterStates(SlotStates):
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
        same = bool((lag == lag[:1]).all()) and len(lag) > 0  # as in a frame: one product of matrices then does it
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


STATES = 5
_PAIRS = np.array(list(combinations_with_replacement(range(STATES), 2))).T
"""Rows and columns of the upper triangle."""
_OBSERVED = np.array(list(combinations_with_replacement(range(3), 2))).T
_FULL = np.zeros((STATES, STATES), dtype=np.intp)
_FULL[_PAIRS[0], _PAIRS[1]] = _FULL[_PAIRS[1], _PAIRS[0]] = np.arange(_PAIRS.shape[1])
_KINEMATIC = _FULL[_OBSERVED[0], _OBSERVED[1]]
"""Place of the upper triangle of the first three states."""


@dataclass(frozen=True, eq=False)
class Swings:
    """M motions that swing about a course."""

    rates: Array  # (M,) Natural frequencies, rad/s
    deviation: float  # Standard deviation of each component of a swing, m
    jerk: float  # Intensity of the course's jerk, m^2/s^5
    velocity_deviation: float
    acceleration_deviation: float

    @classmethod
    def of(cls, velocity_deviation: float, acceleration_deviation: float) -> Swings:
        time = velocity_deviation / acceleration_deviation
        jerk = FILTERS.course_jerk * acceleration_deviation**2 / time
        rates = 2.0 * np.pi / (time * np.array(FILTERS.periods))
        return cls(rates, FILTERS.swing * velocity_deviation * time, jerk, velocity_deviation, acceleration_deviation)

    @cached_property
    def diffusions(self) -> Array:
        """Intensities of acceleration and jerk where nothing is known of the swing any more, (M, 2)."""
        return np.array([[0.0, self.jerk]] * len(self.rates))

    @cached_property
    def driving(self) -> Array:
        swerves = 4.0 * FILTERS.damping * self.rates**3 * self.deviation**2
        return np.stack([swerves, np.full(len(swerves), self.jerk)], axis=1)

    @cached_property
    def apart(self) -> Array:
        """From states to the course and the swing, (M, 5, 5)."""
        matrix = np.tile(np.eye(STATES), (len(self.rates), 1, 1))
        matrix[:, 0, 3] = matrix[:, 1, 4] = -1.0
        matrix[:, 2, 3], matrix[:, 2, 4] = self.rates**2, 2.0 * FILTERS.damping * self.rates
        return matrix

    @cached_property
    def _united(self) -> Array:
        """And back."""
        return np.asarray(np.linalg.inv(self.apart), dtype=float)

    @cached_property
    def _steady(self) -> Array:
        """Covariance of a swing and its rate of which nothing is known, (M, 2, 2)."""
        steady = np.zeros((len(self.rates), 2, 2))
        steady[:, 0, 0], steady[:, 1, 1] = self.deviation**2, (self.deviation * self.rates) ** 2
        return steady

    @cached_property
    def first(self) -> Array:
        """Covariance of the state before anything was seen, of all but the position, (15, M)."""
        known = np.zeros((len(self.rates), STATES, STATES))
        known[:, 1, 1], known[:, 2, 2] = self.velocity_deviation**2, self.acceleration_deviation**2
        known[:, 3:, 3:] = self._steady
        spread = (self._united @ known @ self._united.transpose(0, 2, 1))[:, _PAIRS[0], _PAIRS[1]].T
        spread[:STATES] = 0.0  # where it is may be anywhere, so that it tells nothing of the swing
        return np.asarray(spread)

    def moved(self, lag: float) -> tuple[Array, Array]:
        """Transitions (M, 5, 5) over a lag, s, and the covariances (M, 5, 5) of the noise on the way."""
        rate, damping = self.rates, FILTERS.damping
        decay, damped = np.exp(-damping * rate * lag), np.sqrt(1.0 - damping**2) * rate
        cosine, sine = decay * np.cos(damped * lag), decay * np.sin(damped * lag) / damped
        swing = np.zeros((len(rate), 2, 2))
        swing[:, 0, 0], swing[:, 0, 1] = cosine + damping * rate * sine, sine
        swing[:, 1, 0], swing[:, 1, 1] = -(rate**2) * sine, cosine - damping * rate * sine
        course = WhiteJerk(self.jerk, self.acceleration_deviation)
        moved, noise = np.zeros((2, len(rate), STATES, STATES))
        moved[:, :3, :3] = course.transition(np.array(lag))
        noise[:, :3, :3] = course.noise(np.array(lag))
        moved[:, 3:, 3:] = swing
        noise[:, 3:, 3:] = self._steady - swing @ self._steady @ swing.swapaxes(-1, -2)
        united, apart = self._united, self.apart
        return united @ moved @ apart, united @ noise @ united.transpose(0, 2, 1)


@lru_cache(maxsize=64)  # lags repeat, from frame to frame
def _steps(swings: Swings, lag: float) -> tuple[Array, Array, Array]:
    """From means and upper triangles of covariances to those after a lag, s, and the triangles of the noise."""
    moved, noise = swings.moved(lag)
    return moved, _on_triangles(moved, _PAIRS), noise[:, _PAIRS[0], _PAIRS[1]].T[..., None]


def _on_triangles(matrices: Array, rows: Array) -> Array:
    """From the upper triangle of P to that of F P F', for F (..., n, 5): (..., len(rows[0]), 15)."""
    left, right = matrices[..., rows[0], :], matrices[..., rows[1], :]
    product = left[..., _PAIRS[0]] * right[..., _PAIRS[1]]
    return np.asarray(product + (_PAIRS[0] != _PAIRS[1]) * left[..., _PAIRS[1]] * right[..., _PAIRS[0]])


@dataclass
class SwingStates(SlotStates):
    swings: Swings

    @classmethod
    def none(cls, swings: Swings) -> SwingStates:
        many = len(swings.rates)
        return cls(np.zeros((STATES, 2, many, 0)), np.zeros((_PAIRS.shape[1], many, 0)), swings)

    def begin(self, slots: Index, positions: Array, noise: float, unit: Array) -> None:
        """Begin with positions (n, 2), m, seen with so many times the noise whose variances are (n,), m^2."""
        self.mean[..., slots] = 0.0
        self.mean[0][..., slots] = positions.T[:, None]
        self.spread[..., slots] = self.swings.first[..., None] / unit
        self.spread[0][..., slots] = noise

    def predict(self, lag: Array, unit: Array) -> None:
        lag = np.rint(lag * FILTERS.ticks) / FILTERS.ticks
        for one in dict.fromkeys(lag.tolist()):
            some = run_of(np.flatnonzero(lag == one))
            moved, triangles, noise = _steps(self.swings, one)
            mean, spread = self.mean[..., some].transpose(2, 0, 1, 3), self.spread[..., some].transpose(1, 0, 2)
            self.mean[..., some] = (moved @ mean.reshape(*mean.shape[:2], -1)).reshape(mean.shape).transpose(1, 2, 0, 3)
            self.spread[..., some] = (triangles @ spread).transpose(1, 0, 2) + noise / unit[some]

    def update(self, positions: Array, noise: float) -> tuple[Array, Array]:
        innovation = positions[:, None] - self.mean[0]
        variance = self.spread[0] + noise
        gain = self.spread[:STATES] / variance
        self.mean += gain[:, None] * innovation
        told = np.empty_like(self.spread)
        for row in range(STATES):  # NUMPY-CALLS: to gather both factors takes twice as long
            np.multiply(gain[row], self.spread[row:STATES], out=told[_FULL[row, row] : _FULL[row, -1] + 1])
        self.spread -= told
        return innovation, variance

    @property
    def kinematic(self) -> tuple[Array, Array]:
        return self.mean[:3], self.spread[_KINEMATIC]

    def settled(self, unit: Array) -> tuple[Array, Array]:
        course = self.swings.apart[:, :3]
        mean = np.einsum("mij,jamk->iamk", course, self.mean)
        spread = np.einsum("mij,jmk->imk", _on_triangles(course, _OBSERVED), self.spread)
        spread[0] += self.swings.deviation**2 / unit
        return mean, spread


@dataclass(frozen=True)
class FilterModels:
    velocity_deviation: float
    acceleration_deviation: float

    @cached_property
    def swings(self) -> Swings:
        """The filters of those that weave, which follow the others."""
        return Swings.of(self.velocity_deviation, self.acceleration_deviation)

    @property
    def size(self) -> int:
        return len(self.diffusions) + len(self.swings.rates)

    @cached_property
    def diffusions(self) -> Array:
        """Intensities of acceleration and jerk, (M, 2) m^2/s^3 and m^2/s^5: multiples of those of newcomers."""
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
