"""The loop on one problem: runs from one or several starts."""

from __future__ import annotations

from collections.abc import Generator, Iterator, Sequence
from time import perf_counter

import numpy as np

from scp_planner.arrays import Array
from scp_planner.problem.memory import MOST_TOGETHER
from scp_planner.problem.problem import Problem
from scp_planner.scp.evaluation import Evaluation
from scp_planner.scp.goal import ArrivalSteps, Cutoff, RunLimits
from scp_planner.scp.iterations import Iterations, LoopSetup
from scp_planner.scp.linearisation import TrustRegion
from scp_planner.scp.merit import Penalties
from scp_planner.scp.parameters import LOOP, LoopParameters
from scp_planner.scp.projection import Projection, trip_after
from scp_planner.scp.record import FEASIBILITY, LoopRun, LoopStatus
from scp_planner.scp.rows.base import Rows
from scp_planner.scp.rows.drive import KinematicRows
from scp_planner.scp.step_solver import StepSolver
from scp_planner.scp.together import RunInStep, Wish, evaluated, linearised, run_together
from scp_planner.solvers.interface import QpSolver
from scp_planner.trips.trajectory import Trajectory


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
    parameters : LoopParameters
    steps : ArrivalSteps, optional
        That the trip has to arrive on, in the end: a run ends when it can hardly arrive on an earlier one.
    penalties : Penalties, optional
        That runs begin with; default: the first ones of the parameters.
    """

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
        self.solver = solver
        self.fallback = fallback
        self.parameters = parameters
        self.steps = steps
        self.penalties = penalties
        self.kinematics = KinematicRows(problem)

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
        """Improve a trip until it has converged.

        Parameters
        ----------
        start : Trajectory
        max_iterations : int
        cutoff : float
            The run is given up when it can hardly become faster than this, s.
        deadline : float
            Value of :func:`time.perf_counter` at which the run ends.
        trust : TrustRegion, optional
            The first one; None: that of the parameters.
        enough : int, optional
            After so many iterations a trip without grave violations is good enough, though not the fastest.
        rival : Evaluation, optional
            The best trip so far, of the same problem: the run is given up when it goes the same way.

        Returns
        -------
        LoopRun
        """
        return next(self.run_all([start], max_iterations, cutoff, deadline, trust, enough, rival=rival))

    def run_all(
        self,
        starts: Sequence[Trajectory],
        max_iterations: int,
        cutoff: float = np.inf,
        deadline: float = np.inf,
        trust: TrustRegion | None = None,
        enough: int | None = None,
        *,
        race: bool = False,
        rival: Evaluation | None = None,
    ) -> Iterator[LoopRun]:
        """Improve several trips in step with each other, so that they share the cost of looking at them.

        Not all of them, where that takes much memory; who does not keep all runs needs that of these alone.

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

        Yields
        ------
        LoopRun
            One for each start, in their order.
        """
        setup, first = self._setup(), trust or self._first_trust()
        limits = RunLimits(max_iterations, deadline, enough, self.hopeless_after)
        goal = Cutoff(cutoff, race, rival, self.parameters, self.steps)
        # Trips over many spans, or among many zones, are not looked at all at once.
        at_once = max(1, MOST_TOGETHER // self.problem.trip_bytes)
        for begin in range(0, len(starts), at_once):
            together = starts[begin : begin + at_once]
            yield from run_together(self.problem, [_run_from(start, setup, first, limits, goal) for start in together])

    def moved(self, trajectory: Trajectory, z: Array) -> Trajectory | None:
        """Return the trip after a step z, (n,); None if it would never arrive."""
        return trip_after(self.problem, trajectory, z)

    def _first_trust(self) -> TrustRegion:
        first = self.parameters.first_trust
        steered = self.problem.scenario.vehicle.max_curvature_rate is not None
        return first.scaled(self.parameters.steered) if steered else first

    def _setup(self) -> LoopSetup:
        solver = StepSolver(self.solver, self.fallback, self.parameters.shortest_solve)
        projection = Projection(self.problem, self.kinematics, solver, self.parameters)
        return LoopSetup(self.problem, self.kinematics, solver, projection, self.moved, self.parameters, self.penalties)


def _run_from(start: Trajectory, setup: LoopSetup, trust: TrustRegion, limits: RunLimits, cutoff: Cutoff) -> RunInStep:
    """A run of the loop. A start that breaks a user's constraints is moved to where it keeps them, if it can be."""
    if setup.problem.given is not None:
        start = setup.projection.kept(start, limits.deadline)
    begun = perf_counter()
    evaluation = yield from evaluated(start)
    run = yield from Iterations(setup, evaluation, trust, limits, cutoff, begun).steps()
    given_up = run.status in (LoopStatus.SLOWER, LoopStatus.SAME_WAY)
    near = run.evaluation.worst_violation <= setup.parameters.grave and setup.problem.given is None
    if near and not given_up and setup.projection.misses_goal_speed(run.evaluation.trajectory):
        run.evaluation = yield from _at_goal_speed(run, setup, limits.deadline)
    return run


def _at_goal_speed(run: LoopRun, setup: LoopSetup, deadline: float) -> Generator[Wish, Evaluation | Rows, Evaluation]:
    """What a run came to, at the goal's speed: the loop's own tolerance is coarse beside what that can be met to."""
    projection, found = setup.projection, run.evaluation
    deadline = max(deadline, perf_counter() + setup.parameters.last_mend)
    for _ in range(setup.parameters.projections):
        rows = yield from linearised(found, setup.parameters.retry_trust)
        nearest = projection.mended(found.trajectory, rows, len(run.penalties.weights), deadline)
        if nearest is None:
            return run.evaluation
        found = yield from evaluated(nearest)
        if not projection.misses_goal_speed(found.trajectory):
            break
    return found if found.worst_violation <= max(FEASIBILITY, run.evaluation.worst_violation) else run.evaluation
