"""A trip over a map: planned in convex ground along a route over its free cells, certified against the cells."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from time import perf_counter

import numpy as np

from scp_planner.certificate.check import certify
from scp_planner.certificate.lower_bound import kinematic_bound
from scp_planner.mathematics.frames import PlanningFrame
from scp_planner.mathematics.occupancy import OccupancyMap
from scp_planner.planning.plan import Plan, PlanStatus
from scp_planner.routes.outlines import StandingShape, standing_shapes
from scp_planner.routes.over_map import MAPS, MapRoutes
from scp_planner.scenario.models import Scenario
from scp_planner.scenario.units import changed
from scp_planner.threat_zones.batch import ZoneBatch
from scp_planner.threat_zones.of_scenario import zones

STEPS = 7  # of bisection for the widest passage, at most
LOOKING = 1.0  # s of wall time, after which it is not looked for any closer
PlanWithin = Callable[[Scenario, float | None], Plan]


def plan_over_map(scenario: Scenario, plan: PlanWithin, time_limit: float | None) -> Plan:
    """Plan a trip by ``plan(scenario without a map, time limit)``."""
    ground, began = scenario.ground, perf_counter()
    assert ground is not None
    bare = changed(scenario, ground=None)
    standing = ZoneBatch.of(
        zones(bare) if bare.obstacles or bare.walls else (), PlanningFrame((0.0, 0.0), 0.0, 0.0), 0.0
    )
    routes = MapRoutes(scenario, ground.map, standing_shapes(standing))
    route = routes.route()
    if route is None:
        found = _certified(scenario, plan(bare, _left(began, time_limit)))
        told = replace(found, status=PlanStatus.INFEASIBLE, reason=_no_route(scenario, ground.map, routes.standing))
        return found if found.certified else told
    pieces = tuple(tuple((float(x), float(y)) for x, y in piece) for piece in routes.along(route))
    within = bare.model_copy(update={"corridor": pieces})
    tried: Plan | None = None
    if scenario.guide is not None or len(pieces) <= MAPS.most_open:
        tried = _certified(scenario, plan(within, _left(began, time_limit)))
    if scenario.guide is None and (tried is None or not tried.certified):
        line = np.concatenate([[scenario.start.position], route[1:-1], [scenario.goal.position]])
        along = within.model_copy(update={"guide": line.tolist()})
        tried = _certified(scenario, plan(along, _left(began, time_limit)))
    assert tried is not None
    return replace(tried, wall_time=perf_counter() - began)


def _no_route(scenario: Scenario, ground: OccupancyMap, standing: Sequence[StandingShape]) -> str:
    """Say how wide the widest passage to the goal is."""
    radius = scenario.vehicle.radius
    fits, too_large, began = 0.0, radius, perf_counter()
    for _ in range(STEPS):
        if perf_counter() - began > LOOKING:
            break
        middle = 0.5 * (fits + too_large)
        smaller = changed(scenario, vehicle=changed(scenario.vehicle, radius=middle))
        if MapRoutes(smaller, ground, standing).route() is None:
            too_large = middle
        else:
            fits = middle
    told = f"no route over the map leads to the goal for a vehicle with a radius of {radius:g} m"
    if fits == 0.0:
        return told
    return (
        f"{told}: the widest passage is about {2.0 * fits:.2g} m wide, {2.0 * (radius - fits):.2g} m less than it takes"
    )


def _left(began: float, time_limit: float | None) -> float | None:
    return None if time_limit is None else max(time_limit - (perf_counter() - began), 0.0)


def _certified(scenario: Scenario, found: Plan) -> Plan:
    """Return a plan with what holds of it over the map."""
    verdict = certify(scenario, found)
    status = found.status
    if verdict.holds:
        status = PlanStatus.CERTIFIED
    elif found.certified:
        status = PlanStatus.FEASIBLE
    reason = None if verdict.holds else found.reason or "; ".join(map(str, verdict.violations))
    return replace(
        found,
        status=status,
        reason=reason,
        clearance=verdict.clearance,
        limits=verdict.limits,
        lower_bound=kinematic_bound(scenario),
        planned=scenario,
    )
