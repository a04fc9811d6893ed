"""Result of a descent."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import StrEnum

from scp_planner.baseline.tolerances import REPAIRABLE
from scp_planner.scp.evaluation import Evaluation
from scp_planner.scp.record import FEASIBILITY
from scp_planner.trips.trajectory import Trajectory


class DescentStatus(StrEnum):
    CONVERGED = "converged"
    UNSETTLED = "still moving at the last stage"
    INFEASIBLE = "violations stay at the highest price"
    TIME_LIMIT = "time limit"


@dataclass(frozen=True)
class Iterate:
    """An iterate of a descent."""

    evaluations: int  # of the objective until then
    seconds: float  # since the descent began
    trajectory: Trajectory


@dataclass
class DescentRun:
    """A descent and where it ended."""

    status: DescentStatus
    evaluation: Evaluation  # the last trip, with the exact hinge
    evaluations: int = 0  # of the objective, with gradient or (Monte Carlo) without
    iterations: int = 0  # accepted steps of the minimisers
    iterates: list[Iterate] = field(default_factory=list)  # the iterates, if they were asked for

    @property
    def trajectory(self) -> Trajectory:
        """The trip it ended with."""
        return self.evaluation.trajectory

    @property
    def feasible(self) -> bool:
        """True if the trip keeps all sampled constraints."""
        return self.evaluation.worst_violation <= FEASIBILITY

    @property
    def repairable(self) -> bool:
        """True if settling once more may make a trip of it that the certificate holds for."""
        return self.evaluation.worst_violation <= REPAIRABLE and self.status is not DescentStatus.TIME_LIMIT
