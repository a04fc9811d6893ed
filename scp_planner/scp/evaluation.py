"""Everything the loop needs to know of one trip: by how much it exceeds each constraint, and the merit."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from scp_planner.arrays import Array
from scp_planner.problem.problem import Problem
from scp_planner.scp.merit import Penalties
from scp_planner.trips.trajectory import Trajectory, TripPoints


@dataclass(frozen=True)
class Evaluation:
    """One trip, evaluated."""

    trajectory: Trajectory
    points: TripPoints  # at the problem's samples
    excesses: tuple[Array, ...]  # (n,): excesses over each of the problem's constraints in all places
    # (G,): violations that have a price, 0 where there is none: of zones in m, then of the other constraints
    violations: Array
    zones: int  # how many of them are of zones
    given_violation: float = 0.0  # worst violation of a user's own constraints

    def merit(self, penalties: Penalties) -> float:
        """Travel time plus penalised violations, s."""
        weights, violations, zones = penalties.weights, self.violations, self.zones
        return float(
            self.trajectory.travel_time
            + weights[:zones] @ violations[:zones]
            + weights[zones:] @ violations[zones:]
            + penalties.given * self.given_violation
        )

    @cached_property
    def worst_violation(self) -> float:
        """Largest of all violations (m for zones, relative for limits)."""
        return max(float(self.violations.max()), self.given_violation)

    @property
    def limit_violation(self) -> float:
        """Largest violation of what is no zone."""
        return float(self.violations[self.zones :].max(initial=0.0))


def evaluate_trip(problem: Problem, trip: Trajectory) -> Evaluation:
    excesses = tuple(constraint.excess(trip) for constraint in problem.constraints)
    violations = [
        constraint.violations(constraint.worst(trip, excess))
        for constraint, excess in zip(problem.constraints, excesses, strict=True)
    ]
    given = 0.0 if problem.given is None else problem.given.worst(trip)
    points = trip.kept_at(problem.samples)
    return Evaluation(trip, points, excesses, np.concatenate(violations), problem.zones.size, given)
