"""A replan answers from the state that is reported; and a vehicle has arrived when it is at its goal as that asks."""

from __future__ import annotations

import math
from copy import copy
from functools import cache
from typing import Any

import numpy as np
import pytest

import scp_planner as sp

RADIUS, DECELERATION = 0.3, 2.0
FRONT = 8.8  # m, of a barrier across a road that is 3 m wide
POST = {"id": "post", "shape": {"disc": 0.3}, "motion": {"position": [15.9, 0.0]}}


def road(blocked: bool = True) -> sp.Scenario:
    vehicle = {"radius": RADIUS, "max_speed": 3.0, "max_acceleration": 1.5, "max_deceleration": DECELERATION}
    barrier = {"id": "barrier", "shape": {"rectangle": [0.4, 4.0], "heading": 0.0}, "motion": {"position": [9.0, 0.0]}}
    return sp.Scenario(
        vehicle={**vehicle, "max_curvature": 1.0},
        start={"time": 0.0, "position": [0.0, 0.0], "heading": 0.0, "speed": 2.0},
        goal={"position": [20.0, 0.0]},
        corridor=[[[-2.0, -1.5], [22.0, -1.5], [22.0, 1.5], [-2.0, 1.5]]],
        obstacles=[barrier] if blocked else [],
    )


@cache
def driven(settings: sp.OnlineSettings) -> list[tuple[sp.Planner, Any, float, float]]:
    """Drive exactly, in replans of 0.1 s: copies of the planner before each of them, and place, heading and speed."""
    planner, found = sp.Planner(road(), online=settings), []
    position, heading, pace = np.zeros(2), 0.0, 2.0
    for k in range(43):
        found.append((copy(planner), position, heading, pace))
        plan = planner.replan(0.1 * k, position, heading, pace)
        position, heading = plan.position(0.1 * (k + 1)), float(plan.heading(0.1 * (k + 1)))
        pace = float(plan.speed(0.1 * (k + 1)))
    return found


def answer(settings: sp.OnlineSettings, replans: int, speed: float = 1.0, turn: float = 0.0) -> tuple[Any, Any, float]:
    """After some replans, report another speed and heading: planner, plan, reported speed."""
    kept, position, heading, pace = driven(settings)[replans]
    planner = copy(kept)
    return planner, planner.replan(0.1 * replans, position, heading + turn, speed * pace), speed * pace


def clear_of_the_barrier(plan: Any, error: float) -> bool:
    """Whether the stop of a plan, or the whole of it, stays before the barrier and on the road, sampled densely."""
    trip = plan.stop if plan.stop is not None else plan.trip
    points, _ = trip.at(np.linspace(plan.start_time, plan.start_time + 10.0, 2001))
    place = trip.frame.to_world(points.path.position)
    ahead = place[:, 0].max() + RADIUS + error <= FRONT
    return bool(ahead and np.abs(place[:, 1]).max() + RADIUS <= 1.5 + 1e-9)


@pytest.mark.parametrize("error", [0.0, 0.1])
@pytest.mark.parametrize("speed", [0.7, 1.02, 1.2, 2.0])
def test_what_is_safe_can_be_followed_to_its_stop_from_the_reported_speed(speed: float, error: float) -> None:
    """At 4351452 the last plan was kept with its own speed: under full braking 1.5 m inside the barrier."""
    seen = 0
    for replans in (14, 26, 42):
        planner, plan, pace = answer(sp.OnlineSettings(tracking_error=error), replans, speed)
        now = 0.1 * replans
        stopping = 3.0 / DECELERATION
        assert stopping * abs(float(plan.speed(now)) - pace) <= error + 1e-5
        if plan.safe:
            seen += 1
            assert clear_of_the_barrier(plan, error)
        if stopping * abs(speed - 1.0) * pace / max(speed, 1e-9) > error + 1e-3 and pace > 0.0:
            assert any("m/s in speed" in doubt for doubt in planner.doubts)
    assert seen


@pytest.mark.parametrize("turn", [-1.0, -0.3, 0.05, 0.6])
def test_an_answer_begins_in_the_reported_heading(turn: float) -> None:
    planner, plan, _ = answer(sp.OnlineSettings(), 15, turn=turn)
    kept, _, _ = answer(sp.OnlineSettings(), 15)
    expected = float(kept.plan.heading(1.5)) + turn
    assert math.remainder(float(plan.heading(1.5)) - expected, 2.0 * math.pi) == pytest.approx(0.0, abs=1e-5)
    assert any("rad in heading" in doubt for doubt in planner.doubts)
    assert not plan.safe or clear_of_the_barrier(plan, 0.0)


def test_a_plan_is_kept_within_the_tolerances_that_the_follower_states() -> None:
    """With 0.1 m of tracking error, 0.067 m/s leave a stop from 3 m/s at 2 m/s2 within that, and so do 0.044 rad."""
    plain: dict[str, Any] = {"tracking_error": 0.1, "improve_every": 1000}
    cases: list[tuple[dict[str, Any], float, float, bool]] = [
        ({}, 0.06, 0.0, True),
        ({}, 0.075, 0.0, False),
        ({}, -0.06, 0.0, True),
        ({}, 0.0, 0.04, True),
        ({}, 0.0, -0.05, False),
        ({}, 0.04, 0.04, False),
        ({"speed_error": 0.5}, 0.4, 0.0, True),
        ({"speed_error": 0.5}, 0.6, 0.0, False),
        ({"heading_error": 0.2}, 0.0, 0.15, True),
        ({"heading_error": 0.1}, 0.0, 0.15, False),
    ]
    for more, speed, turn, kept in cases:
        planner = sp.Planner(road(blocked=False), online=sp.OnlineSettings(**plain, **more))
        first = planner.replan(0.0, (0.0, 0.0), 0.0, 2.0)
        reported = float(first.heading(0.1)) + turn, float(first.speed(0.1)) + speed
        plan = planner.replan(0.1, first.position(0.1), *reported)
        assert (plan.trip == first.trip) == kept and bool(planner.doubts) != kept


def before_a_post(goal: dict[str, Any], **vehicle: Any) -> sp.Scenario:
    limits = {"radius": 0.35, "max_speed": 1.5, "max_acceleration": 0.8, "max_deceleration": 1.2, **vehicle}
    return sp.Scenario(
        vehicle=limits,
        start={"time": 0.0, "position": [0.0, 0.0], "heading": 0.0, "speed": 0.0},
        goal={"position": [15.0, 0.0], **goal},
        obstacles=[POST],
    )


@pytest.mark.parametrize("jerk", [None, 2.0])
@pytest.mark.parametrize("goal", [{"speed": 0.0}, {"speed": 0.0, "radius": 0.5, "heading": 0.0}, {}, {"radius": 0.5}])
@pytest.mark.parametrize("error", [0.0, 0.08])
def test_who_arrives_can_stop_from_the_reported_speed(jerk: float | None, goal: dict[str, Any], error: float) -> None:
    """At 4351452: "arrived; the vehicle stands", safe and at speed 0 at once, when told 1.27 m/s before a post."""
    arrived = 0
    for x in (14.52, 14.95, 15.0, 15.02):
        for speed in (0.0, 0.02, 0.75, 1.5):
            planner = sp.Planner(before_a_post(goal, max_jerk=jerk), online=sp.OnlineSettings(tracking_error=error))
            plan = planner.replan(0.0, (x, 0.0), 0.0, speed)
            assert float(plan.speed(0.0)) == pytest.approx(speed, abs=1e-6)
            if plan.safe:
                trip = plan.stop if plan.stop is not None else plan.trip
                points, _ = trip.at(np.linspace(0.0, 10.0, 1001))
                away = np.hypot(*(trip.frame.to_world(points.path.position) - [15.9, 0.0]).T)
                assert away.min() >= 0.65 + error - 1e-6
            if plan.arrived:
                arrived += 1
                assert planner.at_goal((x, 0.0)) and (plan.safe or speed == 0.0)
                assert speed < 0.2 or "speed" not in goal
    assert arrived


@pytest.mark.parametrize("asked", [{"speed": 1.0}, {"speed_range": [0.8, 1.2]}])
def test_the_speed_of_a_goal_counts(asked: dict[str, Any]) -> None:
    scenario = before_a_post({"position": [10.0, 0.0], **asked})
    for speed, as_asked in ((0.0, False), (0.3, False), (1.0, True), (1.5, False)):
        plan = sp.Planner(scenario).replan(0.0, (10.0, 0.0), 0.0, speed)
        assert plan.arrived == as_asked


@pytest.mark.parametrize("asked", [{"heading": 0.0}, {"heading_range": [-0.1, 0.1]}])
def test_the_heading_of_a_goal_counts(asked: dict[str, Any]) -> None:
    scenario = before_a_post({"position": [10.0, 0.0], "speed": 0.0, **asked})
    for heading, as_asked in ((0.0, True), (0.04, True), (2.0 * math.pi, True), (0.3, False), (math.pi, False)):
        plan = sp.Planner(scenario).replan(0.0, (10.0, 0.0), heading, 0.0)
        assert plan.arrived == as_asked and plan.safe


@pytest.mark.parametrize("scale", [1.0, 1e-3, 1e4])
@pytest.mark.parametrize("goal", [{"speed": 0.0}, {}, {"speed": 0.0, "radius": 0.05}])
def test_a_follower_that_errs_by_millimetres_arrives(goal: dict[str, Any], scale: float) -> None:
    """At 4351452 it circled a goal without a radius for 60 s, in an empty world and with default settings."""
    goal = {**goal, "radius": scale * goal.get("radius", 0.0), "position": [3.0 * scale, 0.0]}
    limits = {"radius": 0.3 * scale, "max_speed": 0.6 * scale, "max_curvature": 2.0 / scale}
    limits |= {"max_acceleration": 0.5 * scale, "max_deceleration": 0.5 * scale}
    start = {"time": 0.0, "position": [0.0, 0.0], "heading": 0.0, "speed": 0.0}
    planner = sp.Planner(sp.Scenario(vehicle=limits, start=start, goal=goal))
    rng, position, heading, speed, farthest = np.random.default_rng(1), np.zeros(2), 0.0, 0.0, 0.0
    for k in range(120):
        plan = planner.replan(0.1 * k, position, heading, speed)
        if plan.arrived:
            break
        after = 0.1 * (k + 1)
        position = plan.position(after) + 0.003 * scale * rng.standard_normal(2)
        heading = float(plan.heading(after)) + 0.003 * rng.standard_normal()
        speed, farthest = max(float(plan.speed(after)), 0.0), max(farthest, float(position[0]))
    assert plan.arrived and 0.1 * k < 8.0 and farthest < 3.05 * scale
    assert planner.online.period is not None
    within = goal["radius"] or 0.6 * scale * planner.online.period
    assert math.dist(position, goal["position"]) <= within + 1e-9


def test_the_tolerance_of_arrival_is_what_the_settings_say() -> None:
    scenario = before_a_post({"position": [10.0, 0.0], "speed": 0.0})
    for settings, tolerance in (
        (sp.OnlineSettings(period=0.1), 0.15),
        (sp.OnlineSettings(period=0.1, tracking_error=0.05), 0.2),
        (sp.OnlineSettings(arrival_tolerance=0.02), 0.02),
    ):
        planner = sp.Planner(scenario, online=settings)
        for share, there in ((0.99, True), (1.01, False)):
            assert planner.at_goal((10.0 - share * tolerance, 0.0)) == there
