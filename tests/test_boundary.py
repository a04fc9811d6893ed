"""What holds at the ends of a trip: goals with a radius, accelerations given at the start."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scenes import disc, scene

import scp_planner as sp
from benchmarks.dense_check import check_trip
from scp_planner.plan import Trip
from scp_planner.problem import build_problem
from scp_planner.trajectory import Trajectory

GOALS = {
    "ahead": scene(goal={"radius": 2.0}),
    "its middle covered": scene(disc("lid", (20.0, -0.3), radius=0.6), goal={"radius": 2.0}),
    "beside a disc": scene(disc("post", (18.2, -0.3), radius=0.6), goal={"radius": 2.0}),
    "round a corner": scene(
        goal={"position": [10.0, 12.0], "radius": 1.0}, guide=[[0.0, 0.0], [10.0, 0.0], [10.0, 12.0]]
    ),
    "behind": scene(goal={"position": [-12.0, 1.0], "radius": 1.5}),
    "with a heading": scene(goal={"radius": 1.0, "heading": 0.5}),
    "stop": scene(goal={"radius": 1.0, "speed": 0.0}),
}


@pytest.mark.parametrize("name", GOALS)
def test_a_trip_ends_anywhere_within_the_radius_of_the_goal(name: str) -> None:
    scenario = GOALS[name]
    plan = sp.plan(scenario)
    assert plan.certified, plan.reason
    report = check_trip(scenario.to_dict(), plan.position, plan.start_time, plan.arrival_time)
    assert report.ok, str(report)
    assert np.hypot(*(plan.position(plan.arrival_time) - scenario.goal.position)) <= scenario.goal.radius + 1e-9
    if name != "its middle covered":
        point = sp.plan(scenario.model_copy(update={"goal": scenario.goal.model_copy(update={"radius": 0.0})}))
        assert plan.travel_time < point.travel_time - 0.6 * scenario.goal.radius / 3.0


def test_the_end_of_the_path_moves_aside_within_the_goal() -> None:
    plan = sp.plan(GOALS["beside a disc"])
    assert abs(plan.trip.trajectory.theta[-1]) > 0.1


@pytest.mark.parametrize("degree", [0, 1, 2])
@pytest.mark.parametrize("acceleration", [-1.5, 0.0, 1.2])
def test_the_acceleration_at_the_start_is_kept(acceleration: float, degree: int) -> None:
    scenario = scene(disc("o", (9.0, 0.1)), start={"acceleration": acceleration, "speed": 2.0})
    plan = sp.plan(scenario, settings=sp.Settings(acceleration_degree=degree))
    assert plan.certified, plan.reason
    assert float(plan.acceleration(plan.start_time)) == pytest.approx(acceleration, abs=1e-9)
    times = plan.start_time + np.linspace(0.0, 0.02, 5)
    differences = np.diff(plan.speed(times)) / np.diff(times)
    assert differences[0] == pytest.approx(acceleration, abs=0.2)
    free = sp.plan(scene(disc("o", (9.0, 0.1)), start={"speed": 2.0}))
    assert plan.travel_time >= free.travel_time - 1e-3
    if degree == 0:  # a tenth of a second is soon made up for
        assert plan.travel_time < free.travel_time + 0.12


def test_another_acceleration_at_the_start_is_refused() -> None:
    plan = sp.plan(scene())
    scenario = scene(start={"acceleration": 0.5})
    certificate = sp.certify(scenario, plan)
    assert not certificate.holds
    assert [violation.what for violation in certificate.violations] == ["start acceleration error"]


def test_an_end_beyond_the_radius_is_refused() -> None:
    scenario = GOALS["ahead"]
    plan = sp.plan(scenario)
    problem = build_problem(scenario, sp.zones(scenario), sp.Settings())
    theta = plan.trip.trajectory.theta.copy()
    theta[-1] = problem.ends.upper[-1] + 1e-3
    trip = Trip(plan.trip.frame, problem.space.trajectory(theta, plan.trip.trajectory.beta))
    assert isinstance(trip.trajectory, Trajectory)
    broken = {violation.what for violation in sp.certify(scenario, replace(plan, trip=trip)).violations}
    assert "distance from the goal" in broken
    theta[-1] = problem.ends.upper[-1]
    trip = Trip(plan.trip.frame, problem.space.trajectory(theta, plan.trip.trajectory.beta))
    broken = {violation.what for violation in sp.certify(scenario, replace(plan, trip=trip)).violations}
    assert "distance from the goal" not in broken
