"""Targets that are met while driving: what simulations saw, against the true positions."""

from __future__ import annotations

import copy
import pickle
from time import perf_counter
from typing import Any

import numpy as np
import pytest
from replanning import follow

import scp_planner as sp

VEHICLE = {
    "radius": 0.3,
    "max_speed": 3.0,
    "max_acceleration": 2.0,
    "max_deceleration": 2.0,
    "max_lateral_acceleration": 2.0,
}
START = {"time": 0.0, "position": [0.0, 0.0], "speed": 0.0}
BOAT = {"position": [15.0, 0.0], "velocity": [-0.7, 0.9], "acceleration": [0.0, 0.05]}
OTHER = {"id": "other", "shape": {"disc": 0.5}, "motion": {"position": [8.0, 5.0], "velocity": [0.0, -0.8]}}


def boat(motion: Any = BOAT, **shape: Any) -> dict[str, Any]:
    return {"id": "boat", "shape": shape or {"disc": 1.0}, "motion": motion}


def scene(*obstacles: Any, target: Any = "boat", **goal: Any) -> sp.Scenario:
    return sp.Scenario(vehicle=VEHICLE, start=START, goal={"target": target, **goal}, obstacles=obstacles)


def away(run: sp.Run, name: str = "boat") -> float:
    return float(np.hypot(*(run.position[-1] - run.obstacles[name][-1])))


@pytest.mark.parametrize("target", ["boat", {"motion": BOAT}])
def test_boat_seen_through_noise_is_met_where_it_truly_is(target: Any) -> None:
    """A boat that is no obstacle counts as one named target; other vehicles are kept clear of."""
    name = "boat" if target == "boat" else "target"
    obstacles = [OTHER, boat()] if name == "boat" else [OTHER]
    run = sp.simulate(scene(*obstacles, target=target, radius=0.5), noise=0.1, rate=10, seed=3, time_limit=20)
    assert run.arrived and not run.contact
    assert away(run, name) <= 0.5
    known = sp.plan(scene(OTHER, boat(), radius=0.0))
    assert run.travel_time <= 1.1 * known.travel_time


def test_matched_velocity_is_that_of_the_boat() -> None:
    goal = {"radius": 0.5, "match_velocity": True}
    run = sp.simulate(scene(boat(), **goal), noise=0.05, rate=10, seed=1, time_limit=20)
    assert run.arrived and away(run) <= 0.5
    driven = run.speed[-1] * np.array([np.cos(run.heading[-1]), np.sin(run.heading[-1])])
    true = np.array(BOAT["velocity"]) + run.travel_time * np.array(BOAT["acceleration"])
    assert np.hypot(*(driven - true)) < 0.35


@pytest.mark.parametrize(("seed", "size"), [(0, 1.0), (1, 1.0), (3, 0.1), (6, 10.0)])
def test_oncoming_boat_is_turned_about_for_and_matched(seed: int, size: float) -> None:
    """Its estimate moves with each measurement, and with that the place to meet; the turn goes on all the same."""
    pace = size**0.5  # accelerations stay as they are
    position, velocity = np.array([20.0, 1.5]), pace * np.array([-1.0, 0.2])
    scenario = sp.Scenario(
        vehicle={**VEHICLE, "radius": 0.3 * size, "max_speed": 3.0 * pace},
        start={**START, "heading": 0.3},
        goal={"target": "boat", "match_velocity": True, "radius": 0.4 * size},
        obstacles=[boat({"position": size * position, "velocity": velocity}, disc=0.4 * size)],
    )
    run = sp.simulate(scenario, noise=0.1 * size, rate=10.0 / pace, seed=seed, history=5.0 * pace)
    assert run.arrived and away(run) <= 0.4 * size
    assert run.travel_time <= 1.15 * sp.plan(scenario).travel_time


def test_the_approach_is_by_the_direction_in_which_the_target_moves() -> None:
    steady = {"position": [12.0, 2.0], "velocity": [0.6, 0.6]}
    goal = {"radius": 0.5, "approach": [-1.0, -0.4]}
    run = sp.simulate(scene(boat(steady), **goal), noise=0.05, rate=10, seed=1, time_limit=20)
    assert run.arrived and away(run) <= 0.5
    assert -1.05 <= run.heading[-1] - np.pi / 4.0 <= -0.35  # noise turns the estimate


def test_target_beside_which_the_goal_is_stays_an_obstacle() -> None:
    run = sp.simulate(scene(boat(), offset=[0.0, -3.0], radius=0.3), noise=0.05, rate=10, seed=1, time_limit=20)
    assert run.arrived and not run.contact
    assert np.hypot(*(run.position[-1] - run.obstacles["boat"][-1] + [0.0, 3.0])) <= 0.3
    assert run.least_clearance > 0.0


def drive(planner: sp.Planner, times: Any, course: Any) -> sp.OnlinePlan:
    rng = np.random.default_rng(0)
    place, heading, speed, plan = np.zeros(2), None, 0.0, None
    for time in times:
        planner.observe("boat", time, course(time) + 0.05 * rng.normal(size=2), 0.0025 * np.eye(2))
        if plan is not None:
            place, heading, speed = plan.position(time), float(plan.heading(time)), float(plan.speed(time))
        plan = planner.replan(time, place, heading, speed)
    assert plan is not None
    return plan


def test_target_that_gets_away_is_told_and_the_vehicle_stops() -> None:
    planner = sp.Planner(scene(boat({"position": [10.0, 0.0], "velocity": [1.0, 0.0]}), radius=0.5))
    plan = drive(planner, np.arange(0.1, 1.0, 0.1), lambda t: np.array([10.0 + 5.0 * t, 0.0]))
    began = perf_counter()
    plan = planner.replan(1.0, plan.position(1.0), float(plan.heading(1.0)), float(plan.speed(1.0)))
    assert perf_counter() - began < 0.2
    assert str(plan.reason).startswith("no trip meets the target") and not plan.arrived and plan.safe
    assert float(plan.speed(plan.arrival_time)) == pytest.approx(0.0, abs=1e-6)


def test_every_plan_is_safe_and_leads_to_the_estimate() -> None:
    planner = sp.Planner(scene(boat({"position": [10.0, 3.0], "velocity": [0.0, 1.0]}), radius=0.5))
    plan = drive(planner, np.arange(0.1, 3.0, 0.1), lambda t: np.array([10.0, 3.0 + t]))
    assert plan.safe and plan.certified
    assert np.hypot(*(plan.position(plan.arrival_time) - [10.0, 3.0 + plan.arrival_time])) < 0.5


@pytest.mark.parametrize("match", [False, True])
def test_target_without_a_radius_is_met_within_the_way_of_a_period(match: bool) -> None:
    passing = {"position": [-7.9, -0.7], "velocity": [0.7, 0.0]}
    planner = sp.Planner(scene(target={"motion": passing}, match_velocity=match), online=sp.OnlineSettings(period=0.1))
    plan = planner.replan(0.0, [0.0, 0.0], 1.5, 0.0)
    for t in np.arange(1, 200) / 10.0:
        plan = follow(planner, float(t))
        if plan.arrived:
            break
    assert plan.arrived
    place = np.array(passing["position"]) + t * np.array(passing["velocity"])
    assert np.hypot(*(plan.position(t) - place)) <= 0.1 * VEHICLE["max_speed"]


def test_target_that_is_not_seen_is_waited_for() -> None:
    planner = sp.Planner(scene(boat(), radius=0.5))
    planner.remove_obstacle("boat")
    plan = planner.replan(0.0, [0.0, 0.0], 0.0, 0.0)
    assert str(plan.reason).startswith("the target is not seen") and plan.safe
    planner.observe("boat", 0.05, [15.0, 0.0], 0.01 * np.eye(2))
    assert not str(planner.replan(0.1, [0.0, 0.0], 0.0, 0.0).reason).startswith("the target is not seen")


def test_another_goal_may_move_and_copies_go_on_alike() -> None:
    standing = sp.Scenario(vehicle=VEHICLE, start=START, goal={"position": [10.0, 0.0]}, obstacles=[boat()])
    planner = sp.Planner(standing)
    planner.replan(0.0, [0.0, 0.0], 0.0, 0.0)
    with pytest.raises(ValueError, match="there is no obstacle 'ship'"):
        planner.set_goal({"target": "ship"})
    planner.set_goal({"target": "boat", "radius": 0.5})
    others = [copy.copy(planner), pickle.loads(pickle.dumps(planner))]
    plan = planner.replan(0.1, [0.0, 0.0], 0.0, 0.0)
    meets = np.array([15.0, 0.0]) + plan.arrival_time * np.array([-0.7, 0.9]) + [0.0, 0.025 * plan.arrival_time**2]
    assert np.hypot(*(plan.position(plan.arrival_time) - meets)) <= 0.6
    for other in others:
        assert other.replan(0.1, [0.0, 0.0], 0.0, 0.0).arrival_time == plan.arrival_time
    planner.set_limits(max_speed=2.5)
    assert planner.replan(0.2, plan.position(0.2), float(plan.heading(0.2)), float(plan.speed(0.2))).safe


@pytest.mark.parametrize("curvature", [0.3, 0.6, 1.5])
def test_a_limit_may_change_within_the_wide_radius_of_a_target(curvature: float) -> None:
    """Nothing of the last trip leads on there."""
    planner = sp.Planner(
        sp.Scenario(
            vehicle={"radius": 0.2, "max_speed": 2.3, "max_acceleration": 1.1, "max_deceleration": 5.8},
            start={"time": 0.0, "position": [0.0, 0.0], "heading": 1.74, "speed": 0.0},
            goal={"target": {"motion": {"position": [-0.2, 5.2], "velocity": [-0.5, -1.4]}}, "radius": 4.6},
        ),
        online=sp.OnlineSettings(period=0.1),
    )
    plan = planner.replan(0.0, [0.0, 0.0], 1.74, 0.0)
    for time in (0.1, 0.2, 0.3, 0.4):
        planner.set_limits(max_curvature=curvature)
        plan = planner.replan(time, plan.position(time), float(plan.heading(time)), float(plan.speed(time)))
        assert plan.safe
