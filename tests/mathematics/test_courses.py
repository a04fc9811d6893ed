"""Obstacles on given courses: zones against scipy's spline, plans, and what is refused."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scenes import scene
from scipy.interpolate import CubicSpline
from scipy.stats import chi2
from shapely import affinity, box
from shapely.geometry import Point

import scp_planner as sp
from verification.dense_check import check_trip

pytestmark = pytest.mark.numerics

Array = np.ndarray
TIMES = np.array([99.0, 100.5, 101.5, 103.0, 104.0, 106.0])
PLACES = np.array([[12.0, -6.0], [11.0, -4.0], [11.5, -2.5], [10.0, -0.5], [10.5, 1.0], [9.0, 4.0]])


def course(shape: dict[str, Any], times: Array = TIMES, places: Array = PLACES) -> dict[str, Any]:
    return {"id": "on course", "shape": shape, "motion": {"time": times.tolist(), "position": places.tolist()}}


def start_at(time: float, **more: Any) -> dict[str, Any]:
    return {"time": time, **more}


def test_the_zone_follows_the_natural_spline_and_goes_straight_on() -> None:
    zone = sp.zones(scene(course({"disc": 0.5}), start=start_at(100.0)))[0]
    spline = CubicSpline(TIMES, PLACES, bc_type="natural")
    t = np.linspace(99.0, 106.0, 101)
    np.testing.assert_allclose(zone.center(t), spline(t), atol=1e-12)
    late, early = np.array([107.0, 120.0]), np.array([98.5, 90.0])
    np.testing.assert_allclose(zone.center(late), PLACES[-1] + (late - 106.0)[:, None] * spline(106.0, 1), atol=1e-12)
    np.testing.assert_allclose(zone.center(early), PLACES[0] + (early - 99.0)[:, None] * spline(99.0, 1), atol=1e-12)


def test_a_course_may_have_two_points_and_a_late_clock() -> None:
    late = course({"disc": 0.5}, np.array([1e9, 1e9 + 4.0]), np.array([[5.0, 5.0], [9.0, 3.0]]))
    zone = sp.zones(scene(late, start=start_at(1e9)))[0]
    np.testing.assert_allclose(zone.center(np.array([1e9 + 1.0, 1e9 + 6.0])), [[6.0, 4.5], [11.0, 2.0]], atol=1e-6)


@pytest.mark.parametrize("shape", [{"disc": 0.6}, {"rectangle": [3.0, 1.2]}, {"polygon": [[-1, -1], [1, 0], [-1, 1]]}])
def test_plans_keep_clear_of_courses(shape: dict[str, Any]) -> None:
    scenario = scene(course(shape), start=start_at(100.0))
    plan = sp.plan(scenario)
    assert plan.certified, plan.reason
    bare = {**scenario.to_dict(), "obstacles": []}
    report = check_trip(bare, plan.position, plan.start_time, plan.arrival_time)
    assert report.ok, str(report)
    spline = CubicSpline(TIMES, PLACES, bc_type="natural")
    times = np.linspace(plan.start_time, min(plan.arrival_time, 106.0), 2000)
    for t, position in zip(times, plan.position(times), strict=True):
        velocity = spline(t, 1)
        if "disc" in shape:
            figure = Point(0.0, 0.0).buffer(0.6, quad_segs=512)
        elif "rectangle" in shape:
            heading = np.arctan2(velocity[1], velocity[0])
            figure = affinity.rotate(box(-1.5, -0.6, 1.5, 0.6), heading, origin=(0, 0), use_radians=True)
        else:
            figure = sp_polygon(shape)
        gap = affinity.translate(figure, *spline(t)).distance(Point(position))
        assert gap >= 0.3 - 2e-6
    assert plan.clearance.minimum < 0.05, "it is in the way"


def sp_polygon(shape: dict[str, Any]) -> Any:
    from shapely.geometry import Polygon

    return Polygon(shape["polygon"])


def test_on_a_course_that_stops_the_heading_of_before_serves() -> None:
    """And turns into the next one with the way; what never moves is a disc."""
    halting = np.array([[10.0, -4.0], [10.0, -1.0], [10.0, -1.0], [11.0, -1.0], [12.0, 0.0]])
    times = np.array([0.0, 2.0, 4.0, 6.0, 8.0])
    zone = sp.zones(scene(course({"rectangle": [3.0, 1.0]}, times, halting)))[0]
    assert len(zone.outlines) == 1
    heading = zone.heading_vector(np.array([0.5, 8.0]))
    np.testing.assert_allclose(np.abs(heading[0]), [0.0, 1.0], atol=0.05)
    assert abs(heading[1, 0]) > 0.5
    shaking = np.array([[10.0, -4.0], [10.01, -4.0], [10.0, -4.02], [10.0, -4.0], [9.99, -4.01]])
    still = sp.zones(scene(course({"rectangle": [3.0, 1.0]}, times, shaking)))[0]
    assert not still.outlines and still.radius == pytest.approx(np.hypot(1.5, 0.5))


def test_faults_of_a_course_are_named() -> None:
    wrong = course({"disc": 0.5})
    wrong["motion"]["time"][3] = 100.0
    wrong["motion"]["position"].pop()
    with pytest.raises(sp.ScenarioError) as caught:
        scene(wrong)
    paths = {fault.path for fault in caught.value.faults}
    assert paths == {"obstacles[0].motion.time[3]", "obstacles[0].motion.position"}
    with pytest.raises(sp.ScenarioError) as caught:
        scene(course({"disc": 0.5}, TIMES[:1], PLACES[:1]))
    assert {fault.path for fault in caught.value.faults} == {"obstacles[0].motion.time"}


def test_a_course_is_saved_and_loaded(tmp_path: Any) -> None:
    scenario = scene(course({"disc": 0.5}), start=start_at(100.0))
    scenario.save(tmp_path / "course.yaml")
    assert sp.Scenario.load(tmp_path / "course.yaml") == scenario


# courses that are predicted, with a covariance

ROUND, LONG = [[0.04, 0.0], [0.0, 0.04]], [[0.09, 0.05], [0.05, 0.16]]


def predicted(shape: dict[str, Any], covariance: Any, **more: Any) -> dict[str, Any]:
    given = course(shape)
    return {**given, "motion": {**given["motion"], "covariance": covariance}, **more}


@pytest.mark.parametrize(("level", "count"), [("per_time", 1), ("per_obstacle", len(TIMES)), ("joint", 2 * len(TIMES))])
def test_zones_of_predicted_courses_grow_with_the_covariance_and_the_level(level: str, count: int) -> None:
    each = [ROUND, ROUND, LONG, LONG, ROUND, LONG]
    scenario = scene(
        predicted({"disc": 0.5}, each),
        {**predicted({"disc": 0.5}, ROUND), "id": "another"},
        confidence={"probability": 0.9, "level": level},
        start=start_at(100.0),
    )
    scale = chi2.isf(1.0 - 0.9 ** (1.0 / count), 2)
    one, other = sp.zones(scenario)
    for t, expected in zip(TIMES, each, strict=True):
        np.testing.assert_allclose(one.covariance(t), scale * np.array(expected), rtol=1e-12)
        np.testing.assert_allclose(other.covariance(t), scale * np.array(ROUND), rtol=1e-12)
    middle = 0.5 * (TIMES[1] + TIMES[2])
    np.testing.assert_allclose(one.covariance(middle), scale * 0.5 * (np.array(ROUND) + np.array(LONG)), rtol=1e-12)
    np.testing.assert_allclose(one.covariance(TIMES[-1] + 50.0), scale * np.array(LONG), rtol=1e-12)
    np.testing.assert_allclose(one.covariance(TIMES[0] - 50.0), scale * np.array(ROUND), rtol=1e-12)


def test_the_joint_level_holds_for_errors_that_are_linear_between_the_times() -> None:
    rng, runs = np.random.default_rng(3), 4000
    scenario = scene(predicted({"disc": 0.5}, LONG), confidence={"probability": 0.9}, start=start_at(100.0))
    (zone,) = sp.zones(scenario)
    fine = np.linspace(TIMES[0], TIMES[-1], 120)
    shared = rng.multivariate_normal([0.0, 0.0], LONG, runs)
    alone = rng.multivariate_normal([0.0, 0.0], LONG, (runs, len(TIMES)))
    inverse = np.linalg.inv(zone.covariance(fine))
    for weight in (0.0, 0.7):  # of what all times have in common
        errors = np.sqrt(1.0 - weight) * alone + np.sqrt(weight) * shared[:, None]
        between = np.stack([[np.interp(fine, TIMES, e[:, k]) for e in errors] for k in (0, 1)], axis=2)
        inside = np.einsum("rti,tij,rtj->rt", between, inverse, between).max(axis=1) <= 1.0
        assert 0.885 < inside.mean() < (0.925 if weight == 0.0 else 0.97)


@pytest.mark.parametrize("shape", [{"disc": 0.4}, {"rectangle": [1.0, 0.6]}])
def test_plans_keep_clear_of_predicted_courses(shape: dict[str, Any]) -> None:
    exact = sp.plan(scene(course(shape), start=start_at(100.0)))
    scenario = scene(predicted(shape, ROUND), start=start_at(100.0))
    plan = sp.plan(scenario)
    assert plan.certified, plan.reason
    assert plan.travel_time > exact.travel_time - 1e-3
    spline = CubicSpline(TIMES, PLACES, bc_type="natural")
    times = np.linspace(plan.start_time, min(plan.arrival_time, 106.0), 2000)
    gap = np.hypot(*(plan.position(times) - spline(times)).T)
    ellipse = np.sqrt(chi2.isf(1.0 - 0.95 ** (1.0 / len(TIMES)), 2) * 0.04)
    size = 0.4 if "disc" in shape else np.hypot(0.5, 0.3)  # a rectangle may point anywhere
    assert gap.min() >= size + ellipse + 0.3 - 1e-6


def test_a_planner_online_knows_courses_that_are_predicted() -> None:
    planner = sp.Planner(scene(predicted({"disc": 0.4}, ROUND), start=start_at(100.0)))
    plan = planner.replan(100.0, (0.0, 0.0), 0.0, 1.0)
    assert plan.safe, plan.reason
    (zone,) = planner.zones
    scale = chi2.isf(1.0 - 0.95 ** (1.0 / len(TIMES)), 2)
    np.testing.assert_allclose(zone.covariance(103.0), scale * np.array(ROUND), rtol=1e-9)


def test_a_course_is_public() -> None:
    made = sp.Course(time=(0.0, 1.0), position=((9.0, 9.0), (9.0, 8.0)), covariance=((1.0, 0.0), (0.0, 1.0)))
    obstacle = sp.Obstacle(id="o", shape=sp.Disc(disc=0.5), motion=made)
    scenario = scene(obstacle.model_dump(by_alias=True, exclude_none=True))
    assert scenario.obstacles[0].motion == made
