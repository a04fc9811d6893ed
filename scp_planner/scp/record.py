"""History of a run, step by step."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import Enum

from scp_planner.scp.evaluation import Evaluation
from scp_planner.scp.linearisation import TrustRegion
from scp_planner.scp.merit import Penalties

FEASIBILITY = (
    2e-4  # largest violation of a converged trip: units of length in a zone inflated by more, relative for limits
)


class LoopStatus(Enum):
    CONVERGED = "converged"
    STALLED = "stalled"
    INFEASIBLE = "infeasible"
    ITERATION_LIMIT = "iteration limit"
    TIME_LIMIT = "time limit"
    SOLVER_FAILED = "solver failed"
    SLOWER = "slower than the best"
    SAME_WAY = "the way of the best"
    ON_TIME = "soon enough for its step of time"


@dataclass(frozen=True)
class Iteration:
    """One row of the iteration record."""

    number: int
    travel_time: float  # of the candidate, s
    merit: float  # of the candidate, s
    violation: float  # worst violation of the candidate
    predicted: float  # decrease of the merit by the model, s
    actual: float  # decrease of the merit in truth, s
    accepted: bool  # whether the candidate was accepted, if only on trial
    trust: TrustRegion
    rows: int  # number of rows that could be violated


@dataclass
class LoopRun:
    """A run of the loop and where it ended."""

    status: LoopStatus
    evaluation: Evaluation
    penalties: Penalties
    record: list[Iteration] = field(default_factory=list)

    @property
    def feasible(self) -> bool:
        """True if the trip keeps all sampled constraints."""
        return self.evaluation.worst_violation <= FEASIBILITY
