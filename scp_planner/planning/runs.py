"""Runs of the loop on one problem, each checked by the certificate."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from scp_planner.arrays import Array
from scp_planner.certificate.check import certify_trip
from scp_planner.certificate.checked_trip import Scope
from scp_planner.constraints.arrival import EarliestArrival
from scp_planner.planning.checked import QUALITY, CheckedRun, ReadyProblem, met_what_was_left_out
from scp_planner.planning.loops import LIMITS, SPARING, LoopMaker
from scp_planner.planning.task import OwnConstraints, Task
from scp_planner.problem.build import build_problem
from scp_planner.problem.guides import guide_along
from scp_planner.problem.problem import Problem
from scp_planner.problem.tightening import TIGHTENINGS, URGENCY, tightened
from scp_planner.scenario.models import Scenario
from scp_planner.scp.loop import ScpLoop
from scp_planner.scp.record import LoopRun, LoopStatus
from scp_planner.solvers import QpSolver
from scp_planner.trips.guide import Guide
from scp_planner.trips.space import TripSpace
from scp_planner.trips.trajectory import Trajectory, arriving
from scp_planner.trips.trip import Trip


@dataclass(frozen=True)
class ScpRun(CheckedRun[LoopRun]):
    """A run of the loop, its certificate, and the runs that it is one of."""

    runs: CheckedRuns

    @property
    def holds(self) -> bool:
        """True if it is certified; of a task that is provisional, if it keeps all constraints."""
        if self.certificate is None:
            return self.runs.task.provisional and self.run.feasible
        return self.certificate.holds

    @property
    def hardly_fails(self) -> bool:
        """True if it ended where no step comes nearer to keeping all constraints, of which it misses little."""
        stuck = self.run.status is LoopStatus.INFEASIBLE and not self.holds
        return stuck and self.run.evaluation.worst_violation < QUALITY.hardly


class CheckedRuns:
    """Makes runs of the loop on a task's problem over one guide, each with its certificate."""

    def __init__(
        self,
        task: Task,
        guide: Guide | None = None,
        breakpoints: tuple[float, ...] | None = None,
        spans: int | None = None,
    ) -> None:
        self.task = task
        with task.log.timed("build"):
            everything = build_problem(task.scenario, task.threat_zones, task.settings, breakpoints, guide, spans)
            solver, fallback = task.solvers()
            if task.given is not None:
                everything, solver = _with_given(everything, task.given, solver)
            self._loops, self.solver = LoopMaker(task, solver, fallback), solver
            ready = ReadyProblem.of(everything, task.least_time)
            self.everything, self.problem, self.lower_bound = ready.everything, ready.near, ready.lower_bound
            self.loop = self._loops.loop(self.problem, LIMITS.hopeless_after, task.steps)

    @property
    def most_ways(self) -> int:
        """Number of ways of one grid that are tried at most."""
        return max(1, round(self.task.settings.max_runs * self.task.settings.effort))

    @cached_property
    def patient_loop(self) -> ScpLoop:
        """A loop whose runs go on where others would make room for other ways."""
        return self._loops.loop(self.problem, steps=self.task.steps)

    @cached_property
    def careful_loop(self) -> ScpLoop:
        """A loop for starts that keep all constraints: small steps, and violations at a high price."""
        return self._loops.loop(self.problem, steps=self.task.steps, careful=True)

    @classmethod
    def along(cls, task: Task, trip: Trajectory) -> CheckedRuns:
        """Return runs over the path of a trip, which becomes the guide."""
        with task.log.timed("build"):
            guide = guide_along(trip.path, task.settings)
        return cls(task, guide, tuple(trip.space.acceleration.breakpoints.tolist()))

    @classmethod
    def over(
        cls, task: Task, space: TripSpace, breakpoints: tuple[float, ...] | None = None, spans: int | None = None
    ) -> CheckedRuns:
        """Return runs over the guide and the splines of a trip, but for other breakpoints or spans that are given."""
        own = breakpoints or tuple(space.acceleration.breakpoints.tolist())
        return cls(task, space.guide, own, spans or len(space.path.widths))

    def trip(self, trajectory: Trajectory) -> Trip:
        """Return the trip of a trajectory, in the frame of the problem."""
        return Trip(self.problem.frame, trajectory.settled())

    def judged(self, run: LoopRun, scenario: Scenario | None = None) -> ScpRun:
        """Return a run with its certificate, for the task's scenario or another, and by a user's own constraints."""
        with self.task.log.timed("certificate"):
            trip, scope = self.trip(run.evaluation.trajectory), Scope(deadline=self.task.budget.last_check)
            certificate = certify_trip(scenario or self.task.scenario, trip, self.task.threat_zones, scope)
            if self.problem.given is not None:
                certificate = self.problem.given.judged(certificate, run.evaluation.trajectory)
        return ScpRun(run, certificate, self)

    def along_the_guide(self, beta: Array, near: float, cutoff: float) -> ScpRun:
        """Run the loop from the guide itself, driven with given accelerations in about the given time, s."""
        # The new guide may be a little longer than the path that it is: the same accelerations may end before it does.
        problem = self.problem
        start = arriving(problem.space, problem.ends.theta, beta, problem.limits.acceleration, near)
        return self.attempt(start, cutoff, loop=self.patient_loop)

    def attempt(
        self,
        start: Trajectory,
        cutoff: float = np.inf,
        rival: ScpRun | None = None,
        loop: ScpLoop | None = None,
        mended: float = 0.0,
    ) -> ScpRun:
        """Run the loop from a start, and check the result unless it is cut off or no better than the cutoff.

        A run that fails by no more than ``mended`` is repeated with somewhat stricter constraints.
        """
        loop = loop or self.loop
        attempt = self._checked(self.problem, loop, start, cutoff, rival, mended)
        if attempt.run.status is not LoopStatus.ON_TIME:
            return attempt
        on_time = self._on_its_step(attempt.trajectory)
        if on_time.holds or self.task.budget.is_over:
            return on_time
        return self._checked(self.problem, self._loops.loop(self.problem), attempt.trajectory, cutoff, rival)

    def quick(self, start: Trajectory, cutoff: float) -> LoopRun:
        """Run a patient loop from a start, once and without a certificate."""
        task = self.task
        run = self.patient_loop.run(start, task.settings.max_iterations, cutoff, task.budget.deadline)
        task.log.iterations += len(run.record)
        return run

    def unchecked(self, start: Trajectory, missed: Sequence[ScpRun] = ()) -> ScpRun:
        """Run the loop from a start, without a certificate, with what those of runs like it found missing."""
        problem, loop = self.problem, self.patient_loop
        for repeat, one in enumerate(missed):
            problem = self._asking_for_more(problem, one, URGENCY**repeat)
            loop = self._loops.loop(problem)
        with self.task.log.timed("scp"):
            return ScpRun(
                self._loops.run(loop, start, np.inf, None, SPARING.retry_trust if missed else None), None, self
            )

    def _on_its_step(self, trajectory: Trajectory) -> ScpRun:
        """Go on from a trip to one that arrives on the next step of time."""
        assert self.task.steps is not None
        limit = EarliestArrival(self.problem, self.task.steps.after(trajectory.travel_time))
        problem = replace(self.problem, constraints=(*self.problem.constraints, limit))
        return self._checked(problem, self._loops.loop(problem), trajectory, np.inf, None)

    def _checked(
        self,
        problem: Problem,
        loop: ScpLoop,
        start: Trajectory,
        cutoff: float,
        rival: ScpRun | None,
        mended: float = 0.0,
    ) -> ScpRun:
        """Run a loop, and again with what its certificate found missing."""
        for repeat in range(TIGHTENINGS + 1):
            with self.task.log.timed("scp"):
                trust = SPARING.retry_trust if repeat else None
                run = self._loops.run(loop, start, cutoff, None if rival is None else rival.run.evaluation, trust)
            if run.status is LoopStatus.ON_TIME:
                return ScpRun(run, None, self)
            slower = not run.feasible or run.evaluation.trajectory.travel_time >= cutoff
            near = run.evaluation.worst_violation <= mended and run.evaluation.trajectory.travel_time < cutoff
            if run.status is LoopStatus.SAME_WAY or (np.isfinite(cutoff) and slower and not near):
                return ScpRun(run, None, self)
            if self.task.provisional and run.feasible:
                return ScpRun(run, None, self)
            attempt = self.judged(run)
            certificate = attempt.verdict
            fails = not run.feasible and run.evaluation.worst_violation > mended
            if certificate.holds or fails or certificate.late or self.task.budget.is_over:
                break
            # What the samples missed: ask for a little more of it, and go on from here.
            penalties = None if met_what_was_left_out(problem, certificate) else run.penalties
            problem = self._asking_for_more(problem, attempt, URGENCY**repeat)
            loop = self._loops.loop(problem, penalties=penalties)
            start = run.evaluation.trajectory
        return attempt

    def _asking_for_more(self, problem: Problem, attempt: ScpRun, urgency: float) -> Problem:
        if met_what_was_left_out(problem, attempt.verdict):
            return self.everything
        return tightened(problem, attempt.verdict, urgency, attempt.travel_time)


def _with_given(problem: Problem, given: OwnConstraints, solver: QpSolver) -> tuple[Problem, QpSolver]:
    """A problem with a user's own constraints, and the solver that keeps them."""
    # CVXPY takes a second to load, and hardly anyone needs it.
    from scp_planner.scp.given import problem_with

    return problem_with(problem, given.constraints, given.units, solver)
