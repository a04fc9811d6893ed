"""An answer begins at the reported velocity, ahead or backwards, whatever was changed since the last replan."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import scp_planner as sp

BRAKING, RADIUS = 2.0, 0.5
CAR: dict[str, Any] = {"radius": RADIUS, "max_speed": 3.0, "max_acceleration": 1.5, "max_deceleration": BRAKING}
CAR |= {"max_curvature": 0.5}
REVERSE = {"max_speed": 1.5, "max_acceleration": 1.0}
CHANGES: dict[str, Callable[[sp.Planner], None]] = {
    "nothing": lambda planner: None,
    "goal": lambda planner: planner.set_goal({"position": [9.0, 1.0]}),
    "goal behind": lambda planner: planner.set_goal({"position": [-9.0, 0.0], "speed": 0.0}),
    "speed": lambda planner: planner.set_limits(max_speed=2.0, reverse={"max_speed": 1.0}),
    "no reverse": lambda planner: planner.set_limits(reverse=None),
    "reverse": lambda planner: planner.set_limits(reverse=REVERSE),
    "walls": lambda planner: planner.set_walls([[[-7.0, 4.0], [7.0, 4.0], [7.0, 5.0]]]),
}


def wall(x: float, thick: float = 0.3) -> list[list[float]]:
    return [[x, -2.0], [x + thick, -2.0], [x + thick, 2.0], [x, 2.0]]


def planner_of(goal: float, reverse: bool, *walls: list[list[float]]) -> sp.Planner:
    scenario = sp.Scenario(
        vehicle={**CAR, "reverse": REVERSE if reverse else None},
        start={"time": 0.0, "position": [0.0, 0.0], "heading": 0.0, "speed": 0.0},
        goal={"position": [goal, 0.0], "heading": 0.0, "speed": 0.0},
        walls=list(walls),
    )
    return sp.Planner(scenario, online=sp.OnlineSettings(period=0.1))


def under_way(goal: float, reverse: bool, *walls: list[list[float]]) -> tuple[sp.Planner, Any, float]:
    """Set out for a goal: the planner, and place and heading in the next period."""
    planner = planner_of(goal, reverse, *walls)
    plan = planner.replan(0.0, [0.0, 0.0], 0.0, 0.0)
    return planner, plan.position(0.1), float(plan.heading(0.1))


def begins_as_reported(plan: sp.OnlinePlan, time: float, place: Any, heading: float, speed: float) -> None:
    velocity = speed * np.array([math.cos(heading), math.sin(heading)])
    np.testing.assert_allclose(plan.position(time), place, atol=1e-4)
    np.testing.assert_allclose(plan.velocity(time), velocity, atol=4e-3)  # of 3 m/s, below which a vehicle stands


@pytest.mark.parametrize("change", CHANGES)
@pytest.mark.parametrize("speed", [-4.0, -1.2, 4.0])
@pytest.mark.parametrize(("goal", "reverse"), [(6.0, False), (-6.0, True)])
def test_answers_begin_at_the_reported_velocity(goal: float, reverse: bool, speed: float, change: str) -> None:
    planner, place, heading = under_way(goal, reverse)
    CHANGES[change](planner)
    plan = planner.replan(0.1, place, heading, speed)
    begins_as_reported(plan, 0.1, place, heading, speed)
    has_gear = change in ("reverse", "speed") or (reverse and change != "no reverse")
    if speed < 0.0 and not has_gear:
        assert not plan.safe and any("no reverse gear" in doubt for doubt in planner.doubts)
    if abs(speed) == 4.0:
        assert any("above its limit" in doubt or "gear" in doubt for doubt in planner.doubts)


@pytest.mark.parametrize(("goal", "speed"), [(-6.0, 1.0), (6.0, -2.0)])
@pytest.mark.parametrize("spare", [-0.1, 0.1])
def test_a_vehicle_that_rolls_against_its_gear_stops_first(goal: float, speed: float, spare: float) -> None:
    """It is safe if full braking ends before the wall, by v^2 / 2d, and then drives to its goal."""
    reach = math.copysign(speed**2 / (2.0 * BRAKING) + RADIUS + spare, speed)
    ahead = wall(reach) if reach > 0.0 else wall(reach - 0.3)
    planner, place, heading = under_way(goal, True, [[x + math.copysign(0.1, -speed), y] for x, y in ahead])
    moved = [[x + float(place[0]), y] for x, y in ahead]
    planner.set_walls([moved])
    plan = planner.replan(0.1, place, heading, speed)
    begins_as_reported(plan, 0.1, place, heading, speed)
    assert plan.safe == (spare > 0.0)
    assert any("rolls against its gear" in doubt for doubt in planner.doubts)
    end = plan.position(plan.arrival_time)
    assert abs(float(end[0] - place[0])) == pytest.approx(speed**2 / (2.0 * BRAKING), rel=0.01)
    if not plan.safe:
        return
    time = 0.1
    while time < 12.0 and not plan.arrived:
        time = round(time + 0.1, 6)
        backward = bool(plan.backward(time))
        pace = float(plan.speed(time)) if time < plan.arrival_time else 0.0
        plan = planner.replan(time, plan.position(time), float(plan.heading(time)), -pace if backward else pace)
        assert plan.safe
    assert plan.arrived


def test_the_reverse_gear_may_be_lost_while_a_vehicle_that_turns_on_the_spot_backs_up() -> None:
    vehicle = {**CAR, "reverse": REVERSE, "steering": "on_the_spot", "max_turn_rate": 1.0}
    start, goal = ({"time": 0.0, "position": [x, 0.0], "heading": 0.0, "speed": 0.0} for x in (0.0, -6.0))
    del goal["time"]
    planner = sp.Planner(sp.Scenario(vehicle=vehicle, start=start, goal=goal), online=sp.OnlineSettings(period=0.1))
    assert bool(planner.replan(0.0, [0.0, 0.0], 0.0, -0.2).backward(0.1))
    planner.set_limits(reverse=None)
    assert not planner.replan(0.1, [0.0, 0.0], 0.0, -0.2).safe
    plan = planner.replan(0.2, [-0.02, 0.0], 0.0, 0.0)
    assert plan.safe and not plan.backward(np.linspace(0.2, plan.arrival_time, 20)).any()


def test_who_rolls_back_without_a_reverse_gear_is_not_safe_until_it_stands() -> None:
    planner, speed = planner_of(6.0, False), -1.0
    place = np.zeros(2)
    for k in range(12):
        plan = planner.replan(0.1 * k, place, 0.0, -abs(speed))
        assert plan.safe == (abs(speed) < 1e-12)
        after = 0.1 * (k + 1)
        if not plan.safe:
            place, speed = plan.position(after), float(plan.speed(after)) if after < plan.arrival_time else 0.0
    assert abs(speed) < 1e-12 and plan.safe and sum("no reverse gear" in doubt for doubt in planner.doubts) == 1


@pytest.mark.parametrize("speed", [math.nan, math.inf, -math.inf])
def test_a_speed_that_is_no_number_is_refused_before_a_predictor_is_asked(speed: float) -> None:
    class Never:
        def predict(self, now: float, horizon: float) -> dict[str, Any]:
            raise AssertionError((now, horizon))

    planner = planner_of(6.0, True)
    planner.predictor = Never()
    with pytest.raises(ValueError, match="speed"):
        planner.replan(0.0, [0.0, 0.0], 0.0, speed)
    with pytest.raises(ValueError, match="time: None is not a finite number"):
        planner.replan(None, [0.0, 0.0], 0.0, 0.0)  # type: ignore[arg-type]
    assert planner.plan is None
