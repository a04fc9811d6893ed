"""The loop: from a start to the fastest trip near it, one convex subproblem after the other."""

from __future__ import annotations

import logging
import math
from time import perf_counter

import numpy as np

from scp_planner.arrays import Array
from scp_planner.constraints.drive import DriveRows
from scp_planner.constraints.rows import Rows
from scp_planner.pauses import pause
from scp_planner.problem.problem import Problem
from scp_planner.scp.candidate import Candidate, Linearised
from scp_planner.scp.evaluation import Evaluation, evaluate_trip
from scp_planner.scp.goal import ArrivalSteps, Cutoff, RunLimits
from scp_planner.scp.judgement import judged, settled
from scp_planner.scp.last_step import LastStep
from scp_planner.scp.linearisation import TrustRegion, linearise, rows_within
from scp_planner.scp.merit import Penalties
from scp_planner.scp.parameters import LOOP, LoopParameters
from scp_planner.scp.projection import Projection, trip_after
from scp_planner.scp.record import FEASIBILITY, LoopRun, LoopStatus
from scp_planner.scp.state import LoopState, Progress
from scp_planner.scp.step_solver import StepSolver
from scp_planner.scp.subproblem import Subproblem, build_subproblem
from scp_planner.solvers.interface import QpSolver
from scp_planner.trips.trajectory import Trajectory

logger = logging.getLogger(__name__)


class ScpLoop:
    """Sequential convex programming on one problem."""

    def __init__(
        self,
        problem: Problem,
        solver: QpSolver,
        fallback: str | None = None,
        hopeless_after: int | None = None,
        parameters: LoopParameters = LOOP,
        steps: ArrivalSteps | None = None,
        penalties: Penalties | None = None,
    ) -> None:
        self.problem = problem
        self.hopeless_after = problem.settings.max_iterations if hopeless_after is None else hopeless_after
        self.parameters = parameters
        self.steps = steps
        self.penalties = penalties
        self.drive = DriveRows(problem)
        self.solver = StepSolver(solver, fallback, parameters.shortest_solve)
        self.projection = Projection(problem, self.drive, self.solver, parameters)

    def run(
        self,
        start: Trajectory,
        max_iterations: int,
        cutoff: float = np.inf,
        deadline: float = np.inf,
        trust: TrustRegion | None = None,
        enough: int | None = None,
        rival: Evaluation | None = None,
    ) -> LoopRun:
        """Improve a trip until it has converged."""
        tolerance = self.problem.settings.tolerance
        limits = RunLimits(max_iterations, deadline, enough, self.hopeless_after, tolerance)
        goal = Cutoff(cutoff, rival, self.problem.samples.sigma, self.parameters, self.steps)
        state = self.initialise(start, limits, goal, trust)
        while state.number < max_iterations and not self.step(state):
            pass
        return self._finished(state)

    def initialise(
        self, start: Trajectory, limits: RunLimits, cutoff: Cutoff, trust: TrustRegion | None = None
    ) -> LoopState:
        """Evaluate a start; one that breaks a user's constraints is moved to where it keeps them, if it can be."""
        if self.problem.given is not None:
            start = self.projection.kept(start, limits.deadline)
        begun = perf_counter()
        evaluation = evaluate_trip(self.problem, start)
        if self.penalties is None:
            penalties = Penalties.uniform(self.problem, self.parameters.first_penalty)
        else:
            penalties = self.penalties.copied()
        run = LoopRun(LoopStatus.ITERATION_LIMIT, evaluation, penalties)
        far = Progress(0, evaluation.worst_violation)
        return LoopState(run, self.parameters, limits, cutoff, trust or self._first_trust(), begun, far, far)

    def step(self, state: LoopState) -> bool:
        """Linearise the trip, solve, and judge where the step leads; return True if the run has ended with that."""
        pause()
        state.number += 1
        now = perf_counter()
        if now + self.parameters.spared * (now - state.begun) > state.limits.deadline:
            return state.end(LoopStatus.TIME_LIMIT)
        state.begun = now
        base = state.run.evaluation
        # A path that turns back on itself overflows, or its derivatives do
        if not math.isfinite(base.worst_violation + base.trajectory.path.arc_length):
            return state.end(LoopStatus.SOLVER_FAILED)
        rows = self._rows(state)
        if not np.isfinite(rows.matrix).all():
            return state.end(LoopStatus.SOLVER_FAILED)
        if state.late:
            return state.end(LoopStatus.TIME_LIMIT)
        sub = self._subproblem(state, rows)
        solution = None if state.late else self.solver.solve(sub.program, state.limits.deadline)
        if solution is None or not np.isfinite(solution.x).all():
            del sub
            return state.end(LoopStatus.TIME_LIMIT) if state.late else self._without_step(state)
        if state.trial is None and state.number > 1:
            sooner = -base.trajectory.travel_time * float(solution.x[sub.step_size - 1])
            if settled(state, sooner):
                return state.end(LoopStatus.CONVERGED)
            if state.cutoff.will_be_slower(base, sooner):
                return state.end(LoopStatus.SLOWER)
        state.active = sub.active_set(solution)
        candidate, prices = Candidate.of(base, state.run.penalties, sub, solution.x), sub.prices(solution)
        del sub  # the largest matrix of all is not kept while a trip is looked at
        return judged(state, self._evaluated(state, candidate, rows, solution.x, prices), len(rows.gap))

    def moved(self, trajectory: Trajectory, z: Array) -> Trajectory | None:
        """Return the trip after a step z, (n,); None if it would never arrive."""
        return trip_after(self.problem, trajectory, z)

    def _first_trust(self) -> TrustRegion:
        first = self.parameters.first_trust
        steered = self.problem.scenario.vehicle.max_curvature_rate is not None
        return first.scaled(self.parameters.steered) if steered else first

    def _rows(self, state: LoopState) -> Rows:
        """The trip, linearised: anew only where that has not been done after a step that was rejected."""
        base, trust, known = state.run.evaluation, state.trust, state.linearised
        if known is not None and known.serves(base, trust):
            return rows_within(self.problem, known.rows, trust)
        rows = linearise(self.problem, base, trust)
        state.linearised = Linearised(base, trust, rows)
        return rows

    def _subproblem(self, state: LoopState, rows: Rows) -> Subproblem:
        trip, weights = state.run.evaluation.trajectory, state.run.penalties.weights
        last = state.last if state.last is not None and state.last.end is trip else None
        return build_subproblem(self.problem, self.drive, trip, rows, weights, state.trust, state.active, last)

    def _without_step(self, state: LoopState) -> bool:
        state.run.status = LoopStatus.SOLVER_FAILED
        state.go_back()
        kept = self.projection.within_limits(state.run.evaluation.trajectory, state.limits.deadline)
        if kept is not None:
            state.run.evaluation = evaluate_trip(self.problem, kept)
            return False
        state.trust = state.trust.scaled(self.parameters.shrink)
        return state.trust.theta < self.parameters.smallest_trust

    def _evaluated(self, state: LoopState, step: Candidate, rows: Rows, z: Array, prices: Array) -> Candidate:
        """Evaluate the trip that a step leads to, and remember what the step teaches."""
        base = state.run.evaluation
        state.last = None
        if state.trial is None and not step.predicted > 0.0:
            return step  # rejected wherever it leads
        moved = self.moved(base.trajectory, z)
        if moved is None:
            return step
        there = evaluate_trip(self.problem, moved)
        # Steps to the border of the trust region lead too far to tell how the constraints bend here.
        if step.size < self.parameters.inside:
            state.last = LastStep.of(self.drive, rows, base.trajectory, moved, z, prices)
        return step.led_to(there, state.run.penalties)

    def _finished(self, state: LoopState) -> LoopRun:
        """Return the run; its trip meets the speed of the goal better than the loop's own tolerance asks for."""
        run = state.run
        if state.trial is not None:
            run.evaluation = state.trial.evaluation
        logger.debug("run: %s after %d iterations", run.status.value, len(run.record))
        given_up = run.status in (LoopStatus.SLOWER, LoopStatus.SAME_WAY)
        near = run.evaluation.worst_violation <= self.parameters.grave and self.problem.given is None
        if near and not given_up and self.projection.misses_goal_speed(run.evaluation.trajectory):
            run.evaluation = self._at_goal_speed(run, state.limits.deadline)
        return run

    def _at_goal_speed(self, run: LoopRun, deadline: float) -> Evaluation:
        """The trip of a run, or one nearby at the goal's speed."""
        found = run.evaluation
        deadline = max(deadline, perf_counter() + self.parameters.last_mend)
        for _ in range(self.parameters.projections):
            rows = linearise(self.problem, found, self.parameters.retry_trust)
            nearest = self.projection.mended(found.trajectory, rows, len(run.penalties.weights), deadline)
            if nearest is None:
                return run.evaluation
            found = evaluate_trip(self.problem, nearest)
            if not self.projection.misses_goal_speed(found.trajectory):
                break
        return found if found.worst_violation <= max(FEASIBILITY, run.evaluation.worst_violation) else run.evaluation
