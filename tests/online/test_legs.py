"""Trips of several legs while driving: parking, stopping between legs, turning on the spot, and their records."""

from __future__ import annotations

import copy
from functools import cache
from math import pi, remainder
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely
from replanning import begin, follow

import scp_planner as sp

CAR: dict[str, Any] = {
    "radius": 0.95,
    "discs": [0.0, 1.3, 2.6],
    "max_speed": 3.0,
    "max_acceleration": 1.5,
    "max_deceleration": 2.0,
    "max_curvature": 0.2,
    "reverse": {"max_speed": 1.5, "max_acceleration": 1.0},
}
ROBOT: dict[str, Any] = {
    "radius": 0.3,
    "max_speed": 1.0,
    "max_acceleration": 1.0,
    "max_deceleration": 1.0,
    "max_curvature": 1.0,
    "steering": "on_the_spot",
    "max_turn_rate": 1.0,
}
WALKER = {"id": "walker", "shape": {"disc": 0.3}, "motion": {"position": [0.5, 6.0], "velocity": [0.0, -1.0]}}


def box(left: float, low: float, right: float, high: float) -> list[list[float]]:
    return [[left, low], [right, low], [right, high], [left, high]]


@cache
def parking(walker: bool = False) -> sp.Scenario:
    return sp.Scenario(
        name="parking",
        vehicle=CAR,
        start={"time": 5.0, "position": [6.0, 2.6], "heading": 0.0, "speed": 0.0},
        goal={"position": [0.3, 0.0], "heading": 0.0, "speed": 0.0},
        walls=[box(-8, -1, -1.25, 1), box(5, -1, 12, 1), box(-8, -2.2, 16, -1.2)],
        obstacles=[WALKER] if walker else [],
    )


def least_room(run: sp.Run) -> float:
    """Least distance of the vehicle's discs to the walls, m, by shapely."""
    walls = shapely.union_all([shapely.Polygon(wall) for wall in run.scenario.walls])
    ahead = np.stack([np.cos(run.heading), np.sin(run.heading)], axis=1)
    centres = np.concatenate([run.position + offset * ahead for offset in run.scenario.vehicle.discs])
    return float(shapely.distance(shapely.points(centres), walls).min()) - run.scenario.vehicle.radius


@pytest.mark.parametrize("walker", [False, True])
def test_parks_backwards_in_closed_loop(walker: bool) -> None:
    run = sp.simulate(parking(walker), noise=0.05, rate=10.0, seed=1)
    assert run.arrived and not run.contact and not run.contact_standing
    assert least_room(run) > -1e-4
    assert all(record.safe for record in run.records)
    assert run.travel_time < (1.2 if walker else 1.05) * sp.plan(parking(walker)).travel_time
    # It drives as it heads: against it where the reported speed is negative
    ahead = np.stack([np.cos(run.heading), np.sin(run.heading)], axis=1)[1:-1]
    along = (ahead * (run.position[2:] - run.position[:-2])).sum(axis=1) / (run.time[2:] - run.time[:-2])
    assert np.abs(np.abs(along) - run.speed[1:-1]).max() < 0.15 and along.min() < -0.5
    speeds = [record.speed for record in run.records]
    assert min(speeds) < -0.5 < 0.5 < max(speeds)
    turned = np.abs([remainder(step, 2.0 * pi) for step in np.diff(run.heading)])
    assert (turned <= CAR["max_curvature"] * np.hypot(*np.diff(run.position, axis=0).T) + 1e-3).all()


@pytest.mark.parametrize("along", [3.0, -3.0])
def test_arrives_at_a_goal_that_asks_for_no_speed(along: float) -> None:
    goal = {"position": [along, 0.0], "radius": 0.3}
    start = {"time": 0.0, "position": [0.0, 0.0], "heading": 0.0, "speed": 0.0}
    planner = sp.Planner(sp.Scenario(vehicle={**CAR, "discs": [0.0]}, start=start, goal=goal))
    plan, speed = begin(planner, planner.scenario), 0.0
    for t in np.arange(1, 40) / 10.0:
        speed = float(plan.speed(t))
        plan = follow(planner, float(t))
        if plan.arrived:
            break
    assert plan.arrived and planner.at_goal(plan.position(t))
    assert speed > 1.0


def test_plan_has_the_legs_to_come_and_is_certified_by_its_scenario() -> None:
    planner = sp.Planner(parking())
    plan = planner.replan(5.0, [6.0, 2.6], 0.0, 0.0)
    assert plan.certified and plan.legs is not None
    assert [leg.backward for leg in plan.legs.legs] == [True, False]
    assert sp.certify(planner.scenario, plan).holds
    now = plan.legs.legs[0].end - 0.8
    while now < plan.arrival_time:
        backing = bool(plan.backward(now))
        speed = float(plan.speed(now)) * (-1.0 if backing else 1.0)
        plan = planner.replan(now, plan.position(now), float(plan.heading(now)), speed)
        assert plan.safe and bool(plan.backward(now)) == backing
        assert plan.start_time < now or sp.certify(planner.scenario, plan).holds == plan.certified
        now += 0.25
    assert plan.legs is None and not plan.arrived
    end = planner.replan(now, plan.position(now), float(plan.heading(now)), 0.0)
    assert end.arrived and planner.at_goal([0.3, 0.0])


def test_search_goes_on_over_replans_with_a_deadline_and_the_vehicle_stands() -> None:
    planner = sp.Planner(parking())
    waited = 0
    for number in range(400):
        plan = planner.replan(5.0 + 0.05 * number, [6.0, 2.6], 0.0, 0.0, deadline=0.03)
        if plan.legs is not None:
            break
        assert plan.safe and float(plan.speed(plan.arrival_time)) == 0.0 and plan.code == "out_of_time"
        waited += 1
        if waited == 2:
            planner = copy.copy(planner)
    assert plan.legs is not None and waited > 2


def test_new_goal_while_backing_is_reached() -> None:
    planner = sp.Planner(parking())
    plan = planner.replan(5.0, [6.0, 2.6], 0.0, 0.0)
    assert plan.legs is not None
    now = plan.legs.legs[0].end - 0.2
    planner.replan(now, plan.position(now), float(plan.heading(now)), -float(plan.speed(now)))
    planner.set_goal({"position": [10.0, 3.0], "heading": 0.0, "speed": 0.0})
    place, heading, speed = plan.position(now), float(plan.heading(now)), -float(plan.speed(now))
    for _ in range(120):
        plan = planner.replan(now, place, heading, speed)
        assert plan.safe
        if plan.arrived:
            break
        now += 0.25
        place, heading = plan.position(now), float(plan.heading(now))
        speed = float(plan.speed(now)) * (-1.0 if plan.backward(now) else 1.0)
    assert plan.arrived and np.hypot(*(place - [10.0, 3.0])) < 0.1 and abs(heading) < 0.1


def test_turns_on_the_spot_at_start_and_goal() -> None:
    scenario = sp.Scenario(
        name="turns",
        vehicle=ROBOT,
        start={"time": 0.0, "position": [0.0, 0.0], "heading": 3.0, "speed": 0.0},
        goal={"position": [4.0, 0.0], "heading": -1.5, "speed": 0.0},
        bounds={"min": [-0.5, -0.5], "max": [4.5, 0.5]},
    )
    run = sp.simulate(scenario, noise=0.02, rate=10.0)
    assert run.arrived and abs(remainder(float(run.heading[-1]) + 1.5, 2.0 * pi)) < 0.05
    turned = np.abs([remainder(step, 2.0 * pi) for step in np.diff(run.heading)])
    driven = np.hypot(*np.diff(run.position, axis=0).T)
    assert (turned <= np.diff(run.time) * ROBOT["max_turn_rate"] + driven + 1e-6).all()
    on_the_spot = turned > driven + 1e-6
    assert turned[on_the_spot].sum() > 4.0 and driven[on_the_spot].max() < 1e-4


def test_records_and_pictures_carry_legs(tmp_path: Path) -> None:
    planner = sp.Planner(parking())
    with planner.record(tmp_path / "run.jsonl"):
        plan = planner.replan(5.0, [6.0, 2.6], 0.0, 0.0)
        planner.replan(5.5, plan.position(5.5), float(plan.heading(5.5)), -float(plan.speed(5.5)))
    run = sp.Run.load(tmp_path / "run.jsonl")
    assert run.records[1].speed < 0.0 <= run.speed.min()
    assert run.plans[1].legs is not None and run.plans[1].legs.legs[0].backward
    assert np.allclose(run.plans[1].heading(6.0), planner.plan.heading(6.0) if planner.plan else np.nan)
    run.draw(tmp_path / "run.png")


def test_a_vehicle_that_looks_for_manoeuvres_backs_away_from_who_comes() -> None:
    """There is never time, and the way ahead is as narrow as the vehicle."""
    gap, walker = 1.3, 0.3
    scenario = sp.Scenario(
        vehicle={
            "radius": 0.9,
            "max_speed": 3.0,
            "max_acceleration": 1.5,
            "max_deceleration": 2.0,
            "max_curvature": 0.2,
            "reverse": {"max_speed": 2.0, "max_acceleration": 1.5},
        },
        start={"time": 0.0, "position": (0.0, 0.0), "heading": 0.0, "speed": 0.0},
        goal={"position": (-30.0, 0.0), "heading": 0.0, "speed": 0.0},
        walls=[[(-60, low), (30, low), (30, low + 0.2), (-60, low + 0.2)] for low in (gap, -gap - 0.2)],
        obstacles=[
            {"id": "walker", "shape": {"disc": walker}, "motion": {"position": (6.0, 0.0), "velocity": (-0.8, 0.0)}}
        ],
    )
    planner = sp.Planner(scenario)
    plan = begin(planner, scenario, deadline=1e-9)
    for time in np.arange(1, 101) / 10.0:
        assert plan.safe
        place = plan.position(time)
        assert np.hypot(*(place - (6.0 - 0.8 * time, 0.0))) > 0.9 + walker
        plan = follow(planner, float(time), deadline=1e-9)
    assert place[0] < -2.0
