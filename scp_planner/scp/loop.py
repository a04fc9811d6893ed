"""The loop: linearise, solve, accept or reject, resize the trust region.

Close to a minimum a full step can raise the merit by curvature that the model lacks (the Maratos effect). So a step
that fails by little is taken on trial: from there one more step is made, and only if both together fail the loop goes
back and shrinks the trust region (the watchdog technique of Chamberlain, Powell, Lemarechal and Pedersen, 1982).
Against a second-order correction it saves one solution of the subproblem, and sees the places that the step made worse.
"""

from __future__ import annotations

import logging
from collections.abc import Generator, Sequence
from dataclasses import dataclass, replace
from time import perf_counter

import numpy as np

from scp_planner.arrays import Array
from scp_planner.problem.problem import Problem
from scp_planner.scp.evaluation import Evaluation, evaluate_trips
from scp_planner.scp.last_step import LastStep
from scp_planner.scp.linearisation import TrustRegion, linearise_trips
from scp_planner.scp.merit import Penalties
from scp_planner.scp.record import FEASIBILITY, NEAR, Iteration, LoopRun, LoopStatus
from scp_planner.scp.rows.base import Rows
from scp_planner.scp.rows.drive import KinematicRows
from scp_planner.scp.subproblem import ActiveSet, Subproblem, build_subproblem
from scp_planner.solvers.interface import QpSolver, QuadraticProgram, Solution, SolverStatus, solver_named
from scp_planner.trips.trajectory import Trajectory

logger = logging.getLogger(__name__)
FIRST_PENALTY = 5.0  # units of time to one of length, or to one of relative excess
ESCALATION = 25.0
LAST_PENALTY = 1000.0
FIRST_TRUST = TrustRegion(theta=1.0, beta=3.0, rho=0.3)
LARGEST_TRUST = TrustRegion(theta=3.0, beta=5.0, rho=0.5)
SMALLEST_TRUST = 1e-5  # units of length
INSIDE = 0.99  # relative to the trust region: steps shorter than this are learnt from
ACCEPT = 0.05  # least ratio of actual to predicted decrease of an accepted step
SHRINK_BELOW, GROW_ABOVE = 0.25, 0.7
SHRINK, GROW = 0.3, 1.7
SMALLEST_SHRINK = 0.1
WATCH = 0.5  # largest violation of a trip that is taken on trial
WATCH_LOSS = 1.0  # units of time of merit that it may cost
HOPE = 4.0  # times the next step's gain that a run may still become faster
SAME_WAY = 0.2  # units of length; trips that are never farther apart than this end as one
PATIENCE = 3  # iterations without coming nearer to feasibility, after which penalties are raised
PROGRESS = 0.8  # of the violation: what counts as nearer
MENDED = 2e-3  # a step from a larger violation than this may lead to a place from where others lead on
SHORTEST_SOLVE = 1e-3  # s, that a solver is given at least: some take 0 for no limit
SETTLED = 0.4 * FEASIBILITY  # largest violation of a trip that is taken as it is when nothing is left to gain
GRAVE = 5e-3  # violations below this are no reason to lose patience
HOPELESS = 0.15  # largest violation, after some iterations, of runs that are given up where there are others
RETRY_TRUST = TrustRegion(theta=0.3, beta=1.0, rho=0.1)
ANYWHERE = TrustRegion(theta=1e3, beta=1e2, rho=0.9)
PROJECTIONS = 3  # onto a user's own constraints; the length of the path is linearised in each
ACCELERATION_NEARNESS, TIME_NEARNESS = (
    0.1,
    10.0,
)  # on accelerations and on relative steps of the time, squared, against offsets


@dataclass(frozen=True)
class _Progress:
    """The last iteration that came clearly nearer to feasibility."""

    number: int
    violation: float


@dataclass(frozen=True)
class _Step:
    """A candidate of one iteration.

    Attributes
    ----------
    evaluation : Evaluation
    predicted, actual : float
        Decrease of the merit by the model and in truth, s.
    size : float
        Largest component, relative to the trust region.
    sooner : float
        Decrease of the travel time by the model, s.
    before : float
        Largest violation of the trip that the step leads away from.
    """

    evaluation: Evaluation
    predicted: float
    actual: float
    size: float
    sooner: float
    before: float

    @classmethod
    def of(
        cls,
        base: Evaluation,
        candidate: Evaluation | None,
        penalties: Penalties,
        sub: Subproblem,
        weights: Array,
        z: Array,
    ) -> _Step:
        """The step z from a trip to a candidate; to None if it leads to a trip that would never arrive."""
        tau, rho = base.trajectory.travel_time, float(z[sub.step_size - 1])
        merit = base.merit(penalties)
        model = tau * (1.0 + rho) + float(weights[sub.groups] @ z[sub.step_size :])
        actual = -np.inf if candidate is None else merit - candidate.merit(penalties)
        return cls(candidate or base, merit - model, actual, _relative_size(z, sub), -tau * rho, base.worst_violation)

    @property
    def ratio(self) -> float:
        return self.actual / self.predicted if self.predicted > 0.0 else -1.0

    @property
    def acceptable(self) -> bool:
        return self.actual > 0.0 and self.ratio > ACCEPT


@dataclass(frozen=True)
class _Trial:
    """Where the loop goes back to if what it does on trial fails, and the step that led away from there."""

    evaluation: Evaluation
    step: _Step
    trust: TrustRegion

    def succeeds(self, there: Evaluation, penalties: Penalties) -> bool:
        gained = self.evaluation.merit(penalties) - there.merit(penalties)
        return gained > max(ACCEPT * self.step.predicted, 0.0)


@dataclass
class _Cutoff:
    """Runs are given up when they can hardly become faster than this time, s; in a race the fastest run sets it.

    They are given up as well when they come to go the way of a rival.
    """

    time: float
    race: bool
    rival: Evaluation | None = None

    def same_way(self, trip: Evaluation) -> bool:
        """Whether a trip has come so near to the rival that it would end as that did."""
        if self.rival is None or trip.worst_violation > WATCH:
            return False
        apart = trip.points.path.position - self.rival.points.path.position
        return bool(np.abs(apart).max() < SAME_WAY)

    def hear(self, run: LoopRun) -> None:
        if self.race and run.status is LoopStatus.CONVERGED:
            self.time = min(self.time, run.evaluation.trajectory.travel_time)


@dataclass(frozen=True)
class _Wish:
    """A trip to be linearised."""

    base: Evaluation
    trust: TrustRegion


_Steps = Generator[Trajectory | _Wish, Evaluation | Rows, LoopRun]


def _evaluated(trip: Trajectory) -> Generator[Trajectory | _Wish, Evaluation | Rows, Evaluation]:
    evaluation = yield trip
    assert isinstance(evaluation, Evaluation)
    return evaluation


def _linearised(base: Evaluation, trust: TrustRegion) -> Generator[Trajectory | _Wish, Evaluation | Rows, Rows]:
    rows = yield _Wish(base, trust)
    assert isinstance(rows, Rows)
    return rows


def _limited(program: QuadraticProgram, deadline: float) -> QuadraticProgram:
    """A program that is given up at a deadline, of the clock of :func:`time.perf_counter`."""
    left = max(deadline - perf_counter(), SHORTEST_SOLVE)
    return program if left >= program.time_limit else replace(program, time_limit=left)


class ScpLoop:
    """Sequential convex programming on one problem.

    Parameters
    ----------
    problem : Problem
    solver : QpSolver
    fallback : str, optional
        Name of the solver to try when the solver fails.
    hopeless_after : int, optional
        A run that is still far from feasible after so many iterations ends; None: it goes on.
    """

    def __init__(
        self, problem: Problem, solver: QpSolver, fallback: str | None = None, hopeless_after: int | None = None
    ) -> None:
        self.problem = problem
        self.hopeless_after = problem.settings.max_iterations if hopeless_after is None else hopeless_after
        self.solver = solver
        self.fallback = fallback
        self.kinematics = KinematicRows(problem)
        self.zone_count = problem.zones.size

    def run(
        self,
        start: Trajectory,
        max_iterations: int,
        cutoff: float = np.inf,
        deadline: float = np.inf,
        trust: TrustRegion = FIRST_TRUST,
        enough: int | None = None,
        rival: Evaluation | None = None,
    ) -> LoopRun:
        """Improve a trip until it has converged.

        Parameters
        ----------
        start : Trajectory
        max_iterations : int
        cutoff : float
            The run is given up when it can hardly become faster than this, s.
        deadline : float
            Value of :func:`time.perf_counter` at which the run ends.
        trust : TrustRegion
            The first one.
        enough : int, optional
            After so many iterations a trip without grave violations is good enough, though not the fastest.
        rival : Evaluation, optional
            The best trip so far, of the same problem: the run is given up when it goes the same way.

        Returns
        -------
        LoopRun
        """
        return self.run_all([start], max_iterations, cutoff, deadline, trust, enough, rival=rival)[0]

    def run_all(
        self,
        starts: Sequence[Trajectory],
        max_iterations: int,
        cutoff: float = np.inf,
        deadline: float = np.inf,
        trust: TrustRegion = FIRST_TRUST,
        enough: int | None = None,
        *,
        race: bool = False,
        rival: Evaluation | None = None,
    ) -> list[LoopRun]:
        """Improve several trips in step with each other, so that they share the cost of looking at them.

        Parameters
        ----------
        starts : sequence of Trajectory
        max_iterations : int
            Of each.
        cutoff, deadline, trust, enough
            As in :meth:`run`.
        race : bool
            A run that has converged cuts off those that can hardly become faster. Without it each run ends as it would
            alone, up to rounding.
        rival
            As in :meth:`run`.

        Returns
        -------
        list of LoopRun
            One for each start.
        """
        goal = _Cutoff(cutoff, race, rival)
        steps = [self._steps(start, max_iterations, goal, deadline, trust, enough) for start in starts]
        wishes: dict[int, Trajectory | _Wish] = {k: next(some) for k, some in enumerate(steps)}
        runs: dict[int, LoopRun] = {}

        def hand(number: int, answer: Evaluation | Rows) -> None:
            try:
                wishes[number] = steps[number].send(answer)
            except StopIteration as end:
                runs[number] = end.value
                del wishes[number]

        while wishes:
            trips = {k: wish for k, wish in wishes.items() if isinstance(wish, Trajectory)}
            if trips:
                evaluations = evaluate_trips(self.problem, list(trips.values()), NEAR)
                for number, evaluation in zip(trips, evaluations, strict=True):
                    hand(number, evaluation)
            lines = {k: wish for k, wish in wishes.items() if isinstance(wish, _Wish)}
            if lines:
                bases, trusts = [wish.base for wish in lines.values()], [wish.trust for wish in lines.values()]
                for number, rows in zip(lines, linearise_trips(self.problem, bases, trusts, NEAR), strict=True):
                    hand(number, rows)
        return [runs[number] for number in range(len(steps))]

    def _steps(
        self,
        start: Trajectory,
        max_iterations: int,
        cutoff: _Cutoff,
        deadline: float,
        trust: TrustRegion,
        enough: int | None,
    ) -> _Steps:
        """The loop. It yields what it wishes to have evaluated or linearised, and is sent that."""
        penalties = Penalties.uniform(self.problem, FIRST_PENALTY)
        active: ActiveSet | None = None
        if self.problem.given is not None:
            start = self._kept(start, deadline)
        run = LoopRun(LoopStatus.ITERATION_LIMIT, (yield from _evaluated(start)), penalties)
        progress = _Progress(0, run.evaluation.worst_violation)
        trial: _Trial | None = None
        last: LastStep | None = None
        for number in range(1, max_iterations + 1):
            if perf_counter() > deadline:
                run.status = LoopStatus.TIME_LIMIT
                break
            rows = yield from _linearised(run.evaluation, trust)
            weights = np.concatenate([penalties.zones, penalties.limits])
            trip = run.evaluation.trajectory
            if last is not None and last.end is not trip:
                last = None
            sub = build_subproblem(self.problem, self.kinematics, trip, rows, weights, trust, active, last)
            solution = self._solve(sub, deadline)
            if solution is None:
                run.status = LoopStatus.SOLVER_FAILED
                if trial is not None:
                    run.evaluation, trust, trial = trial.evaluation, trial.trust, None
                kept = self._within_limits(run.evaluation.trajectory, deadline)
                if kept is not None:
                    run.evaluation = yield from _evaluated(kept)
                    continue
                trust = trust.scaled(SHRINK)
                if trust.theta < SMALLEST_TRUST:
                    break
                continue
            if trial is None and number > 1 and self._settled(run.evaluation, sub, solution):
                run.status = LoopStatus.CONVERGED
                break
            active = sub.active_set(solution)
            moved = self._moved(trip, solution.x)
            candidate = None if moved is None else (yield from _evaluated(moved))
            step = _Step.of(run.evaluation, candidate, penalties, sub, weights, solution.x)
            # Steps to the border of the trust region lead too far to tell how the constraints bend here.
            last = None
            if moved is not None and step.size < INSIDE:
                last = LastStep.of(self.kinematics, rows, trip, moved, sub.program, solution)
            run.status = LoopStatus.ITERATION_LIMIT
            accepted = step.acceptable if trial is None else trial.succeeds(step.evaluation, penalties)
            on_trial = trial is None and not accepted and self._worth_a_trial(step)
            run.record.append(_record(number, step, penalties, accepted or on_trial, trust, len(rows.gap)))
            if on_trial and number < max_iterations:
                trial = _Trial(run.evaluation, step, trust)
                run.evaluation = step.evaluation
                continue
            if accepted:
                run.evaluation = step.evaluation
            elif trial is not None:
                run.evaluation, step, trust = trial.evaluation, trial.step, trial.trust
            trial = None
            ended = self._ended(run, step, penalties, cutoff)
            violation = run.evaluation.worst_violation
            if violation < max(PROGRESS * progress.violation, GRAVE):
                progress = _Progress(number, violation)
            elif ended is None and number - progress.number >= PATIENCE:
                ended = self._escalated(run.evaluation, penalties)
                progress = _Progress(number, violation)
                trust = RETRY_TRUST
            if ended is None and number >= self.hopeless_after and violation > HOPELESS:
                ended = LoopStatus.INFEASIBLE
            if ended is not None:
                run.status = ended
                break
            if enough is not None and number >= enough and violation <= GRAVE:
                break
            trust = _resized(trust, step)
            if trust.theta < SMALLEST_TRUST:
                run.status = LoopStatus.STALLED
                break
        if trial is not None:
            run.evaluation = trial.evaluation
        cutoff.hear(run)
        logger.debug("run: %s after %d iterations", run.status.value, len(run.record))
        return run

    def _settled(self, base: Evaluation, sub: Subproblem, solution: Solution) -> bool:
        """Whether a trip keeps all constraints, and the step from it, not yet evaluated, would gain nothing."""
        sooner = base.trajectory.travel_time * abs(float(solution.x[sub.step_size - 1]))
        return base.worst_violation <= SETTLED and sooner < self.problem.settings.tolerance

    def _worth_a_trial(self, step: _Step) -> bool:
        return (
            step.predicted > self.problem.settings.tolerance
            and step.actual > -WATCH_LOSS
            and step.evaluation.worst_violation < WATCH
        )

    def _solve(self, sub: Subproblem, deadline: float) -> Solution | None:
        """The step, or None; a solver has what is left of the time, or else of its own limit."""
        solution = self.solver.solve(_limited(sub.program, deadline))
        if solution.status is SolverStatus.FAILED and self.fallback is not None and perf_counter() < deadline:
            solution = solver_named(self.fallback).solve(_limited(sub.program, deadline))
        return solution if solution.status is SolverStatus.OPTIMAL else None

    def _within_limits(self, trip: Trajectory, deadline: float) -> Trajectory | None:
        """The nearest trip within speed and acceleration, if this one is not; None if nothing better is found."""
        excess = self.kinematics.excess(trip)
        if excess <= FEASIBILITY:
            return None
        kept = self._kept(trip, deadline)
        return kept if self.kinematics.excess(kept) < 0.5 * excess else None

    def _kept(self, start: Trajectory, deadline: float) -> Trajectory:
        """The trip nearest to a start that keeps what every step must keep: speed, acceleration, a user's constraints.

        From a trip that breaks them short steps would have nowhere to go. A start for which none is found is returned
        as it is.
        """
        count = self.problem.step_size
        none = Rows.none(count)
        nearness = np.full(count, ACCELERATION_NEARNESS)
        nearness[: self.problem.ends.free.stop - self.problem.ends.free.start] = 1.0
        nearness[-1] = TIME_NEARNESS
        near = start
        for _ in range(PROJECTIONS):
            sub = build_subproblem(self.problem, self.kinematics, near, none, np.zeros(0), ANYWHERE)
            program = replace(sub.program, hessian=np.diag(nearness), gradient=np.zeros(count))
            solution = self._solve(replace(sub, program=program), deadline)
            moved = None if solution is None else self._moved(near, solution.x)
            if moved is None:
                return start
            near = moved
        return near

    def _moved(self, trajectory: Trajectory, z: Array) -> Trajectory | None:
        """The trip after a step, its travel time from the closed form; None if it would never arrive."""
        free = self.problem.ends.free
        count = free.stop - free.start
        size = self.problem.space.acceleration_size
        theta = trajectory.theta.copy()
        theta[free] += z[:count]
        beta = (trajectory.beta + z[count : count + size]) / (1.0 + z[count + size]) ** 2
        if self.problem.ends.start_acceleration is not None:
            beta[0] = self.problem.ends.start_acceleration  # the row is exact to first order
        moved = Trajectory.of(self.problem.space, theta, beta, trajectory.travel_time * (1.0 + z[count + size]))
        return moved if np.isfinite(moved.travel_time) else None

    def _ended(self, run: LoopRun, step: _Step, penalties: Penalties, cutoff: _Cutoff) -> LoopStatus | None:
        """Whether the run has ended, and how; raises the penalties of what stays violated."""
        current = run.evaluation
        violation = current.worst_violation
        # What is still violated can only take more time.
        if current.trajectory.travel_time - HOPE * max(step.sooner, 0.0) > cutoff.time:
            return LoopStatus.SLOWER
        if cutoff.same_way(current):
            return LoopStatus.SAME_WAY
        tolerance = self.problem.settings.tolerance
        if violation <= FEASIBILITY and step.before <= MENDED and abs(step.sooner) < tolerance:
            return LoopStatus.CONVERGED
        if step.predicted < tolerance * max(1.0, 10.0 * violation):
            if violation <= FEASIBILITY:
                return LoopStatus.CONVERGED
            return self._escalated(current, penalties)
        return None

    def _escalated(self, current: Evaluation, penalties: Penalties) -> LoopStatus | None:
        """Raise the penalties of what stays violated; INFEASIBLE if they are as high as they get."""
        stuck = np.concatenate([current.zone_violation, current.limit_violation]) > FEASIBILITY
        weights = np.concatenate([penalties.zones, penalties.limits])
        if weights[stuck].max(initial=0.0) >= LAST_PENALTY or not stuck.any():
            return LoopStatus.INFEASIBLE  # without any: a user's own constraints are, whose price stays
        penalties.zones[stuck[: self.zone_count]] *= ESCALATION
        penalties.limits[stuck[self.zone_count :]] *= ESCALATION
        return None


def _resized(trust: TrustRegion, step: _Step) -> TrustRegion:
    if step.ratio < SHRINK_BELOW:
        # From where the step ended, not from a border that it never touched
        return trust.scaled(SHRINK * max(step.size, SMALLEST_SHRINK))
    if step.ratio > GROW_ABOVE:
        grown, most = trust.scaled(GROW), LARGEST_TRUST
        return TrustRegion(min(grown.theta, most.theta), min(grown.beta, most.beta), min(grown.rho, most.rho))
    return trust


def _relative_size(z: Array, sub: Subproblem) -> float:
    """Largest component of a step, relative to the trust region."""
    program, count = sub.program, sub.step_size
    radius = np.maximum(program.upper[:count], -program.lower[:count])
    return float(np.max(np.abs(z[:count]) / np.maximum(radius, 1e-300)))


def _record(number: int, step: _Step, penalties: Penalties, accepted: bool, trust: TrustRegion, rows: int) -> Iteration:
    candidate = step.evaluation
    return Iteration(
        number,
        candidate.trajectory.travel_time,
        candidate.merit(penalties),
        candidate.worst_violation,
        step.predicted,
        step.actual,
        accepted,
        trust,
        rows,
    )
