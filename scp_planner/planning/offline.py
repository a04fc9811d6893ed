"""From a scenario to a certified plan: ways round, runs of the loop, the best trip that the certificate holds for."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from math import cos, dist, inf, sin
from time import perf_counter
from typing import TYPE_CHECKING

import numpy as np

from scp_planner.arrays import Array
from scp_planner.certificate.lower_bound import ground_bound, kinematic_bound
from scp_planner.certificate.verdict import Certificate, Clearance
from scp_planner.pauses import OutOfTimeError
from scp_planner.planning.along_routes import AlongGuide, OtherRoutes, Routes, along_a_guide, guide_on
from scp_planner.planning.attempts import Attempt, Tally
from scp_planner.planning.explain import Ending, explain
from scp_planner.planning.in_tube import plan_in_tube
from scp_planner.planning.last_resorts import MoreEffort, StricterLimits
from scp_planner.planning.legs import may_have_legs, plan_of_legs
from scp_planner.planning.meeting_search import MeetingSearch
from scp_planner.planning.over_map import plan_over_map
from scp_planner.planning.over_places import plan_over_places
from scp_planner.planning.plan import Plan, PlanStatus
from scp_planner.planning.refinements import at_any_time, from_trip, on_a_step, refinements, with_short_spans
from scp_planner.planning.runs import CheckedRuns, OwnConstraints, ScpRun, Task
from scp_planner.planning.trip_search import TripSearch
from scp_planner.planning.ways_round import ways_round
from scp_planner.problem.memory import check_obstacles
from scp_planner.problem.preparation import asked_for_time, last_check
from scp_planner.scenario.checks import same_place
from scp_planner.scenario.goal_checks import goal_is_elsewhere
from scp_planner.scenario.models import Scenario
from scp_planner.scenario.scale import OTHER_LENGTH, TRIP_LENGTH
from scp_planner.scenario.tolerances import SAME_PLACE
from scp_planner.scenario.units import NaturalUnits, changed
from scp_planner.scp.record import LoopRun, LoopStatus
from scp_planner.settings.planning import Settings, for_scene
from scp_planner.solvers import QpSolver
from scp_planner.threat_zones.of_scenario import ZonesOf, tell_of_discs, zones, zones_of
from scp_planner.threat_zones.sorted_zones import told_of
from scp_planner.threat_zones.target import TargetMotion
from scp_planner.threat_zones.zone import ThreatZone
from scp_planner.trips.trip import Trip

if TYPE_CHECKING:
    from scp_planner.scp.given import UserConstraints
    from scp_planner.threat_zones.error_tube import TrackingTube

GETS_AWAY = (
    "no trip meets the target: at no time is it as near to the start as the vehicle can have driven by then, at full"
    " acceleration up to its top speed"
)
PROOF_TIME = 1.0  # s of wall time; what a proof that there is no trip may take


def plan(
    scenario: Scenario,
    settings: Settings | None = None,
    solver: str | QpSolver | None = None,
    time_limit: float | None = None,
    constraints: UserConstraints | None = None,
    tube: TrackingTube | None = None,
) -> Plan:
    """Plan the fastest safe trip of a scenario. Nothing is drawn at random: the same input gives the same plan.

    Parameters
    ----------
    scenario : Scenario
    settings : Settings, optional
    solver : str or QpSolver, optional
        Overrides ``settings.solver``: a name, or a solver of one's own. No other solver takes the place of one's own
        when that fails.
    time_limit : float, optional
        Wall time in s after which the best plan so far is returned.
    constraints : callable, optional
        ``constraints(trip)`` returns convex CVXPY constraints on a :class:`scp_planner.TripVariables`. They go into
        every subproblem, which CVXPY then solves (``solver`` may be a ``CvxpySolver`` with another solver inside).
    tube : TrackingTube, optional
        How far the vehicle may be from its plan, by speed and lateral acceleration: wherever it may be, it keeps clear
        and in the workspace. Then several trips may have to be planned.

    Returns
    -------
    Plan
        With status ``certified`` only if the continuous-time certificate holds, and the given constraints are kept to
        a hundred-thousandth of the trip's length; else the best attempt, with the reason.

    Raises
    ------
    ValueError
        If the time limit is negative; if no solver has that name; if there are constraints and the solver is another
        than CVXPY; if a constraint is not convex by the rules of CVXPY.
    TypeError
        If the scenario is none, or ``constraints`` returns something else than constraints.
    EstimationError
        If the vehicle may drive or turn faster than the tube was recorded for.
    TooLargeError
        If it would take more than 500 MB; with the reason, and what to change.
    """
    if time_limit is not None and not time_limit >= 0.0:
        raise ValueError(f"time_limit: {time_limit!r} must not be negative")
    if tube is not None:

        def without(roomier: Scenario, left: float | None) -> Plan:
            return plan(roomier, settings, solver, left, constraints)

        return plan_in_tube(scenario, tube, without, time_limit)
    NaturalUnits.of(scenario)  # which refuses what is no scenario

    def over_ground(within: Scenario, left: float | None, along: Array | None = None) -> Plan:
        if along is not None:
            return planned(within, settings, solver, left, constraints, along=along)
        if constraints is not None or not may_have_legs(within):
            return planned(within, settings, solver, left, constraints)
        # What is estimated is known less well at a later start: all legs keep clear of the zones at the first one
        try:
            found = zones_of(within, asked_for_time(inf if left is None else left, perf_counter()))
        except OutOfTimeError:  # which is told of the trip without them
            return planned(within, settings, solver, 0.0)

        def one(scene: Scenario, left: float | None, thorough: bool) -> Plan:
            return planned(scene, settings, solver, left, thorough=thorough, threat_zones=found)

        return plan_of_legs(within, one, left, found)

    if scenario.ground is None:
        return over_ground(scenario, time_limit)
    return plan_over_map(scenario, over_ground, time_limit)


def planned(
    scenario: Scenario,
    settings: Settings | None = None,
    solver: str | QpSolver | None = None,
    time_limit: float | None = None,
    constraints: UserConstraints | None = None,
    *,
    thorough: bool = True,
    threat_zones: Sequence[ThreatZone] | None = None,
    along: Array | None = None,
    begin: Trip | None = None,
) -> Plan:
    """Plan a trip without a tube round it, see :func:`plan`; among zones that are at hand, if there are some.

    A route from start to goal, (n, 2) m, is driven ``along`` at first; or a trip is where the search begins and ends.
    """
    began = perf_counter()
    settings, scenario = settings or Settings(), _apart(scenario)
    if scenario.goals and scenario.guide is None:

        def guided(one: Scenario, left: float | None, begin: Trip | None) -> Plan:
            return planned(
                one, settings, solver, left, constraints, thorough=thorough, threat_zones=threat_zones, begin=begin
            )

        return plan_over_places(scenario, settings, guided, time_limit)
    if constraints is not None and solver is None and settings.solver == Settings.solver:
        solver = "cvxpy"
    if isinstance(solver, str):
        settings, solver = replace(settings, solver=solver), None
    check_obstacles(len(scenario.obstacles))
    call = _Call(scenario, settings, began, time_limit, solver, constraints, thorough, threat_zones)
    try:
        return _searched(call, along, begin)
    except OutOfTimeError as error:  # before all obstacles were ready: without them no trip is known to be safe
        alone = replace(call, scenario=changed(scenario, obstacles=(), walls=()), time_limit=0.0, threat_zones=None)
        found = _searched(replace(alone, began=perf_counter()), None, None)
        unchecked = replace(found, status=PlanStatus.INFEASIBLE, reason=str(error), clearance=Clearance(-np.inf))
        return replace(unchecked, planned=scenario, wall_time=perf_counter() - began)


def _apart(scenario: Scenario) -> Scenario:
    """Return a scenario whose start is not at its goal: a vehicle in a wide goal that is not as asked has to move."""
    start, goal = scenario.start.position, scenario.goal
    if goal.target is not None or not any(goal_is_elsewhere(scenario)):
        return scenario
    goal = changed(goal, radius=0.0, region=None)
    if not same_place(start, goal.position):
        return changed(scenario, goal=goal)
    away = 4.0 * SAME_PLACE * max(scenario.vehicle.radius, *map(abs, start))
    angle = scenario.start.heading or 0.0
    ahead = (start[0] + away * cos(angle), start[1] + away * sin(angle))
    return changed(scenario, goal=changed(goal, position=ahead), guide=None)


def _searched(call: _Call, along: Array | None, begin: Trip | None) -> Plan:
    """Search for a trip, in units of the straight way, or of the route that is driven if that is far longer."""
    scenario, began, constraints = call.scenario, call.began, call.constraints
    units = NaturalUnits.of(scenario, None if along is None else float(np.hypot(*np.diff(along, axis=0).T).sum()))
    inside, task = call.task(units)
    if isinstance(task.threat_zones, ZonesOf):
        tell_of_discs(scenario.obstacles, task.threat_zones.of_others)
    target = TargetMotion.of(inside)
    if target is not None:
        return _plan_to_meet(call, target, inside, task, units)
    known = _guided(task, units, along, begin)
    if known is not None and known.best is not None:
        return _told(scenario, known.lower_bound, on_a_step(task, inside, known.best), units, began)
    runs = CheckedRuns(task)
    routes = None if constraints is not None else Routes.of(runs.everything, task.deadline)
    first = None if routes is None else routes.first_beside(runs.everything.space.guide)
    if first is None:
        bends = routes is not None and routes.bends
        search = TripSearch(with_short_spans(CheckedRuns(_bounded(task)) if bends else runs, bends=bends))
    else:
        # The scene's units are those of the trip, which is longer than the straight line to the goal
        units = NaturalUnits.of(scenario, first.length * units.length)
        inside, task = call.task(units, task.tally)
        task = _bounded(task)
        everything = CheckedRuns(task).everything
        routes = Routes.of(everything, task.deadline)
        first = None if routes is None else routes.next()
        guide = None if routes is None or first is None else routes.take(first, everything)
        search = TripSearch(CheckedRuns(task, guide))
    search.walk(attempts(search, routes, first is not None))
    assert search.best is not None, "the first run is never cut off"
    made = _told(scenario, search.lower_bound, on_a_step(task, inside, search.best), units, began)
    if made.reason is None or routes is None:
        return made
    return replace(made, reason=made.reason + routes.told(scenario, units))


def _plan_to_meet(call: _Call, target: TargetMotion, inside: Scenario, task: Task, units: NaturalUnits) -> Plan:
    """Plan a trip to a target, in units of the way to where it can first be met if the given ones are far from that."""
    least = kinematic_bound(inside)
    length = dist(inside.start.position, target.place(inside.start.time + least)) if least < np.inf else 0.0
    if length > 0.0 and not 1.0 / OTHER_LENGTH <= length / TRIP_LENGTH <= OTHER_LENGTH:
        units = NaturalUnits.of(call.scenario, length * units.length)
        inside, task = call.task(units, task.tally)
        target, least = TargetMotion.met(inside, inside.goal), kinematic_bound(inside)
    return _told(call.scenario, least, MeetingSearch(task, inside, target, least, _fastest).run(), units, call.began)


def _guided(task: Task, units: NaturalUnits, along: Array | None, begin: Trip | None) -> TripSearch | None:
    """Search along a route, or from a trip, where one is given."""
    if begin is not None:
        search = from_trip(task, begin.inside(units).trajectory)
        search.walk(refinements(task))
        return search
    if along is None:
        return None
    search = TripSearch(
        CheckedRuns(task, guide_on(task.scenario, (along - units.origin) / units.length, for_scene(task.settings)))
    )
    search.walk(attempts(search, None, along=False))
    assert search.best is not None, "the first run is never cut off"
    return search


def _fastest(task: Task, known: ScpRun | None) -> ScpRun | None:
    """Return the fastest trip of a task, in the units that it is in; None if none is faster than the known one."""
    runs = CheckedRuns(task)
    routes = None if task.given is not None else Routes.of(runs.everything, task.deadline)
    first = None if routes is None else routes.first_beside(runs.everything.space.guide)
    if routes is not None and first is not None:
        runs = CheckedRuns(task, routes.take(first, runs.everything))
    else:
        runs = with_short_spans(runs, bends=routes is not None and routes.bends)
    search = TripSearch(runs, np.inf if known is None else known.travel_time, known)
    search.walk(attempts(search, routes, first is not None))
    return search.best


def _bounded(task: Task) -> Task:
    """A task that knows how long the way round what stands takes at least."""
    with task.tally.timed("search"):
        least = ground_bound(task.scenario, task.threat_zones, task.deadline)
    return replace(task, least_time=least if np.isfinite(least) else 0.0)


@dataclass(frozen=True)
class _Call:
    """A call of :func:`planned`, ready to be made a task of in any units."""

    scenario: Scenario
    settings: Settings
    began: float
    time_limit: float | None
    solver: QpSolver | None
    constraints: UserConstraints | None
    thorough: bool
    threat_zones: Sequence[ThreatZone] | None

    def task(self, units: NaturalUnits, tally: Tally | None = None) -> tuple[Scenario, Task]:
        """The scenario in some units, and the task of planning it; its tally goes on with another one."""
        limit = np.inf if self.time_limit is None else self.time_limit
        go_on = asked_for_time(limit, self.began)
        inside = units.scenario(self.scenario, go_on)
        any_time, known = at_any_time(inside), self.threat_zones
        task = Task(
            any_time,
            ZonesOf(any_time, go_on) if known is None else tuple(zone.inside(units) for zone in known),
            for_scene(self.settings, units),
            self.began + limit,
            last_check(limit, self.began),
            own_solver=self.solver,
            given=None if self.constraints is None else OwnConstraints(self.constraints, units),
            arrival_step=inside.goal.arrival_step,
            thorough=self.thorough,
        )
        return inside, task if tally is None else replace(task, tally=tally)


def attempts(search: TripSearch, routes: Routes | None, along: bool) -> Iterator[Attempt[TripSearch, ScpRun]]:
    """Yield the attempts of a plan, in order; which ones follow, and what they may cost, depends on those before."""
    yield from along_a_guide(search.runs) if along else ways_round(search.runs)
    if not along and search.runs.problem.profile is not None:
        yield AlongGuide()
    if routes is not None:
        yield OtherRoutes(routes, search.runs.most_ways)
    if search.task.given is None:
        yield StricterLimits()
        yield MoreEffort()
    best, goal = search.best or search.rival, search.task.scenario.goal
    search.best = best
    if search.task.given is not None or best is None:  # constraints are written in stations of the guide
        return
    late = goal.latest_arrival is not None and search.task.scenario.start.time + best.travel_time > goal.latest_arrival
    if search.task.thorough or best.holds or not late:
        yield from refinements(search.task)


def _told(scenario: Scenario, lower_bound: float, best: ScpRun, units: NaturalUnits, began: float) -> Plan:
    """The best attempt as a plan in the user's units, with the reason if it is none to be driven."""
    runs = best.runs
    trip, found = runs.trip(best.trajectory).outside(units), best.verdict.outside(units)
    status = _status(best.run, best.verdict, lower_bound)
    return Plan(
        scenario=scenario.name,
        status=status,
        reason=None if status is PlanStatus.CERTIFIED else _reason(scenario, runs.task, best, trip, units, lower_bound),
        trip=trip,
        method="scp",
        solver=runs.solver.name,
        iterations=runs.task.tally.iterations,
        wall_time=perf_counter() - began,
        clearance=found.clearance,
        limits=found.limits,
        lower_bound=lower_bound * units.time,
        timings=runs.task.tally.timings,
        converged=best.run.status is LoopStatus.CONVERGED,
        planned=scenario,
    )


def _reason(scenario: Scenario, task: Task, best: ScpRun, trip: Trip, units: NaturalUnits, lower_bound: float) -> str:
    """Why there is no certified plan; with a proof, where there is time for one and a trip is hardly to be had."""
    if lower_bound == np.inf:
        return GETS_AWAY
    now, deadline = perf_counter(), task.deadline
    hopeless = task.thorough and deadline - now > PROOF_TIME and (best.late or not best.run.feasible)
    ending = Ending.of(best.run, dict(task.tally.tried), units.time)
    found = best.verdict.outside(units)
    if hopeless:
        return explain(scenario, zones(scenario), trip, ending, found, prove_until=deadline)
    names = {violation.obstacle for violation in found.violations if violation.obstacle is not None}
    told = [zone.outside(units) for zone in told_of(task.threat_zones, names)] if names else []
    return explain(scenario, told, trip, ending, found, prove_until=now)


def _status(run: LoopRun, certificate: Certificate, lower_bound: float) -> PlanStatus:
    if lower_bound == np.inf:
        return PlanStatus.INFEASIBLE
    if certificate.holds:
        return PlanStatus.CERTIFIED
    if certificate.late:
        return PlanStatus.INFEASIBLE
    if run.status is LoopStatus.SOLVER_FAILED and not run.record:
        return PlanStatus.FAILED
    return PlanStatus.FEASIBLE if run.feasible else PlanStatus.INFEASIBLE
