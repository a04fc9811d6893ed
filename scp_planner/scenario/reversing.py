"""Driving backwards: ahead, as a vehicle that is mirrored at its reference point."""

from __future__ import annotations

from math import pi
from typing import TypeVar

from scp_planner.scenario.models import Goal, Scenario, Start, Steering, Vehicle
from scp_planner.scenario.units import changed

EndT = TypeVar("EndT", Start, Goal)


def backwards(scenario: Scenario) -> Scenario:
    """Return the scene in which a vehicle that drives backwards drives ahead: with its limits while it does."""
    goal = scenario.goal
    if goal.heading_range is not None:
        low, high = goal.heading_range
        goal = changed(goal, heading_range=(low + pi, high + pi))
    return changed(scenario, vehicle=_mirrored(scenario.vehicle), start=_turned(scenario.start), goal=_turned(goal))


def ahead(scenario: Scenario) -> Scenario:
    """Return the scene in which a vehicle drives ahead alone."""
    vehicle = scenario.vehicle
    return changed(scenario, vehicle=changed(vehicle, reverse=None, max_turn_rate=None, steering=Steering.AHEAD))


def with_lines(scenario: Scenario) -> Scenario:
    """Return the scene with a line for each speed limit that has none: its parts have it as well."""
    line = (scenario.start.position, scenario.goal.position)
    if all(limit.line is not None for limit in scenario.speed_limits):
        return scenario
    limits = (limit if limit.line is not None else changed(limit, line=line) for limit in scenario.speed_limits)
    return changed(scenario, speed_limits=tuple(limits))


def _turned(end: EndT) -> EndT:
    return end if end.heading is None else changed(end, heading=end.heading + pi)


def _mirrored(vehicle: Vehicle) -> Vehicle:
    reverse = vehicle.reverse
    assert reverse is not None, "only a vehicle that can drives backwards"
    return changed(
        vehicle,
        max_speed=reverse.max_speed,
        max_acceleration=reverse.max_acceleration or vehicle.max_acceleration,
        discs=tuple(-offset for offset in vehicle.discs),
        centre=-vehicle.centre,
        reverse=None,
        max_turn_rate=None,
        steering=Steering.AHEAD,
    )
