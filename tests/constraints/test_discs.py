"""Long vehicles: several discs on an axis that points along the path."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scenes import disc, scene
from slopes import differences

import scp_planner as sp
from scp_planner.certificate.check import certify_trip
from scp_planner.constraints.box import DiscInBox
from scp_planner.constraints.discs import DiscClearance
from scp_planner.plotting.recording import record_plan
from scp_planner.problem.build import build_problem
from scp_planner.settings.planning import Settings
from scp_planner.trips.trajectory import Trajectory
from scp_planner.trips.trip import Trip, discs_at
from verification.dense_check import check_trip

pytestmark = pytest.mark.numerics

Array = np.ndarray
LONG = {"radius": 0.5, "discs": [0.0, 0.8, 1.6, -0.5]}
SCENES = {
    "round a post": scene(disc("o", (9.0, 0.4), radius=1.0), disc("p", (14.0, -1.0)), vehicle=LONG),
    "among moving discs": scene(
        disc("a", (9.0, -5.0), (0.0, 1.2)), disc("b", (14.0, 6.0), (0.0, -1.3)), disc("c", (6.0, 0.7)), vehicle=LONG
    ),
    "in a box": scene(
        disc("o", (9.0, 0.4), radius=0.8), vehicle=LONG, bounds={"min": [-2.0, -1.6], "max": [24.0, 1.6]}
    ),
    "along a bent guide": scene(
        disc("o", (10.5, 3.0), radius=0.8),
        vehicle=LONG,
        goal={"position": [12.0, 12.0]},
        guide=[[0.0, 0.0], [10.0, 0.0], [12.0, 12.0]],
    ),
}


@pytest.mark.parametrize("name", SCENES)
def test_plans_keep_all_discs_clear(name: str) -> None:
    scenario = SCENES[name]
    plan = sp.plan(scenario)
    assert plan.certified, plan.reason
    report = check_trip(scenario.to_dict(), plan.position, plan.start_time, plan.arrival_time)
    assert report.ok, str(report)
    # the least clearance that is told is that of the discs, from the heading of the plan
    times = np.linspace(plan.start_time, plan.arrival_time, 4000)
    discs = discs_at(plan.position(times), plan.heading(times), scenario.vehicle.discs)
    gaps = [zone.signed_distance(times, centre).min() - 0.5 for zone in sp.zones(scenario) for centre in discs]
    assert plan.clearance.minimum == pytest.approx(min(gaps), abs=1.1e-3)
    assert np.nanmin(record_plan(plan, scenario, times).clearance) == pytest.approx(min(gaps), abs=1e-12)


def test_rounding_does_not_tell_where_discs_are_nearest() -> None:
    """Beside what drives as fast as the vehicle no moment is nearer than others."""
    beside = disc("o", (0.0, 2.5), (1.0, 0.0))
    scenario = scene(beside, vehicle={**LONG, "max_speed": 1.0})
    problem, rng = build_problem(scenario, sp.zones(scenario), Settings()), np.random.default_rng(2)
    space, limit = problem.space, next(one for one in problem.constraints if isinstance(one, DiscClearance))
    theta, beta = np.zeros(space.path_size), np.zeros(space.acceleration_size)
    counts = np.isfinite(limit.excess(Trajectory.of(space, theta, beta)))
    assert counts.all()
    for _ in range(5):
        moved = Trajectory.of(space, theta + rng.normal(0.0, 1e-14, theta.shape), beta)
        np.testing.assert_array_equal(np.isfinite(limit.excess(moved)), counts)


@pytest.mark.parametrize("name", SCENES)
def test_the_rows_of_discs_agree_with_differences(name: str) -> None:
    scenario = SCENES[name]
    problem = build_problem(scenario, sp.zones(scenario), Settings(acceleration_degree=1))
    rng = np.random.default_rng(5)
    theta, free = problem.ends.theta.copy(), problem.ends.free
    theta[free] = 0.2 * rng.normal(size=free.stop - free.start)
    trip = Trajectory.of(problem.space, theta, rng.uniform(-0.1, 0.4, problem.space.acceleration_size))
    limits = [one for one in problem.constraints if isinstance(one, DiscClearance | DiscInBox)]
    assert any(isinstance(one, DiscInBox) for one in limits) == (scenario.bounds is not None)
    for limit in limits:
        excess = limit.excess(trip)
        index = np.flatnonzero(excess > -0.9)
        assert len(index)

        def value(other: Trajectory) -> Array:
            return limit.excess(other)[index]  # noqa: B023

        with np.errstate(invalid="ignore"):
            expected = differences(problem, trip, value, 1e-6)
        found = limit.gradient(trip, index)
        # samples that are no longer beside a minimum do not count, and after arrival the vehicle stands
        usual = np.isfinite(expected).all(axis=1)
        if isinstance(limit, DiscClearance):
            usual &= problem.samples.sigma[index // problem.zones.size] < 1.0
        assert usual.mean() > 0.8
        assert found[usual] == pytest.approx(expected[usual], abs=1e-5 * max(1.0, np.abs(expected[usual]).max()))


def test_walls_that_overlap_take_no_more_rows_than_one() -> None:
    block = [[5.0, 1.5], [15.0, 1.5], [15.0, 3.0], [5.0, 3.0]]
    found = []
    for walls in ([block], [block, [[x, y + 0.25 * (y > 2.0)] for x, y in block], block]):
        scenario = scene(vehicle=LONG, walls=walls)
        problem = build_problem(scenario, sp.zones(scenario), Settings())
        trip = Trajectory.of(problem.space, problem.ends.theta, np.zeros(problem.space.acceleration_size))
        limit = next(one for one in problem.constraints if isinstance(one, DiscClearance))
        excess = limit.excess(trip)
        places = limit.places(trip, excess)
        assert len(walls) * len(places) <= np.count_nonzero(excess > -limit.near)
        found.append((places // len(walls), limit.gradient(trip, places)))
    (one, alone), (several, together) = found
    np.testing.assert_array_equal(several, one)
    assert len(one) > 20
    assert together == pytest.approx(alone, abs=1e-12)


def test_the_sides_on_which_discs_touch_are_told() -> None:
    posts = [disc("left", (8.0, 1.1)), disc("right", (13.0, -1.1)), disc("far", (16.0, 3.0))]
    scenario = scene(*posts, vehicle=LONG)
    problem = build_problem(scenario, sp.zones(scenario), Settings())
    trip = Trajectory.of(problem.space, problem.ends.theta, np.zeros(problem.space.acceleration_size))
    limit = next(one for one in problem.constraints if isinstance(one, DiscClearance))
    # To the right of what is to the left
    assert limit.touched(trip, 0.2) == {0: -1, 1: 1}
    assert limit.touched(trip, 0.05) == {}


def test_a_trip_that_is_safe_for_one_disc_is_refused_for_a_long_vehicle() -> None:
    """The front swings out where the path turns."""
    wall = {"id": "wall", "shape": {"rectangle": [0.4, 16.0]}, "motion": {"position": [11.15, 6.0]}}
    bent: dict[str, Any] = {"goal": {"position": [10.0, 12.0]}, "guide": [[0.0, 0.0], [10.0, 0.0], [10.0, 12.0]]}
    plan = sp.plan(scene(wall, vehicle={"radius": 0.5}, **bent))
    assert plan.certified
    long = scene(wall, vehicle=LONG, **bent)
    certificate = sp.certify(long, plan)
    assert {(violation.what, violation.obstacle) for violation in certificate.violations} == {("clearance", "wall")}
    report = check_trip(long.to_dict(), plan.position, plan.start_time, plan.arrival_time)
    assert {finding.name for finding in report.violations} == {"clearance"}
    assert report["clearance"].value - 1e-3 < certificate.clearance.minimum < -0.1
    boxed = scene(vehicle=LONG, bounds={"min": [-2.0, -2.0], "max": [10.95, 15.0]}, **bent)
    assert {violation.what for violation in sp.certify(boxed, plan).violations} == {"workspace bounds"}


def test_the_certificate_agrees_with_dense_times_on_wild_paths() -> None:
    scenario = SCENES["among moving discs"]
    problem = build_problem(scenario, sp.zones(scenario), Settings())
    plan = sp.plan(scenario)
    rng, theta, free = np.random.default_rng(2), problem.ends.theta.copy(), problem.ends.free
    held = 0
    for _ in range(20):
        theta[free] = plan.trip.trajectory.theta[free]
        theta[free] += rng.uniform(0.002, 0.1) * rng.normal(size=free.stop - free.start)
        trajectory = Trajectory.of(problem.space, theta, plan.trip.trajectory.beta)
        trip = Trip(problem.frame, trajectory)
        certificate = certify_trip(scenario, trip, sp.zones(scenario))
        times = np.linspace(0.0, trajectory.travel_time, 20_001)
        points, _ = trip.at(times)
        heading = np.arctan2(*trip.frame.vectors_to_world(points.path.direction).T[::-1])
        discs = discs_at(trip.frame.to_world(points.path.position), heading, scenario.vehicle.discs)
        dense = min(zone.signed_distance(times, centre).min() - 0.5 for zone in sp.zones(scenario) for centre in discs)
        if dense > 1e-3:
            assert dense - 1.1e-3 <= certificate.clearance.minimum <= dense + 1e-9
            held += 1
        elif dense < -1e-6:
            assert any(violation.what == "clearance" for violation in certificate.violations)
    assert 2 <= held <= 18


def test_what_starts_in_an_obstacle_with_its_front_is_refused() -> None:
    with pytest.raises(sp.ScenarioError, match=r"from obstacles\[0\]"):
        scene(disc("o", (2.4, 0.0)), vehicle=LONG)
    scene(disc("o", (2.4, 0.0)), vehicle=LONG, start={"heading": None})  # it may set off in another direction
    with pytest.raises(sp.ScenarioError, match=r"start\.position.*bounds"):
        scene(vehicle=LONG, start={"heading": np.pi / 2}, bounds={"min": [-2.0, -2.0], "max": [22.0, 2.0]})


def test_a_long_vehicle_drives_online_and_its_contacts_are_those_of_its_discs() -> None:
    scenario = scene(disc("o", (9.0, 0.5), radius=0.6), vehicle={"radius": 0.5, "discs": [0.0, 1.0]})
    run = sp.simulate(scenario, noise=0.0, rate=10.0, seed=0)
    assert run.arrived
    assert not run.contact
    discs = discs_at(run.position, run.heading, (0.0, 1.0))
    gaps = [np.hypot(*(centre - [9.0, 0.5]).T).min() - 1.1 for centre in discs]
    assert run.least_clearance == pytest.approx(min(gaps), abs=5e-3)
