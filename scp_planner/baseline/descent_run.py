"""What a descent came to."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import StrEnum

from scp_planner.scp.evaluation import Evaluation
from scp_planner.scp.record import FEASIBILITY
from scp_planner.trips.trajectory import Trajectory

REPAIRABLE = 0.01  # units of length or relative; larger violations are not tightened away


class DescentStatus(StrEnum):
    """How a descent ended."""

    CONVERGED = "converged"
    UNSETTLED = "still moving at the last stage"
    INFEASIBLE = "violations stay at the highest price"
    TIME_LIMIT = "time limit"


@dataclass(frozen=True)
class Iterate:
    """An iterate of a descent.

    Attributes
    ----------
    evaluations : int
        Of the objective until then.
    seconds : float
        Since the descent began.
    trajectory : Trajectory
    """

    evaluations: int
    seconds: float
    trajectory: Trajectory


@dataclass
class DescentRun:
    """A descent and where it ended.

    Attributes
    ----------
    status : DescentStatus
    evaluation : Evaluation
        The last trip, with the exact hinge.
    evaluations : int
        Of the objective, with gradient or (Monte Carlo) without.
    iterations : int
        Accepted steps of the minimisers.
    iterates : list of Iterate
        The iterates, if they were asked for.
    """

    status: DescentStatus
    evaluation: Evaluation
    evaluations: int = 0
    iterations: int = 0
    iterates: list[Iterate] = field(default_factory=list)

    @property
    def trajectory(self) -> Trajectory:
        """The trip it ended with."""
        return self.evaluation.trajectory

    @property
    def feasible(self) -> bool:
        """Whether the trip keeps all sampled constraints."""
        return self.evaluation.worst_violation <= FEASIBILITY

    @property
    def repairable(self) -> bool:
        """Whether settling once more may make a trip of it that the certificate holds for."""
        return self.evaluation.worst_violation <= REPAIRABLE and self.status is not DescentStatus.TIME_LIMIT
