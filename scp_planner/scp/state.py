from __future__ import annotations

from dataclasses import dataclass
from time import perf_counter

from scp_planner.scp.candidate import Candidate, Linearised, Watchdog
from scp_planner.scp.goal import Cutoff, RunLimits
from scp_planner.scp.last_step import LastStep
from scp_planner.scp.linearisation import TrustRegion
from scp_planner.scp.parameters import LoopParameters
from scp_planner.scp.record import LoopRun, LoopStatus
from scp_planner.scp.subproblem import ActiveSet


@dataclass(frozen=True)
class Progress:
    """An iteration that came clearly nearer to feasibility."""

    number: int
    violation: float


@dataclass
class LoopState:
    """A run so far."""

    run: LoopRun  # the trip of the next iteration, the penalties, the record
    parameters: LoopParameters
    limits: RunLimits
    cutoff: Cutoff
    trust: TrustRegion
    begun: float  # value of :func:`time.perf_counter` at which the last iteration began, or the run, s
    progress: Progress  # the last one that counts against the patience
    nearest: Progress  # the last one among those with small violations
    number: int = 0  # of the last iteration, from 1
    active: ActiveSet | None = None  # of the last subproblem
    last: LastStep | None = None  # the step that led to the trip, if it is to be learnt from
    linearised: Linearised | None = None
    trial: Watchdog | None = None  # where to go back to if the step on trial fails

    @property
    def late(self) -> bool:
        """True if the time is up: among thousands of rows each part of an iteration takes long."""
        return perf_counter() > self.limits.deadline

    def end(self, status: LoopStatus) -> bool:
        """Note how the run has ended."""
        self.run.status = status
        return True

    def go_back(self) -> Candidate | None:
        """Return to where the trial began, if there is one: the step that led away from there."""
        trial, self.trial = self.trial, None
        if trial is None:
            return None
        self.run.evaluation, self.trust, self.linearised = trial.evaluation, trial.trust, trial.linearised
        return trial.step
