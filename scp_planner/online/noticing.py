"""Notice when obstacles are not what zones take them for, and say what to go by instead.

Each observation is compared with what had been predicted of it (`scp_planner.online.innovations`). What follows where
that was improbable, until predictions hold again:

- **the model is widened, and memory shortened**: zones of an obstacle whose windows are improbable are those of a
  mixture of filters, whose memories are as short as their motions are free (`scp_planner.online.mixtures`). The filters
  always run. Those whose own windows are not improbable count, or else the freest, each as much as the observations
  since the alarming window were probable under it. If they are as probable under the polynomial motion after all, and
  its windows hold again, the alarm is called off;
- **noise is re-estimated** over all obstacles together, see `scp_planner.online.sensor_noise`.

All of it is done for many obstacles at once.
"""

from __future__ import annotations

import numpy as np

from scp_planner.arrays import Array, Index, Mask
from scp_planner.estimation.recursive import RecursiveEstimator
from scp_planner.online.innovations import WINDOWS, windows_of
from scp_planner.online.mixtures import FilterStates, Mixture, Widening
from scp_planner.online.sensor_noise import NEIGHBOURS, third_differences
from scp_planner.settings.online import RARE

CALM = 3.0
"""Log odds from which on, with `EVIDENCE` observations since an alarm, it was a false one."""
EVIDENCE = 32
"""Newest observations by whose probability the filters are compared."""
_RING = WINDOWS[-1]


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


def _longer(array: Array, size: int) -> Array:
    grown = np.zeros((size, *array.shape[1:]), dtype=array.dtype)
    grown[: len(array)] = array
    return grown


def _pushed(newest: Array, one: Array) -> Array:
    """Drop the oldest of a few, (n, few, ...), and add one, (n, ...)."""
    return np.concatenate([newest[:, 1:], one[:, None]], axis=1)
