"""Notice when obstacles, or the noise of sensors, are not what zones take them for, and say what to go by instead."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache, lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from scp_planner.arrays import Array, Index, Mask, Single, grown, rows_of, run_of
from scp_planner.settings.online import RARE
from scp_planner.tracking.filters import FilterModels, FilterStates, Mixture, SwingStates
from scp_planner.tracking.recursive import RecursiveEstimator
from scp_planner.tracking.tolerances import LEAST_DEVIATION, PROBABILITY


@dataclass(frozen=True)
class NoticingParameters:
    # Numbers of the newest innovations that are tested together
    windows: tuple[int, ...] = (2, 3, 4, 6, 8, 12, 16, 24, 32)
    # Standard deviations to which innovations are cut: an outlier alone makes no alarm of a probability of `RARE`
    wild: float = 4.0
    calm: float = 3.0  # Log odds from which on, with as much evidence since an alarm, it was a false one
    # Weight that those who weave must have together to count: zones of what swings are of more pieces than others
    little: float = 1e-3


NOTICING = NoticingParameters()
_KEPT = NOTICING.windows[-1]
"""Newest measurements of each obstacle that are kept."""


@dataclass(frozen=True)
class NoiseParameters:
    newest: int = 512  # Newest third differences that the noise is estimated from
    # Standard errors by which the noise must exceed what is declared, to be believed; from then on one is enough
    sure: float = 4.0
    fewest: int = 12  # Fewest measurements of one obstacle from which a change of its motion is found
    most: int = 64  # Newest measurements that are looked at for that
    exact: float = 10.0  # Least standard deviations that are used, up to which residuals are no sign of another motion
    median: float = 1.3862943611198906  # Of chi-square with 2 degrees of freedom
    median_error: float = 2.28  # Relative standard error of the median of n overlapping differences, times sqrt(n)


# With noise twice as declared trips take 1.96 +- 0.11 times as long where it is not noticed, with three times as much
# 2.13 +- 0.14 times (`benchmarks.online noticing`, noise2 and noise3, seeds 500 to 509).
NOISE = NoiseParameters()
NEIGHBOURS = 4
"""Observations that a third difference is of."""
_SELF = np.eye(NEIGHBOURS)[..., None]


class Bank:
    """Filters of K obstacles, each in a slot, which is the last axis of all arrays."""

    def __init__(self, order: int, widening: FilterModels, alarm_probability: float = RARE) -> None:
        self.order, self.widening, self.alarm_probability = order, widening, alarm_probability
        self.noise = 1.0
        self.polynomials = RecursiveEstimator(0, order, np.zeros((0, 2, 2)))
        self.states, self.swings = FilterStates.none(widening.diffusions), SwingStates.none(widening.swings)
        levels, self._walks = widening.size, len(widening.diffusions)
        self.count, self._since = np.zeros((2, 0), dtype=np.intp)  # Measurements in all, and since an alarm
        self.alarmed = np.zeros(0, dtype=bool)
        self.weights, self.gain, self.trend, self.last = np.zeros((levels, 0)), np.zeros(0), np.zeros(0), np.zeros(0)
        self._sigma, self._whiten, self._least = np.zeros((2, 2, 0)), np.zeros((2, 2, 0)), np.zeros(0)
        # Of the newest measurements, the last of them last: times and positions, and the standardised innovations of
        # the polynomials and of all filters. Log densities are in a ring, since nobody asks for their order
        self._looks, self._innovations = np.zeros((3, 2 * _KEPT, 0)), np.zeros((2, 1 + levels, 2 * _KEPT, 0))
        self._cut = np.zeros((3, 1 + levels, 2 * _KEPT, 0), dtype=np.float32)  # as windows look at them
        self._end = np.zeros(0, dtype=np.intp)  # of the newest `_KEPT` of these
        self._evidence = np.zeros((1 + levels, _KEPT, 0))
        self._free: list[int] = []

    # slots

    def take(self, covariance: Array) -> int:
        """Give a slot for an obstacle whose observations have a covariance (2, 2), m^2."""
        if not self._free:
            self._grow(max(2 * len(self.count), 8))
        slot = self._free.pop()
        self._sigma[..., slot] = covariance
        self._whiten[..., slot] = np.linalg.inv(np.linalg.cholesky(covariance))
        self._least[slot] = np.linalg.eigvalsh(covariance)[0]
        self.polynomials.set_covariance(slot, self.noise * covariance)
        self.polynomials.reset(slot)
        for array in (self.count, self._since, self.alarmed, self.weights, self.trend):
            array[..., slot] = 0
        for ring in (self._innovations, self._cut, self._evidence):
            ring[..., slot] = 0.0
        self._looks[0, :, slot] = self.last[slot] = -np.inf
        self._end[slot] = _KEPT
        return slot

    def give_back(self, slot: int) -> None:
        self._free.append(slot)

    def set_noise(self, factor: float) -> None:
        """Take the variance of the noise for so many times what is declared."""
        self._innovations *= np.sqrt(self.noise / factor)
        self._cut = cut(self._innovations)
        self.noise = factor
        for slot in range(len(self.count)):
            self.polynomials.set_covariance(slot, factor * self._sigma[..., slot])

    def _grow(self, size: int) -> None:
        self._free.extend(range(size - 1, len(self.count) - 1, -1))
        self.polynomials.grow(size)
        self.states.grow(size)
        self.swings.grow(size)
        for name, array in vars(self).items():
            if isinstance(array, np.ndarray):
                setattr(self, name, grown(array, size))

    def _declared(self, slots: Index) -> Array:
        """Covariances of the noise of some obstacles, as they are declared, (n, 2, 2) m^2."""
        return np.asarray(np.moveaxis(self._sigma, -1, 0).take(slots, axis=0))

    def noise_of(self, slots: Index) -> Array:
        return self.noise * self._declared(slots)

    def is_declared(self, slots: Index, covariances: Sequence[Array | None]) -> Mask:
        """True if observations of some obstacles, (n,), come with the covariance that is known, or without one."""
        given = [number for number, one in enumerate(covariances) if one is not None]
        same = np.ones(len(slots), dtype=bool)
        if given:
            own = np.array([covariances[number] for number in given])
            same[given] = (own == self._declared(slots[given])).all(axis=(1, 2))
        return same

    # observations

    def update(self, slots: Index, times: Array, positions: Array) -> None:
        """Take in one observation each of some obstacles, none of them before its last one."""
        if not len(slots):
            return
        run = run_of(slots)
        lag, old, alarmed = times - self.last[run], self.count[run] > 0, self.alarmed[run]
        innovations = np.zeros((2, 1 + self.widening.size, len(slots)))
        evidence = np.zeros(innovations.shape[1:])
        self.polynomials.take_in(slots, times, positions)
        innovations[:, 0], evidence[0] = self._fed(slots)
        self._begin(slots[~old], positions[~old])
        walks, swings = slice(1, 1 + self._walks), slice(1 + self._walks, None)
        for states, which, mask in ((self.states, walks, old), (self.swings, swings, alarmed)):
            if mask.any():
                some = run_of(np.flatnonzero(mask))
                own, places = slots[some], positions[some].T
                seen = states.take_in(own, lag[some], self._least[own], places, self.noise)
                evidence[which, some], innovations[:, which, some] = self._judged(own, *seen)
        self.last[run] = times
        looks = np.stack([times, *positions.T])
        full = slots[self._end[run] == 2 * _KEPT]
        self._end[full] = _KEPT
        newest = _places(self._end[run], slots)
        for kept, values in ((self._looks, looks), (self._innovations, innovations), (self._cut, cut(innovations))):
            if len(full):
                kept[..., :_KEPT, run_of(full)] = kept[..., _KEPT:, run_of(full)]
            kept[(..., *newest)] = values
        self._evidence[(..., *_places(self.count[run] % _KEPT, slots))] = evidence
        self._end[run] += 1
        self.count[run] += 1
        self._notice(slots)

    def take_in_late(self, slot: int, time: float, position: Array) -> None:
        """Take in an observation that is older than the newest: only the polynomial motion learns of it."""
        self.polynomials.take_in(np.array([slot]), np.array([time]), position[None])

    def surprise(self, slots: Index, times: Array, positions: Array) -> Array:
        """Squared standardised innovations that observations would be, (n,)."""
        squares = np.zeros(len(slots))
        known = self.count[slots] > 0
        which, lag, seen = slots[known], times[known] - self.last[slots[known]], positions[known]
        offset, variance = self._polynomial_innovations(which, times[known], seen)
        by_polynomials = np.where(self.alarmed[which], 0.0, (offset * offset).sum(axis=0) / variance)
        part = self.states.predicted(which, lag, self._least[which])
        freest = self._whitened(which, seen.T - part.mean[0, :, -1])
        by_filter = (freest * freest).sum(axis=0) / (part.spread[0, -1] + self.noise)
        squares[known] = np.maximum(by_polynomials, by_filter)
        return squares

    def _whitened(self, slots: Index, offsets: Array) -> Array:
        """Standardise offsets (2, ..., n), m, by what is declared of the noise; the factor is triangular."""
        (xx, _), (yx, yy) = self._whiten[..., slots]
        return np.stack([xx * offsets[0], yx * offsets[0] + yy * offsets[1]])

    def _fed(self, slots: Index) -> tuple[Array, Array]:
        """Standardised innovations (2, n) of the polynomials, and log densities (n,); 0 where too little was seen."""
        scaled, shrunk = self.polynomials.innovations
        share = shrunk[slots]
        sure = share > PROBABILITY
        innovations = np.where(sure, self._whitened(slots, scaled.take(slots, axis=1)) / math.sqrt(self.noise), 0.0)
        share = np.where(sure, share, 1.0)
        squares = innovations[0] * innovations[0] + innovations[1] * innovations[1]
        return innovations, np.where(sure, -0.5 * squares - np.log(self.noise / (share * share)), 0.0)

    def _polynomial_innovations(self, slots: Index, times: Array, positions: Array) -> tuple[Array, Array]:
        """Whitened innovations (2, n) of positions, 0 where too little was seen, and their variances (n,)."""
        roots = rows_of(self.polynomials.roots, slots)
        diagonal = np.abs(np.diagonal(roots.factor, axis1=1, axis2=2))
        sure = diagonal.min(axis=1) > PROBABILITY * diagonal.max(axis=1)
        factor = np.where(sure[:, None, None], roots.factor, np.eye(self.order + 1))
        powers = (times - roots.center)[:, None] ** np.arange(self.order + 1)
        rows = np.linalg.solve(factor.transpose(0, 2, 1), powers[..., None])
        offset = positions - roots.origin - (rows * roots.right).sum(axis=1)
        return np.where(sure, self._whitened(slots, offset.T), 0.0), self.noise * (1.0 + (rows * rows).sum(axis=(1, 2)))

    def _begin(self, slots: Index, positions: Array) -> None:
        part = self.states.of(slots)
        part.mean[...], part.spread[...] = 0.0, 0.0
        part.mean[0] = positions.T[:, None]
        part.spread[0] = self.noise
        part.spread[3], part.spread[5] = self.widening.priors.T[:, :, None] / self._least[slots]
        self.states.put(slots, part)

    def _judged(self, slots: Index, innovation: Array, variance: Array) -> tuple[Array, Array]:
        """Log densities (M, ..., n), but for a constant, of innovations (2, M, ..., n), m, and these in sigmas."""
        offset = self._whitened(slots, innovation) / np.sqrt(variance)
        return -0.5 * (offset[0] * offset[0] + offset[1] * offset[1]) - np.log(variance), offset

    def _newest(self, kept: NDArray[Any], slots: Index) -> NDArray[Any]:
        """The newest values (..., ring, n), oldest first, of some obstacles."""
        end = self._end[slots]
        if (end == end[:1]).all():
            first = int(end[0]) - _KEPT if len(end) else 0
            return kept[..., first : first + _KEPT, run_of(slots)]
        return kept[..., end - _KEPT + np.arange(_KEPT)[:, None], slots]

    # tests

    def _notice(self, slots: Index) -> None:
        """Alarm those whose polynomial motion does not hold, and weigh the filters of those that are alarmed."""
        trends, worst = tested(self._newest(self._cut[:, 0], slots), self.alarm_probability)
        most = worst.max(axis=0)
        self.trend[slots] = trends.max(axis=0)
        fresh = (most > 1.0) & ~self.alarmed[slots]
        if fresh.any():
            self.alarm(slots[fresh], np.array(NOTICING.windows)[worst[:, fresh].argmax(axis=0)])
        some = self.alarmed[slots]
        if some.any():
            self._weigh(slots[some], most[some] <= 1.0)

    def alarm(self, slots: Index, windows: Index) -> None:
        """Go by the filters from now on, and by what was seen in the newest windows of so many observations, (n,)."""
        self.alarmed[slots], self._since[slots] = True, windows
        self._learn_swings(slots)
        age = (self.count[slots] - 1 - np.arange(_KEPT)[:, None]) % _KEPT  # of each place in the ring
        self._evidence[..., slots] *= age < windows

    def _learn_swings(self, slots: Index) -> None:
        """Let those that weave learn from the newest looks: before an alarm nobody asks for them."""
        clock, *places = self._newest(self._looks, slots)
        positions, there = np.stack(places, axis=-1), np.isfinite(clock)
        part, shape = self.swings.of(slots), (self.swings.mean.shape[2], _KEPT, len(slots))
        innovation, variance, told = np.zeros((2, *shape)), np.ones(shape), np.zeros((_KEPT, len(slots)), dtype=bool)
        for row in range(_KEPT):
            first = there[row] & (~there[row - 1] if row else True)
            if first.any():
                part.begin(np.flatnonzero(first), positions[row, first], self.noise, self._least[slots[first]])
            told[row] = old = there[row] & ~first
            if not old.any():
                continue
            some = np.flatnonzero(old)
            states = part.of(some)
            states.predict(clock[row, some] - clock[row - 1, some], self._least[slots[some]])
            innovation[:, :, row, some], variance[:, row, some] = states.update(positions[row, some].T, self.noise)
            part.put(some, states)
        self.swings.put(slots, part)
        evidence, found = self._judged(slots, innovation, variance)
        swings, place = 1 + self._walks, (self.count[slots] + np.arange(_KEPT)[:, None]) % _KEPT
        newest = self._end[slots] - _KEPT + np.arange(_KEPT)[:, None]
        self._innovations[:, swings:, newest, slots], self._cut[:, swings:, newest, slots] = found, cut(found)
        self._evidence[swings:, place, slots] = np.where(told, evidence, 0.0)

    def _weigh(self, slots: Index, calm: Mask) -> None:
        """Weigh the filters; call those alarms off that were false, of those whose polynomial motion holds."""
        _, worst = tested(self._newest(self._cut[:, 1:], slots), self.alarm_probability)
        holds = worst.max(axis=-2) <= 1.0  # each filter's own windows are not improbable, (M, n)
        holds[self._walks - 1] |= ~holds.any(axis=0)  # the freest
        self._since[slots] += 1
        evidence = self._evidence[..., run_of(slots)].sum(axis=-2)
        among = np.where(holds, evidence[1:], -np.inf)
        most = among.max(axis=0)
        weights = np.exp(among - most)
        swing = weights[self._walks :].sum(axis=0)
        weights[self._walks :] *= swing >= NOTICING.little * weights.sum(axis=0)
        total = weights.sum(axis=0)
        self.weights[:, slots] = weights / total
        self.gain[slots] = most + np.log(total / len(among)) - evidence[0]
        false = calm & (self._since[slots] >= _KEPT) & (evidence[0] > most + NOTICING.calm)
        self.alarmed[slots[false]] = False

    def weave(self, slots: Index) -> Mask:
        """True if those that weave count among the filters of some obstacles, (n,)."""
        return np.asarray(self.weights[self._walks :, slots].any(axis=0))

    def mixed(self, slots: Index, times: Array) -> Mixture:
        swings = self.swings.predicted(slots, *self._lags(slots, times))
        return self._mixture(slots, times, *swings.kinematic, self.widening.swings.driving)

    def settled(self, slots: Index, times: Array) -> Mixture:
        swings = self.swings.predicted(slots, *self._lags(slots, times))
        return self._mixture(slots, times, *swings.settled(self._least[slots]), self.widening.swings.diffusions)

    def _lags(self, slots: Index, times: Array) -> tuple[Array, Array]:
        """Times since the newest measurements, and variances of these, (n,) each."""
        return np.maximum(times - self.last[slots], 0.0), self._least[slots]

    def _mixture(self, slots: Index, times: Array, mean: Array, spread: Array, diffusions: Array) -> Mixture:
        """With means (3, 2, M, n) and spreads (6, M, n) of those that weave, and what intensities they go on with."""
        part = self.states.predicted(slots, *self._lags(slots, times))
        every = np.concatenate([self.widening.diffusions, diffusions])
        part = FilterStates(
            np.concatenate([part.mean, mean], axis=2), np.concatenate([part.spread, spread], axis=1), every
        )
        weights, means = np.ascontiguousarray(self.weights[:, slots].T), part.means
        mean = (weights[..., None, None] * means).sum(axis=1)
        offset = means - mean[:, None]
        spread = (weights[..., None, None] * part.spreads).sum(axis=1)
        declared = self._declared(slots)
        covariance = np.einsum("nij,nab->niajb", spread, declared)
        apart = offset.reshape(*weights.shape, -1)  # NUMPY-CALLS: products of matrices take a third of the time of sums
        between = (weights[..., None] * apart).transpose(0, 2, 1) @ apart
        covariance += between.reshape(covariance.shape)
        return Mixture(mean, covariance, weights @ every, declared / self._least[slots][:, None, None])

    # the noise

    def looks(self, slots: Index) -> Array:
        """Times, s, and positions, m, of the newest looks at some obstacles, (3, ring, n); -inf before the first."""
        return self._newest(self._looks, slots)

    def differences(self, slots: Index) -> Array:
        """Squared third differences of the newest four positions of some obstacles, standardised: chi-square with 2."""
        some = slots[self.count[slots] >= NEIGHBOURS]
        rows, whiten = self._newest(self._looks, some)[:, -NEIGHBOURS:], self._whiten[..., run_of(some)]
        apart = (rows[0, 1:] > rows[0, :-1]).all(axis=0)
        if not apart.all():
            whiten, rows = whiten[..., apart], rows[..., apart]
        return third_differences(rows[0], rows[1:], whiten.transpose(2, 0, 1))


def _places(rows: Index, slots: Index) -> tuple[Index | int, Index | slice]:
    """Rows and slots of the newest values (..., n) in a ring: one row and a run of slots, if all are in step."""
    return (int(rows[0]), run_of(slots)) if (rows == rows[0]).all() else (rows, slots)


@cache
def _weights() -> Single:
    """Weights of the trend in each window, (ring, windows), oldest first: squares 1, 4, 9 ..., of length 1."""
    weights = np.zeros((NOTICING.windows[-1], len(NOTICING.windows)))
    for column, window in enumerate(NOTICING.windows):
        weights[NOTICING.windows[-1] - window :, column] = np.arange(1, window + 1) ** 2
    return np.asarray(weights / np.linalg.norm(weights, axis=0), dtype=np.float32)


@lru_cache(maxsize=8)
def _members(probability: float) -> Single:
    """One over the quantile of chi-square for the size of each window, (windows, ring); 0 of what is not in it."""
    from scipy.special import gammainccinv

    limits = 2.0 * gammainccinv(np.array(NOTICING.windows, dtype=float), probability)
    return np.asarray(((_weights() > 0.0) / limits).T, dtype=np.float32)


def cut(innovations: Array) -> Single:
    """Give standardised innovations (2, ...) as windows look at them: cut at `wild`, and their squares, (3, ...)."""
    x, y = innovations
    squares = x * x + y * y
    within = np.minimum(squares, NOTICING.wild**2)
    share = np.sqrt(within / np.maximum(squares, NOTICING.wild**2 * 1e-9))
    # 32 bits take half of the time of 64 to test: an alarm is no matter of the eighth digit.
    return np.stack([share * x, share * y, within]).astype(np.float32)


def tested(innovations: Single, probability: float) -> tuple[Single, Single]:
    """Squared trends and test statistics, (..., windows, n) each, of newest innovations, cut, (3, ..., ring, n)."""
    x, y, squares = innovations
    weights = _weights().T
    trends = (weights @ x) ** 2 + (weights @ y) ** 2
    # trends are chi-square with 2 degrees of freedom, and an alarm, of a probability, is a statistic above 1
    return trends, np.maximum(_members(probability) @ squares, trends / (-2.0 * math.log(probability)))


def third_differences(times: Array, positions: Array, whiten: Array) -> Array:
    """Squared third divided differences, standardised so that for white noise they are chi-square with 2 degrees."""
    if times.shape[1] and (times == times[:, :1]).all():
        times = times[:, :1]  # as in a frame
    between = times[:, None] - times[None] + _SELF
    weights = 1.0 / between.prod(axis=1)
    weights /= np.sqrt((weights * weights).sum(axis=0))
    x, y = weights[:, 0] @ positions if weights.shape[1] == 1 else (weights * positions).sum(axis=1)
    first, second = whiten[:, 0, 0] * x, whiten[:, 1, 0] * x + whiten[:, 1, 1] * y
    return np.asarray(first * first + second * second)


def neighbour_differences(times: Array, positions: Array, whiten: Array) -> Array:
    """`third_differences` of all neighbours in (n,) s and (n, 2) m; whiten as there, (2, 2)."""
    if len(times) < NEIGHBOURS:
        return np.zeros(0)
    view = np.lib.stride_tricks.sliding_window_view
    clock, places = view(times, NEIGHBOURS).T, view(positions, NEIGHBOURS, axis=0).transpose(1, 2, 0)
    apart = np.diff(clock, axis=0).min(axis=0) > 0.0
    return third_differences(clock[:, apart], places[..., apart], whiten[None])


def is_misfit(times: Sequence[float], positions: Sequence[tuple[float, float]], noise: Array) -> bool:
    """True if residuals are larger than neighbouring observations explain, (n,) s and (n, 2) m."""
    if len(times) < NOISE.fewest or np.trace(noise) < NOISE.exact**2 * LEAST_DEVIATION**2:
        return False
    newest, places = np.array(times[-NOISE.most :]), np.array(positions[-NOISE.most :])
    differences = neighbour_differences(newest, places, np.linalg.inv(np.linalg.cholesky(noise)))
    if len(differences) < NOISE.fewest - NEIGHBOURS:
        return False
    doubt = NOISE.sure * NOISE.median_error / math.sqrt(len(differences))
    return float(np.median(differences)) / NOISE.median < 1.0 / (1.0 + doubt)


class NoiseWatch:
    def __init__(self) -> None:
        self._newest = np.zeros(0)
        self.factor = 1.0
        """Its variance as a multiple of what is declared, never below 1."""

    def take_in(self, differences: Array) -> bool:
        """Take in standardised squared third differences, (n,); return whether the noise is another now."""
        self._newest = np.concatenate([self._newest, differences])[-NOISE.newest :]
        if not len(self._newest):
            return False
        doubt = (NOISE.sure if self.factor == 1.0 else 1.0) * NOISE.median_error / math.sqrt(len(self._newest))
        ratio = float(np.median(self._newest)) / NOISE.median / self.factor
        if 1.0 / (1.0 + doubt) <= ratio <= 1.0 + doubt:
            return False
        before, self.factor = self.factor, max(self.factor * ratio, 1.0)
        return self.factor != before
