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
