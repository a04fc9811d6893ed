"""Kalman filters over many observations of each obstacle, in logarithmically many steps."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from scp_planner.arrays import Array
from scp_planner.tracking.dynamics import Dynamics
from scp_planner.tracking.kalman import FilterState

MOST_AT_ONCE = 4096  # observations of all histories: what is kept of each at a time are a few hundred numbers


@dataclass(frozen=True)
class _Stretches:
    """Linear maps of N segments of each of K histories, acting on the state x of s components before them."""

    forward: Array  # The state after a stretch is normal, its mean ``forward @ x + mean``
    mean: Array
    covariance: Array
    pull: Array
    information: Array

    def part(self, which: slice) -> _Stretches:
        return _Stretches(*(getattr(self, name)[which] for name in self.__dataclass_fields__))

    def then(self, after: _Stretches) -> _Stretches:
        """Each stretch and the one after it as one stretch."""
        states = self.mean.shape[-1]
        share = np.linalg.inv(np.eye(states) + self.covariance @ after.information)
        onward = after.forward @ share
        back = np.swapaxes(share @ self.forward, -1, -2)
        new = after.pull - _times(after.information, self.mean)
        return _Stretches(
            onward @ self.forward,
            _times(onward, self.mean + _times(self.covariance, after.pull)) + after.mean,
            onward @ self.covariance @ np.swapaxes(after.forward, -1, -2) + after.covariance,
            _times(back, new) + self.pull,
            back @ after.information @ self.forward + self.information,
        )


def state_after(dynamics: Dynamics, first: FilterState, times: Array, positions: Array, noise: Array) -> FilterState:
    """Return what is known of obstacles after many observations of each."""
    d, count = dynamics.states, times.shape[1]
    known = first.mean.reshape(1, count, 2 * d), first.covariance[None]
    lags = np.diff(times, axis=0, prepend=first.times[None])
    step = max(1, MOST_AT_ONCE // count)
    for begin in range(0, len(times), step):
        some = slice(begin, begin + step)
        # The state before is a stretch from which nothing is asked.
        nothing = np.zeros((1, count, 2 * d, 2 * d))
        before = _Stretches(nothing, known[0], known[1], np.zeros((1, count, 2 * d)), nothing)
        whole = before.then(_whole(_single(dynamics, lags[some], positions[some], noise[some])))
        known = whole.mean, 0.5 * (whole.covariance + np.swapaxes(whole.covariance, -1, -2))
    return FilterState(times[-1].copy(), known[0].reshape(count, d, 2), known[1][0])


def _single(dynamics: Dynamics, lags: Array, positions: Array, noise: Array) -> _Stretches:
    """Stretches of one observation each, (n, K) s after the last one."""
    states = 2 * dynamics.states
    forward, grown = np.zeros((*lags.shape, states, states)), np.zeros((*lags.shape, states, states))
    transition, process_noise = dynamics.transition(lags), dynamics.process_noise(lags)
    for axis in range(2):
        forward[..., axis::2, axis::2], grown[..., axis::2, axis::2] = transition, process_noise
    seen = forward[..., :2, :]  # where the state before is expected to be seen
    certain = np.linalg.inv(grown[..., :2, :2] + noise)
    gain = grown[..., :2] @ certain
    weighed = np.swapaxes(seen, -1, -2) @ certain
    return _Stretches(
        forward - gain @ seen,
        _times(gain, positions),
        grown - gain @ grown[..., :2, :],
        _times(weighed, positions),
        weighed @ seen,
    )


def _whole(stretches: _Stretches) -> _Stretches:
    """All stretches of each history, in their order, as one."""
    while (count := len(stretches.mean)) > 1:
        even = count - count % 2
        pairs = stretches.part(slice(0, even, 2)).then(stretches.part(slice(1, even, 2)))
        rest = stretches.part(slice(even, count))
        stretches = _Stretches(
            *(np.concatenate([getattr(some, name) for some in (pairs, rest)]) for name in pairs.__dataclass_fields__)
        )
    return stretches


def _times(matrices: Array, vectors: Array) -> Array:
    """Products of matrices, (..., r, s), and vectors, (..., s)."""
    return (matrices @ vectors[..., None])[..., 0]
