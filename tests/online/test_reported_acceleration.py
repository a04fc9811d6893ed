"""Accelerations that are reported where the jerk is limited: plans begin with them, or tell that they cannot be."""

from __future__ import annotations

from typing import Any

import pytest

import scp_planner as sp

GEARS: list[dict[str, Any]] = [{}, {"reverse": {"max_speed": 2.0}}, {"steering": "on_the_spot", "max_turn_rate": 0.5}]


def planner(**vehicle: Any) -> sp.Planner:
    limits = {"radius": 0.5, "max_speed": 4.0, "max_acceleration": 1.3, "max_deceleration": 3.9, "max_curvature": 1.4}
    start = {"time": 0.0, "position": [0.0, 0.0], "heading": 0.0, "speed": 0.0}
    scenario = sp.Scenario(
        vehicle={**limits, "max_jerk": 8.0, **vehicle}, start=start, goal={"position": [11.6, 0.0], "speed": 0.72}
    )
    return sp.Planner(scenario, online=sp.OnlineSettings(period=0.1))


@pytest.mark.parametrize("gear", GEARS)
@pytest.mark.parametrize("acceleration", [0.0, 0.4])
def test_first_plan_of_any_gear_begins_with_the_reported_acceleration(
    gear: dict[str, Any], acceleration: float
) -> None:
    asked = planner(**gear)
    plan = asked.replan(0.0, [0.0, 0.0], 0.0, 0.0, acceleration=acceleration)
    assert plan.certified and not asked.doubts
    assert float(plan.acceleration(0.0)) == pytest.approx(acceleration, abs=1e-9)
    assert sp.certify(asked.scenario, plan).holds


@pytest.mark.parametrize(("speed", "reported", "taken"), [(2.0, -6.0, -3.9), (2.0, 100.0, 1.3), (0.0, -0.4, 0.0)])
def test_acceleration_that_cannot_be_is_a_doubt_and_the_nearest_one_is_taken(
    speed: float, reported: float, taken: float
) -> None:
    asked = planner()
    plan = asked.replan(0.0, [0.0, 0.0], 0.0, speed, acceleration=reported)
    (doubt,) = asked.doubts
    assert "m/s2, which it cannot" in doubt and f"{taken:.4g} m/s2 is taken" in doubt
    assert plan.safe and float(plan.acceleration(0.0)) == pytest.approx(taken, abs=1e-9)
