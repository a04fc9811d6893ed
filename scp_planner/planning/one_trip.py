"""One trip of a scene whose order, ground and gears are decided: searched for in the units of the scene."""

from __future__ import annotations

from dataclasses import replace
from math import dist, inf
from time import perf_counter

import numpy as np

from scp_planner.certificate.lower_bound import kinematic_bound
from scp_planner.certificate.verdict import Certificate, Clearance
from scp_planner.pauses import Budget, OutOfTimeError
from scp_planner.planning.explain import GETS_AWAY, Ending, explain
from scp_planner.planning.fastest_trip import fastest_of, fastest_trip, from_trip, on_line, prepare
from scp_planner.planning.plan import Plan, PlanStatus
from scp_planner.planning.runs import CheckedRuns, ScpRun
from scp_planner.planning.sources.one_meeting import MeetingSearch
from scp_planner.planning.sources.refinements import on_a_step, with_short_spans
from scp_planner.planning.task import Request, Skeleton, Task
from scp_planner.scenario.models import Scenario
from scp_planner.scenario.scale import OTHER_LENGTH, TRIP_LENGTH
from scp_planner.scenario.units import NaturalUnits, changed
from scp_planner.scp.record import LoopRun, LoopStatus
from scp_planner.threat_zones.of_scenario import ZonesOf, tell_of_discs, zones
from scp_planner.threat_zones.sorted_zones import told_of
from scp_planner.threat_zones.target import TargetMotion

PROOF_TIME = 1.0  # s of wall time; what a proof that there is no trip may take


def plan_trip(request: Request, skeleton: Skeleton) -> Plan | None:
    """Plan the fastest trip of a scene, or the best attempt with the reason; None if it cannot beat a known time."""
    began, scenario = perf_counter(), skeleton.scenario
    try:
        made = _search_trip(request, skeleton)
    except OutOfTimeError as error:  # before all obstacles were ready: without them no trip is known to be safe
        alone = changed(scenario, obstacles=(), walls=())
        at_once = replace(request, budget=Budget.within(0.0), threat_zones=None, known=inf)
        found = _search_trip(at_once, Skeleton(alone))
        assert found is not None, "without a known time there is a trip"
        made = replace(found, status=PlanStatus.INFEASIBLE, reason=str(error), clearance=Clearance(-np.inf))
    return made and replace(made, planned=scenario, wall_time=perf_counter() - began)


def _search_trip(request: Request, skeleton: Skeleton) -> Plan | None:
    """Search for a trip, in units of the straight line, or of the route that is driven if that is far longer."""
    scenario, line = skeleton.scenario, skeleton.line
    units = NaturalUnits.of(scenario, None if line is None else float(np.hypot(*np.diff(line, axis=0).T).sum()))
    inside, task = request.task(scenario, units)
    if isinstance(task.threat_zones, ZonesOf):
        tell_of_discs(scenario.obstacles, task.threat_zones.of_others)
    if inside.goal.target is not None:
        return _to_meet(request, skeleton, units, inside, task)
    known = None
    if skeleton.begin is not None:
        known = from_trip(task, skeleton.begin.inside(units).trajectory)
    elif line is not None:
        known = on_line(task, (line - units.origin) / units.length)
    if known is not None:
        if known.best is None:
            return None
        return _as_plan(skeleton, known.lower_bound, on_a_step(task, inside, known.best), units)
    runs, routes, first = prepare(task)
    if first is not None:
        # The scene's units are those of the trip, which is longer than the straight line to the goal
        units = NaturalUnits.of(scenario, first.length * units.length)
        inside, task = request.task(scenario, units, task.log)
        task = task.bounded
        runs, routes, first = prepare(task, beside=False)
    else:
        bends = routes is not None and routes.bends
        runs = with_short_spans(CheckedRuns(task.bounded) if bends else runs, bends=bends)
    search = fastest_trip(runs, routes, first, request.known / units.time)
    if search.best is None:
        return None
    made = _as_plan(skeleton, search.lower_bound, on_a_step(task, inside, search.best), units)
    if made.reason is None or routes is None:
        return made
    return replace(made, reason=made.reason + routes.told(scenario, units))


def _to_meet(request: Request, skeleton: Skeleton, units: NaturalUnits, inside: Scenario, task: Task) -> Plan:
    """Plan a trip to a target, in units of the way to where it can first be met if the given ones are far from that."""
    target, least = TargetMotion.met(inside, inside.goal), kinematic_bound(inside)
    length = dist(inside.start.position, target.place(inside.start.time + least)) if least < np.inf else 0.0
    if length > 0.0 and not 1.0 / OTHER_LENGTH <= length / TRIP_LENGTH <= OTHER_LENGTH:
        units = NaturalUnits.of(skeleton.scenario, length * units.length)
        inside, task = request.task(skeleton.scenario, units, task.log)
        target, least = TargetMotion.met(inside, inside.goal), kinematic_bound(inside)
    return _as_plan(skeleton, least, MeetingSearch(task, inside, target, least, fastest_of).run(), units)


def _as_plan(skeleton: Skeleton, lower_bound: float, best: ScpRun, units: NaturalUnits) -> Plan:
    """Return the plan of a run in the user's units; with a reason, unless it is certified."""
    scenario, runs, log = skeleton.scenario, best.runs, best.runs.task.log
    trip, found = runs.trip(best.trajectory).outside(units), best.verdict.outside(units)
    status = _status(best.run, best.verdict, lower_bound)
    made = Plan(
        scenario=scenario.name,
        status=status,
        reason=None,
        trip=trip,
        method="scp",
        solver=runs.solver.name,
        iterations=log.iterations,
        wall_time=0.0,
        clearance=found.clearance,
        limits=found.limits,
        lower_bound=lower_bound * units.time,
        timings=log.timings,
        converged=best.run.status is LoopStatus.CONVERGED,
        tried=tuple(one.outside(units.time, *skeleton.decided) for one in log.skeletons),
    )
    if status is PlanStatus.CERTIFIED:
        return made
    return replace(made, reason=_reason(scenario, best, made, units, lower_bound))


def _reason(scenario: Scenario, best: ScpRun, made: Plan, units: NaturalUnits, lower_bound: float) -> str:
    """Explain why no plan is certified; with a proof that there is no trip, if there is time for one."""
    if lower_bound == np.inf:
        return GETS_AWAY
    task = best.runs.task
    now, deadline = perf_counter(), task.budget.deadline
    hopeless = task.thorough and deadline - now > PROOF_TIME and (best.late or not best.run.feasible)
    ending = Ending.of(best.run, dict(task.log.tried), units.time)
    found = best.verdict.outside(units)
    if hopeless:
        return explain(scenario, zones(scenario), made.trip, ending, found, prove_until=deadline)
    names = {violation.obstacle for violation in found.violations if violation.obstacle is not None}
    told = [zone.outside(units) for zone in told_of(task.threat_zones, names)] if names else []
    return explain(scenario, told, made.trip, ending, found, prove_until=now)


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
