"""A Kalman filter of many obstacles at once, each at its own times."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from scp_planner.arrays import Array
from scp_planner.tracking.dynamics import Dynamics


@dataclass
class FilterState:
    """State of a Kalman filter for N obstacles."""

    times: Array
    mean: Array  # Expected states; the last axis is x and y
    covariance: Array

    def copy(self) -> FilterState:
        """Give a state that goes on by itself."""
        return FilterState(self.times.copy(), self.mean.copy(), self.covariance.copy())


def first_state(
    dynamics: Dynamics, velocity_variance: float, times: Array, positions: Array, noise: Array
) -> FilterState:
    """Begin at first observations: (N,) s, (N, 2) m and their covariances (N, 2, 2) m^2."""
    count, d = len(times), dynamics.states
    mean = np.zeros((count, d, 2))
    mean[:, 0] = positions
    covariance = np.zeros((count, 2 * d, 2 * d))
    covariance[:] = np.kron(dynamics.prior(velocity_variance), np.eye(2))
    covariance[:, :2, :2] = noise
    return FilterState(np.array(times, dtype=float), mean, covariance)


def update_state(dynamics: Dynamics, state: FilterState, times: Array, positions: Array, noise: Array) -> Array:
    """Take in the next observation of each obstacle; give the log likelihood of each: (N,)."""
    predict_state(dynamics, state, times)
    mean, p = state.mean, state.covariance
    innovation = positions - mean[:, 0]
    xx, xy, yy = (p[:, a, b] + noise[:, a, b] for a, b in ((0, 0), (0, 1), (1, 1)))
    determinant = xx * yy - xy**2
    inverse = np.empty_like(noise)
    inverse[:, 0, 0], inverse[:, 1, 1] = yy / determinant, xx / determinant
    inverse[:, 0, 1] = inverse[:, 1, 0] = -xy / determinant
    gain = p[:, :, :2] @ inverse
    weighted = (inverse @ innovation[:, :, None])[:, :, 0]
    mean += (gain @ innovation[:, :, None]).reshape(mean.shape)
    seen = noise @ (inverse @ p[:, :2, :])  # of the position, in which nothing cancels: it never comes out as 0
    p -= gain @ p[:, :2, :]
    p[:, :2, :], p[:, :, :2] = seen, np.swapaxes(seen, 1, 2)
    p += np.swapaxes(p, 1, 2).copy()  # rounding would make it lopsided
    p *= 0.5
    squares = np.einsum("na,na->n", weighted, innovation)
    return -0.5 * (squares + np.log(determinant)) - math.log(2.0 * math.pi)


def predict_state(dynamics: Dynamics, state: FilterState, times: Array) -> None:
    """Move the state of each obstacle on to a later time: (N,) s."""
    lag = times - state.times
    f, q = dynamics.transition(lag), dynamics.process_noise(lag)
    state.mean = f @ state.mean
    count, d = len(lag), dynamics.states
    # the same transition for x and y: (N, d, 2, d, 2)
    p = state.covariance.reshape(count, d, 4 * d)
    p = (f @ p).reshape(count, d, 2, d, 2)
    p = np.swapaxes(p, 1, 3).reshape(count, d, 4 * d)
    p = (f @ p).reshape(count, d, 2, d, 2)
    p = np.swapaxes(p, 1, 3)
    p[:, :, 0, :, 0] += q
    p[:, :, 1, :, 1] += q
    state.covariance = p.reshape(count, 2 * d, 2 * d)
    state.times = np.array(times, dtype=float)
