"""Ends of plans while driving: goals that may be passed at speed, and plans that have ended."""

from __future__ import annotations

import math

import numpy as np
import pytest
from replanning import follow

import scp_planner as sp

VEHICLE = {"radius": 0.3, "max_speed": 3.0, "max_acceleration": 2.0, "max_deceleration": 2.0}
ONLINE = sp.OnlineSettings(period=0.1)


@pytest.mark.parametrize("jerk", [{}, {"max_jerk": 8.0}])
def test_goal_before_the_edge_is_passed_no_faster_than_the_vehicle_can_stop(jerk: dict[str, float]) -> None:
    scenario = sp.Scenario(
        vehicle={**VEHICLE, **jerk},
        start={"time": 0.0, "position": [0.0, 0.0], "heading": 0.0, "speed": 2.0},
        goal={"position": [6.0, 0.0]},
        bounds={"min": [-2.0, -2.0], "max": [6.4, 2.0]},
    )
    planner = sp.Planner(scenario, online=ONLINE)
    plan = planner.replan(0.0, [0.0, 0.0], 0.0, 2.0)
    for t in np.arange(1, 60) / 10.0:
        assert plan.safe
        plan = follow(planner, float(t))
        if plan.arrived:
            break
    assert plan.arrived and plan.safe
    assert plan.position(plan.arrival_time)[0] + 0.3 <= 6.4 + 1e-6


def test_goal_with_room_behind_it_is_passed_at_full_speed() -> None:
    start = {"time": 0.0, "position": [0.0, 0.0], "heading": 0.0, "speed": 3.0}
    bounds = {"min": [-2.0, -2.0], "max": [6.0 + 0.3 + 3.0**2 / 4.0 + 0.01, 2.0]}
    scenario = sp.Scenario(vehicle=VEHICLE, start=start, goal={"position": [6.0, 0.0]}, bounds=bounds)
    plan = sp.Planner(scenario, online=ONLINE).replan(0.0, [0.0, 0.0], 0.0, 3.0)
    assert plan.certified and plan.arrival_time == pytest.approx(2.0, rel=0.01)


def test_edge_that_comes_behind_the_goal_slows_a_plan_that_was_kept_down() -> None:
    start = {"time": 0.0, "position": [0.0, 0.0], "heading": 0.0, "speed": 2.0}
    beside = [[0.0, 5.0], [9.0, 5.0], [9.0, 6.0], [0.0, 6.0]]
    scenario = sp.Scenario(vehicle=VEHICLE, start=start, goal={"position": [6.0, 0.0]}, walls=[beside])
    planner = sp.Planner(scenario, online=ONLINE)
    planner.replan(0.0, [0.0, 0.0], 0.0, 2.0)
    kept = [follow(planner, float(t)) for t in (0.1, 0.2, 0.3)]
    assert all(plan.certified and plan.trip == kept[0].trip for plan in kept)
    assert np.hypot(*kept[0].velocity(kept[0].arrival_time)) > 2.9
    planner.set_walls([beside, [[6.8, -2.0], [8.0, -2.0], [8.0, 2.0], [6.8, 2.0]]])
    later = [follow(planner, float(t)) for t in np.arange(4, 15) / 10.0]
    assert all(plan.safe for plan in later)
    ends = [np.hypot(*plan.velocity(plan.arrival_time)) for plan in later if plan.certified]
    assert ends and max(ends) <= math.sqrt(2.0 * 2.0 * 0.5) + 1e-6


def test_radius_crossed_between_two_replans_is_an_arrival() -> None:
    """The plan ends between two replans: there is no target within the radius at either of them."""
    rate = 2.5 * np.array([math.cos(math.pi / 4.0), math.sin(math.pi / 4.0)])
    target = {"motion": {"position": [0.8, 0.0], "velocity": rate.tolist()}}
    start = {"time": 0.0, "position": [0.0, 0.0], "heading": 0.7, "speed": 3.0}
    vehicle = {**VEHICLE, "max_lateral_acceleration": 2.0}
    planner = sp.Planner(
        sp.Scenario(vehicle=vehicle, start=start, goal={"target": target, "radius": 0.5}), online=ONLINE
    )
    plan = planner.replan(0.0, [0.0, 0.0], 0.7, 3.0)
    for t in np.arange(1, 80) / 10.0:
        certified, arrival = plan.certified, plan.arrival_time
        plan = follow(planner, float(t))
        if plan.arrived:
            break
        assert plan.arrival_time > t
    assert plan.arrived and certified and arrival <= t


def test_scenario_after_a_change_of_the_goal_has_its_target() -> None:
    start = {"time": 0.0, "position": [0.0, 0.0], "heading": 0.0, "speed": 0.0}
    boat = {"id": "boat", "shape": {"disc": 0.3}, "motion": {"position": [8.0, 1.0], "velocity": [0.3, 0.0]}}
    standing = sp.Scenario(vehicle=VEHICLE, start=start, goal={"position": [10.0, 0.0]}, obstacles=[boat])
    plan = sp.plan(standing)
    planner = sp.Planner(standing, online=ONLINE)
    planner.set_goal({"target": "boat", "radius": 0.8})
    found = sp.certify(planner.scenario, plan)
    assert not found.holds and "goal" in found.violations[0].what
    planner.set_goal({"position": [10.0, 0.0]}, goals=[{"target": "boat", "radius": 2.0}])
    assert sp.certify(planner.scenario, plan).holds
    planner.remove_obstacle("boat")
    with pytest.raises(sp.ScenarioError, match="there is no obstacle of this id"):
        sp.certify(planner.scenario, plan)


@pytest.mark.parametrize(("place", "velocity"), [([11.0, 1.3], [-0.68, 0.02]), ([15.0, 0.0], [-0.7, 0.9])])
def test_certified_answer_meets_a_known_target_as_the_certificate_says(
    place: list[float], velocity: list[float]
) -> None:
    vehicle = {**VEHICLE, "max_speed": 1.5, "max_curvature": 1.4}
    start = {"time": 0.0, "position": [0.0, 0.0], "heading": 0.0, "speed": 0.0}
    target = {"motion": {"position": place, "velocity": velocity}}
    planner = sp.Planner(sp.Scenario(vehicle=vehicle, start=start, goal={"target": target}), online=ONLINE)
    plan, certified = planner.replan(0.0, [0.0, 0.0], 0.0, 0.0), 0
    for t in np.arange(1, 100) / 10.0:
        if plan.certified:
            off = plan.position(plan.arrival_time) - np.array(place) - plan.arrival_time * np.array(velocity)
            assert np.hypot(*off) <= 2e-5
            certified += 1
        plan = follow(planner, float(t))
        if plan.arrived:
            break
    assert plan.arrived and certified > 10
