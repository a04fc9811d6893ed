"""The published method's baseline: penalty descent from the planner's starts, to the same plan and certificate."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from math import inf

import numpy as np

from scp_planner.baseline.descent import DESCENT, CheckedDescent, Descent, checked_descent
from scp_planner.baseline.descent_run import DescentSettings, DescentStatus
from scp_planner.certificate.verdict import Certificate
from scp_planner.errors import TooLargeError
from scp_planner.pauses import Budget, OutOfTimeError
from scp_planner.planning.checked import QUALITY, ReadyProblem, met_what_was_left_out
from scp_planner.planning.explain import grave_violations
from scp_planner.planning.plan import Plan, PlanStatus
from scp_planner.planning.search import Search, SearchLog, Source
from scp_planner.problem.build import build_problem
from scp_planner.problem.memory import check_obstacles
from scp_planner.problem.problem import Problem
from scp_planner.scenario.models import Scenario
from scp_planner.scenario.units import NaturalUnits
from scp_planner.search.starts import starts
from scp_planner.settings.planning import SceneSettings, Settings, for_scene
from scp_planner.threat_zones.of_scenario import ZonesOf
from scp_planner.threat_zones.zone import ThreatZone
from scp_planner.trips.trajectory import Trajectory
from scp_planner.trips.trip import Trip


@dataclass(frozen=True)
class _Start:
    """A start by its number; without a trip the root."""

    number: int = 0
    trip: Trajectory | None = None


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
    budget = Budget.within(time_limit)
    settings, descent = settings or Settings(), descent or DescentSettings()
    units = NaturalUnits.of(scenario)
    check_obstacles(len(scenario.obstacles))
    go_on = budget.go_on
    log, scene = SearchLog("build", "search", "descent", "certificate"), for_scene(settings, units)
    try:
        inside = units.scenario(scenario, go_on)
        zones = tuple(ZonesOf(inside, go_on))
    except OutOfTimeError as error:
        raise TooLargeError(str(error)) from None
    with log.timed("build"):
        ready = ReadyProblem.of(build_problem(inside, zones, scene))
    only = None if start is None else _as_start(ready.near, start, units)
    enough = ready.lower_bound * (1.0 + QUALITY.good_enough / scene.effort)
    search = _Descents(ready, zones, enough, budget, log)
    search.descent, search.seed = descent, seed
    search.sources = [_Starts(search, scene, only)]
    best = search.explore(_Start())
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
        iterations=log.iterations,
        wall_time=budget.spent,
        clearance=certificate.clearance,
        limits=certificate.limits,
        lower_bound=ready.lower_bound * units.time,
        planned=scenario,
        timings=log.timings,
        converged=best.run.status is DescentStatus.CONVERGED,
    )


class _Descents(Search[_Start, CheckedDescent]):
    """Descents from starts, as long as they may lead to faster trips."""

    def __init__(
        self, ready: ReadyProblem, zones: Sequence[ThreatZone], enough: float, budget: Budget, log: SearchLog
    ) -> None:
        super().__init__(log, budget, least=ready.lower_bound, enough=enough)
        self.ready, self.threat_zones = ready, tuple(zones)
        self.descent, self.seed = DescentSettings(), 0

    def accepts(self, result: CheckedDescent) -> bool:
        return result.holds

    def is_better(self, result: CheckedDescent, other: CheckedDescent) -> bool:
        return result.better_than(other)

    def is_open(self, skeleton: _Start) -> bool:
        return skeleton.trip is None

    def describe(self, skeleton: _Start) -> str:
        return f"descent {skeleton.number + 1}"

    def complete(self, skeleton: _Start) -> CheckedDescent | None:
        assert skeleton.trip is not None
        found = self._from(self.ready.near, skeleton.trip, skeleton.number)
        if met_what_was_left_out(self.ready.near, found.verdict):
            found = self._from(self.ready.everything, found.trajectory, skeleton.number)
        return found

    def _from(self, problem: Problem, start: Trajectory, number: int) -> CheckedDescent:
        descent = Descent(problem, start, self.descent, seed=self.seed + number, deadline=self.budget.deadline)
        found = checked_descent(problem, self.threat_zones, descent, self.log.timings)
        self.log.iterations += found.run.iterations
        return found


class _Starts(Source[_Start, CheckedDescent]):
    """The starts that the planner tries, the fastest estimate first; or the only one."""

    name = "starts"

    def __init__(self, search: _Descents, settings: SceneSettings, only: Trajectory | None) -> None:
        self.search, self.settings, self.only = search, settings, only

    def children(
        self,
        skeleton: _Start,
        found: CheckedDescent | None,  # noqa: ARG002
    ) -> Iterator[tuple[float, _Start]]:
        if skeleton.trip is not None:
            return
        if self.only is not None:
            yield 0.0, _Start(0, self.only)
            return
        search, estimated = self.search, 0.0  # estimate of the start of the best trip, s
        estimates = starts(search.ready.near, self.settings.searches, search.budget.deadline)
        for number in range(self.settings.max_runs):
            with search.log.timed("search"):
                estimate, start = next(estimates, (inf, None))
            if start is None or (search.certified and estimate - estimated - DESCENT.estimate_slack > 0.0):
                return
            before = search.cutoff
            yield 0.0, _Start(number, start)
            estimated = estimate if search.cutoff < before else estimated


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
