"""Limits that only some scenarios have: gradients against differences, and what the certificate says of them."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scenes import CROSSERS, disc, scene
from shapely.geometry import LineString, Point
from slopes import differences, trip_near_the_guide

import scp_planner as sp
from scp_planner.arrays import Array
from scp_planner.baseline.descent_run import DescentSettings
from scp_planner.constraints.curvature_rate import rate_partials
from scp_planner.constraints.speed_limits import SpeedLimits
from scp_planner.problem.build import build_problem
from scp_planner.problem.problem import Problem
from scp_planner.problem.profile import fastest_profile
from scp_planner.scenario.places import Line, Stretch
from scp_planner.settings.planning import Settings
from scp_planner.trips.trajectory import Trajectory
from verification.dense_check import check_trip

pytestmark = pytest.mark.numerics

USUAL = 4  # constraints that every one of these scenes has
BENT: list[list[float]] = [[0.0, 0.0], [10.0, 0.0], [16.0, 12.0]]
SLOW: list[dict[str, Any]] = [{"from": 4.0, "to": 8.0, "speed": 1.2}, {"from": 13.0, "speed": 1.6}]

SCENES = {
    "earliest arrival": (scene(*CROSSERS, goal={"earliest_arrival": 12.0}), Settings()),
    "slow stretches": (scene(*CROSSERS, speed_limits=SLOW), Settings()),
    "slow stretches, linear acceleration": (scene(*CROSSERS, speed_limits=SLOW), Settings(acceleration_degree=1)),
    "jerk": (scene(*CROSSERS, vehicle={"max_jerk": 2.0}), Settings()),
    "jerk, quadratic acceleration": (scene(*CROSSERS, vehicle={"max_jerk": 2.0}), Settings(acceleration_degree=2)),
    "curvature rate": (scene(*CROSSERS, vehicle={"max_curvature_rate": 0.2}), Settings(acceleration_degree=1)),
    "curvature rate along a bent guide": (
        scene(*CROSSERS, vehicle={"max_curvature_rate": 0.2}, goal={"position": [16.0, 12.0]}, guide=BENT),
        Settings(acceleration_degree=1),
    ),
    "all of them": (
        scene(
            *CROSSERS,
            vehicle={"max_curvature_rate": 0.2, "max_jerk": 2.0},
            goal={"position": [16.0, 12.0], "earliest_arrival": 12.0},
            guide=BENT,
            speed_limits=SLOW,
        ),
        Settings(),
    ),
}


def problem_and_trip(name: str, seed: int) -> tuple[Problem, Trajectory]:
    scenario, settings = SCENES[name]
    problem = build_problem(scenario, sp.zones(scenario), settings)
    return problem, trip_near_the_guide(problem, seed)


def test_rounding_does_not_tell_which_of_two_pieces_is_faster() -> None:
    """Where a drive is refined its accelerations are equal in pairs: in other units by other last digits."""
    problem = build_problem(scene(), (), Settings())
    space, rng = problem.space, np.random.default_rng(5)
    breaks = space.acceleration.breakpoints
    pairs = np.repeat(rng.uniform(-0.02, 0.2, len(breaks)), 2)[: len(breaks) - 1]
    line = Line(np.array([[0.0, 0.0], [20.0, 0.0]]))
    theta = np.zeros(space.path_size)
    for place in (5.0, 10.0, 15.0):
        limit = SpeedLimits(problem, (Stretch(line, place, np.inf, 1.0),))
        known = np.isfinite(limit.excess(Trajectory.of(space, theta, pairs)))
        for _ in range(5):
            rounded = pairs * (1.0 + rng.normal(0.0, 1e-14, len(pairs)))
            other = limit.excess(Trajectory.of(space, theta, rounded))
            np.testing.assert_array_equal(np.isfinite(other), known)


def test_a_border_moved_past_a_rise_of_the_acceleration_is_foreseen() -> None:
    """Braking up to a slow stretch: whoever is there later, in a share of the travel time, has braked no longer."""
    problem = build_problem(scene(), (), Settings())
    space, free = problem.space, problem.ends.free
    breaks = space.acceleration.breakpoints
    beta = np.where(np.arange(len(breaks) - 1) < 8, 0.3, 0.0)
    beta[8:11] = -1.0
    trip = Trajectory.of(space, np.zeros(space.path_size), beta)
    gate = trip.at(space.time_table(breaks[[11]] - 1e-6))
    stretch = Stretch(Line(np.array([[0.0, 0.0], [20.0, 0.0]])), float(gate.path.position[0, 0]), np.inf, 1.0)
    limit = SpeedLimits(problem, (stretch,))
    first = len(space.tables.station_parameters)
    rows = first + np.array([0, 2, 4])  # the border's own, and those of the pieces before and after it
    known = limit.excess(trip)[rows]
    assert known[1] == -np.inf
    assert known[2] <= known[0]
    other = beta + 1e-4 * (np.arange(len(beta)) == 2)
    moved = Trajectory.of(space, trip.theta, other)
    rho = moved.travel_time / trip.travel_time - 1.0
    step = np.concatenate([np.zeros(free.stop - free.start), other - beta + 2.0 * beta * rho, [rho]])
    foreseen = known[[0, 2]] + limit.gradient(trip, rows[[0, 2]]) @ step
    found = limit.excess(moved)[rows[0]]
    assert found == pytest.approx(foreseen[1], abs=1e-6)
    assert found > foreseen[0] + 1e-4


@pytest.mark.parametrize("seed", [0, pytest.param(1, marks=pytest.mark.slow)])
@pytest.mark.parametrize("name", SCENES)
def test_the_rows_of_optional_limits_agree_with_differences(name: str, seed: int) -> None:
    problem, trip = problem_and_trip(name, seed)
    for limit in problem.constraints[USUAL:]:
        index = np.flatnonzero(np.isfinite(limit.excess(trip)))
        assert len(index) >= 1

        def value(other: Trajectory) -> Array:
            return limit.excess(other)[index]  # noqa: B023

        expected = differences(problem, trip, value, 1e-6)
        found = limit.gradient(trip, index)
        scale = max(1.0, float(np.abs(expected[np.isfinite(expected)]).max()))
        # a place may leave its stretch in a step, and a station may be passed just when the acceleration jumps
        usual = np.isfinite(expected).all(axis=1) & (np.abs(expected).max(axis=1) < 1e3)
        wrong = np.abs(found - expected)[usual].max(axis=1) > 1e-5 * scale
        assert usual.mean() > 0.9
        # nor are differences to both sides made at the last station, where the trip ends
        assert wrong.sum() <= 2, np.flatnonzero(usual)[wrong]


def test_a_scenario_without_them_has_none() -> None:
    scenario = scene(*CROSSERS)
    problem = build_problem(scenario, sp.zones(scenario), Settings())
    names = ["clearance", "lateral_acceleration", "curvature", "speed"]
    assert [one.name for one in problem.constraints] == names
    assert len(names) == USUAL and problem.profile is None


# places along a line


coordinates = st.floats(-15.0, 25.0)


@given(st.lists(st.tuples(coordinates, coordinates), min_size=1, max_size=8))
def test_stations_are_those_of_shapely(points: list[tuple[float, float]]) -> None:
    drawn, line = LineString(BENT), Line(np.array(BENT))
    assert line.length == pytest.approx(drawn.length)
    for point, station in zip(points, line.nearest(np.array(points)), strict=True):
        assert Point(point).distance(drawn.interpolate(station)) == pytest.approx(
            Point(point).distance(drawn), abs=1e-9
        )


def crossed(line: Line, border: float, begin: np.ndarray, end: np.ndarray) -> float:
    """The share of a straight way at which the stations of its points pass a border, by bisection."""
    low, high = 0.0, 1.0
    for _ in range(60):
        middle = 0.5 * (low + high)
        beyond = line.nearest((begin + middle * (end - begin))[None])[0] >= border
        low, high = (low, middle) if beyond else (middle, high)
    return high


@pytest.mark.parametrize("border", [3.0, 5.6, 6.4, 6.0, 9.0], ids=str)
def test_where_a_border_is_crossed_moves_as_its_direction_says(border: float) -> None:
    line = Line(np.array([[0.0, 0.0], [6.0, 0.0], [6.0, 5.0]]))
    # Inside of the bend, where the stations jump over borders near it, and outside
    for begin, end in (([2.0, 1.3], [4.7, 4.0]), ([2.5, -0.4], [6.2, 3.5])):
        first, last = np.array(begin), np.array(end)
        share = crossed(line, border, first, last)
        assert 0.0 < share < 1.0
        direction = line.across_border(first + share * (last - first), border)
        aside, h = np.array([0.6, -0.8]), 1e-5
        moved = [crossed(line, border, first + way * aside, last + way * aside) for way in (h, -h)]
        expected = -(direction @ aside) / (direction @ (last - first))
        assert (moved[0] - moved[1]) / (2.0 * h) == pytest.approx(expected, rel=1e-4)


def test_no_point_of_a_stretch_is_overlooked() -> None:
    rng = np.random.default_rng(4)
    line = Line(np.array([[0.0, 0.0], [6.0, 0.0], [6.0, 5.0], [1.0, 5.5]]))
    middle, reach = rng.uniform(-2.0, 8.0, (300, 2)), rng.uniform(0.0, 0.8, 300)
    sure = line.may_be_between(middle, reach, 5.0, 9.0)
    angle, far = rng.uniform(0.0, 2.0 * np.pi, (300, 50)), np.sqrt(rng.uniform(0.0, 1.0, (300, 50)))
    around = middle[:, None] + (far * reach[:, None])[:, :, None] * np.stack([np.cos(angle), np.sin(angle)], axis=2)
    stations = line.nearest(around.reshape(-1, 2)).reshape(300, 50)
    there = ((stations >= 5.0) & (stations <= 9.0)).any(axis=1)
    assert np.all(sure[there])
    assert 0.2 < there.mean() < sure.mean() < there.mean() + 0.15


def test_the_fastest_profile_is_that_of_the_textbook() -> None:
    stations = np.linspace(0.0, 20.0, 2001)
    limits = np.where((stations >= 6.0) & (stations <= 10.0), 1.0, 3.0)
    profile = fastest_profile(stations, limits, 1.0, None, 1.5, 2.0)
    # up to 3 m/s, on, down to 1 m/s at 6 m; 4 m at 1 m/s; up to 3 m/s, and on
    up, down = 2.0 / 1.5, 2.0 / 2.0
    on = (6.0 - 4.0 / 1.5 - 4.0 / 2.0) / 3.0
    last = (10.0 - 4.0 / 1.5) / 3.0
    assert profile.times[-1] == pytest.approx(up + on + down + 4.0 + up + last, abs=2e-3)
    expected = np.cumsum([up, on, down, 4.0, up])
    assert np.array(profile.switches) == pytest.approx(expected, abs=0.02)


# plans


def test_a_slow_stretch_costs_what_the_textbook_says() -> None:
    scenario = scene(speed_limits=[{"from": 6.0, "to": 10.0, "speed": 1.0}])
    plan = sp.plan(scenario)
    assert plan.certified, plan.reason
    up, down = 2.0 / 1.5, 2.0 / 2.0
    best = 2 * up + down + 4.0 + (6.0 - 4.0 / 1.5 - 4.0 / 2.0 + 10.0 - 4.0 / 1.5) / 3.0
    assert best <= plan.travel_time <= 1.001 * best
    assert 0.999 < plan.limits["speed_limits[0]"].worst <= 1.0


def test_a_stretch_that_a_path_is_never_in_costs_nothing() -> None:
    """Below the bend of the line the stations jump from before the stretch to beyond it."""
    line = [[8.0, 0.0], [10.0, 6.0], [12.0, 0.0]]
    plan = sp.plan(scene(speed_limits=[{"from": 3.0, "to": 9.6, "speed": 1.0, "line": line}]))
    assert plan.certified, plan.reason
    assert plan.travel_time < 1.001 * plan.lower_bound


def test_what_is_too_fast_for_a_place_is_refused() -> None:
    plan = sp.plan(scene(disc("o", (9.0, 0.1))))
    slow = {"from": 6.0, "to": 10.0, "speed": 2.0}
    elsewhere = {"from": 6.0, "to": 10.0, "speed": 2.0, "line": [[0.0, 50.0], [1.0, 50.0], [20.0, 80.0]]}
    scenario = scene(disc("o", (9.0, 0.1)), speed_limits=[slow, elsewhere])
    certificate = sp.certify(scenario, plan)
    assert [violation.what for violation in certificate.violations] == ["speed_limits[0]"]
    assert certificate.violations[0].value == pytest.approx(3.0, abs=0.01)
    report = check_trip(scenario.to_dict(), plan.position, plan.start_time, plan.arrival_time)
    assert [finding.name for finding in report.violations] == ["place_speed"]
    # as fast as allowed, and a little faster than that
    worst = sp.certify(scenario, plan).limits["speed_limits[0]"].worst
    for share, holds in ((1.0 + 1e-6, True), (1.0 - 1e-6, False)):
        allowed = scene(disc("o", (9.0, 0.1)), speed_limits=[{**slow, "speed": worst * share}])
        assert sp.certify(allowed, plan).holds is holds


def test_places_stay_where_they_are_while_the_vehicle_drives() -> None:
    scenario = scene(speed_limits=[{"from": 6.0, "to": 10.0, "speed": 1.0}], start={"speed": 0.0})
    planner = sp.Planner(scenario)
    plan = planner.replan(time=0.0, position=(0.0, 0.0), heading=0.0, speed=0.0)
    for time in np.arange(0.1, 2.0, 0.1):
        x, y = plan.position(time)
        plan = planner.replan(time, (x, y), float(plan.heading(time)), float(plan.speed(time)))
    assert plan.position(1.9)[0] > 2.5
    assert plan.certified, plan.reason
    times = np.linspace(plan.start_time, plan.arrival_time, 2000)
    inside = np.abs(plan.position(times)[:, 0] - 8.0) < 2.0
    assert plan.speed(times)[inside].max() <= 1.0
    assert plan.speed(times)[inside].max() > 0.99


# rates


@pytest.mark.parametrize("guide", [None, BENT])
def test_the_rate_of_the_curvature_is_its_derivative(guide: list[list[float]] | None) -> None:
    scenario = scene(goal={"position": [16.0, 12.0]}, guide=guide, start={"heading": None})
    problem = build_problem(scenario, (), Settings())
    rng = np.random.default_rng(1)
    theta = problem.ends.theta.copy()
    theta[problem.ends.free] = 0.3 * rng.normal(size=len(theta[problem.ends.free]))
    path = Trajectory.of(problem.space, theta, np.zeros(problem.space.acceleration_size)).path
    parameters, step = rng.uniform(0.01, 0.99, 200), 1e-6
    curvature = [path.bend(path.points(parameters + sign * step)).curvature for sign in (1.0, -1.0)]
    by_differences = (curvature[0] - curvature[1]) / (2.0 * step * problem.space.length)
    points = path.points(parameters)
    assert path.curvature_rate(points) == pytest.approx(by_differences, abs=1e-5)
    # the partial derivatives give back the change of the rate along the path, where only f and its derivatives move
    partials = rate_partials(path, parameters)
    other = theta.copy()
    other[problem.ends.free] += 1e-6 * rng.normal(size=len(theta[problem.ends.free]))
    moved = Trajectory.of(problem.space, other, np.zeros(problem.space.acceleration_size)).path
    basis, change = problem.space.path, np.zeros(200)
    for order, partial in enumerate(partials):
        change += partial * (basis.rows(parameters) @ (other - theta)) / problem.space.length**order
        basis = basis.derivative
    there = moved.points(parameters)
    found = moved.curvature_rate(there) / there.speed - path.curvature_rate(points) / points.speed
    assert np.abs(found).max() > 1e-7
    assert change == pytest.approx(found, abs=1e-4 * np.abs(found).max())


def jerks(plan: sp.Plan) -> Array:
    """Slopes of the acceleration over 1 ms."""
    times = np.arange(plan.start_time, plan.arrival_time, 1e-3)
    return np.abs(np.diff(plan.acceleration(times))) / 1e-3


@cache
def without_limit_of_the_jerk() -> sp.Plan:
    return sp.plan(scene(disc("o", (9.0, 0.1)), start={"speed": 0.0, "acceleration": 0.0}, goal={"speed": 0.0}))


@pytest.mark.parametrize("degree", [0, 1, 2])
def test_the_jerk_is_limited_and_used(degree: int) -> None:
    """A degree of 0 makes way for accelerations that do not jump."""
    free = without_limit_of_the_jerk()
    scenario = scene(
        disc("o", (9.0, 0.1)),
        vehicle={"max_jerk": 1.5},
        start={"speed": 0.0, "acceleration": 0.0},
        goal={"speed": 0.0},
    )
    plan = sp.plan(scenario, settings=Settings(acceleration_degree=degree))
    assert plan.certified, plan.reason
    assert jerks(plan).max() <= 1.5 + 1e-9
    assert jerks(plan).max() > 1.49
    assert free.travel_time + 0.3 < plan.travel_time < free.travel_time + 1.5
    report = check_trip(scenario.to_dict(), plan.position, plan.start_time, plan.arrival_time)
    assert report.ok, str(report)
    certificate = sp.certify(scenario, free)
    assert [violation.what for violation in certificate.violations] == ["jerk"]
    broken = check_trip(scenario.to_dict(), free.position, free.start_time, free.arrival_time)
    assert [finding.name for finding in broken.violations] == ["jerk"]


def test_the_rate_of_the_curvature_is_limited_and_used() -> None:
    obstacle = disc("o", (6.0, 0.1), radius=1.0)
    free = sp.plan(scene(obstacle))
    scenario = scene(obstacle, vehicle={"max_curvature_rate": 0.2})
    plan = sp.plan(scenario)
    assert plan.certified, plan.reason
    times = np.arange(plan.start_time, plan.arrival_time, 1e-3)
    rates = np.abs(np.diff(plan.curvature(times))) / 1e-3
    assert 0.198 < rates.max() <= 0.2 + 1e-9
    assert plan.travel_time > free.travel_time
    report = check_trip(scenario.to_dict(), plan.position, plan.start_time, plan.arrival_time)
    assert report.ok, str(report)
    certificate = sp.certify(scenario, free)
    assert [violation.what for violation in certificate.violations] == ["curvature_rate"]
    broken = check_trip(scenario.to_dict(), free.position, free.start_time, free.arrival_time)
    assert [finding.name for finding in broken.violations] == ["curvature_rate"]


def test_penalty_descent_knows_them_too() -> None:
    scenario = scene(disc("o", (9.0, 0.1)), vehicle={"max_jerk": 3.0}, speed_limits=SLOW[:1])
    coarse = Settings(path_span=2.5, acceleration_spans=15, samples=80, max_runs=1)
    plan = sp.plan(scenario, coarse)
    by_descent = sp.penalty_descent(scenario, settings=coarse, descent=DescentSettings(settlings=4))
    assert by_descent.certified, by_descent.reason
    assert plan.certified, plan.reason
    assert by_descent.travel_time == pytest.approx(plan.travel_time, rel=0.01)
