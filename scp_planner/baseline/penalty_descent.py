"""The published method's baseline: penalty descent from the planner's starts, to the same plan and certificate."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from time import perf_counter

import numpy as np

from scp_planner.baseline.descent import DESCENT, CheckedDescent, Descent, checked_descent
from scp_planner.baseline.descent_run import DescentSettings, DescentStatus
from scp_planner.certificate.verdict import Certificate
from scp_planner.errors import TooLargeError
from scp_planner.pauses import OutOfTimeError
from scp_planner.planning.attempts import ATTEMPTS, Attempt, ReadyProblem, Search, Tally, met_what_was_left_out
from scp_planner.planning.explain import grave_violations
from scp_planner.planning.plan import Plan, PlanStatus
from scp_planner.problem.build import build_problem
from scp_planner.problem.memory import check_obstacles
from scp_planner.problem.preparation import asked_for_time
from scp_planner.problem.problem import Problem
from scp_planner.scenario.models import Scenario
from scp_planner.scenario.units import NaturalUnits
from scp_planner.search.starts import starts
from scp_planner.settings.planning import SceneSettings, Settings, for_scene
from scp_planner.threat_zones.of_scenario import ZonesOf
from scp_planner.threat_zones.zone import ThreatZone
from scp_planner.trips.trajectory import Trajectory
from scp_planner.trips.trip import Trip


def penalty_descent(
    scenario: Scenario,
    settings: Settings | None = None,
    *,
    descent: DescentSettings | None = None,
    start: Plan | Trajectory | None = None,
    seed: int = 0,
    time_limit: float | None = None,
) -> Plan:
    """Plan a scenario by penalty descent, the published method's baseline.

    Parameters
    ----------
    scenario : Scenario
    settings : Settings, optional
        Of the planner: splines, samples, margins, and how many starts are tried; those of SCP by default.
    descent : DescentSettings, optional
    start : Plan or Trajectory, optional
        The only start, of the same splines; default: the starts that :func:`scp_planner.plan` tries.
    seed : int
        Of the Monte Carlo search; the same seed gives the same plan.
    time_limit : float, optional
        Wall time in s after which the best plan so far is returned.

    Returns
    -------
    Plan
        With method ``penalty-descent`` and the variant as its solver; status ``certified`` only if the
        continuous-time certificate holds.

    Raises
    ------
    ValueError
        If the start belongs to other splines.
    TooLargeError
        If it would take too much memory, or its many obstacles cannot even be made ready in the time; with the
        reason, and what to change.
    """
    began = perf_counter()
    settings, descent = settings or Settings(), descent or DescentSettings()
    deadline = np.inf if time_limit is None else began + time_limit
    units = NaturalUnits.of(scenario)
    check_obstacles(len(scenario.obstacles))
    go_on = None if time_limit is None else asked_for_time(time_limit, began)
    tally, scene = Tally("build", "search", "descent", "certificate"), for_scene(settings, units)
    try:
        inside = units.scenario(scenario, go_on)
        zones = tuple(ZonesOf(inside, go_on))
    except OutOfTimeError as error:
        raise TooLargeError(str(error)) from None
    with tally.timed("build"):
        ready = ReadyProblem.of(build_problem(inside, zones, scene))
    only = None if start is None else _as_start(ready.near, start, units)
    enough = ready.lower_bound * (1.0 + ATTEMPTS.good_enough / scene.effort)
    search = Search[CheckedDescent](tally, deadline, ready.lower_bound, enough)
    search.walk([_Descents(ready, zones, scene, descent, seed, only)])
    best = search.best
    assert best is not None, "there is always a start"
    trip = Trip(ready.near.frame, best.trajectory.settled()).outside(units)
    certificate = best.verdict.outside(units)
    status, reason = _verdict(scenario, trip, best, certificate)
    return Plan(
        scenario=scenario.name,
        status=status,
        reason=reason,
        trip=trip,
        method="penalty-descent",
        solver=descent.variant.value,
        iterations=tally.iterations,
        wall_time=perf_counter() - began,
        clearance=certificate.clearance,
        limits=certificate.limits,
        lower_bound=ready.lower_bound * units.time,
        planned=scenario,
        timings=tally.timings,
        converged=best.run.status is DescentStatus.CONVERGED,
    )


@dataclass
class _Descents(Attempt[Search[CheckedDescent], CheckedDescent]):
    """Descents from one start after the other, as long as they may lead to faster trips; or from the only start."""

    ready: ReadyProblem
    threat_zones: tuple[ThreatZone, ...]
    settings: SceneSettings
    descent: DescentSettings
    seed: int
    only: Trajectory | None

    what = "descent"

    def __post_init__(self) -> None:
        self.most = 1 if self.only is not None else self.settings.max_runs

    def runs(self, search: Search[CheckedDescent]) -> Iterator[CheckedDescent]:
        best_estimate = 0.0  # of the start of the best trip, s
        for number, (estimate, start) in enumerate(self._starts(search)):
            best = search.best
            if search.out_of_time and best is not None:
                return
            if best is not None and best.holds and estimate - best_estimate - DESCENT.estimate_slack > 0.0:
                return
            found = self._from(search, self.ready.near, start, number)
            if met_what_was_left_out(self.ready.near, found.verdict):
                found = self._from(search, self.ready.everything, found.trajectory, number)
            yield found
            best_estimate = estimate if search.best is found else best_estimate

    def _starts(self, search: Search[CheckedDescent]) -> Iterator[tuple[float, Trajectory]]:
        if self.only is not None:
            yield self.only.travel_time, self.only
            return
        found = starts(self.ready.near, self.settings.searches, search.deadline)
        while True:
            with search.tally.timed("search"):
                item = next(found, None)
            if item is None:
                return
            yield item

    def _from(self, search: Search[CheckedDescent], problem: Problem, start: Trajectory, number: int) -> CheckedDescent:
        descent = Descent(problem, start, self.descent, seed=self.seed + number, deadline=search.deadline)
        found = checked_descent(problem, self.threat_zones, descent, search.tally.timings)
        search.tally.iterations += found.run.iterations
        return found


def _as_start(problem: Problem, start: Plan | Trajectory, units: NaturalUnits) -> Trajectory:
    trajectory = start.trip.trajectory if isinstance(start, Plan) else start
    trajectory = trajectory.in_units(1.0 / units.length, 1.0 / units.time)
    mine, given = problem.space, trajectory.space
    if (mine.path_size, mine.acceleration_size) != (given.path_size, given.acceleration_size):
        raise ValueError(
            f"start: it has {given.path_size} and {given.acceleration_size} control points, not"
            f" {mine.path_size} and {mine.acceleration_size} as the problem's splines have"
        )
    if not np.isfinite(trajectory.travel_time):
        raise ValueError("start: it never arrives")
    return Trajectory.of(mine, problem.ends.around(trajectory.theta[problem.ends.free]), trajectory.beta)


def _verdict(
    scenario: Scenario, trip: Trip, best: CheckedDescent, certificate: Certificate
) -> tuple[PlanStatus, str | None]:
    if certificate.holds:
        return PlanStatus.CERTIFIED, None
    told = grave_violations(scenario, trip, certificate)
    reason = f"{best.run.status.value}: " + "; ".join(str(violation) for violation in told)
    return (PlanStatus.FEASIBLE if best.run.feasible else PlanStatus.INFEASIBLE), reason
