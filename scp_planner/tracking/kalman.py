"""Kalman filters of many obstacles that follow one model, each at its own times."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from scp_planner.arrays import Array, kronecker, rows_of
from scp_planner.errors import EstimationError
from scp_planner.scenario.process_model import ProcessModel
from scp_planner.tracking.dynamics import Dynamics, dynamics_of
from scp_planner.tracking.maximum_likelihood import CheckedObservations, check_observations
from scp_planner.tracking.process_estimate import ProcessEstimate


@dataclass
class FilterState:
    times: Array  # (N,) s
    mean: Array  # (N, d, 2) Expected states
    covariance: Array  # (N, 2 d, 2 d)

    def estimate(self, place: int, model: ProcessModel, observations: int, noise: Array) -> ProcessEstimate:
        time, mean, covariance = float(self.times[place]), self.mean[place], self.covariance[place]
        return ProcessEstimate(time, observations, noise, dynamics_of(model), mean, covariance, model.tails)


@dataclass(frozen=True)
class Scan:
    """One observation of each of the first obstacles."""

    times: Array  # (m,) s
    positions: Array  # (m, 2) m
    noise: Array | None = None  # (m, 2, 2) m^2; None: the model's own


def first_state(
    dynamics: Dynamics, velocity_variance: float, times: Array, positions: Array, noise: Array
) -> FilterState:
    """Begin at first observations: (N,) s, (N, 2) m and their covariances (N, 2, 2) m^2."""
    count, d = len(times), dynamics.states
    mean = np.zeros((count, d, 2))
    mean[:, 0] = positions
    covariance = np.zeros((count, 2 * d, 2 * d))
    covariance[:] = kronecker(dynamics.prior(velocity_variance), np.eye(2))
    covariance[:, :2, :2] = noise
    return FilterState(np.array(times, dtype=float), mean, covariance)


def update_state(dynamics: Dynamics, state: FilterState, times: Array, positions: Array, noise: Array) -> Array:
    """Take in the next observation of each obstacle; give the log likelihood of each: (N,)."""
    predict_state(dynamics, state, times)
    mean, p = state.mean, state.covariance
    innovation = positions - mean[:, 0]
    spread = p[:, :2, :2] + noise
    inverse = np.linalg.inv(spread)
    gain = p[:, :, :2] @ inverse
    weighted = (inverse @ innovation[:, :, None])[:, :, 0]
    mean += (gain @ innovation[:, :, None]).reshape(mean.shape)
    seen = noise @ (inverse @ p[:, :2, :])  # of the position, in which nothing cancels: it never comes out as 0
    p -= gain @ p[:, :2, :]
    p[:, :2, :], p[:, :, :2] = seen, np.swapaxes(seen, 1, 2)
    p += np.swapaxes(p, 1, 2).copy()  # rounding would make it lopsided
    p *= 0.5
    squares = np.einsum("na,na->n", weighted, innovation)
    return -0.5 * (squares + np.log(np.linalg.det(spread))) - math.log(2.0 * math.pi)


def predict_state(dynamics: Dynamics, state: FilterState, times: Array) -> None:
    """Move the state of each obstacle on to a later time: (N,) s."""
    lag = times - state.times
    f, q = dynamics.transition(lag), dynamics.noise(lag)
    both = kronecker(f, np.eye(2))
    state.mean = f @ state.mean
    state.covariance = both @ state.covariance @ np.swapaxes(both, 1, 2) + kronecker(q, np.eye(2))
    state.times = np.array(times, dtype=float)


def run_filter(model: ProcessModel, scans: Iterable[Scan]) -> tuple[FilterState, Array]:
    """Give states after all scans, each of no more obstacles than the last, and log likelihoods of what follows."""
    dynamics, own, state, total = dynamics_of(model), model.noise_deviation**2 * np.eye(2), None, np.zeros(0)
    for scan in scans:
        count = len(scan.times)
        noise = np.broadcast_to(own, (count, 2, 2)) if scan.noise is None else scan.noise
        if state is None:
            state = first_state(dynamics, model.velocity_deviation**2, scan.times, scan.positions, noise)
            total = np.zeros(count)
            continue
        part = rows_of(state, slice(count))
        total[:count] += update_state(dynamics, part, scan.times, scan.positions, noise)
        state.times[:count], state.mean[:count], state.covariance[:count] = part.times, part.mean, part.covariance
    assert state is not None, "there is one scan at least"
    return state, total


def estimate_process(
    times: ArrayLike, positions: ArrayLike, model: ProcessModel, covariance: ArrayLike | None = None
) -> ProcessEstimate:
    """Estimate a motion with process noise from observations, in any order of time."""
    seen = check_observations(times, positions, covariance)
    if not len(seen.times):
        raise EstimationError("observations: there are none")
    return estimate_processes(model, [seen])[0]


def estimate_processes(model: ProcessModel, records: Sequence[CheckedObservations]) -> list[ProcessEstimate]:
    """Estimate the motions of obstacles that follow one model, each from one observation at least."""
    own, ranks = model.noise_deviation**2 * np.eye(2), sorted(range(len(records)), key=lambda k: -len(records[k].times))
    whole = [record if record.covariance is not None else replace(record, covariance=own) for record in records]
    state, _ = run_filter(model, scans_of([whole[k] for k in ranks]))
    return [
        state.estimate(place, model, len(record.times), np.asarray(record.covariance).reshape(-1, 2, 2).mean(axis=0))
        for place, record in zip(np.argsort(ranks).tolist(), whole, strict=True)
    ]


def scans_of(records: Sequence[CheckedObservations]) -> Iterator[Scan]:
    """Give observations of obstacles, the longest records first, one of each at a time."""
    for i in range(len(records[0].times)):
        left = [one for one in records if len(one.times) > i]
        times, positions = np.array([one.times[i] for one in left]), np.array([one.positions[i] for one in left])
        known = [one.covariance for one in left if one.covariance is not None]
        noise = np.array([one if one.ndim == 2 else one[i] for one in known]) if known else None
        yield Scan(times, positions, noise)
