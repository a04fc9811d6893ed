"""Features of a scene that are decided by different sources, in one plan; each judged by dense samples."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import shapely

import scp_planner as sp

CAR = {"radius": 0.3, "max_speed": 1.5, "max_acceleration": 1.0, "max_deceleration": 1.5, "max_curvature": 1.2}
BACKS = {**CAR, "reverse": {"max_speed": 0.8}}
TURNS = {**CAR, "steering": "on_the_spot", "max_turn_rate": 1.0}
START = {"time": 2.0, "position": [5.0, 0.0], "heading": 0.0, "speed": 0.0}
NOSE = [[[5.5, -2.0], [5.7, -2.0], [5.7, 2.0], [5.5, 2.0]]]
PLACES = [{"position": [2.0, 1.0], "radius": 0.2}, {"position": [0.0, 3.0], "radius": 0.2}]
AWAY = {"target": {"motion": {"position": [0.0, 5.0], "velocity": [-0.2, 0.1]}}, "radius": 0.2}


def room(width: float, height: float, low: tuple[float, float]) -> sp.OccupancyMap:
    cells = np.zeros((int(height / 0.1), int(width / 0.1)), dtype=bool)
    cells[:1], cells[-1:], cells[:, :1], cells[:, -1:] = True, True, True, True
    cells[: len(cells) // 2, 20:22] = True  # a wall from below
    return sp.OccupancyMap(cells, 0.1, low)


@pytest.mark.parametrize(
    "parts",
    [
        {"vehicle": BACKS, "walls": NOSE, "goals": PLACES, "goal": {"position": [-3.0, 3.0]}},
        {"vehicle": BACKS, "walls": NOSE, "goal": AWAY},
        {"vehicle": TURNS, "walls": NOSE, "goal": AWAY},
        {"vehicle": CAR, "start": {**START, "heading": np.pi}, "goals": PLACES, "goal": AWAY},
        {
            "vehicle": CAR,
            "start": {**START, "heading": np.pi / 2},
            "goals": PLACES,
            "goal": {"position": [-3.0, 2.0]},
            "map": True,
        },
        {
            "vehicle": BACKS,
            "start": {**START, "heading": np.pi / 2},
            "goals": PLACES,
            "goal": {"position": [-3.0, 2.0]},
            "map": True,
        },
    ],
    ids=["reverse+goals", "reverse+target", "spot+target", "goals+target", "goals+map", "reverse+goals+map"],
)
def test_features_are_planned_together(parts: dict[str, Any]) -> None:
    given = {"start": START, **parts}
    if given.pop("map", False):
        given["ground"] = {"map": room(12.0, 8.0, (-5.0, -3.0))}
    scenario = sp.Scenario(**given)
    plan = sp.plan(scenario)
    assert plan.certified, plan.reason
    times = np.linspace(plan.start_time, plan.arrival_time, 4001)
    place = plan.position(times)
    for wall in scenario.walls:
        assert shapely.distance(shapely.points(place), shapely.Polygon(wall)).min() >= 0.3 - 1e-6
    end = np.array(scenario.goal.position)
    if "target" in given["goal"]:
        end = np.array([0.0, 5.0]) + (plan.arrival_time - 2.0) * np.array([-0.2, 0.1])
    assert np.hypot(*(place[-1] - end)) <= scenario.goal.radius + 1e-5
    begin = 0
    for one in scenario.goals:
        near = np.hypot(*(place[begin:] - one.position).T) <= 0.2 + 1e-3
        assert near.any()
        begin += int(np.argmax(near))
    if scenario.vehicle.reverse is None:
        assert not plan.backward(times).any()


def test_each_leg_keeps_a_users_constraint() -> None:
    scenario = sp.Scenario(vehicle=BACKS, start=START, walls=NOSE, goal={"position": [1.0, 2.0], "heading": np.pi / 2})
    normal, most = np.array([0.0, -1.0]), 0.3
    plan = sp.plan(scenario, constraints=lambda trip: [trip.position(trip.stations) @ normal <= most])
    assert plan.certified and plan.legs is not None
    times = np.linspace(plan.start_time, plan.arrival_time, 2001)
    assert (plan.position(times) @ normal).max() <= most + 0.01


@pytest.mark.parametrize(("radius", "pace"), [(5.0, 1.0), (3.3, 0.5)])
def test_a_slow_target_inside_of_the_turning_circle_is_met_after_a_loop(radius: float, pace: float) -> None:
    vehicle = {"radius": 0.3, "max_speed": 3.0, "max_acceleration": 2.0, "max_deceleration": 2.0}
    target = {"motion": {"position": [2.0, 3.0], "velocity": [pace, 0.0]}}
    scenario = sp.Scenario(
        vehicle={**vehicle, "max_curvature": 1.0 / radius},
        start={"time": 0.0, "position": [0.0, 0.0], "heading": 0.0, "speed": 3.0},
        goal={"target": target, "radius": 0.5},
    )
    plan = sp.plan(scenario)
    assert plan.certified
    times = np.linspace(0.0, plan.arrival_time, 2001)
    assert np.abs(plan.curvature(times)).max() <= (1.0 + 1e-6) / radius
    assert np.hypot(*(plan.position(times)[-1] - [2.0 + pace * times[-1], 3.0])) <= 0.5 + 1e-6


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_vehicle_turns_round_past_posts(side: float) -> None:
    posts = [[1.656, 2.757], [-0.943, 2.884], [-1.165, -4.156]]
    vehicle = {"radius": 1.0, "max_speed": 1.0, "max_acceleration": 0.5, "max_deceleration": 0.5, "max_curvature": 1.0}
    scenario = sp.Scenario(
        vehicle=vehicle,
        start={"time": 0.0, "position": [0.0, 0.0], "heading": side * np.pi / 8, "speed": 0.0},
        goal={"position": [-5.0, -7.0 * side]},
        obstacles=[
            {"id": f"post{k}", "shape": {"disc": 0.05}, "motion": {"position": [x, side * y]}}
            for k, (x, y) in enumerate(posts)
        ],
    )
    plan = sp.plan(scenario)
    assert plan.certified and plan.tried[-1].what == "manoeuvre ahead"
    place = plan.position(np.linspace(0.0, plan.arrival_time, 2001))
    assert min(np.hypot(*(place - [x, side * y]).T).min() for x, y in posts) >= 1.05 - 1e-6
