"""Rules of a goal, alone and in its scene."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

from scp_planner.mathematics import planar
from scp_planner.scenario.checks import ahead_of, polygon_faults, same_place, speed_is_within
from scp_planner.scenario.motions import Futures
from scp_planner.scenario.tolerances import SAME_PLACE
from scp_planner.scenario.validation import Objection

MOST_IN_ANY_ORDER = 8  # places to pass in any order


def goal_is_elsewhere(scenario: Any) -> Iterator[Objection]:
    """The goal, with its radius, does not hold the start."""
    start, goal = scenario.start.position, scenario.goal.position
    if scenario.goal.region is not None:
        middle = ahead_of(scenario.start, scenario.vehicle.centre)
        region = scenario.goal.region
        if not any(polygon_faults(region)) and planar.distance_to_polygon(middle, region) == 0.0:
            yield Objection(("goal", "region"), region, "must not hold the middle of the vehicle at the start")
    if same_place(start, goal):
        yield Objection(("goal", "position"), goal, "must not be the start's position")
    elif math.dist(start, goal) <= scenario.goal.radius and scenario.goal.target is None:
        text = f"must be less than {math.dist(start, goal):g}, the distance from start to goal"
        yield Objection(("goal", "radius"), scenario.goal.radius, text)


def goal_position_is_at_its_region(scenario: Any) -> Iterator[Objection]:
    """The middle of a vehicle whose reference point is at the goal's position can be in the goal's region."""
    goal, ahead = scenario.goal, abs(scenario.vehicle.centre)
    if goal.region is None or any(polygon_faults(goal.region)):
        return
    away = planar.distance_to_polygon(goal.position, goal.region)
    if away > ahead + SAME_PLACE * max(map(abs, goal.position)):
        text = f"must be in goal.region, or at most {ahead:g} m, vehicle.centre, from it; it is {away:.6g} m"
        yield Objection(("goal", "position"), goal.position, text)


def goal_speed_is_allowed(scenario: Any) -> Iterator[Objection]:
    """The goal's speed is within the vehicle's limit."""
    if scenario.goal.speed is not None:
        yield from speed_is_within("goal", scenario.goal.speed, scenario.vehicle.max_speed)
    given, top = scenario.goal.speed_range, scenario.vehicle.max_speed
    if given is not None and given[0] > top:
        text = f"must be at most vehicle.max_speed, {top:g} m/s"
        yield Objection(("goal", "speed_range", 0), given[0], text)


def places_can_be_passed(scenario: Any) -> Iterator[Objection]:
    """Places to pass differ from those before and after, can be reached in the bounds, and lead ahead."""
    if not scenario.goals:
        return
    vehicle, bounds = scenario.vehicle, scenario.bounds
    places = [scenario.start.position, *(one.position for one in scenario.goals), scenario.goal.position]
    for i, one in enumerate(scenario.goals):
        if one.target is not None:
            continue
        if same_place(places[i], one.position) or (i + 1 == len(scenario.goals) and same_place(*places[i + 1 :])):
            yield Objection(("goals", i, "position"), one.position, "must differ from the places before and after it")
        if bounds is None:
            continue
        sides = zip(one.position, bounds.min, bounds.max, strict=True)
        inside = [min(max(value, low + vehicle.radius), high - vehicle.radius) for value, low, high in sides]
        if math.dist(inside, one.position) > one.within(vehicle):
            text = f"must be at most {one.within(vehicle):g} m, its radius, from where the bounds let the vehicle be"
            yield Objection(("goals", i, "position"), one.position, text)


def places_are_in_time(scenario: Any) -> Iterator[Objection]:
    """Places are passed after the start; of those in any order there are not too many, and no guide leads over them."""
    count, start = len(scenario.goals), scenario.start.time
    for i, one in enumerate(scenario.goals):
        if one.latest_arrival is not None and one.latest_arrival <= start:
            text = f"must be later than start.time, {start:g} s"
            yield Objection(("goals", i, "latest_arrival"), one.latest_arrival, text)
    if scenario.goals_order == "given":
        return
    if count > MOST_IN_ANY_ORDER:
        yield Objection(("goals",), count, f"must be at most {MOST_IN_ANY_ORDER} where goals_order is fastest")
    if scenario.guide is not None:
        yield Objection(("guide",), scenario.guide, "must be null where goals_order is fastest")


def arrival_is_possible(goal: Any) -> Iterator[Objection]:
    """The latest arrival is not before the earliest one."""
    earliest, latest = goal.earliest_arrival, goal.latest_arrival
    if earliest is not None and latest is not None and latest < earliest:
        yield Objection(("latest_arrival",), latest, f"must not be before earliest_arrival, {earliest:g} s")


def region_is_simple(goal: Any) -> Iterator[Objection]:
    """The region's edges bound one area and meet only at its vertices."""
    if goal.region is not None:
        yield from polygon_faults(goal.region, "region")


def goal_is_told_once(goal: Any) -> Iterator[Objection]:
    """A goal has a region or a range, or else a radius or a value."""
    if goal.region is not None and goal.radius > 0.0:
        yield Objection(("radius",), goal.radius, "must be 0 where a region is given")
    for key in ("heading", "speed"):
        value = getattr(goal, key)
        if value is not None and getattr(goal, f"{key}_range") is not None:
            yield Objection((key,), value, f"must be null where {key}_range is given")
    if goal.region is not None and goal.heading is not None:
        yield Objection(("heading",), goal.heading, "must be null where a region is given; heading_range may be given")


def ranges_are_not_empty(goal: Any) -> Iterator[Objection]:
    """A range's first value is not above its second one."""
    for key in ("heading_range", "speed_range", "approach"):
        given = getattr(goal, key, None)
        if given is not None and given[1] < given[0]:
            yield Objection((key, 1), given[1], f"must not be less than {given[0]:g}, the first value")


def arrival_is_after_start(scenario: Any) -> Iterator[Objection]:
    """The trip takes time."""
    start = scenario.start.time
    for key in ("earliest_arrival", "latest_arrival"):
        value = getattr(scenario.goal, key)
        if value is not None and value <= start:
            yield Objection(("goal", key), value, f"must be later than start.time, {start:g} s")


def target_leaves_the_rest_open(goal: Any) -> Iterator[Objection]:
    """A goal that moves has no region and no step of time; one whose velocity is matched has no speed or heading."""
    matches, approach = getattr(goal, "match_velocity", False), getattr(goal, "approach", None)
    if goal.target is None:
        told = {"offset": (goal.offset, any(goal.offset)), "match_velocity": (matches, matches)}
        for key, (value, given) in {**told, "approach": (approach, approach is not None)}.items():
            if given:
                yield Objection((key,), value, "must be left out where there is no target")
        return
    matched = ("heading", "speed", "heading_range", "speed_range", "approach") if matches else ()
    approached = ("heading", "heading_range") if approach is not None else ()
    for key, why in (
        *((key, "a target") for key in ("region", "arrival_step")),
        *((key, "match_velocity") for key in matched),
        *((key, "approach") for key in approached),
    ):
        value = getattr(goal, key, None)
        if value is not None:
            yield Objection((key,), value, f"must be null where {why} is given")


def target_is_known(scenario: Any) -> Iterator[Objection]:
    """Targets that are obstacles are some of the scenario, in one future; guide and speed limits lead elsewhere."""
    known = {obstacle.id: obstacle for obstacle in scenario.obstacles}
    goals = [(("goals", i), one) for i, one in enumerate(scenario.goals)]
    for location, goal in [(("goal",), scenario.goal), *goals]:
        name = None if goal.target is None else goal.target.obstacle
        if name is not None and name not in known:
            yield Objection((*location, "target"), name, "there is no obstacle of this id")
        elif name is not None and isinstance(known[name].motion, Futures):
            yield Objection((*location, "target"), name, "must not be an obstacle of several futures")
    if scenario.goal.target is None:
        return
    if scenario.guide is not None:
        yield Objection(("guide",), scenario.guide, "must be null where the goal has a target")
    for i, limit in enumerate(scenario.speed_limits):
        if limit.line is None:
            yield Objection(("speed_limits", i, "line"), None, "must be given where the goal has a target")
