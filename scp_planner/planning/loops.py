"""Loops of a problem, and runs of them that go on while they gain."""

from __future__ import annotations

import logging
from dataclasses import dataclass, replace
from math import inf

from scp_planner.planning.task import Task
from scp_planner.problem.problem import Problem
from scp_planner.scp.evaluation import Evaluation
from scp_planner.scp.goal import ArrivalSteps
from scp_planner.scp.linearisation import TrustRegion
from scp_planner.scp.loop import ScpLoop
from scp_planner.scp.merit import Penalties
from scp_planner.scp.parameters import LOOP
from scp_planner.scp.record import LoopRun, LoopStatus
from scp_planner.solvers import QpSolver
from scp_planner.trips.trajectory import Trajectory

logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class RunLimits:
    """Limits of runs of the loop."""

    continuations: int = 4  # how often a run that is at its limit of iterations goes on
    # iterations, after which a run from a way that is far from feasible makes room for other ways
    hopeless_after: int = 8


LIMITS = RunLimits()
SPARING = replace(LOOP, spared=3.0)  # a run leaves time for its last iteration and for its certificate
CAREFUL = replace(SPARING, first_trust=SPARING.retry_trust, first_penalty=100.0)
"""From starts that keep all constraints, along guides with widened bends."""


@dataclass(frozen=True)
class LoopMaker:
    """Makes the loops of a task's problems."""

    task: Task
    solver: QpSolver
    fallback: str | None

    def loop(
        self,
        problem: Problem,
        hopeless_after: int | None = None,
        steps: ArrivalSteps | None = None,
        penalties: Penalties | None = None,
        *,
        careful: bool = False,
    ) -> ScpLoop:
        """Return a loop that keeps trips apart which pass the smallest zones on different sides."""
        radius = problem.zones.typical_radius
        apart = SPARING.same_way if radius is None else min(SPARING.same_way, radius)
        parameters = replace(CAREFUL if careful else SPARING, same_way=apart)
        return ScpLoop(problem, self.solver, self.fallback, hopeless_after, parameters, steps, penalties)

    def run(
        self,
        loop: ScpLoop,
        start: Trajectory,
        cutoff: float = inf,
        rival: Evaluation | None = None,
        trust: TrustRegion | None = None,
    ) -> LoopRun:
        """Run a loop from a start; go on from where it was at its limit of iterations, while it gains by that."""
        most, log, budget = self.task.settings.max_iterations, self.task.log, self.task.budget
        run = loop.run(start, most, cutoff, budget.deadline, trust, rival=rival)
        log.iterations += len(run.record)
        for _ in range(LIMITS.continuations):
            if run.status is not LoopStatus.ITERATION_LIMIT or budget.is_over:
                break
            logger.info("at the limit of %d iterations after %.4f units; going on", most, promise(run)[1])
            further = loop.run(run.evaluation.trajectory, most, cutoff, budget.deadline, rival=rival)
            log.iterations += len(further.record)
            if not promise(further) < promise(run):
                if further.status is LoopStatus.INFEASIBLE:
                    run.status = further.status  # it was not cut short: where it is, no step comes nearer
                break
            run = further
        return run


def promise(run: LoopRun) -> tuple[bool, float]:
    """Return a key that orders runs: those that keep all constraints, by travel time, before others, by violation."""
    evaluation = run.evaluation
    return not run.feasible, evaluation.trajectory.travel_time if run.feasible else evaluation.worst_violation
