"""Motions with process noise."""

from __future__ import annotations

import math
from copy import copy

import numpy as np
from numpy.typing import ArrayLike

from scp_planner.arrays import Array, Index, Mask
from scp_planner.errors import EstimationError
from scp_planner.scenario.process_model import ProcessModel
from scp_planner.tracking.dynamics import dynamics_of
from scp_planner.tracking.kalman import FilterState, first_state, update_state
from scp_planner.tracking.observations import check_covariance, usable
from scp_planner.tracking.process_estimate import ProcessEstimate


class MotionFilter:
    """Kalman filters of K obstacles that follow one model, used like a `RecursiveEstimator`."""

    def __init__(
        self,
        model: ProcessModel,
        obstacles: int = 1,
        covariance: ArrayLike | None = None,
        *,
        gate_probability: float | None = None,
    ) -> None:
        if gate_probability is not None and not 0.0 < gate_probability < 1.0:
            raise EstimationError(f"gate_probability: {gate_probability!r} is not between 0 and 1")
        self.model = model
        self.gate_probability = gate_probability
        self._dynamics = dynamics_of(model)
        own = model.noise_deviation**2 * np.eye(2)
        self._noise = np.broadcast_to(
            check_covariance(own if covariance is None else covariance, obstacles), (obstacles, 2, 2)
        )
        d = self._dynamics.states
        self._state = FilterState(
            np.full(obstacles, -math.inf), np.zeros((obstacles, d, 2)), np.zeros((obstacles, 2 * d, 2 * d))
        )
        self._newest = np.full((obstacles, 2), math.nan)
        self._count = np.zeros(obstacles, dtype=np.intp)
        self._noise_sum = np.zeros((obstacles, 2, 2))
        self.log_likelihood = np.zeros(obstacles)
        """Log-likelihood of each obstacle's observations but the first, (K,)."""

    @property
    def observations(self) -> Index:
        """Number of observations of each estimate, (K,)."""
        return self._count.copy()

    def copy(self) -> MotionFilter:
        """Give a filter that has seen the same, and goes on by itself."""
        other = copy(self)
        for name in ("_state", "_newest", "_count", "_noise_sum", "log_likelihood"):
            setattr(other, name, getattr(self, name).copy())
        return other

    def update(
        self,
        times: ArrayLike,
        positions: ArrayLike,
        covariance: ArrayLike | None = None,
        seen: ArrayLike | None = None,
    ) -> Mask:
        """Take in at most one observation of each obstacle, none of them before its last one."""
        count = len(self._count)
        t = np.broadcast_to(np.asarray(times, dtype=float), (count,))
        z = np.asarray(positions, dtype=float)
        if z.shape != (count, 2):
            raise EstimationError(f"positions: their shape is {z.shape}; must be ({count}, 2)")
        noise = self._noise
        if covariance is not None:
            noise = np.broadcast_to(check_covariance(covariance, count), (count, 2, 2))
        used = usable(t, z, seen, self._state.times, self._newest, in_order=True)
        if self.gate_probability is not None:
            used = self._gate(t, z, noise, used)
        self._begin(t, z, noise, np.flatnonzero(used & (self._count == 0)))
        self._go_on(t, z, noise, np.flatnonzero(used & (self._count > 0)))
        self._newest[used] = z[used]
        self._noise_sum[used] += noise[used]
        self._count += used
        return used

    def estimate(self, obstacle: int = 0) -> ProcessEstimate:
        """Give the estimate of one obstacle as of its last observation."""
        k = obstacle
        if not self._count[k]:
            raise EstimationError(f"obstacle {k}: it has not been seen")
        return ProcessEstimate(
            reference_time=float(self._state.times[k]),
            observations=int(self._count[k]),
            noise_covariance=self._noise_sum[k] / self._count[k],
            dynamics=self._dynamics,
            mean=self._state.mean[k].copy(),
            state_covariance=self._state.covariance[k].copy(),
            tails=self.model.tails,
        )

    def _begin(self, t: Array, z: Array, noise: Array, new: Index) -> None:
        if len(new):
            variance = self.model.velocity_deviation**2
            self._put(new, first_state(self._dynamics, variance, t[new], z[new], noise[new]))

    def _go_on(self, t: Array, z: Array, noise: Array, old: Index) -> None:
        if len(old):
            state = self._take(old)
            self.log_likelihood[old] += update_state(self._dynamics, state, t[old], z[old], noise[old])
            self._put(old, state)

    def _take(self, which: Index) -> FilterState:
        state = self._state
        return FilterState(state.times[which], state.mean[which], state.covariance[which])

    def _put(self, which: Index, part: FilterState) -> None:
        state = self._state
        state.times[which], state.mean[which], state.covariance[which] = (
            part.times,
            part.mean,
            part.covariance,
        )

    def _gate(self, t: Array, z: Array, noise: Array, used: Mask) -> Mask:
        """Tell which observations are not improbable after what was seen before."""
        inside = used.copy()
        for k in np.flatnonzero(used & (self._count > 0)):
            estimate = self.estimate(int(k))
            offset = z[k] - estimate.position(t[k])
            distance = float(offset @ np.linalg.solve(estimate.covariance(t[k]) + noise[k], offset))
            inside[k] = estimate.errors.exceedance(distance) >= (self.gate_probability or 0.0)
        return inside
