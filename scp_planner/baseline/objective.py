"""The penalised objective that all methods minimise, with a hinge that may be smooth, and its exact gradient."""

from __future__ import annotations

from dataclasses import dataclass
from math import sqrt

import numpy as np

from scp_planner.arrays import Array
from scp_planner.baseline.priced import priced_constraints, slope, softened, trapezoidal_shares
from scp_planner.problem.problem import Problem
from scp_planner.trips.trajectory import Trajectory


@dataclass(frozen=True)
class ObjectiveValue:
    """The objective at one trip."""

    value: float  # Q, s
    travel_time: float  # tau, s; inf outside D0(v0)
    # (G,): of zones in m, then of the other constraints: relative, but m for box and offsets, and m/s for the goal
    # speed
    violations: Array
    # (G,): derivatives of the violations with respect to a common margin, in [0, 1]: times the price, the multiplier
    use: Array
    gradient: Array  # (K,): dQ / d omega; empty if it was not asked for


class PenalisedObjective:
    """Q at a fixed problem."""

    def __init__(
        self, problem: Problem, prices: Array, widths: Array, sigma: Array | None = None, margins: Array | None = None
    ) -> None:
        self.problem, self.prices, self.widths = problem, prices, widths
        times = problem.samples if sigma is None else problem.space.time_table(sigma)
        self.margins = np.zeros(len(prices)) if margins is None else margins
        self.shares = trapezoidal_shares(times.sigma)
        self.path_size = problem.free_size
        self.size = self.path_size + problem.space.acceleration_size
        self._constraints = [constraint.smooth(times) for constraint in priced_constraints(problem)]

    def omega(self, trajectory: Trajectory) -> Array:
        """Return the variables (theta, beta) of a trip, (K,)."""
        return np.concatenate([trajectory.theta[self.problem.ends.free], trajectory.beta])

    def trajectory(self, omega: Array) -> Trajectory:
        """Return the trip with given variables; its travel time is infinite outside D0(v0)."""
        theta = self.problem.ends.around(omega[: self.path_size])
        return Trajectory.of(self.problem.space, theta, omega[self.path_size :])

    def value(self, omega: Array) -> float:
        """Return Q(omega), s."""
        return self.evaluate(omega, gradient=False).value

    def gradient(self, omega: Array) -> Array:
        """Return dQ / d omega, (K,)."""
        return self.evaluate(omega).gradient

    def evaluate(self, omega: Array, *, gradient: bool = True) -> ObjectiveValue:
        """Return Q and its parts at omega, (K,), and its gradient."""
        trip = self.trajectory(omega)
        if not np.isfinite(trip.travel_time):
            nothing = np.zeros(len(self.prices))
            return ObjectiveValue(np.inf, np.inf, nothing, nothing, np.full(self.size, np.nan))
        step = np.zeros(self.problem.step_size)
        violations, use = np.empty(len(self.prices)), np.empty(len(self.prices))
        first = 0
        for constraint in self._constraints:
            mine = slice(first, first + constraint.size)
            first = mine.stop
            if constraint.size == 0:
                continue
            found = softened(constraint, trip, self.shares, self.margins[mine], float(self.widths[mine.start]))
            violations[mine], use[mine] = found.values, found.shares.sum(axis=1)
            if gradient:
                step += slope(constraint, trip, found, self.prices[mine])
        value = trip.travel_time + float(self.prices @ violations)
        total = self._total(trip, step) if gradient else np.zeros(0)
        return ObjectiveValue(value, trip.travel_time, violations, use, total)

    def _total(self, trip: Trajectory, step: Array) -> Array:
        """Return dQ / d omega from the gradient of the penalties with respect to a step."""
        space, tau = self.problem.space, trip.travel_time
        theta, beta, rho = step[: self.path_size], step[self.path_size : -1], float(step[-1])
        by_tau = 1.0 + (rho + 2.0 * float(beta @ trip.beta)) / tau
        gain = float(space.drive.final_distance @ trip.beta)
        rate = by_tau / sqrt(max(space.start_speed**2 + 4.0 * gain * trip.path.arc_length, 1e-300))
        length = trip.path.final_gradient[self.problem.ends.free]
        return np.concatenate([theta + rate * length, beta - (rate * tau * tau) * space.drive.final_distance])
