"""A trip over places to pass: planned along guides that lead over them, round what stands."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise
from time import perf_counter

import numpy as np

from scp_planner.arrays import Array
from scp_planner.errors import TooLargeError
from scp_planner.mathematics.frames import PlanningFrame
from scp_planner.mathematics.taut import TautLines
from scp_planner.pauses import OutOfTimeError
from scp_planner.planning.plan import Plan
from scp_planner.problem.guides import over_places
from scp_planner.routes.outlines import polygons_around, standing_shapes
from scp_planner.scenario.limits import Box
from scp_planner.scenario.models import Scenario
from scp_planner.scenario.units import NaturalUnits
from scp_planner.settings.planning import Settings, for_scene
from scp_planner.threat_zones.batch import ZoneBatch
from scp_planner.threat_zones.of_scenario import zones

PlanOne = Callable[[Scenario, float | None], Plan]
"""Plans a trip along the guide of a scenario within a wall time, s."""


def plan_over_places(scenario: Scenario, settings: Settings, plan_one: PlanOne, time_limit: float | None) -> Plan:
    """Plan over each guide that leads over the places to pass; return the fastest of the certified plans."""
    began, made = perf_counter(), list[Plan]()
    legs = _legs(scenario, settings, np.inf if time_limit is None else began + time_limit)
    guided = over_places(scenario, legs)
    for number, one in enumerate(guided):
        left = None if time_limit is None else max(time_limit - (perf_counter() - began), 0.0) / (len(guided) - number)
        made.append(plan_one(one, left))
    best = min(made, key=lambda plan: (not plan.certified, plan.travel_time))
    iterations = sum(plan.iterations for plan in made)
    return replace(best, planned=scenario, iterations=iterations, wall_time=perf_counter() - began)


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
