"""A trip over places to pass: planned along guides that lead over them, round what stands."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from itertools import pairwise
from math import dist, inf
from time import perf_counter

import numpy as np

from scp_planner.arrays import Array
from scp_planner.errors import TooLargeError
from scp_planner.mathematics.frames import PlanningFrame
from scp_planner.mathematics.taut import TautLines
from scp_planner.pauses import OutOfTimeError
from scp_planner.planning.plan import Plan
from scp_planner.planning.visits import Visit, fixed, visits
from scp_planner.problem.guides import over_places
from scp_planner.routes.outlines import polygons_around, standing_shapes
from scp_planner.scenario.limits import Box
from scp_planner.scenario.models import Scenario
from scp_planner.scenario.units import NaturalUnits, changed
from scp_planner.settings.planning import Settings, for_scene
from scp_planner.threat_zones.batch import ZoneBatch
from scp_planner.threat_zones.of_scenario import zones
from scp_planner.trips.trip import Trip


@dataclass(frozen=True)
class OverPlacesSettings:
    """Work of a plan over places."""

    orders: int = 3  # that are planned, where any will do
    rounds: int = 4  # to targets that move, at most
    slow: float = 1.05  # times the time that is expected of a trip, from which on other guides are tried, too
    near: float = 0.3  # units of length, from where a target was taken to be, for a trip that is led to where it is


OVER_PLACES = OverPlacesSettings()
PlanOne = Callable[[Scenario, float | None, Trip | None], Plan]
"""Plans a trip along the guide of a scenario within a wall time, s; from a trip over it, if there is one."""


@dataclass(frozen=True)
class _Tried:
    """A plan, and whether it is one of the scenario: not one to where its targets stood in for themselves."""

    plan: Plan
    counts: bool


def plan_over_places(scenario: Scenario, settings: Settings, plan_one: PlanOne, time_limit: float | None) -> Plan:
    """Plan over the places to pass, in the best orders; return the fastest of the certified plans.

    Targets stand at first where they are about when they are met, and then move: the trip over those places is led to
    where they really are. Where that fails, it says when they are met, and they stand there for the next one.
    """
    began, tried = perf_counter(), list[_Tried]()
    deadline = inf if time_limit is None else began + time_limit
    asked = visits(scenario, OVER_PLACES.orders)
    for place, visit in enumerate(asked):
        best = min((one.plan for one in tried if one.counts), key=_rank, default=None)
        if best is not None and (perf_counter() > deadline or (best.certified and best.travel_time <= visit.arrival)):
            break
        share = deadline if time_limit is None else began + time_limit * (place + 1) / len(asked)
        tried += _in_order(scenario, visit, settings, plan_one, share)
    iterations = sum(one.plan.iterations for one in tried)
    best = min((one.plan for one in tried if one.counts), key=_rank)
    return replace(best, planned=scenario, iterations=iterations, wall_time=perf_counter() - began)


def _in_order(
    scenario: Scenario, visit: Visit, settings: Settings, plan_one: PlanOne, deadline: float
) -> Iterator[_Tried]:
    """Plan over the places in one order until a plan is certified."""
    moves = any(one.target is not None for one in scenario.goals)

    def planned(one: Scenario, parts: int, begin: Trip | None = None) -> Plan:
        left = None if deadline == inf else max(deadline - perf_counter(), 0.0) / parts
        return plan_one(one, left, begin)

    best_guide, again = 0, visit.taken(scenario)
    for number in range(OVER_PLACES.rounds):
        one, found = again, dict[int, Plan]()
        guided = over_places(fixed(one), _legs(one, settings, deadline))
        for place in sorted(range(len(guided)), key=lambda place: place != best_guide):
            if number == 0 or not any(_expected(each, visit) for each in found.values()):
                found[place] = planned(guided[place], len(guided) - len(found) + moves)
        best_guide = min(found, key=lambda place: _rank(found[place]))
        nearest = found[best_guide]
        yield from (_Tried(each, not moves) for each in found.values())
        if not moves:
            return
        visit = visit.led_by(one, nearest.trip)
        again = visit.taken(scenario)
        moved = max(dist(a.position, b.position) for a, b in zip(one.goals, again.goals, strict=True))
        last = number + 1 == OVER_PLACES.rounds or perf_counter() > deadline
        if moved > OVER_PLACES.near * NaturalUnits.of(one).length and not last:
            continue
        assert nearest.planned is not None
        led = planned(changed(one, guide=nearest.planned.guide), 1, nearest.trip)
        yield _Tried(led, True)
        if led.certified or last or moved == 0.0:
            return


def _expected(plan: Plan, visit: Visit) -> bool:
    return plan.certified and plan.travel_time <= OVER_PLACES.slow * visit.arrival


def _rank(plan: Plan) -> tuple[bool, float]:
    return not plan.certified, plan.travel_time


def _legs(scenario: Scenario, settings: Settings, deadline: float) -> list[Array]:
    """The shortest way from each place to the next one, (n, 2) m, round what stands; straight where there is none."""
    places = [scenario.start.position, *(one.position for one in scenario.goals), scenario.goal.position]
    straight = [np.array(pair) for pair in pairwise(places)]
    if not (scenario.obstacles or scenario.walls):
        return straight
    units, world = NaturalUnits.of(scenario), PlanningFrame((0.0, 0.0), 0.0, 0.0)
    margin = for_scene(settings, units)
    length = units.length
    batch = ZoneBatch.of(zones(scenario), world, scenario.vehicle.radius + length * margin.clearance_margin)
    shapes = standing_shapes(batch)
    box = Box.of(scenario, world, length * margin.box_margin)
    inside = list(zip(box.normals, box.offsets.tolist(), strict=True))
    found = list[Array]()
    for leg in straight:
        try:
            line = next(iter(TautLines(polygons_around(shapes, leg), leg[0], leg[1], inside, deadline)), None)
        except (OutOfTimeError, TooLargeError):
            line = None
        found.append(leg if line is None else line.points)
    return found
