"""Obstacles on given courses: zones against scipy's spline, plans, and what is refused."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scenes import scene
from scipy.interpolate import CubicSpline
from shapely import affinity, box
from shapely.geometry import Point

import scp_planner as sp
from benchmarks.dense_check import check_trip

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


def test_the_heading_on_a_course_that_stops_is_not_trusted() -> None:
    halting = np.array([[10.0, -4.0], [10.0, -1.0], [10.0, -1.0], [11.0, -1.0], [12.0, 0.0]])
    times = np.array([0.0, 2.0, 4.0, 6.0, 8.0])
    zone = sp.zones(scene(course({"rectangle": [3.0, 1.0]}, times, halting)))[0]
    disc = sp.zones(scene(course({"disc": np.hypot(1.5, 0.5)}, times, halting)))[0]
    place = np.random.default_rng(0).normal(size=(40, 2)) * 5.0
    np.testing.assert_allclose(zone.signed_distance(3.0, place), disc.signed_distance(3.0, place))


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
