"""scp_planner on the same terms: the whole of ``plan()``, and one run of its loop from a given start."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from benchmarks.families import as_scenario
from benchmarks.peers.base import TIME_LIMIT, Attempt, Scenario
from benchmarks.peers.starts import Start, first_guess
from scp_planner.arrays import Array
from scp_planner.trips.trajectory import Trajectory


class WholePlan:
    """``scp_planner.plan``: search, several runs and the certificate. It chooses its starts itself."""

    name = "scp_planner.plan"
    own_starts = True

    def __init__(self, solver: str | None = None) -> None:
        self._solver = solver
        self._scenarios: dict[str, Any] = {}

    def build(self, scenarios: Sequence[Scenario]) -> None:
        """Validate the scenarios; plan the first one once, so that imports are not timed."""
        import scp_planner

        for scenario in scenarios:
            self._scenarios[scenario["name"]] = as_scenario(dict(scenario))
        scp_planner.plan(self._scenarios[scenarios[0]["name"]], solver=self._solver)

    def solve(self, scenario: Scenario, start: Start) -> Attempt:
        """Plan; the start is not used."""
        del start
        import scp_planner

        plan = scp_planner.plan(self._scenarios[scenario["name"]], solver=self._solver)
        return Attempt(
            success=plan.certified,
            position=plan.position,
            start_time=plan.start_time,
            arrival_time=plan.arrival_time,
            iterations=plan.iterations,
            detail=f"{plan.status}: {plan.reason}" if plan.reason else str(plan.status),
        )


class OneRun:
    """One run of the loop of scp_planner from the start that all methods share; no search, no certificate."""

    name = "scp_planner one run"
    own_starts = False

    def __init__(self) -> None:
        self._scenarios: dict[str, Any] = {}

    def build(self, scenarios: Sequence[Scenario]) -> None:
        """Validate the scenarios, and run once so that imports are not timed."""
        for scenario in scenarios:
            self._scenarios[scenario["name"]] = as_scenario(dict(scenario))
        self.solve(scenarios[0], Start(0.0))

    def solve(self, scenario: Scenario, start: Start) -> Attempt:
        """Prepare the problem, fit the start, and run the loop to its end."""
        from scp_planner.problem.build import build_problem
        from scp_planner.scp.loop import ScpLoop
        from scp_planner.settings.planning import Settings
        from scp_planner.solvers import solver_named
        from scp_planner.threat_zones.of_scenario import ZonesOf

        model, settings = self._scenarios[scenario["name"]], Settings()
        problem = build_problem(model, ZonesOf(model), settings)
        loop = ScpLoop(problem, solver_named(settings.solver))
        return _attempt(problem, loop.run(fitted(problem, scenario, start), settings.max_iterations))


def _attempt(problem: Any, run: Any) -> Attempt:
    """The end of a run of the loop, without a certificate."""
    from scp_planner.scp.record import LoopStatus
    from scp_planner.trips.trip import Trip

    trajectory = run.evaluation.trajectory
    trip, begin = Trip(problem.frame, trajectory), problem.frame.time

    def position(times: Array) -> Array:
        points, _ = trip.at(times)
        return problem.frame.to_world(points.path.position)

    return Attempt(
        success=run.status is LoopStatus.CONVERGED,
        position=position,
        start_time=begin,
        arrival_time=begin + trajectory.travel_time,
        iterations=len(run.record),
        detail=run.status.value,
    )


class PenaltyDescent:
    """The published method's baseline, on the same objective, as scp_planner has it."""

    name = "penalty descent"
    own_starts = False

    def __init__(self) -> None:
        self._scenarios: dict[str, Any] = {}

    def build(self, scenarios: Sequence[Scenario]) -> None:
        """Validate the scenarios, and descend once so that imports are not timed."""
        for scenario in scenarios:
            self._scenarios[scenario["name"]] = as_scenario(dict(scenario))
        self.solve(scenarios[0], Start(0.0))

    def solve(self, scenario: Scenario, start: Start) -> Attempt:
        """Descend from the start; what the certificate finds missing is settled once more."""
        from scp_planner.baseline.penalty_descent import penalty_descent
        from scp_planner.problem.build import build_problem
        from scp_planner.settings.planning import Settings
        from scp_planner.threat_zones.of_scenario import zones

        model, settings = self._scenarios[scenario["name"]], Settings()
        problem = build_problem(model, zones(model), settings)
        first = fitted(problem, scenario, start)
        plan = penalty_descent(model, settings, start=first, time_limit=TIME_LIMIT)
        return Attempt(
            success=plan.certified,
            position=plan.position,
            start_time=plan.start_time,
            arrival_time=plan.arrival_time,
            iterations=plan.iterations,
            detail=plan.reason or str(plan.status),
        )


def fitted(problem: Any, scenario: Scenario, start: Start) -> Any:
    """The start as a trajectory of the problem's splines (least squares)."""
    space, ends = problem.space, problem.ends
    guess = first_guess(scenario, start, samples=200)
    local = problem.frame.to_frame(guess.states[:, :2])
    basis = np.asarray(space.path.rows(np.clip(local[:, 0] / space.length, 0.0, 1.0)))
    theta = ends.theta.copy()
    theta[ends.free] = 0.0
    residual = local[:, 1] - basis @ theta
    theta[ends.free] = np.linalg.lstsq(basis[:, ends.free], residual, rcond=None)[0]
    breaks = np.asarray(space.acceleration.breakpoints)
    middles = (breaks[1:] + breaks[:-1]) / 2.0
    if space.acceleration_size != middles.size:
        middles = np.linspace(0.0, 1.0, space.acceleration_size)
    shares = (guess.times - guess.times[0]) / guess.duration
    return Trajectory.of(space, theta, np.interp(middles, shares, guess.accelerations))
