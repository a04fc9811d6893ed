"""The iterations of one run: linearise, solve, accept or reject, resize the trust region.

Close to a minimum a full step can raise the merit by curvature that the model lacks (the Maratos effect). So a step
that fails by little is taken on trial: from there one more step is made, and only if both together fail the loop goes
back and shrinks the trust region (the watchdog technique of Chamberlain, Powell, Lemarechal and Pedersen, 1982).
Against a second-order correction it saves one solution of the subproblem, and sees the places that the step made worse.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Callable, Generator
from dataclasses import dataclass
from time import perf_counter

import numpy as np

from scp_planner.arrays import Array
from scp_planner.problem.problem import Problem
from scp_planner.scp.candidate import Candidate, Watchdog
from scp_planner.scp.evaluation import Evaluation
from scp_planner.scp.goal import Cutoff, RunLimits
from scp_planner.scp.last_step import LastStep
from scp_planner.scp.linearisation import TrustRegion, rows_within
from scp_planner.scp.merit import Penalties
from scp_planner.scp.parameters import LoopParameters
from scp_planner.scp.projection import Projection
from scp_planner.scp.record import FEASIBILITY, LoopRun, LoopStatus
from scp_planner.scp.rows.base import Rows
from scp_planner.scp.rows.drive import KinematicRows
from scp_planner.scp.step_solver import StepSolver
from scp_planner.scp.subproblem import ActiveSet, Subproblem, build_subproblem
from scp_planner.scp.together import Linearised, RunInStep, Wish, evaluated, linearised
from scp_planner.solvers.interface import Solution
from scp_planner.trips.trajectory import Trajectory

logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class LoopSetup:
    """What all runs of a loop share.

    Attributes
    ----------
    problem : Problem
    kinematics : KinematicRows
    solver : StepSolver
    projection : Projection
    move : callable
        The trip after a step z, (n,), from a trip; None if it would never arrive.
    parameters : LoopParameters
    penalties : Penalties or None
        That runs begin with; None: the first ones of the parameters.
    """

    problem: Problem
    kinematics: KinematicRows
    solver: StepSolver
    projection: Projection
    move: Callable[[Trajectory, Array], Trajectory | None]
    parameters: LoopParameters
    penalties: Penalties | None = None

    def first_penalties(self) -> Penalties:
        """Return what a run begins with, which it may raise."""
        if self.penalties is None:
            return Penalties.uniform(self.problem, self.parameters.first_penalty)
        return self.penalties.copied()


@dataclass(frozen=True)
class _Progress:
    """The last iteration that came clearly nearer to feasibility."""

    number: int
    violation: float


class Iterations:
    """One run of the loop.

    Parameters
    ----------
    setup : LoopSetup
    start : Evaluation
        Of the trip that it improves.
    trust : TrustRegion
        The first one.
    limits : RunLimits
    cutoff : Cutoff
    begun : float
        Value of :func:`time.perf_counter` when the start was about to be looked at.
    """

    def __init__(
        self,
        setup: LoopSetup,
        start: Evaluation,
        trust: TrustRegion,
        limits: RunLimits,
        cutoff: Cutoff,
        begun: float,
    ) -> None:
        self.setup = setup
        self.limits = limits
        self.cutoff = cutoff
        self.trust = trust
        self.penalties = setup.first_penalties()
        self.run = LoopRun(LoopStatus.ITERATION_LIMIT, start, self.penalties)
        self._progress = _Progress(0, start.worst_violation)
        self._nearest = self._progress
        self._active: ActiveSet | None = None
        self._last: LastStep | None = None
        self._linearised: Linearised | None = None
        self._trial: Watchdog | None = None
        self._begun = begun  # then the last iteration, or what came before it

    def steps(self) -> RunInStep:
        """Iterate until the run has ended."""
        for number in range(1, self.limits.max_iterations + 1):
            ended = yield from self._iteration(number)
            if ended:
                break
        if self._trial is not None:
            self.run.evaluation = self._trial.evaluation
        self.cutoff.hear(self.run)
        logger.debug("run: %s after %d iterations", self.run.status.value, len(self.run.record))
        return self.run

    def _iteration(self, number: int) -> Generator[Wish, Evaluation | Rows, bool]:
        """Linearise, solve, look at where the step leads, and judge it. Whether the run has ended with that."""
        now = perf_counter()
        if now + self.setup.parameters.spared * (now - self._begun) > self.limits.deadline:
            return self._end(LoopStatus.TIME_LIMIT)
        self._begun = now
        rows = yield from self._rows()
        if self._late():
            return self._end(LoopStatus.TIME_LIMIT)
        sub = self._subproblem(rows)
        solution = None if self._late() else self.setup.solver.solve(sub.program, self.limits.deadline)
        if solution is None:
            del sub
            if self._late():
                return self._end(LoopStatus.TIME_LIMIT)
            ended = yield from self._without_step()
            return ended
        if self._trial is None and number > 1:
            sooner = self._sooner(sub, solution)
            if self._settled(sooner):
                return self._end(LoopStatus.CONVERGED)
            if self.cutoff.will_be_slower(self.run.evaluation, sooner):
                return self._end(LoopStatus.SLOWER)
        self._active = sub.active_set(solution)
        step, prices = Candidate.of(self.run.evaluation, self.penalties, sub, solution.x), sub.prices(solution)
        del sub  # the largest matrix of all is not kept while a trip is looked at
        step = yield from self._led_to(step, rows, solution.x, prices)
        return self._judged(number, step, len(rows.gap))

    def _late(self) -> bool:
        """Whether the time is up: among thousands of rows each part of an iteration takes long."""
        return perf_counter() > self.limits.deadline

    def _rows(self) -> Generator[Wish, Evaluation | Rows, Rows]:
        """The trip, linearised: anew only where that has not been done after a step that was rejected."""
        base, trust, known = self.run.evaluation, self.trust, self._linearised
        if known is not None and known.serves(base, trust):
            return rows_within(self.setup.problem, known.rows, trust)
        rows = yield from linearised(base, trust)
        self._linearised = Linearised(base, trust, rows)
        return rows

    def _end(self, status: LoopStatus) -> bool:
        self.run.status = status
        return True

    def _subproblem(self, rows: Rows) -> Subproblem:
        setup, trip = self.setup, self.run.evaluation.trajectory
        last = self._last if self._last is not None and self._last.end is trip else None
        weights = self.penalties.weights
        return build_subproblem(setup.problem, setup.kinematics, trip, rows, weights, self.trust, self._active, last)

    def _without_step(self) -> Generator[Wish, Evaluation | Rows, bool]:
        """Where the subproblem has no solution, go to the nearest trip within the limits, or look less far."""
        self.run.status = LoopStatus.SOLVER_FAILED
        self._go_back()
        kept = self.setup.projection.within_limits(self.run.evaluation.trajectory, self.limits.deadline)
        if kept is not None:
            self.run.evaluation = yield from evaluated(kept)
            return False
        self.trust = self.trust.scaled(self.setup.parameters.shrink)
        return self.trust.theta < self.setup.parameters.smallest_trust

    def _sooner(self, sub: Subproblem, solution: Solution) -> float:
        """What a step, not yet evaluated, gains of the travel time, s."""
        return -self.run.evaluation.trajectory.travel_time * float(solution.x[sub.step_size - 1])

    def _settled(self, sooner: float) -> bool:
        """Whether the trip keeps all constraints, and the step from it would gain nothing."""
        setup = self.setup
        kept = self.run.evaluation.worst_violation <= setup.parameters.settled
        return kept and abs(sooner) < setup.problem.settings.tolerance

    def _led_to(
        self, step: Candidate, rows: Rows, z: Array, prices: Array
    ) -> Generator[Wish, Evaluation | Rows, Candidate]:
        """Look at the trip that the step leads to, and remember what the step teaches."""
        setup, base = self.setup, self.run.evaluation
        self._last = None
        if self._trial is None and not step.predicted > 0.0:
            return step  # rejected wherever it leads
        moved = setup.move(base.trajectory, z)
        if moved is None:
            return step
        there = yield from evaluated(moved)
        # Steps to the border of the trust region lead too far to tell how the constraints bend here.
        if step.size < setup.parameters.inside:
            self._last = LastStep.of(setup.kinematics, rows, base.trajectory, moved, z, prices)
        return step.led_to(there, self.penalties)

    def _judged(self, number: int, step: Candidate, rows: int) -> bool:
        """Accept a step, take it on trial, or reject it; then resize the trust region. Whether the run has ended."""
        run = self.run
        run.status = LoopStatus.ITERATION_LIMIT
        accepted = self._acceptable(step)
        on_trial = self._trial is None and not accepted and self._worth_a_trial(step)
        run.record.append(step.recorded(number, self.penalties, accepted or on_trial, self.trust, rows))
        if on_trial and number < self.limits.max_iterations:
            self._trial = Watchdog(run.evaluation, step, self.trust, self._linearised)
            run.evaluation = step.evaluation
            return False
        if accepted:
            run.evaluation = step.evaluation
            self._trial = None
        else:
            step = self._go_back() or step
        ended = self._ended(number, step)
        if ended is not None:
            return self._end(ended)
        if self._good_enough(number):
            return True
        self.trust = self.setup.parameters.resized(self.trust, step.ratio, step.size)
        if self.trust.theta < self.setup.parameters.smallest_trust:
            return self._end(LoopStatus.STALLED)
        return False

    def _acceptable(self, step: Candidate) -> bool:
        least = self.setup.parameters.accept
        if self._trial is None:
            return step.actual > 0.0 and step.ratio > least
        gained = self._trial.gained(step.evaluation, self.penalties)
        return gained > max(least * self._trial.step.predicted, 0.0)

    def _worth_a_trial(self, step: Candidate) -> bool:
        parameters = self.setup.parameters
        return (
            step.predicted > self.setup.problem.settings.tolerance
            and step.actual > -parameters.watch_loss
            and step.evaluation.worst_violation < parameters.watch
        )

    def _go_back(self) -> Candidate | None:
        """Return to where the trial began, if there is one: the step that led away from there."""
        trial, self._trial = self._trial, None
        if trial is None:
            return None
        self.run.evaluation, self.trust, self._linearised = trial.evaluation, trial.trust, trial.linearised
        return trial.step

    def _good_enough(self, number: int) -> bool:
        enough = self.limits.enough
        return (
            enough is not None
            and number >= enough
            and self.run.evaluation.worst_violation <= self.setup.parameters.grave
        )

    def _ended(self, number: int, step: Candidate) -> LoopStatus | None:
        """Whether the run has ended, and how; raises the penalties of what stays violated."""
        ended, parameters = self._outcome(step), self.setup.parameters
        violation = self.run.evaluation.worst_violation
        if ended is None and self._lingers(number, violation):
            return LoopStatus.INFEASIBLE
        if violation < max(parameters.progress * self._progress.violation, parameters.grave):
            self._progress = _Progress(number, violation)
        elif ended is None and number - self._progress.number >= parameters.patience:
            ended = self._escalated()
            self._progress = _Progress(number, violation)
            self.trust = parameters.retry_trust
        if ended is None and number >= self.limits.hopeless_after and violation > parameters.hopeless:
            return LoopStatus.INFEASIBLE
        return ended

    def _lingers(self, number: int, violation: float) -> bool:
        """Whether the run has been near to feasibility for long, without getting there or nearer."""
        parameters, best = self.setup.parameters, self._nearest
        near = FEASIBILITY < violation < parameters.grave
        if not near or violation < parameters.progress * best.violation:
            self._nearest = _Progress(number, violation)
        return number - self._nearest.number >= parameters.lingering

    def _outcome(self, step: Candidate) -> LoopStatus | None:
        """Whether nothing is left to gain, or not enough."""
        current, parameters = self.run.evaluation, self.setup.parameters
        if self.cutoff.slower(current, step.sooner):
            return LoopStatus.SLOWER
        if self.cutoff.same_way(current):
            return LoopStatus.SAME_WAY
        if step.evaluation is current and self.cutoff.on_time(current, step.sooner):
            return LoopStatus.ON_TIME
        tolerance, violation = self.setup.problem.settings.tolerance, current.worst_violation
        feasible = violation <= FEASIBILITY
        if feasible and step.before <= parameters.mended and abs(step.sooner) < tolerance:
            return LoopStatus.CONVERGED
        if step.evaluation is current and violation <= parameters.settled and self._last_step(step):
            return LoopStatus.CONVERGED
        if step.predicted < tolerance * max(1.0, 10.0 * violation):
            return LoopStatus.CONVERGED if feasible else self._escalated()
        return None

    def _last_step(self, step: Candidate) -> bool:
        """Whether a step went so little of the way that was open to it, for the constraints, that none is to follow.

        It ends at the minimum of its model, off the trip's own by the square of its length.
        """
        parameters, tolerance = self.setup.parameters, self.setup.problem.settings.tolerance
        short = step.size < parameters.inside and step.size * self.trust.theta < parameters.short * math.sqrt(tolerance)
        return short and step.sooner < tolerance

    def _escalated(self) -> LoopStatus | None:
        """Raise the penalties of what stays violated; INFEASIBLE if they are as high as they get."""
        current, parameters = self.run.evaluation, self.setup.parameters
        stuck = np.concatenate([current.zone_violation, current.limit_violation]) > FEASIBILITY
        if self.penalties.weights[stuck].max(initial=0.0) >= parameters.last_penalty or not stuck.any():
            return LoopStatus.INFEASIBLE  # without any: a user's own constraints are, whose price stays
        self.penalties.raise_where(stuck, parameters.escalation)
        return None
