"""The published method's baseline: penalty descent from the planner's starts, to the same plan and certificate.

What one descent does is in `scp_planner.baseline.descent`; the objective is that of all methods (objective.py). Nothing
is linearised and no subproblem is solved.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from time import perf_counter

import numpy as np

from scp_planner.baseline.descent import CheckedDescent, Descent, DescentSettings, DescentStatus, checked_descent
from scp_planner.certificate.lower_bound import kinematic_bound
from scp_planner.certificate.verdict import Certificate
from scp_planner.planning.explain import grave_violations
from scp_planner.planning.offline import GOOD_ENOUGH
from scp_planner.planning.plan import Plan, PlanStatus
from scp_planner.problem.build import build_problem
from scp_planner.problem.near_zones import LONGEST_TRIP, without_far_zones
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
    """
    began = perf_counter()
    settings, descent = settings or Settings(), descent or DescentSettings()
    deadline = np.inf if time_limit is None else began + time_limit
    units = NaturalUnits.of(scenario)
    inside = units.scenario(scenario)
    search = _Search(inside, tuple(ZonesOf(inside)), for_scene(settings, units), descent, seed, deadline)
    best = search.best(None if start is None else _as_start(search.problem, start, units))
    trip = Trip(search.problem.frame, best.run.trajectory.settled()).outside(units)
    certificate = best.certificate.outside(units)
    status, reason = _verdict(scenario, trip, best, certificate)
    return Plan(
        scenario=scenario.name,
        status=status,
        reason=reason,
        trip=trip,
        method="penalty-descent",
        solver=descent.variant.value,
        iterations=search.iterations,
        wall_time=perf_counter() - began,
        clearance=certificate.clearance,
        limits=certificate.limits,
        lower_bound=search.least * units.time,
        timings=search.timings,
        converged=best.run.status is DescentStatus.CONVERGED,
    )


@dataclass
class _Search:
    """The state of one call of :func:`penalty_descent`, all of it in the units of the scene."""

    scenario: Scenario
    threat_zones: tuple[ThreatZone, ...]
    settings: SceneSettings
    descent: DescentSettings
    seed: int
    deadline: float
    timings: dict[str, float] = field(
        default_factory=lambda: {"build": 0.0, "search": 0.0, "descent": 0.0, "certificate": 0.0}
    )
    iterations: int = 0

    def __post_init__(self) -> None:
        clock = perf_counter()
        self.least = kinematic_bound(self.scenario)
        self.everything = build_problem(self.scenario, self.threat_zones, self.settings)
        self.problem = without_far_zones(self.everything, LONGEST_TRIP * self.least)
        self.timings["build"] = perf_counter() - clock

    def best(self, only: Trajectory | None) -> CheckedDescent:
        """Descend from one start after the other, until no other can be expected to be better."""
        best: CheckedDescent | None = None
        reference, least = 0.0, self.least
        for number, (estimate, start) in enumerate(self._starts(only)):
            if best is not None and best.certificate.holds:
                time = best.run.trajectory.travel_time
                if estimate - reference - ESTIMATE_SLACK > time or time <= least * (1.0 + GOOD_ENOUGH):
                    break
            attempt = self._attempt(self.problem, start, number)
            if any(v.obstacle not in (None, *self.problem.zones.ids) for v in attempt.certificate.violations):
                # a trip longer than expected met what was left out
                attempt = self._attempt(self.everything, attempt.run.trajectory, number)
            if attempt.better_than(best):
                best, reference = attempt, estimate - attempt.run.trajectory.travel_time
            if perf_counter() > self.deadline:
                break
        assert best is not None, "there is always a start"
        return best

    def _attempt(self, problem: Problem, start: Trajectory, number: int) -> CheckedDescent:
        descent = Descent(problem, start, self.descent, seed=self.seed + number, deadline=self.deadline)
        attempt = checked_descent(problem, self.threat_zones, descent, self.timings)
        self.iterations += attempt.run.iterations
        return attempt

    def _starts(self, only: Trajectory | None) -> Iterator[tuple[float, Trajectory]]:
        if only is not None:
            yield only.travel_time, only
            return
        clock = perf_counter()
        for number, item in enumerate(starts(self.problem, self.settings.searches)):
            if number >= self.settings.max_runs:
                return
            self.timings["search"] += perf_counter() - clock
            yield item
            clock = perf_counter()


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
