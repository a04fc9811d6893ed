"""Goals that leave something open, walls, courses with headings, and what tyres and motors allow."""

from __future__ import annotations

import math
from functools import partial
from typing import Any

import numpy as np
import pytest
from scenes import scene
from shapely import Point, Polygon
from slopes import assert_rows, differences

import scp_planner as sp
from scp_planner.arrays import Array
from scp_planner.certificate.check import certify
from scp_planner.constraints.goals import GoalHeading, GoalRegion, GoalSpeedRange
from scp_planner.constraints.power import Power
from scp_planner.constraints.total_acceleration import TotalAcceleration
from scp_planner.problem.build import build_problem
from scp_planner.problem.problem import Problem
from scp_planner.settings.planning import Settings
from scp_planner.trips.trajectory import Trajectory

REGION = [[18.0, -2.0], [24.0, -4.0], [26.0, 3.0], [19.0, 2.0]]
SHARED = {
    "radius": 0.3,
    "discs": [0.0, 0.6],
    "centre": 0.3,
    "max_total_acceleration": 1.4,
    "max_power": 2.5,
}


def some_trip(degree: int, *, bent: bool) -> tuple[Problem, Trajectory]:
    guide = [[0.0, 0.0], [10.0, 0.0], [20.0, 4.0]] if bent else None
    goal: dict[str, Any] = {"region": REGION, "speed_range": [1.0, 2.0], "heading_range": [0.1, 0.4]}
    if bent:
        goal = {**goal, "region": [[18, 2], [24, 2], [24, 8], [18, 8]], "position": [20.0, 4.0]}
    given = scene(vehicle=SHARED, goal=goal, guide=guide)
    problem = build_problem(given, sp.zones(given), Settings(acceleration_degree=degree))
    rng = np.random.default_rng(3)
    theta = problem.ends.theta.copy()
    theta[problem.ends.free] += rng.normal(0.0, 0.1, theta[problem.ends.free].shape)
    beta = rng.uniform(-0.4, 0.9, problem.space.acceleration_size)
    return problem, Trajectory.of(problem.space, theta, beta)


@pytest.mark.parametrize("bent", [False, True])
@pytest.mark.parametrize("degree", [0, 1])
@pytest.mark.parametrize("kind", [Power, TotalAcceleration, GoalRegion, GoalHeading, GoalSpeedRange])
def test_rows_agree_with_differences(kind: Any, degree: int, bent: bool) -> None:
    problem, trip = some_trip(degree, bent=bent)
    (limit,) = [one for one in problem.constraints if isinstance(one, kind)]
    # At the very end a trip that does not arrive is held there.
    inner = np.arange(len(limit.excess(trip)))
    if isinstance(limit, TotalAcceleration | Power):
        inner = inner[: len(limit.times.sigma)][limit.times.sigma < 1.0 - 1e-6]
    found = differences(problem, trip, lambda other: limit.excess(other)[inner], 1e-6)
    assert_rows(limit.gradient(trip, inner), found)


@pytest.mark.parametrize("bent", [False, True])
def test_tangents_beside_an_acceleration_are_those_to_the_circle(bent: bool) -> None:
    problem, trip = some_trip(0, bent=bent)
    (limit,) = [one for one in problem.constraints if isinstance(one, TotalAcceleration)]
    times = limit.times.sigma
    inner = np.flatnonzero(times < 1.0 - 1e-6)

    def parts(other: Trajectory) -> Array:
        points = other.at(limit.times)
        lateral = points.speed**2 * other.path.bend(points.path).curvature
        return np.stack([points.acceleration, lateral], axis=1)[inner] / limit.limit

    def along(tangent: Array, other: Trajectory) -> Array:
        outward: Array = (parts(other) * tangent).sum(axis=1)
        return outward

    here = parts(trip)
    direction = np.arctan2(here[:, 1], here[:, 0])
    assert len(limit.beside) > 1
    for place, turn in enumerate(limit.beside):
        tangent = np.stack([np.cos(direction + turn), np.sin(direction + turn)], axis=1)
        index = inner + place * len(times)
        assert limit.excess(trip)[index] == pytest.approx(along(tangent, trip) - 1.0)
        found = differences(problem, trip, partial(along, tangent), 1e-6)
        assert_rows(limit.gradient(trip, index), found)


def test_what_is_steered_slowly_has_one_tangent() -> None:
    given = scene(vehicle={**SHARED, "max_curvature_rate": 0.3})
    (limit,) = [
        one
        for one in build_problem(given, sp.zones(given), Settings()).constraints
        if isinstance(one, TotalAcceleration)
    ]
    assert limit.beside == (0.0,)


def test_a_region_is_reached_where_it_is_nearest() -> None:
    for region in (REGION, [[10, 2], [20, 2], [20, 12], [18, 12], [18, 4], [10, 4]]):
        given = scene(goal={"region": region, "position": None})
        plan = sp.plan(given)
        assert plan.certified, plan.reason
        end, shape = Point(plan.position(plan.arrival_time)), Polygon(region)
        assert shape.buffer(1e-6).contains(end)
        start = Point(given.start.position)
        assert start.distance(end) == pytest.approx(start.distance(shape), rel=0.01)


def test_ranges_are_kept_and_used() -> None:
    goal = {"region": REGION, "speed_range": [0.5, 1.0], "heading_range": [0.3, 0.6], "arrival_step": 0.25}
    given = scene(goal=goal)
    plan = sp.plan(given)
    assert plan.certified, plan.reason
    end = plan.arrival_time
    assert 0.5 <= plan.speed(end) <= 1.0 + 1e-9
    assert 0.3 <= plan.heading(end) <= 0.6
    assert abs(math.remainder(plan.travel_time, 0.25)) <= 1e-3
    for change in ({"speed_range": [1.2, 2.0]}, {"heading_range": [0.7, 0.9]}, {"arrival_step": 0.31}):
        judged = certify(scene(goal={**goal, **change}), plan)
        assert not judged.holds
        assert len(judged.violations) == 1


def test_tyres_and_motor_limit_the_drive() -> None:
    wall = {"id": "post", "shape": {"disc": 1.2}, "motion": {"position": [10.0, 0.3]}}
    vehicle = {"max_total_acceleration": 0.8, "max_power": 1.2}
    given = scene(vehicle=vehicle, obstacles=[wall])
    plan = sp.plan(given)
    assert plan.certified, plan.reason
    times = np.linspace(plan.start_time, plan.arrival_time, 4001)
    along, speed = plan.acceleration(times), plan.speed(times)
    across = speed**2 * plan.curvature(times)
    assert np.hypot(along, across).max() <= 0.8 * (1 + 1e-6)
    assert (along * speed).max() <= 1.2 * (1 + 1e-6)
    assert plan.limits["total_acceleration"].worst == pytest.approx(np.hypot(along, across).max(), rel=0.02)
    assert plan.limits["power"].worst == pytest.approx((along * speed).max(), rel=0.02)
    freely = sp.plan(scene(obstacles=[wall]))
    judged = certify(given, freely)
    assert {violation.what for violation in judged.violations} == {"total_acceleration", "power"}


def test_walls_are_kept_clear_of() -> None:
    walls = [[[5, -6], [7, -6], [7, 0.5], [5, 0.5]], [[11, -0.5], [13, -0.5], [13, 6], [11, 6]]]
    given = scene(walls=walls)
    plan = sp.plan(given)
    assert plan.certified, plan.reason
    places = plan.position(np.linspace(plan.start_time, plan.arrival_time, 2000))
    nearest = min(Polygon(wall).distance(Point(place)) for wall in walls for place in places)
    assert nearest >= given.vehicle.radius - 1e-9
    assert plan.clearance.minimum == pytest.approx(nearest - given.vehicle.radius, abs=2e-3)
    with pytest.raises(sp.ScenarioError, match=r"start.position = .*must be at least 0.3 m.*walls\[0\]"):
        scene(walls=[[[-1, -1], [1, -1], [1, 1], [-1, 1]]])


def test_courses_head_where_they_say() -> None:
    """A long thing that slides sideways: its length lies across its motion."""
    times = [0.0, 1.0, 2.0, 3.0, 4.0]
    places = [[10.0, 2.0 - 0.5 * t] for t in times]
    headings = [0.0, 0.2, 0.5, 0.9, 1.4]
    course = {"time": times, "position": places, "heading": headings}
    given = scene({"id": "sled", "shape": {"rectangle": [4.0, 1.0]}, "motion": course})
    (zone,) = sp.zones(given)
    points = np.random.default_rng(2).uniform([6.0, -3.0], [14.0, 4.0], (200, 2))
    for time, place, heading in zip(times, places, headings, strict=True):
        c, s = math.cos(heading), math.sin(heading)
        corners = [
            (x * c - y * s + place[0], x * s + y * c + place[1])
            for x, y in ((2, 0.5), (-2, 0.5), (-2, -0.5), (2, -0.5))
        ]
        shape = Polygon(corners)
        found = zone.signed_distance(np.full(200, time), points)
        outside = np.array([shape.distance(Point(point)) for point in points])
        assert np.maximum(found, 0.0) == pytest.approx(outside, abs=1e-9)
    plan = sp.plan(given)
    assert plan.certified, plan.reason
    moments = np.linspace(plan.start_time, plan.arrival_time, 1500)
    gaps = zone.signed_distance(moments, plan.position(moments)) - given.vehicle.radius
    assert gaps.min() >= -1e-9
    assert plan.clearance.minimum == pytest.approx(gaps.min(), abs=2e-3)


@pytest.mark.parametrize(
    ("goal", "message"),
    [
        ({"region": [[-1, -1], [1, -1], [1, 1], [-1, 1]]}, "must not hold the middle of the vehicle at the start"),
        ({"region": REGION, "radius": 1.0}, "goal.radius = 1.0: must be 0 where a region is given"),
        ({"position": [20, 0], "speed_range": [2.0, 1.0]}, r"goal.speed_range\[1\] = 1.0: must not be less than 2"),
        ({"position": [20, 0], "heading": 0.1, "heading_range": [0, 1]}, "goal.heading = 0.1: must be null"),
        ({"region": [[10, 0], [14, 3], [14, 0], [10, 2]]}, "must not cross or touch itself"),
        (
            {"position": [40, 9], "region": REGION},
            r"= \[40.0, 9.0\]: must be in goal.region, or at most 0 m",
        ),
    ],
)
def test_faulty_goals_are_refused(goal: dict[str, Any], message: str) -> None:
    with pytest.raises(sp.ScenarioError, match=message):
        scene(goal=goal)


@pytest.mark.parametrize("window", [0.0, 1e-6, 1e-3])
@pytest.mark.parametrize(("size", "duration"), [(1.0, 1.0), (1e3, 1.0), (1.0, 1e3)])
def test_a_trip_arrives_in_a_window_of_any_width(window: float, size: float, duration: float) -> None:
    vehicle = {"radius": 0.3 * size, "max_speed": 3.0 * size / duration}
    vehicle |= {"max_acceleration": 1.5 * size / duration**2, "max_deceleration": 2.0 * size / duration**2}
    motion = {"position": [10.0 * size, -4.0 * size], "velocity": [0.0, 1.2 * size / duration]}
    earliest, latest = 10.0 * duration, (10.0 + window) * duration
    scenario = sp.Scenario(
        vehicle=vehicle,
        start={"time": 0.0, "position": [0.0, 0.0], "heading": 0.0, "speed": size / duration},
        goal={"position": [20.0 * size, 0.0], "earliest_arrival": earliest, "latest_arrival": latest},
        obstacles=[{"id": "crosser", "shape": {"disc": 0.5 * size}, "motion": motion}],
    )
    plan = sp.plan(scenario)
    assert plan.certified, plan.reason
    assert earliest * (1.0 - 1e-7) <= plan.arrival_time <= latest * (1.0 + 1e-7)
