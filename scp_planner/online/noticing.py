"""Notice when obstacles, or the sensor, are not what zones take them for, and say what to go by instead.

Each observation is compared with what had been predicted of it. The *innovations* of a polynomial motion, standardised,
are independent and standard normal as long as the motion and the noise are what they are taken for (R. L. Brown,
J. Durbin, J. M. Evans, *Techniques for testing the constancy of regression relationships over time*, J. R. Statist.
Soc. B 37 (1975)). Over windows of the newest ones, of several lengths, two things are tested:

- their *trend*: their sum, weighted like the path of a motion whose acceleration has changed, which is normal;
- their *size*: the sum of their squares, which is chi-square.

What follows, until predictions hold again:

- **the model is widened, and memory shortened**: zones of an obstacle whose windows are improbable are those of a
  mixture of filters, whose memories are as short as their motions are free. The filters always run: with white jerk
  and with white acceleration, of different sizes. Those whose own windows are not improbable count, or else the freest,
  each as much as the observations since the alarming window were probable under it. If they are as probable under the
  polynomial motion after all, and its windows hold again, the alarm is called off;
- **noise is re-estimated** over all obstacles together, from third differences of neighbouring positions, to which no
  motion contributes that is smooth over four observations; from their median, so outliers do not matter.

All of it is done for many obstacles at once.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np

from scp_planner.arrays import Array, Index, Mask
from scp_planner.estimation.recursive import RecursiveEstimator
from scp_planner.scenario.process_model import RandomWalkAcceleration, RandomWalkVelocity
from scp_planner.settings.online import RARE

WINDOWS = (2, 3, 4, 6, 8, 12, 16, 24, 32)
"""Numbers of the newest innovations that are tested together."""
CALM = 3.0
"""Log odds from which on, with `EVIDENCE` observations since an alarm, it was a false one."""
WILD = 4.0
"""Standard deviations to which innovations are cut: an outlier alone makes no alarm of a probability of `RARE`."""
EVIDENCE = 32
"""Newest observations by whose probability the filters are compared."""
JERKS = (0.03, 0.3, 3.0)
"""Intensities of the filters with white jerk, as multiples of that of newcomers; the least free first."""
SWERVES = (0.03, 0.1, 0.3, 1.0)
"""Intensities of the filters with white acceleration, as multiples of that of newcomers."""
NOISES = 512
"""Newest third differences that the noise is estimated from."""
SURE = 4.0
"""Standard errors by which the noise must exceed what is declared, to be believed; from then on one is enough."""

NEIGHBOURS = 4
"""Observations that a third difference is of."""

_RING = WINDOWS[-1]
_MEDIAN = 1.3862943611198906  # of chi-square with 2 degrees of freedom
_MEDIAN_ERROR = 2.28  # relative standard error of the median of n overlapping differences, times sqrt(n)


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


@lru_cache(maxsize=1)
def _weights() -> Array:
    """Weights of the trend in each window, (ring, windows), oldest first: squares 1, 4, 9 ..., of length 1."""
    weights = np.zeros((_RING, len(WINDOWS)))
    for column, window in enumerate(WINDOWS):
        weights[_RING - window :, column] = np.arange(1, window + 1) ** 2
    return weights / np.linalg.norm(weights, axis=0)


@lru_cache(maxsize=1)
def _members() -> Array:
    """Which innovations are in each window, 1 or 0, (ring, windows)."""
    return np.asarray(_weights() > 0.0, dtype=float)


@lru_cache(maxsize=4)
def _limits(probability: float) -> Array:
    """Quantiles of chi-square for the size of each window, (windows,)."""
    from scipy.special import gammainccinv

    return np.asarray(2.0 * gammainccinv(np.array(WINDOWS, dtype=float), probability))


def windows_of(innovations: Array, probability: float = RARE) -> Array:
    """How improbable the newest innovations are, window by window.

    Parameters
    ----------
    innovations : (..., ring, 2)
        Standardised, the newest last; 0 where there is none.
    probability : float
        Of a window to be called improbable though all is as it is taken for.

    Returns
    -------
    (..., windows)
        The larger of what trend and size are as multiples of their limits; above 1: improbable.
    """
    x, y = innovations[..., 0], innovations[..., 1]
    squares = x * x + y * y
    cut = np.minimum(squares, WILD**2)
    share = np.sqrt(cut / np.maximum(squares, WILD**2 * 1e-9))
    trends = ((share * x) @ _weights()) ** 2 + ((share * y) @ _weights()) ** 2
    return np.asarray(np.maximum(trends / (-2.0 * np.log(probability)), cut @ _members() / _limits(probability)))


class Bank:
    """What is known of many obstacles whose noise is known, each in a slot of its own.

    Parameters
    ----------
    order : int
        Of their polynomial motions.
    widening : Widening
    alarm_probability : float
        Of a window, below which it is improbable.

    Attributes
    ----------
    polynomials : RecursiveEstimator
        Of the polynomial motions.
    states : FilterStates
        Of the filters, (K, M).
    noise : float
        Variance of the noise, as a multiple of what is declared.
    count : (K,)
        Observations.
    last : (K,) s
        Time of the last one.
    alarmed : (K,) bool
        Whether zones go by the filters, and not by the polynomial motion any more.
    weights : (K, M)
        Of the filters, of those that are alarmed.
    """

    def __init__(self, order: int, widening: Widening, alarm_probability: float = RARE) -> None:
        self.order, self.widening, self.alarm_probability = order, widening, alarm_probability
        self.polynomials = RecursiveEstimator(0, order, np.zeros((0, 2, 2)))
        self.noise = 1.0
        levels = len(widening.filters)
        self.count = np.zeros(0, dtype=np.intp)
        self.alarmed = np.zeros(0, dtype=bool)
        self.weights = np.zeros((0, levels))
        self.states = FilterStates(np.zeros((0, levels, 3, 2)), np.zeros((0, levels, 3, 3)))
        self._sigma, self._whiten, self._least = np.zeros((0, 2, 2)), np.zeros((0, 2, 2)), np.zeros(0)
        self._times, self._positions = np.zeros((0, NEIGHBOURS)), np.zeros((0, NEIGHBOURS, 2))
        # rings, in which observation number n is at the place n modulo their length
        self._innovations = np.zeros((0, _RING, 1 + levels, 2))
        self._evidence = np.zeros((0, EVIDENCE, 1 + levels))
        self._since = np.zeros(0, dtype=np.intp)  # observations since an alarm
        self._free: list[int] = []

    # slots

    def take(self, covariance: Array) -> int:
        """Give a slot for an obstacle whose observations have a covariance (2, 2), m^2."""
        if not self._free:
            self._grow(max(2 * len(self.count), 8))
        slot = self._free.pop()
        self._sigma[slot] = covariance
        self._whiten[slot] = np.linalg.inv(np.linalg.cholesky(covariance))
        self._least[slot] = np.linalg.eigvalsh(covariance)[0]
        self.polynomials.set_covariance(slot, self.noise * covariance)
        self.clear(slot)
        return slot

    def clear(self, slot: int) -> None:
        """Forget all that was seen of the obstacle in a slot."""
        self.polynomials.reset(slot)
        for array in (self.count, self.alarmed, self.weights, self._since, self._innovations, self._evidence):
            array[slot] = 0
        self._times[slot] = -np.inf

    def give_back(self, slot: int) -> None:
        """Leave a slot to others."""
        self._free.append(slot)

    def set_noise(self, factor: float) -> None:
        """Take the variance of the noise for so many times what is declared."""
        self._innovations *= np.sqrt(self.noise / factor)
        self.noise = factor
        for slot, sigma in enumerate(self._sigma):
            self.polynomials.set_covariance(slot, factor * sigma)

    def _grow(self, size: int) -> None:
        self._free.extend(range(size - 1, len(self.count) - 1, -1))
        self.polynomials.grow(size)
        for name, value in vars(self).items():
            if isinstance(value, np.ndarray):
                setattr(self, name, _longer(value, size))
        self.states = FilterStates(_longer(self.states.mean, size), _longer(self.states.spread, size))

    @property
    def last(self) -> Array:
        """Time of the last observation of each, (K,) s."""
        return self._times[:, -1]

    # observations

    def update(self, slots: Index, times: Array, positions: Array) -> None:
        """Take in one observation each of some obstacles, none of them before its last one.

        Parameters
        ----------
        slots : (n,)
        times : (n,) s
        positions : (n, 2) m
        """
        innovations = np.zeros((len(slots), *self._innovations.shape[2:]))
        evidence = np.zeros(innovations.shape[:2])
        innovations[:, 0], evidence[:, 0] = self._polynomial_innovations(slots, times, positions)
        self._feed(slots, times, positions)
        begin, old = slots[self.count[slots] == 0], self.count[slots] > 0
        if len(begin):
            self._begin(begin, positions[~old])
        if old.any():
            evidence[old, 1:], innovations[old, 1:] = self._filter(slots[old], times[old], positions[old])
        self._times[slots] = _pushed(self._times[slots], times)
        self._positions[slots] = _pushed(self._positions[slots], positions)
        self._evidence[slots, self.count[slots] % EVIDENCE] = evidence
        self._innovations[slots, self.count[slots] % _RING] = innovations
        self.count[slots] += 1
        self._notice(slots)

    def take_in_late(self, slot: int, time: float, position: Array) -> None:
        """Take in an observation that is older than the newest: only the polynomial motion learns of it."""
        self._feed(np.array([slot]), np.array([time]), position[None])

    def surprise(self, slots: Index, times: Array, positions: Array) -> Array:
        """Squared standardised innovations that observations would be, (n,).

        Of the freest filter, which nothing that moves surprises; and of the polynomial motion, where it is believed.
        """
        found, _ = self._polynomial_innovations(slots, times, positions)
        squares = np.where(self.alarmed[slots], 0.0, (found * found).sum(axis=1))
        known = self.count[slots] > 0
        which, lag = slots[known], times[known] - self.last[slots[known]]
        part = FilterStates(self.states.mean[which, -1], self.states.spread[which, -1])
        part.predict(lag, self.widening.diffusions[-1] / self._least[which][:, None])
        offset = (self._whiten[which] @ (positions[known] - part.mean[:, 0])[:, :, None])[:, :, 0]
        squares[known] = np.maximum(squares[known], (offset * offset).sum(axis=1) / (part.spread[:, 0, 0] + self.noise))
        return np.asarray(squares)

    def _feed(self, slots: Index, times: Array, positions: Array) -> None:
        size = len(self.count)
        t, z, seen = np.zeros(size), np.zeros((size, 2)), np.zeros(size, dtype=bool)
        t[slots], z[slots], seen[slots] = times, positions, True
        self.polynomials.update(t, z, seen=seen)

    def _polynomial_innovations(self, slots: Index, times: Array, positions: Array) -> tuple[Array, Array]:
        """Standardised, (n, 2), and log densities (n,), as of filters; 0 of those of which too little was seen."""
        roots = self.polynomials.roots
        factor, found, evidence = roots.factor[slots], np.zeros((len(slots), 2)), np.zeros(len(slots))
        diagonal = np.abs(np.diagonal(factor, axis1=1, axis2=2))
        sure = np.flatnonzero(diagonal.min(axis=1) > 1e-9 * diagonal.max(axis=1))
        if not len(sure):
            return found, evidence
        which = slots[sure]
        powers = (times[sure] - roots.center[which])[:, None] ** np.arange(self.order + 1)
        row = np.linalg.solve(factor[sure].transpose(0, 2, 1), powers[:, :, None])[:, :, 0]
        expected = (row[:, :, None] * roots.right[which]).sum(axis=1) + roots.origin[which]
        size = np.sqrt(self.noise * (1.0 + (row * row).sum(axis=1)))
        offset = (self._whiten[which] @ (positions[sure] - expected)[:, :, None])[:, :, 0]
        found[sure] = offset / size[:, None]
        evidence[sure] = -0.5 * (found[sure] ** 2).sum(axis=1) - 2.0 * np.log(size)
        return found, evidence

    def _begin(self, slots: Index, positions: Array) -> None:
        states = self.states
        states.mean[slots], states.spread[slots] = 0.0, 0.0
        states.mean[slots, :, 0] = positions[:, None]
        states.spread[slots, :, 0, 0] = self.noise
        priors = self.widening.priors / self._least[slots][:, None, None]
        states.spread[slots, :, 1, 1], states.spread[slots, :, 2, 2] = priors[..., 0], priors[..., 1]

    def _filter(self, slots: Index, times: Array, positions: Array) -> tuple[Array, Array]:
        """Log densities of the observations under each filter (n, M), but for a constant, and innovations (n, M, 2)."""
        part = FilterStates(self.states.mean[slots], self.states.spread[slots])
        lag = np.broadcast_to((times - self._times[slots, -1])[:, None], part.mean.shape[:2])
        part.predict(lag, self.widening.diffusions / self._least[slots][:, None, None])
        innovation, variance = part.update(positions[:, None], self.noise)
        self.states.mean[slots], self.states.spread[slots] = part.mean, part.spread
        offset = (innovation @ self._whiten[slots].transpose(0, 2, 1)) / np.sqrt(variance)[..., None]
        return -0.5 * (offset * offset).sum(axis=-1) - np.log(variance), offset

    # tests

    def _notice(self, slots: Index) -> None:
        """Alarm those whose polynomial motion does not hold, and weigh the filters of those that are alarmed."""
        order = (self.count[slots, None] + np.arange(_RING)) % _RING  # the oldest first
        worst = windows_of(self._innovations[slots[:, None], order, 0], self.alarm_probability)
        fresh = (worst.max(axis=1) > 1.0) & ~self.alarmed[slots]
        if fresh.any():
            self.alarm(slots[fresh], np.array(WINDOWS)[worst[fresh].argmax(axis=1)])
        some = self.alarmed[slots]
        if some.any():
            self._weigh(slots[some], order[some], worst[some].max(axis=1) <= 1.0)

    def alarm(self, slots: Index, windows: Index) -> None:
        """Go by the filters from now on, and by what was seen in the newest windows of so many observations, (n,)."""
        self.alarmed[slots], self._since[slots] = True, windows
        age = (self.count[slots, None] - 1 - np.arange(EVIDENCE)) % EVIDENCE  # of each place in the ring
        self._evidence[slots] *= (age < windows[:, None])[..., None]

    def _weigh(self, slots: Index, order: Index, calm: Mask) -> None:
        """Weigh the filters; call those alarms off that were false, of those whose polynomial motion holds."""
        innovations = self._innovations[slots[:, None], order, 1:].swapaxes(1, 2)
        holds = windows_of(innovations, self.alarm_probability).max(axis=2) <= 1.0
        holds[~holds.any(axis=1), -1] = True
        self._since[slots] += 1
        evidence = self._evidence[slots].sum(axis=1)
        among = np.where(holds, evidence[:, 1:], -np.inf)
        most = among.max(axis=1)
        weights = np.exp(among - most[:, None])
        self.weights[slots] = weights / weights.sum(axis=1, keepdims=True)
        false = calm & (self._since[slots] >= EVIDENCE) & (evidence[:, 0] > most + CALM)
        self.alarmed[slots[false]] = False

    def mixed(self, slots: Index, times: Array) -> Mixture:
        """What the filters together predict for times (n,), s, not before the last observations."""
        part = FilterStates(self.states.mean[slots], self.states.spread[slots])
        lag = np.broadcast_to((times - self.last[slots])[:, None], part.mean.shape[:2])
        part.predict(np.maximum(lag, 0.0), self.widening.diffusions / self._least[slots][:, None, None])
        weights = self.weights[slots]
        mean = (weights[..., None, None] * part.mean).sum(axis=1)
        offset = part.mean - mean[:, None]
        spread = (weights[..., None, None] * part.spread).sum(axis=1)
        covariance = np.einsum("nij,nab->niajb", spread, self._sigma[slots])
        covariance += np.einsum("nm,nmia,nmjb->niajb", weights, offset, offset)
        change = self._sigma[slots] / self._least[slots][:, None, None]
        return Mixture(mean, covariance, weights @ self.widening.diffusions, change)

    # the noise

    def differences(self, slots: Index) -> Array:
        """Squared third differences of the newest four positions of some obstacles, standardised: chi-square with 2."""
        slots = slots[self.count[slots] >= NEIGHBOURS]
        slots = slots[np.diff(self._times[slots], axis=1).min(axis=1, initial=1.0) > 0.0]
        return third_differences(self._times[slots], self._positions[slots], self._whiten[slots])


def third_differences(times: Array, positions: Array, whiten: Array) -> Array:
    """Squared third divided differences, standardised so that for white noise they are chi-square with 2 degrees.

    Parameters
    ----------
    times : (n, 4) s
        Increasing.
    positions : (n, 4, 2) m
    whiten : (n, 2, 2)
        W with W Sigma W' = I, 1/m.

    Returns
    -------
    (n,)
    """
    between = times[:, :, None] - times[:, None]
    between[:, range(NEIGHBOURS), range(NEIGHBOURS)] = 1.0
    weights = 1.0 / between.prod(axis=2)
    weights /= np.linalg.norm(weights, axis=1)[:, None]
    offset = (whiten @ (weights[:, None] @ positions)[:, 0, :, None])[:, :, 0]
    return np.asarray((offset * offset).sum(axis=1))


def neighbour_differences(times: Array, positions: Array, whiten: Array) -> Array:
    """`third_differences` of all neighbours in (n,) s and (n, 2) m; whiten as there, (2, 2)."""
    if len(times) < NEIGHBOURS:
        return np.zeros(0)
    view = np.lib.stride_tricks.sliding_window_view
    clock, places = view(times, NEIGHBOURS), view(positions, NEIGHBOURS, axis=0).transpose(0, 2, 1)
    apart = np.diff(clock, axis=1).min(axis=1) > 0.0
    return third_differences(clock[apart], places[apart], whiten[None])


class NoiseWatch:
    """How much larger the noise of a sensor is than it declares, from all obstacles together."""

    def __init__(self) -> None:
        self._newest = np.zeros(0)
        self.factor = 1.0
        """Its variance as a multiple of what is declared, never below 1."""

    def take_in(self, differences: Array) -> bool:
        """Take in standardised squared third differences, (n,); return whether the noise is another now."""
        self._newest = np.concatenate([self._newest, differences])[-NOISES:]
        if not len(self._newest):
            return False
        doubt = (SURE if self.factor == 1.0 else 1.0) * _MEDIAN_ERROR / np.sqrt(len(self._newest))
        ratio = float(np.median(self._newest)) / _MEDIAN / self.factor
        if 1.0 / (1.0 + doubt) <= ratio <= 1.0 + doubt:
            return False
        before, self.factor = self.factor, max(self.factor * ratio, 1.0)
        return self.factor != before


def _longer(array: Array, size: int) -> Array:
    grown = np.zeros((size, *array.shape[1:]), dtype=array.dtype)
    grown[: len(array)] = array
    return grown


def _pushed(newest: Array, one: Array) -> Array:
    """Drop the oldest of a few, (n, few, ...), and add one, (n, ...)."""
    return np.concatenate([newest[:, 1:], one[:, None]], axis=1)
