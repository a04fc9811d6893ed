"""Driving round what stands where the straight guide leads into a trap."""

from __future__ import annotations

import numpy as np
from replanning import PERIOD, follow
from shapely import Point, box, unary_union

import scp_planner as sp

RADIUS = 0.3
WALLS = {"back": (10.0, -4.3, 10.3, 4.3), "low": (6.0, -4.3, 10.0, -4.0), "high": (6.0, 4.0, 10.0, 4.3)}


def trap() -> sp.Scenario:
    """A U that is open to the vehicle."""
    obstacles = [
        {
            "id": name,
            "shape": {"rectangle": [right - left, high - low]},
            "motion": {"position": [0.5 * (left + right), 0.5 * (low + high)]},
        }
        for name, (left, low, right, high) in WALLS.items()
    ]
    vehicle = {"radius": RADIUS, "max_speed": 2.0, "max_acceleration": 1.5, "max_deceleration": 2.0}
    return sp.Scenario(
        vehicle={**vehicle, "max_curvature": 2.0, "max_lateral_acceleration": 2.0},
        start={"time": 0.0, "position": (4.0, 0.3), "heading": 0.0, "speed": 0.0},
        goal={"position": (18.0, 0.0), "speed": 0.0},
        obstacles=obstacles,
    )


def test_a_trap_is_driven_round() -> None:
    scenario, standing = trap(), unary_union([box(*wall) for wall in WALLS.values()])
    planner, time = sp.Planner(scenario), 0.0
    place, heading, speed = np.array(scenario.start.position), 0.0, 0.0
    for _ in range(400):
        plan = planner.replan(time, place, heading, speed)
        assert plan.safe
        if plan.arrived:
            break
        time = round(time + 0.1, 6)
        place, heading, speed = plan.position(time), float(plan.heading(time)), float(plan.speed(time))
        assert standing.distance(Point(place)) > RADIUS - 1e-6
    assert plan.arrived
    assert time < 1.1 * sp.plan(scenario).travel_time
    assert planner.scenario.guide is None  # it was not asked for


def test_the_trip_that_is_found_with_a_route_is_driven_at_once() -> None:
    scenario = trap()
    plan = sp.Planner(scenario).replan(0.0, scenario.start.position, 0.0, 0.0)
    assert plan.certified
    assert plan.arrival_time < 1.01 * sp.plan(scenario).travel_time


def test_a_trap_is_driven_round_though_there_is_never_time() -> None:
    """The deadline of each replan has passed before it begins, on any machine."""
    scenario, planner, time = trap(), sp.Planner(trap()), 0.0
    place, heading, speed = np.array(scenario.start.position), 0.0, 0.0
    for _ in range(600):
        plan = planner.replan(time, place, heading, speed, deadline=1e-9)
        assert plan.safe
        if plan.arrived:
            break
        time = round(time + 0.1, 6)
        place, heading, speed = plan.position(time), float(plan.heading(time)), float(plan.speed(time))
    assert plan.arrived


def limited(speed: float, limit: float) -> sp.Scenario:
    """A guide round three sides of a rectangle, of which the first is slow."""
    return sp.Scenario(
        vehicle={
            "radius": 0.5,
            "max_speed": 6.0,
            "max_acceleration": 2.0,
            "max_deceleration": 2.0,
            "max_curvature": 0.5,
        },
        start={"time": 0.0, "position": (0.0, 0.0), "heading": 0.0, "speed": speed},
        goal={"position": (0.0, 12.0)},
        guide=[(0.0, 0.0), (6.0, 0.0), (6.0, 12.0), (0.0, 12.0)],
        speed_limits=[{"from": 0.0, "to": 6.0, "speed": limit}],
    )


def test_a_trip_along_a_guide_is_found_though_there_is_never_time() -> None:
    run = sp.simulate(limited(0.0, 1.5), deadline=1e-9, time_limit=30.0)
    assert run.arrived
    plans = [plan for plan in run.plans if isinstance(plan, sp.OnlinePlan)]
    assert plans
    assert all(plan.safe for plan in plans)


def test_what_is_driven_without_time_keeps_to_the_limit_of_a_place() -> None:
    plan = sp.Planner(limited(1.0, 1.0)).replan(0.0, (0.0, 0.0), 0.0, 1.0, deadline=1e-9)
    assert plan.safe
    assert plan.speed(np.linspace(0.0, plan.arrival_time, 50)).max() <= 1.0 + 1e-9


def test_who_had_to_stop_before_its_goal_sets_out_again() -> None:
    """A turn that is nearly as tight as may be: no trip over the straight guide makes it."""
    vehicle = {"radius": RADIUS, "max_speed": 3.0, "max_acceleration": 1.5, "max_deceleration": 2.0}
    scenario = sp.Scenario(
        vehicle={**vehicle, "max_curvature": 1.0, "max_lateral_acceleration": 2.0},
        start={"time": 0.0, "position": (21.23465, 0.44402), "heading": 2.79293, "speed": 0.0},
        goal={"position": (20.0, 0.0)},
    )
    planner = sp.Planner(scenario, online=sp.OnlineSettings(period=PERIOD))
    for cycle in range(100):
        time, start = PERIOD * cycle, scenario.start
        held = cycle <= 20
        plan = planner.replan(time, start.position, start.heading, 0.0) if held else follow(planner, time)
        assert plan.safe
        if plan.arrived:
            break
    assert plan.arrived
    assert time < 2.0 + 0.5 + 2.0 * sp.plan(scenario).travel_time
