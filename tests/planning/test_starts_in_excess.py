"""Plans from starts beyond a limit that was lowered under way, beside the fastest drive in closed form."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scenes import scene

import scp_planner as sp

LENGTH, SPEED = 20.0, 2.5


def lowered(vehicle: dict[str, Any], **changes: Any) -> sp.Scenario:
    """A straight trip that begins with 2.5 m/s, whatever is allowed, as if its limits were lowered before."""
    usual = {"max_speed": 3.0, "max_curvature": 1.0, "max_lateral_acceleration": 2.0, **vehicle}
    scenario = scene(vehicle=usual, start={"speed": 0.0}, **changes)
    return scenario.model_copy(update={"start": scenario.start.model_copy(update={"speed": SPEED})})


def fastest(limit: float, deceleration: float) -> float:
    """Time of braking to a limit and going on at it, s."""
    braking = (SPEED - limit) / deceleration
    return braking + (LENGTH - 0.5 * (SPEED + limit) * braking) / limit


@pytest.mark.parametrize("limit", [2.3, 2.0, 1.5, 1.2, 0.8, 0.5, 0.3])
def test_trip_brakes_as_hard_as_it_can_until_it_keeps_the_top_speed(limit: float) -> None:
    scenario = lowered({"max_speed": limit})
    plan = sp.plan(scenario)
    assert plan.certified and sp.certify(scenario, plan).holds
    assert fastest(limit, 2.0) * (1.0 - 1e-6) <= plan.travel_time <= 1.06 * fastest(limit, 2.0)
    times = np.linspace(0.0, plan.travel_time, 4001)
    assert np.all(plan.speed(times) <= np.maximum(limit, SPEED - 2.0 * times) + 3e-6)


def test_trip_keeps_the_total_acceleration_while_it_brakes() -> None:
    scenario = lowered({"max_speed": 1.5, "max_total_acceleration": 1.5})
    plan = sp.plan(scenario)
    assert plan.certified and plan.travel_time <= 1.05 * fastest(1.5, 1.5)


@pytest.mark.parametrize("end", [10.0, 40.0])
def test_trip_in_a_slow_zone_brakes_as_hard_as_it_can(end: float) -> None:
    zone = {"line": [[-2.0, 0.0], [40.0, 0.0]], "from": 0.0, "to": end, "speed": 1.0}
    scenario = lowered({"max_curvature": None, "max_lateral_acceleration": None}, speed_limits=[zone])
    plan = sp.plan(scenario)
    assert plan.certified and sp.certify(scenario, plan).holds
    times = np.linspace(0.0, plan.travel_time, 4001)
    there = plan.position(times)[:, 0] < end - 2.0
    assert np.all(plan.speed(times)[there] <= np.maximum(1.0, SPEED - 2.0 * times[there]) + 3e-6)


def test_trip_round_a_wall_brakes_first() -> None:
    wall = [[6.0, -3.0], [7.0, -3.0], [7.0, 0.5], [6.0, 0.5]]
    plan = sp.plan(lowered({"max_speed": 1.0}, walls=[wall]))
    assert plan.certified and plan.travel_time <= 1.06 * fastest(1.0, 2.0)
