"""Guides against quadrature and differences, and trips over curved ones."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from scenes import scene
from scipy.integrate import quad
from scipy.interpolate import CubicSpline

import scp_planner as sp
from scp_planner.mathematics.dubins import Pose, shortest_path
from scp_planner.problem.build import build_problem
from scp_planner.problem.guides import guide_along
from scp_planner.settings.planning import Settings
from scp_planner.trips.guide import CurvedGuide, StraightGuide
from scp_planner.trips.smoothing import smooth_guide
from scp_planner.trips.space import TripSpace
from scp_planner.trips.trajectory import Trajectory
from verification.dense_check import check_trip

pytestmark = pytest.mark.numerics

Array = np.ndarray
POLYLINES = {
    "corner": [[0, 0], [10, 0], [10, 12]],
    "zigzag": [[0, 0], [6, 3], [12, -3], [18, 3], [24, 0]],
    "u-turn": [[0, 0], [15, 0], [15, 5], [0, 5]],
    "arc": [[8 * np.sin(a), 8 - 8 * np.cos(a)] for a in np.linspace(0.0, 4.0, 60)],
    "sharp": [[0, 0], [10, 0], [1, 3]],
}


def guide(name: str, radius: float = 2.0) -> CurvedGuide:
    made = smooth_guide(np.array(POLYLINES[name], dtype=float), radius)
    assert isinstance(made, CurvedGuide)
    return made


@pytest.mark.parametrize("name", POLYLINES)
def test_the_frame_is_that_of_the_integrated_heading(name: str) -> None:
    curve = guide(name)
    knots = np.linspace(0.0, curve.length, len(curve.headings))
    heading = CubicSpline(knots, curve.headings)
    stations = np.sort(np.random.default_rng(0).uniform(0.0, curve.length, 12))
    frame = curve.frame(stations)
    place, last = np.zeros(2), 0.0
    for k, station in enumerate(stations):
        inner = knots[(knots > last) & (knots < station)]
        for low, high in zip([last, *inner], [*inner, station], strict=True):
            place += [
                quad(lambda s: np.cos(heading(s)), low, high, epsabs=1e-13)[0],
                quad(lambda s: np.sin(heading(s)), low, high, epsabs=1e-13)[0],
            ]
        last = station
        np.testing.assert_allclose(frame.position[k], place, atol=1e-10)
    tangent = np.stack([np.cos(heading(stations)), np.sin(heading(stations))], axis=1)
    np.testing.assert_allclose(frame.tangent, tangent, atol=1e-12)
    np.testing.assert_allclose(np.einsum("ij,ij->i", frame.tangent, frame.normal), 0.0, atol=1e-15)
    np.testing.assert_allclose(frame.curvature, heading(stations, 1), atol=1e-10)
    np.testing.assert_allclose(frame.curvature_rate, heading(stations, 2), atol=1e-9)


@pytest.mark.parametrize("name", POLYLINES)
def test_smoothed_polylines_keep_their_ends_and_stay_near(name: str) -> None:
    corners = np.array(POLYLINES[name], dtype=float)
    curve = guide(name)
    along = curve.frame(np.linspace(0.0, curve.length, 2001))
    np.testing.assert_allclose(along.position[0], corners[0], atol=1e-12)
    np.testing.assert_allclose(along.position[-1], corners[-1], atol=1e-9)
    a, b = corners[:-1], corners[1:]
    share = np.einsum("nki,ki->nk", along.position[:, None] - a, b - a) / ((b - a) ** 2).sum(axis=1)
    nearest = a + np.clip(share, 0.0, 1.0)[..., None] * (b - a)
    strayed = np.hypot(*(along.position[:, None] - nearest).T).min(axis=0)
    assert strayed.max() < (3.5 if name == "sharp" else 1.5)
    if name != "sharp":  # there the legs leave no room for the radius
        assert np.abs(along.curvature).max() < 1.0


def test_straight_parts_stay_where_they_are() -> None:
    curve = guide("corner")
    along = curve.frame(np.linspace(0.0, 5.0, 50))
    np.testing.assert_allclose(along.position[:, 1], 0.0, atol=5e-3)
    np.testing.assert_allclose(along.curvature, 0.0, atol=5e-3)


def test_a_polyline_in_line_is_straight() -> None:
    assert smooth_guide(np.array([[0.0, 0.0], [3.0, 0.0], [9.0, 0.0]]), 2.0) == StraightGuide(9.0)


def test_an_arc_of_many_points_has_its_curvature() -> None:
    curve = guide("arc")
    inner = curve.frame(np.linspace(3.0, curve.length - 3.0, 200))
    np.testing.assert_allclose(inner.curvature, 1.0 / 8.0, rtol=0.02)


@pytest.mark.parametrize("name", POLYLINES)
def test_ranges_of_the_curvature_contain_dense_samples(name: str) -> None:
    curve = guide(name)
    rng = np.random.default_rng(1)
    width = rng.choice([1e-3, 0.1, 0.8], 200)
    stations = rng.uniform(width, curve.length - width)
    bend, rate, second = curve.curvature_ranges(stations, width)
    step = 1e-4
    for x in np.linspace(-1.0, 1.0, 21):
        at = stations + x * (width - step)
        frame = curve.frame(at)
        assert np.all((frame.curvature >= bend.lower - 1e-12) & (frame.curvature <= bend.upper + 1e-12))
        assert np.all((frame.curvature_rate >= rate.lower - 1e-12) & (frame.curvature_rate <= rate.upper + 1e-12))
        slope = (curve.frame(at + step).curvature_rate - curve.frame(at - step).curvature_rate) / (2 * step)
        assert np.all((slope >= second.lower - 1e-6) & (slope <= second.upper + 1e-6))


# Trips over curved guides: the same as those over straight ones, against differences and quadrature.


def trip_over(name: str, degree: int = 3) -> Trajectory:
    trips = TripSpace(guide(name), 1.0, degree, 12, 0, (0.0, 0.2, 0.6, 1.0))
    rng = np.random.default_rng(2)
    theta = 0.25 * rng.normal(size=trips.path_size)
    theta[[0, -1]] = 0.0
    return Trajectory.of(trips, theta, rng.uniform(0.0, 0.4, trips.acceleration_size))


# Guides that plans are made over.


def dense(plan: sp.Plan, scenario: sp.Scenario) -> None:
    report = check_trip(scenario.to_dict(), plan.position, plan.start_time, plan.arrival_time)
    assert report.ok, str(report)


HEADINGS = {
    "behind": scene(goal={"position": [-12.0, 1.0]}),
    "turn round": scene(goal={"position": [0.0, 6.0], "heading": np.pi}),
    "arrive backwards": scene(goal={"position": [15.0, 0.0], "heading": np.pi, "speed": 1.0}),
    "arrive across": scene(goal={"position": [15.0, 0.0], "heading": 0.5 * np.pi, "speed": 1.0}),
    "leave across": scene(start={"heading": -2.0}, goal={"position": [15.0, 0.0], "heading": 0.3}),
}


@pytest.mark.parametrize("name", HEADINGS)
def test_headings_that_differ_from_the_line_are_kept(name: str, tmp_path: Path) -> None:
    plan = sp.plan(HEADINGS[name])
    assert plan.certified, plan.reason
    dense(plan, HEADINGS[name])
    plan.save(tmp_path / "plan.json")
    again = sp.Plan.load(tmp_path / "plan.json")
    t = np.linspace(plan.start_time, plan.arrival_time, 50)
    np.testing.assert_allclose(again.position(t), plan.position(t), atol=1e-9)
    assert sp.certify(HEADINGS[name], again).holds


def test_a_scenario_s_polyline_is_followed() -> None:
    scenario = scene(goal={"position": [10.0, 12.0]}, guide=[[0.0, 0.0], [10.0, 0.0], [10.0, 12.0]])
    plan = sp.plan(scenario)
    assert plan.certified, plan.reason
    dense(plan, scenario)
    # The search begins over the polyline, and leaves it for better guides: here nothing stands on the straight line.
    straight = np.hypot(10.0, 12.0)
    assert build_problem(scenario, sp.zones(scenario), Settings()).space.length > 1.2 * straight
    assert plan.trip.trajectory.path.arc_length < 1.05 * straight


def test_a_guide_may_be_any_curve() -> None:
    """A quarter of a circle about (0, 10), as a function; a pillar inside of it keeps the path out there."""
    pillar = {"id": "pillar", "shape": {"disc": 6.0}, "motion": {"position": [0.0, 10.0]}}
    given = scene(pillar, goal={"position": [10.0, 10.0]}, vehicle={"max_lateral_acceleration": 2.0})
    scenario = sp.Scenario(
        **{name: getattr(given, name) for name in ("name", "vehicle", "start", "goal", "obstacles", "confidence")},
        guide=lambda share: (10.0 * np.sin(0.5 * np.pi * share), 10.0 - 10.0 * np.cos(0.5 * np.pi * share)),
    )
    assert scenario.guide is not None and scenario.guide[0] == (0.0, 0.0)
    assert scenario.guide[-1] == pytest.approx((10.0, 10.0))
    guide = build_problem(scenario, sp.zones(scenario), Settings()).space.guide
    assert not guide.straight and guide.length == pytest.approx(5.0 * np.pi, rel=1e-2)
    plan = sp.plan(scenario)
    assert plan.certified, plan.reason
    dense(plan, scenario)


def test_offsets_stay_where_the_guide_does_not_fold() -> None:
    scenario = scene(goal={"position": [0.0, 5.0]}, guide=[[0.0, 0.0], [9.0, 0.0], [9.0, 5.0], [0.0, 5.0]])
    problem = build_problem(scenario, sp.zones(scenario), Settings())
    ends, space = problem.ends, problem.space
    assert np.all(ends.lower < 0.0) and np.all(ends.upper > 0.0)
    assert ends.upper.min() < 3.0 and ends.lower.min() == -8.0
    rng = np.random.default_rng(0)
    for _ in range(50):
        theta = np.where(rng.uniform(size=space.path_size) < 0.5, ends.lower, ends.upper)
        points = Trajectory.of(space, theta, np.zeros(space.acceleration_size)).path.points(np.linspace(0, 1, 999))
        assert points.stretch.min() > 0.15


@pytest.mark.parametrize("radius", [1.0, 2.5])
def test_shortest_paths_join_their_ends_and_are_shorter_than_others(radius: float) -> None:
    rng = np.random.default_rng(0)
    for _ in range(200):
        start = Pose(tuple(rng.normal(size=2) * 4), rng.uniform(-3, 3))
        goal = Pose(tuple(rng.normal(size=2) * 4), rng.uniform(-3, 3))
        points = shortest_path(start, goal, radius)
        legs = np.diff(points, axis=0)
        np.testing.assert_allclose(points[0], start.position, atol=1e-9)
        np.testing.assert_allclose(points[-1], goal.position, atol=1e-6)
        headings = np.unwrap(np.arctan2(legs[:, 1], legs[:, 0]))
        assert abs(np.sin(0.5 * (headings[0] - start.heading))) < 0.04
        assert abs(np.sin(0.5 * (headings[-1] - goal.heading))) < 0.04
        assert np.abs(np.diff(headings)).max() < 0.13
        length = np.hypot(*legs.T).sum()
        wider = shortest_path(start, goal, 1.5 * radius)
        assert length <= np.hypot(*np.diff(wider, axis=0).T).sum() * (1.0 + 1e-3)
        assert start.heading is not None and goal.heading is not None
        back = shortest_path(
            Pose(goal.position, goal.heading + np.pi), Pose(start.position, start.heading + np.pi), radius
        )
        assert np.hypot(*np.diff(back, axis=0).T).sum() == pytest.approx(length, rel=2e-3)
        free = shortest_path(Pose(start.position, None), goal, radius)
        assert np.hypot(*np.diff(free, axis=0).T).sum() <= length + 0.15 * radius


def test_the_best_path_becomes_the_guide_where_the_guide_limits_it() -> None:
    """Corners of a polyline without room for wide bends: what is planned over it alone is slower."""
    from scp_planner.planning.runs import CheckedRuns
    from scp_planner.planning.sources.sides import Sides
    from scp_planner.planning.starts import SCENE, OverGuide, Start, TripSearch
    from scp_planner.planning.task import Task
    from scp_planner.threat_zones.of_scenario import zones

    scenario = scene(goal={"position": [-12.0, 1.0]})
    search = TripSearch(CheckedRuns(Task(scenario, zones(scenario), Settings())))
    search.sources = [Sides(search)]
    best = search.explore(Start(SCENE, OverGuide(search.runs)))
    assert best is not None
    alone = best.travel_time
    plan = sp.plan(scenario)
    assert plan.certified, plan.reason
    assert plan.travel_time < 0.99 * alone
    dense(plan, scenario)


def test_the_guide_along_a_path_is_that_path() -> None:
    trip = trip_over("corner")
    again = guide_along(trip.path, Settings())
    stations = np.linspace(0.0, 1.0, 500)
    old = trip.path.points(trip.path.parameter_at(stations * trip.path.arc_length)).position
    assert again.length == pytest.approx(trip.path.arc_length, rel=1e-4)
    assert np.hypot(*(again.frame(stations * again.length).position - old).T).max() < 0.01
    np.testing.assert_allclose(again.frame(np.array([again.length])).position[0], old[-1], atol=1e-8)


@pytest.mark.parametrize("turn", [0.3, 1.5, 2.5])
def test_positions_are_as_near_to_the_integral_as_they_say_where_headings_turn_fast(turn: float) -> None:
    headings = np.zeros(21)
    headings[3:] = turn  # within a single piece, of 0.1 m
    curve = CurvedGuide(2.0, headings)
    heading = CubicSpline(np.linspace(0.0, 2.0, 21), headings)
    assert 0.0 < curve.error <= 1e-12 * 2.0
    for station in np.random.default_rng(1).uniform(0.2, 0.4, 6):
        knots = np.linspace(0.0, 2.0, 21)
        edges = [*knots[knots < station], station]
        place = [
            sum(
                quad(lambda s, part=part: part(heading(s)), low, high, epsabs=1e-14)[0] for low, high in pairwise(edges)
            )
            for part in (np.cos, np.sin)
        ]
        np.testing.assert_allclose(curve.frame(np.array([station])).position[0], place, rtol=0.0, atol=4e-12)


def test_a_guide_says_how_far_it_strays_where_no_cells_are_short_enough() -> None:
    curve = CurvedGuide(1.0, np.random.default_rng(0).uniform(-1e4, 1e4, 101))
    assert curve.error > 1e-9
