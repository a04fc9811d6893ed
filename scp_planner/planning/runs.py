"""Runs of the loop on one problem, each checked by the certificate."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from time import perf_counter
from typing import TYPE_CHECKING

import numpy as np

from scp_planner.arrays import Array
from scp_planner.certificate.check import certify_trip
from scp_planner.certificate.checked_trip import Scope
from scp_planner.constraints.arrival import EarliestArrival
from scp_planner.planning.attempts import ATTEMPTS, CheckedRun, ReadyProblem, Tally, met_what_was_left_out
from scp_planner.problem.build import build_problem
from scp_planner.problem.guides import guide_along
from scp_planner.problem.problem import Problem
from scp_planner.problem.tightening import TIGHTENINGS, URGENCY, tightened
from scp_planner.scenario.models import Scenario
from scp_planner.scenario.units import NaturalUnits
from scp_planner.scp.evaluation import Evaluation
from scp_planner.scp.goal import ArrivalSteps
from scp_planner.scp.linearisation import TrustRegion
from scp_planner.scp.loop import ScpLoop
from scp_planner.scp.merit import Penalties
from scp_planner.scp.parameters import LOOP
from scp_planner.scp.record import LoopRun, LoopStatus
from scp_planner.settings.planning import Settings
from scp_planner.solvers import QpSolver, solver_named
from scp_planner.threat_zones.zone import ThreatZone
from scp_planner.trips.guide import Guide
from scp_planner.trips.path import Path
from scp_planner.trips.space import TripSpace
from scp_planner.trips.trajectory import Trajectory, arriving
from scp_planner.trips.trip import Trip

if TYPE_CHECKING:
    from scp_planner.scp.given import UserConstraints

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
class OwnConstraints:
    """A user's own constraints, and the units of the scene, in which they are not written."""

    constraints: UserConstraints
    units: NaturalUnits


@dataclass(frozen=True)
class Task:
    """The work of one call of :func:`scp_planner.plan`, in the units of the scene."""

    scenario: Scenario
    threat_zones: Sequence[ThreatZone]
    settings: Settings
    deadline: float  # value of `perf_counter` at which it ends
    last_check: float = np.inf  # the same, at which the certificate of the runs so far is given up
    own_solver: QpSolver | None = None
    given: OwnConstraints | None = None
    arrival_step: float | None = None  # s; the scenario lacks it: the trip is brought to a step at last
    least_time: float = 0.0  # s; no trip is faster
    thorough: bool = True  # arcs, and a proof that there is no trip, where no way leads to a certified one
    provisional: bool = False  # a trip that keeps all constraints is taken for certified: it is changed before it is
    tally: Tally = field(default_factory=lambda: Tally("build", "search", "scp", "certificate"))

    @property
    def steps(self) -> ArrivalSteps | None:
        """Steps of time to arrive on, in travel times."""
        if self.arrival_step is None:
            return None
        latest = self.scenario.goal.latest_arrival
        return ArrivalSteps(self.arrival_step, np.inf if latest is None else latest - self.scenario.start.time)

    @property
    def out_of_time(self) -> bool:
        """True if the deadline has passed."""
        return perf_counter() > self.deadline

    def solvers(self) -> tuple[QpSolver, str | None]:
        """Return the solver, and the name of the one to fall back to; a user's own solver or constraints allow none."""
        if self.own_solver is not None:
            return self.own_solver, None
        name = self.settings.solver
        if self.given is not None:
            return solver_named(name), None
        return solver_named(name), "clarabel" if name != "clarabel" else "daqp"


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
        return stuck and self.run.evaluation.worst_violation < ATTEMPTS.hardly


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
        with task.tally.timed("build"):
            everything = build_problem(task.scenario, task.threat_zones, task.settings, breakpoints, guide, spans)
            self.solver, self._fallback = task.solvers()
            if task.given is not None:
                everything, self.solver = _with_given(everything, task.given, self.solver)
            ready = ReadyProblem.of(everything, task.least_time)
            self.everything, self.problem, self.lower_bound = ready.everything, ready.near, ready.lower_bound
            self.loop = self._loop(self.problem, LIMITS.hopeless_after, task.steps)

    @property
    def most_ways(self) -> int:
        """Number of ways of one grid that are tried at most."""
        return max(1, round(self.task.settings.max_runs * self.task.settings.effort))

    @cached_property
    def patient_loop(self) -> ScpLoop:
        """A loop whose runs go on where others would make room for other ways."""
        return self._loop(self.problem, steps=self.task.steps)

    @cached_property
    def careful_loop(self) -> ScpLoop:
        """A loop for starts that keep all constraints: small steps, and violations at a high price."""
        return self._loop(self.problem, steps=self.task.steps, careful=True)

    @classmethod
    def along(cls, task: Task, path: Path) -> CheckedRuns:
        """Return the same over a path that becomes the guide."""
        with task.tally.timed("build"):
            guide = guide_along(path, task.settings)
        return cls(task, guide, tuple(path.space.acceleration.breakpoints.tolist()))

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
        with self.task.tally.timed("certificate"):
            trip, scope = self.trip(run.evaluation.trajectory), Scope(deadline=self.task.last_check)
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
        if on_time.holds or self.task.out_of_time:
            return on_time
        return self._checked(self.problem, self._loop(self.problem), attempt.trajectory, cutoff, rival)

    def unchecked(self, start: Trajectory, missed: Sequence[ScpRun] = ()) -> ScpRun:
        """Run the loop from a start, without a certificate, with what those of runs like it found missing."""
        problem, loop = self.problem, self.patient_loop
        for repeat, one in enumerate(missed):
            problem = self._asking_for_more(problem, one, URGENCY**repeat)
            loop = self._loop(problem)
        with self.task.tally.timed("scp"):
            return ScpRun(self._run(loop, start, np.inf, None, SPARING.retry_trust if missed else None), None, self)

    def _on_its_step(self, trajectory: Trajectory) -> ScpRun:
        """Go on from a trip to one that arrives on the next step of time."""
        assert self.task.steps is not None
        limit = EarliestArrival(self.problem, self.task.steps.after(trajectory.travel_time))
        problem = replace(self.problem, constraints=(*self.problem.constraints, limit))
        return self._checked(problem, self._loop(problem), trajectory, np.inf, None)

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
            with self.task.tally.timed("scp"):
                trust = SPARING.retry_trust if repeat else None
                run = self._run(loop, start, cutoff, None if rival is None else rival.run.evaluation, trust)
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
            if certificate.holds or fails or certificate.late or self.task.out_of_time:
                break
            # What the samples missed: ask for a little more of it, and go on from here.
            problem = self._asking_for_more(problem, attempt, URGENCY**repeat)
            loop = self._loop(problem, penalties=run.penalties if problem is not self.everything else None)
            start = run.evaluation.trajectory
        return attempt

    def _loop(
        self,
        problem: Problem,
        hopeless_after: int | None = None,
        steps: ArrivalSteps | None = None,
        penalties: Penalties | None = None,
        *,
        careful: bool = False,
    ) -> ScpLoop:
        radius = problem.zones.typical_radius
        # Trips on different sides of what is small are near to each other.
        apart = SPARING.same_way if radius is None else min(SPARING.same_way, radius)
        parameters = replace(CAREFUL if careful else SPARING, same_way=apart)
        return ScpLoop(problem, self.solver, self._fallback, hopeless_after, parameters, steps, penalties)

    def _asking_for_more(self, problem: Problem, attempt: ScpRun, urgency: float) -> Problem:
        if met_what_was_left_out(problem, attempt.verdict):
            return self.everything
        return tightened(problem, attempt.verdict, urgency, attempt.travel_time)

    def _run(
        self,
        loop: ScpLoop,
        start: Trajectory,
        cutoff: float,
        rival: Evaluation | None,
        trust: TrustRegion | None = None,
    ) -> LoopRun:
        """Run the loop from a start; go on from where it was at its limit of iterations, while it gains by that."""
        most, task = self.task.settings.max_iterations, self.task
        run = loop.run(start, most, cutoff, task.deadline, trust, rival=rival)
        task.tally.iterations += len(run.record)
        for _ in range(LIMITS.continuations):
            if run.status is not LoopStatus.ITERATION_LIMIT or task.out_of_time:
                break
            logger.info("at the limit of %d iterations after %.4f units; going on", most, promise(run)[1])
            further = loop.run(run.evaluation.trajectory, most, cutoff, task.deadline, rival=rival)
            task.tally.iterations += len(further.record)
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


def _with_given(problem: Problem, given: OwnConstraints, solver: QpSolver) -> tuple[Problem, QpSolver]:
    """A problem with a user's own constraints, and the solver that keeps them."""
    # CVXPY takes a second to load, and hardly anyone needs it.
    from scp_planner.scp.given import GivenConstraints
    from scp_planner.solvers.cvxpy_solver import CvxpySolver

    if not isinstance(solver, CvxpySolver):
        raise ValueError(f"solver: {solver.name!r} cannot take constraints of one's own; cvxpy can")
    kept = GivenConstraints(problem, given.constraints, given.units)
    return replace(problem, given=kept), solver.keeping(kept.on)
