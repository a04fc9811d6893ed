"""The published method's baseline: penalty descent from the planner's starts, to the same plan and certificate.

What one descent does is in `scp_planner.baseline.descent`; the objective is that of all methods (objective.py). Nothing
is linearised and no subproblem is solved.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from time import perf_counter

import numpy as np

from scp_planner.baseline.checked_descent import CheckedDescent, checked_descent
from scp_planner.baseline.descent import Descent
from scp_planner.baseline.descent_run import DescentRun, DescentStatus
from scp_planner.baseline.descent_settings import DescentSettings
from scp_planner.certificate.verdict import Certificate
from scp_planner.planning.attempts import OuterSearch, ReadyProblem, Tally, met_what_was_left_out
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

ESTIMATE_SLACK = 0.15  # units of time; how much better than its estimate another start may turn out


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
    inside = units.scenario(scenario, go_on)
    search = _Descents(inside, ZonesOf(inside, go_on), for_scene(settings, units), descent, seed, deadline)
    best = search.best(None if start is None else _as_start(search.problem, start, units))
    trip = Trip(search.problem.frame, best.trajectory.settled()).outside(units)
    certificate = best.verdict.outside(units)
    status, reason = _verdict(scenario, trip, best, certificate)
    return Plan(
        scenario=scenario.name,
        status=status,
        reason=reason,
        trip=trip,
        method="penalty-descent",
        solver=descent.variant.value,
        iterations=search.tally.iterations,
        wall_time=perf_counter() - began,
        clearance=certificate.clearance,
        limits=certificate.limits,
        lower_bound=search.ready.lower_bound * units.time,
        planned=scenario,
        timings=search.tally.timings,
        converged=best.run.status is DescentStatus.CONVERGED,
    )


@dataclass(frozen=True)
class _DescentStart:
    """A trip to descend from, the estimate of the travel time that it leads to, s, and its number."""

    estimate: float
    trajectory: Trajectory
    number: int


class _Descents(OuterSearch[_DescentStart, DescentRun]):
    """Descends from one start after the other, in the units of the scene."""

    def __init__(
        self,
        scenario: Scenario,
        zones: Sequence[ThreatZone],
        settings: SceneSettings,
        descent: DescentSettings,
        seed: int,
        deadline: float,
    ) -> None:
        self.settings, self.descent, self.seed = settings, descent, seed
        self.tally = Tally("build", "search", "descent", "certificate")
        self.threat_zones = tuple(zones)
        with self.tally.timed("build"):
            self.ready = ReadyProblem.of(build_problem(scenario, self.threat_zones, settings))
        self.problem = self.ready.near
        super().__init__(self.ready.lower_bound, settings.effort, deadline)

    def best(self, only: Trajectory | None) -> CheckedDescent:
        """Return the best attempt from any start, or from the only one."""
        best = self.try_all(self._starts() if only is None else [_DescentStart(only.travel_time, only, 0)])
        assert best is not None, "there is always a start"
        return best

    def tried(self, start: _DescentStart) -> CheckedDescent:
        """Descend; once more from there if the trip met what was left out."""
        attempt = self._attempt(self.problem, start.trajectory, start.number)
        if met_what_was_left_out(self.problem, attempt.verdict):
            attempt = self._attempt(self.ready.everything, attempt.trajectory, start.number)
        return attempt

    def _attempt(self, problem: Problem, start: Trajectory, number: int) -> CheckedDescent:
        descent = Descent(problem, start, self.descent, seed=self.seed + number, deadline=self.deadline)
        attempt = checked_descent(problem, self.threat_zones, descent, self.tally.timings)
        self.tally.iterations += attempt.run.iterations
        return attempt

    def _starts(self) -> Iterator[_DescentStart]:
        """Starts, as long as they may lead to faster trips."""
        found = starts(self.problem, self.settings.searches, self.deadline)
        for number in range(self.settings.max_runs):
            with self.tally.timed("search"):
                item = next(found, None)
            if item is None or self._hardly_faster(item[0]):
                return
            yield _DescentStart(*item, number)

    def _hardly_faster(self, estimate: float) -> bool:
        best = self.incumbent
        if best is None or not best.holds:
            return False
        return estimate - (self.estimate - best.travel_time) - ESTIMATE_SLACK > best.travel_time


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
    theta = problem.ends.theta.copy()
    theta[problem.ends.free] = trajectory.theta[problem.ends.free]
    return Trajectory.of(mine, theta, trajectory.beta)


def _verdict(
    scenario: Scenario, trip: Trip, best: CheckedDescent, certificate: Certificate
) -> tuple[PlanStatus, str | None]:
    if certificate.holds:
        return PlanStatus.CERTIFIED, None
    told = grave_violations(scenario, trip, certificate)
    reason = f"{best.run.status.value}: " + "; ".join(str(violation) for violation in told)
    return (PlanStatus.FEASIBLE if best.run.feasible else PlanStatus.INFEASIBLE), reason
