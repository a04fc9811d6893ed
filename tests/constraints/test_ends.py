"""What holds at the ends of a trip: goals with a radius, times of arrival, accelerations given at the start."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scenes import disc, scene

import scp_planner as sp
from scp_planner.problem.build import build_problem
from scp_planner.trips.trajectory import Trajectory
from scp_planner.trips.trip import Trip
from verification.dense_check import check_trip

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


WAITS = {
    "a little": scene(disc("o", (9.0, 0.1)), goal={"earliest_arrival": 9.0}),
    "at one moment": scene(disc("o", (9.0, 0.1)), goal={"earliest_arrival": 9.0, "latest_arrival": 9.0}),
    "among others": scene(
        disc("a", (9.0, -5.0), (0.0, 0.6)), disc("b", (14.0, 6.0), (0.0, -0.5)), goal={"earliest_arrival": 13.0}
    ),
    "for long, with a start too fast for that": scene(
        disc("o", (9.0, 0.1)), start={"speed": 2.0}, goal={"earliest_arrival": 60.0, "latest_arrival": 61.0}
    ),
    "for long, from a stop, to a stop": scene(start={"speed": 0.0}, goal={"speed": 0.0, "earliest_arrival": 45.0}),
}


@pytest.mark.parametrize("name", WAITS)
def test_the_vehicle_does_not_arrive_before_it_may(name: str) -> None:
    scenario = WAITS[name]
    earliest = scenario.goal.earliest_arrival
    assert earliest is not None
    plan = sp.plan(scenario)
    assert plan.certified, plan.reason
    assert plan.arrival_time == pytest.approx(earliest, abs=1e-3)
    assert plan.lower_bound == earliest
    report = check_trip(scenario.to_dict(), plan.position, plan.start_time, plan.arrival_time)
    assert report.ok, str(report)
    again = sp.Plan.from_dict(plan.to_dict(), "plan.json")
    assert again.arrival_time == pytest.approx(plan.arrival_time, abs=1e-9)
    assert sp.certify(scenario, again).holds


def test_a_latest_arrival_that_can_be_met_changes_nothing() -> None:
    free = sp.plan(scene(disc("o", (9.0, 0.1))))
    plan = sp.plan(scene(disc("o", (9.0, 0.1)), goal={"latest_arrival": free.arrival_time + 0.01}))
    assert plan.certified
    assert plan.travel_time == free.travel_time


def test_a_latest_arrival_that_cannot_be_met_is_a_failure_that_says_so() -> None:
    plan = sp.plan(scene(disc("o", (9.0, 0.1)), goal={"latest_arrival": 6.5}))
    assert plan.status == "infeasible"
    assert plan.reason is not None
    assert plan.reason.startswith("latest arrival 7.1")
    assert "acceptable with the latest arrival 0.6" in plan.reason


def test_arrivals_outside_the_window_are_refused() -> None:
    plan = sp.plan(scene())
    for window, broken in (
        ({"earliest_arrival": plan.arrival_time + 2e-3}, ["earliest arrival"]),
        ({"latest_arrival": plan.arrival_time - 2e-3}, ["latest arrival"]),
        ({"earliest_arrival": plan.arrival_time - 1e-3, "latest_arrival": plan.arrival_time + 1e-3}, []),
    ):
        certificate = sp.certify(scene(goal=window), plan)
        assert [violation.what for violation in certificate.violations] == broken
        assert certificate.holds is (not broken)
        report = check_trip(scene(goal=window).to_dict(), plan.position, plan.start_time, plan.arrival_time)
        assert [finding.name.replace("_", " ") for finding in report.violations] == broken


CORNER = {"goal": {"position": [10.0, 12.0]}, "guide": [[0.0, 0.0], [10.0, 0.0], [10.0, 12.0]]}


def test_a_path_that_sets_off_steeply_across_its_straight_guide_gets_another_one() -> None:
    plan = sp.plan(scene(goal={"position": [10.0, 12.0]}))
    assert plan.certified
    assert not plan.trip.trajectory.space.guide.straight
    assert plan.travel_time < 5.73  # 5.755 over the straight guide


@pytest.mark.parametrize("radius", [0.3, 0.5])
def test_a_corner_is_cut_as_far_as_its_guide_and_no_obstacle_would_have_it(radius: float) -> None:
    """Over a new guide lateral accelerations peak between stations: they are pressed down until it is certified."""
    plan = sp.plan(scene(vehicle={"radius": radius}, **CORNER))
    free = sp.plan(scene(goal=CORNER["goal"]))
    assert plan.certified
    assert plan.travel_time <= 1.002 * free.travel_time


def test_an_end_beyond_the_radius_is_refused() -> None:
    scenario = GOALS["ahead"]
    plan = sp.plan(scenario)
    problem = build_problem(scenario, sp.zones(scenario), sp.Settings())
    theta = plan.trip.trajectory.theta.copy()
    theta[-1] = problem.ends.upper[-1] + 1e-3
    trip = Trip(plan.trip.frame, Trajectory.of(problem.space, theta, plan.trip.trajectory.beta))
    assert isinstance(trip.trajectory, Trajectory)
    broken = {violation.what for violation in sp.certify(scenario, replace(plan, trip=trip)).violations}
    assert "distance from the goal" in broken
    theta[-1] = problem.ends.upper[-1]
    trip = Trip(plan.trip.frame, Trajectory.of(problem.space, theta, plan.trip.trajectory.beta))
    broken = {violation.what for violation in sp.certify(scenario, replace(plan, trip=trip)).violations}
    assert "distance from the goal" not in broken


def test_online_the_vehicle_waits_for_the_earliest_arrival_and_drives_on_when_it_is_late() -> None:
    early = sp.simulate(scene(disc("o", (9.0, 0.1)), goal={"earliest_arrival": 10.0}), noise=0.0, rate=5.0, seed=0)
    assert early.arrived
    assert not early.contact
    assert early.travel_time == pytest.approx(10.0, abs=0.05)
    late = sp.simulate(scene(disc("o", (9.0, 0.1)), goal={"latest_arrival": 6.0}), noise=0.0, rate=5.0, seed=0)
    assert late.arrived
    assert not late.contact
    assert late.travel_time < 7.5
