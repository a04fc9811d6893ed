"""The penalised objective that all methods minimise, with a hinge that may be smooth, and its exact gradient.

Over omega = (theta, beta), the free control points of the offset and those of the acceleration,

    Q(omega) = tau(omega) + sum_l mu_l S_w(-c_l(omega)) + sum_k mu_k S_w(e_k(omega)),

with tau the travel time in closed form, c_l(t) the signed distance to zone l and e_k the excess over limit k wherever
it is looked at. S_w makes one violation of the excesses g_i of one kind, with shares p_i that add up to 1:

    S_w(g) = w log(1 + sum_i p_i exp(g_i / w)),        S_0(g) = max(0, max_i g_i).

For zones the p_i are the weights of the trapezoidal rule over normalised time, so that S_w is w log(1 + integral of
exp(-c / w)). S_w is convex and increasing in each g_i, smooth for w > 0, and tends to S_0 as w does to 0. S_0 is the
violation in the merit of sequential convex programming (evaluation.py): one objective, and the width of the hinge is
all that differs.

Q is finite on D0(v0), the trips that arrive: v0^2 + 4 A(beta) L(theta) >= 0, and infinite elsewhere. The gradient is
exact: d tau from v0 tau + A tau^2 = L, and at a normalised time the vehicle moves along the guide by
ds = (dD - dS) / |r'|. It exists off the kinks: for w = 0 those of the maxima and the hinge; for every w the centres
of zones, and trips that pass a fixed station just when the acceleration jumps.
"""

from __future__ import annotations

import numpy as np

from scp_planner.arrays import Array
from scp_planner.baseline.objective_parts import (
    Hinge,
    Margins,
    ObjectiveValue,
    Pricing,
    SampleTimes,
    Weights,
    limit_count,
)
from scp_planner.baseline.objective_terms import Terms
from scp_planner.problem.problem import Problem
from scp_planner.trips.trajectory import Trajectory


class PenalisedObjective:
    """Q at a fixed problem.

    Parameters
    ----------
    problem : Problem
    weights : Weights
    hinge : Hinge
    times : SampleTimes, optional
        Default: the problem's samples.
    margins : Margins, optional
    """

    def __init__(
        self,
        problem: Problem,
        weights: Weights,
        hinge: Hinge,
        times: SampleTimes | None = None,
        margins: Margins | None = None,
    ) -> None:
        self.problem = problem
        self.pricing = Pricing(
            problem, weights, hinge, times or SampleTimes.of(problem), margins or Margins.none(problem)
        )
        free = problem.ends.free
        self.path_size = free.stop - free.start
        self.size = self.path_size + problem.space.acceleration_size

    def omega(self, trajectory: Trajectory) -> Array:
        """Return the variables (theta, beta) of a trip, (K,)."""
        return np.concatenate([trajectory.theta[self.problem.ends.free], trajectory.beta])

    def trajectory(self, omega: Array) -> Trajectory:
        """Return the trip with given variables; its travel time is infinite outside D0(v0)."""
        theta = self.problem.ends.theta.copy()
        theta[self.problem.ends.free] = omega[: self.path_size]
        return Trajectory.of(self.problem.space, theta, omega[self.path_size :])

    def value(self, omega: Array) -> float:
        """Return Q(omega), s."""
        return self.evaluate(omega, gradient=False).value

    def gradient(self, omega: Array) -> Array:
        """Return dQ / d omega, (K,)."""
        return self.evaluate(omega).gradient

    def evaluate(self, omega: Array, *, gradient: bool = True) -> ObjectiveValue:
        """Return Q and its parts at omega, (K,), and its gradient."""
        trajectory = self.trajectory(omega)
        if not np.isfinite(trajectory.travel_time):
            return self._outside()
        points = trajectory.at(self.pricing.times.table)
        terms = Terms(self.pricing, trajectory, points, gradient)
        zones, zone_use = terms.zones()
        limits, limit_use = terms.limits()
        weights = self.pricing.weights
        value = trajectory.travel_time + float(weights.zones @ zones) + float(weights.limits @ limits)
        total = terms.total_gradient() if gradient else np.zeros(0)
        return ObjectiveValue(value, trajectory.travel_time, zones, limits, zone_use, limit_use, total)

    def _outside(self) -> ObjectiveValue:
        zones, limits = np.zeros(self.problem.zones.size), np.zeros(limit_count(self.problem))
        return ObjectiveValue(np.inf, np.inf, zones, limits, zones, limits, np.full(self.size, np.nan))
