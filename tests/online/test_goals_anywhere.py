"""Goals and targets at any distance, ahead and behind: nothing raises or hangs."""

from __future__ import annotations

from typing import Any

import pytest

import scp_planner as sp

CAR = {"radius": 0.3, "max_speed": 3.0, "max_acceleration": 1.5, "max_deceleration": 2.0, "max_curvature": 1.0}
START = {"time": 0.0, "position": [0.0, 0.0], "heading": 0.0, "speed": 0.0}


@pytest.mark.parametrize("gear", [{}, {"reverse": {"max_speed": 1.0}}])
@pytest.mark.parametrize("away", [0.0, 1e-9, -1e-9, 1e3, -1e3, 1e6, -1e6])
@pytest.mark.parametrize("kind", ["goal", "heading", "target", "place"])
def test_no_distance_raises(kind: str, away: float, gear: dict[str, Any]) -> None:
    if kind == "place" and gear:
        pytest.skip("a vehicle with a reverse gear passes no places: that is refused by name")
    calls: dict[str, dict[str, Any]] = {
        "goal": {"goal": {"position": [away, 0.0]}},
        "heading": {"goal": {"position": [away, 0.0], "heading": 1.57, "speed": 0.0}},
        "target": {"goal": {"target": {"motion": {"position": [away, 0.0], "velocity": [0.1, 0.0]}}}},
        "place": {"goal": {"position": [5.0, 0.0]}, "goals": [{"position": [away, 0.1], "radius": 0.2}]},
    }
    planner = sp.Planner(
        sp.Scenario(vehicle={**CAR, **gear}, start=START, goal={"position": [5.0, 0.0]}),
        online=sp.OnlineSettings(period=0.1),
    )
    planner.set_goal(**calls[kind])
    for k in range(2):
        plan = planner.replan(0.1 * k, [0.0, 0.0], 0.0, 0.0, deadline=0.1)
    assert plan.arrival_time > 0.0
    assert sp.certify(planner.scenario, plan).holds in (True, False)


@pytest.mark.parametrize(
    "gear",
    [
        {"reverse": {"max_speed": 1.0}},
        {"steering": "on_the_spot", "max_turn_rate": 1.0},
        {"reverse": {"max_speed": 1.0}, "steering": "on_the_spot", "max_turn_rate": 1.0},
    ],
)
@pytest.mark.parametrize("off", [0.0, 1e-13, 0.5])
def test_a_vehicle_within_a_wide_goal_that_heads_elsewhere_may_manoeuvre(off: float, gear: dict[str, Any]) -> None:
    """A scenario that starts there is refused, so the planner asks for another one."""
    goal = {"position": [20.0, 0.0], "heading": 0.6, "speed": 0.0, "radius": 6.0}
    planner = sp.Planner(
        sp.Scenario(vehicle={**CAR, **gear}, start=START, goal=goal), online=sp.OnlineSettings(period=0.1)
    )
    for time in (0.0, 0.1, 0.2):
        plan = planner.replan(time, [20.0 - off, 0.0], 0.0, 0.0)
        assert plan.safe
        assert plan.position(time) == pytest.approx([20.0 - off, 0.0], abs=1e-6)
