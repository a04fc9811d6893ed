"""A candidate step of the loop, and the trip to return to if a step on trial fails."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from scp_planner.arrays import Array
from scp_planner.constraints.rows import Rows
from scp_planner.scp.evaluation import Evaluation
from scp_planner.scp.linearisation import TrustRegion
from scp_planner.scp.merit import Penalties
from scp_planner.scp.record import Iteration
from scp_planner.scp.subproblem import Subproblem


@dataclass(frozen=True)
class Candidate:
    evaluation: Evaluation  # of the trip that the step leads away from, as long as it has not been looked at where to
    predicted: float  # decrease of the merit by the model, s
    actual: float  # decrease of the merit in truth, s
    size: float  # largest component of the step, relative to the trust region
    sooner: float  # decrease of the travel time by the model, s
    before: float  # largest violation of the trip that the step leads away from

    @classmethod
    def of(cls, base: Evaluation, penalties: Penalties, sub: Subproblem, z: Array) -> Candidate:
        """Return the step z from a trip, as the model sees it: where it leads has not been looked at."""
        tau, rho = base.trajectory.travel_time, float(z[sub.step_size - 1])
        model = tau * (1.0 + rho) + float(penalties.weights[sub.groups] @ z[sub.step_size :])
        predicted = base.merit(penalties) - model
        return cls(base, predicted, -np.inf, relative_size(z, sub), -tau * rho, base.worst_violation)

    def led_to(self, there: Evaluation, penalties: Penalties) -> Candidate:
        """Return the same, now that it is known where the step leads."""
        return replace(self, evaluation=there, actual=self.evaluation.merit(penalties) - there.merit(penalties))

    @property
    def ratio(self) -> float:
        return self.actual / self.predicted if self.predicted > 0.0 else -1.0

    def recorded(self, number: int, penalties: Penalties, accepted: bool, trust: TrustRegion, rows: int) -> Iteration:
        """Return the row of the iteration record."""
        return Iteration(
            number,
            self.evaluation.trajectory.travel_time,
            self.evaluation.merit(penalties),
            self.evaluation.worst_violation,
            self.predicted,
            self.actual,
            accepted,
            trust,
            rows,
        )


@dataclass(frozen=True)
class Linearised:
    """A trip, linearised, and how far around it no row is missing."""

    base: Evaluation
    trust: TrustRegion
    rows: Rows

    def serves(self, base: Evaluation, trust: TrustRegion) -> bool:
        """True if its rows are all that are wanted of a trip so far around it."""
        mine = self.trust
        inside = trust.theta <= mine.theta and trust.beta <= mine.beta and trust.rho <= mine.rho
        return base is self.base and inside


@dataclass(frozen=True)
class Watchdog:
    evaluation: Evaluation
    step: Candidate
    trust: TrustRegion
    linearised: Linearised | None

    def gained(self, there: Evaluation, penalties: Penalties) -> float:
        """Decrease of the merit since then, s."""
        return self.evaluation.merit(penalties) - there.merit(penalties)


def relative_size(z: Array, sub: Subproblem) -> float:
    """Largest component of a step, relative to the trust region."""
    program, count = sub.program, sub.step_size
    radius = np.maximum(program.upper[:count], -program.lower[:count])
    return float(np.max(np.abs(z[:count]) / np.maximum(radius, 1e-300)))
