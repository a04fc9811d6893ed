"""The independent check of what roads ask for: forces together, goals that are regions, walls, shapes that turn."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from exact_trips import arc_trip, refused, scenario, straight_trip
from scenes import VEHICLE
from scipy.interpolate import CubicSpline

from scp_planner.arrays import Array
from verification.dense_check import check_trip
from verification.distances import distance_to_uncertain, signed_distance
from verification.places import disc_centres


def _with_vehicle(**changes: Any) -> dict[str, Any]:
    return scenario(vehicle={**VEHICLE, **changes})


@pytest.mark.parametrize(("limit", "names"), [(4.51, set()), (4.45, {"power"})])
def test_the_power_of_an_acceleration_is_largest_at_its_end(limit: float, names: set[str]) -> None:
    """1.5 m/s2 up to 3 m/s: 4.5 m2/s3."""
    position, duration = straight_trip()
    report = check_trip(_with_vehicle(max_power=limit), position, 0.0, duration)
    assert refused(report) == names
    assert report["power"].value == pytest.approx(4.5, abs=0.01)


def test_accelerations_along_and_across_count_together() -> None:
    """On a circle of 4 m with a speed that grows by 1 m/s2 from 1 m/s: the norm of 1 and v^2 / 4 at the end."""
    duration, radius = 1.5, 4.0

    def position(t: Array) -> Array:
        angle = (t + t**2 / 2.0) / radius
        return radius * np.stack([np.sin(angle), 1.0 - np.cos(angle)], axis=1)

    largest = math.hypot(1.0, 2.5**2 / radius)
    goal = {"position": position(np.array([duration]))[0].tolist()}
    for limit, names in ((largest + 1e-4, set()), (largest - 5e-3, {"total_acceleration"})):
        data = {**_with_vehicle(max_total_acceleration=limit), "goal": goal}
        report = check_trip(data, position, 0.0, duration)
        assert refused(report) == names
        assert report["total_acceleration"].value == pytest.approx(largest, abs=4e-3)


@pytest.mark.parametrize(("asked", "names"), [(0.5, set()), (0.45, {"start_acceleration"})])
@pytest.mark.parametrize("jerk", [0.1, None])
def test_the_acceleration_at_the_start_is_the_one_asked_for(asked: float, names: set[str], jerk: float | None) -> None:
    """Without a limit of the jerk it may be another one at once."""

    def position(t: Array) -> Array:
        return np.stack([t + 0.5 * t**2 / 2.0, np.zeros_like(t)], axis=1)

    duration = 3.0
    start = {"time": 0.0, "position": [0.0, 0.0], "heading": 0.0, "speed": 1.0, "acceleration": asked}
    goal = {"position": position(np.array([duration]))[0].tolist()}
    data = scenario(start=start, goal=goal, vehicle={**VEHICLE, "max_jerk": jerk})
    assert refused(check_trip(data, position, 0.0, duration)) == (names if jerk else set())


@pytest.mark.parametrize(("asked", "names"), [(0.5, set()), (0.45, {"start_acceleration"})])
@pytest.mark.parametrize(("size", "rate"), [(5e-3, 40.0), (1e-4, 400.0)])
def test_the_acceleration_at_the_start_of_a_sharp_turn_is_the_one_along_it(
    asked: float, names: set[str], size: float, rate: float
) -> None:
    """At the start 20 m/s2 across the trip, 0.5 m/s2 along it, and that changes as fast as only a turn makes it."""
    duration = 1.0

    def position(t: Array) -> Array:
        angle = rate * t  # a wave without a second derivative at the start, and with a fourth one
        return np.stack([2.0 * t + 0.25 * t**2 + size * (angle**2 / 2 - 1.0 + np.cos(angle)), 10.0 * t**2], axis=1)

    start = {"time": 0.0, "position": [0.0, 0.0], "heading": 0.0, "speed": 2.0, "acceleration": asked}
    goal = {"position": position(np.array([duration]))[0].tolist()}
    limits = {"max_acceleration": 1e3, "max_deceleration": 1e3, "max_jerk": 1e6, "max_speed": 99.0}
    vehicle = {**VEHICLE, **limits, "max_lateral_acceleration": None, "max_curvature": None}
    report = check_trip(scenario(start=start, goal=goal, vehicle=vehicle), position, 0.0, duration)
    assert refused(report) == names
    assert report["start_acceleration"].value == pytest.approx(0.5, abs=2e-3)


def test_the_middle_of_the_vehicle_has_to_be_in_the_region() -> None:
    """After three quarters of a turn on a circle the vehicle heads to -y; its middle is 1 m ahead of what arrives."""
    position, duration, data = arc_trip(4.0, 1.0, 1.5 * math.pi)
    end = position(np.array([duration]))[0]
    data["vehicle"] = {**VEHICLE, "centre": 1.0}

    def region(depth: float) -> list[list[float]]:
        """A box in which the end lies 0.1 m deep, and what is 1 m below it so deep."""
        (x, y), half = end, 0.5
        low, high = y - 1.0 - depth, y + 0.1
        return [[x - half, low], [x + half, low], [x + half, high], [x - half, high]]

    for depth, names in ((1e-4, set()), (-1e-3, {"goal_region"})):
        data["goal"] = {"position": end.tolist(), "region": region(depth)}
        assert refused(check_trip(data, position, 0.0, duration)) == names


@pytest.mark.parametrize(
    ("goal", "names"),
    [
        ({"heading_range": [2.9, 3.1]}, set()),
        ({"heading_range": [2.9 - 2.0 * math.pi, 3.1 - 2.0 * math.pi]}, set()),
        ({"heading_range": [3.01, 3.5]}, {"goal_heading_range"}),
        ({"heading_range": [-1.0, 2.99]}, {"goal_heading_range"}),
        ({"speed_range": [1.0, 1.5]}, set()),
        ({"speed_range": [1.1, 1.5]}, {"goal_speed_range"}),
        ({"speed_range": [0.0, 0.9]}, {"goal_speed_range"}),
        ({"arrival_step": 0.5}, set()),
        ({"arrival_step": 0.7}, {"arrival_step"}),
    ],
)
def test_ranges_and_steps_of_a_goal(goal: dict[str, Any], names: set[str]) -> None:
    """An arc of 3 rad at 1 m/s about 4 m: it arrives at 12 s with a heading of 3 rad."""
    position, duration, data = arc_trip(4.0, 1.0)
    data["goal"] = {"position": data["goal"]["position"], **goal}
    assert refused(check_trip(data, position, 0.0, duration)) == names


def test_no_disc_of_the_vehicle_may_enter_a_wall() -> None:
    """The second disc, 1 m ahead, comes to a wall that the first one never comes near."""
    position, duration = straight_trip()
    for gap, names in ((1e-4, set()), (-1e-3, {"walls"})):
        left = 21.0 + VEHICLE["radius"] + gap
        data = _with_vehicle(discs=[0.0, 1.0])
        data["walls"] = [[[left, -1.0], [left + 1.0, -1.0], [left + 1.0, 1.0], [left, 1.0]]]
        assert refused(check_trip(data, position, 0.0, duration)) == names


def test_discs_are_where_a_vehicle_points_that_sets_out_in_a_sharp_turn() -> None:
    """Half a millimetre and more would be missed by chords of a millimetre: it turns by 60 rad/m, and ever less."""
    times = np.linspace(0.0, 2.0, 20_001)
    way = 0.25 * times**2

    def heading(s: Array) -> Array:
        return np.asarray(0.3 * np.exp(-200.0 * s))

    grid = np.linspace(0.0, 1.0, 200_001) ** 2  # as dense as it turns
    along, across = (CubicSpline(grid, turn(heading(grid))).antiderivative() for turn in (np.cos, np.sin))
    positions = np.stack([along(way), across(way)], axis=1)
    (ahead,) = disc_centres(_with_vehicle(discs=[0.8]), positions)
    exact = positions + 0.8 * np.stack([np.cos(heading(way)), np.sin(heading(way))], axis=1)
    assert np.abs(ahead - exact).max() < 2e-6


@pytest.mark.parametrize("creep", [0.0, 1e-6])
def test_where_discs_are_while_a_vehicle_waits(creep: float) -> None:
    """It comes along x, stands or creeps for a while, and goes on: meanwhile it points along x, and never back."""
    times = np.linspace(0.0, 3.0, 3001)
    way = 1.0 - np.maximum(1.0 - times, 0.0) ** 2 + np.maximum(times - 2.0, 0.0) ** 2 + creep * times
    (ahead,) = disc_centres(_with_vehicle(discs=[0.8]), np.stack([5.0 + way, np.zeros_like(way)], axis=1))
    assert ahead == pytest.approx(np.stack([5.8 + way, np.zeros_like(way)], axis=1), abs=1e-9)
    data, still = _with_vehicle(discs=[0.8]), np.ones((100, 2))
    data["start"]["heading"] = math.pi / 2.0
    (ahead,) = disc_centres(data, still)
    assert ahead == pytest.approx(np.tile([1.0, 1.8], (100, 1)))
    data["start"]["heading"] = None
    with pytest.raises(ValueError, match="hardly moves"):
        disc_centres(data, still)


def test_an_ellipse_is_as_far_away_as_its_axes_say() -> None:
    obstacle = {"id": "e", "shape": {"ellipse": [2.0, 0.5]}, "motion": {"position": [0.0, 0.0], "velocity": [0.0, 1.0]}}
    found = signed_distance(obstacle, np.array([1.0, 1.0]), np.array([[0.0, 4.0], [1.5, 1.0]]))
    assert found == pytest.approx([1.0, 1.0])
    obstacle["shape"] = {"ellipse": [2.0, 0.5], "heading": 0.0}
    found = signed_distance(obstacle, np.array([1.0, 1.0]), np.array([[0.0, 4.0], [2.5, 1.0]]))
    assert found == pytest.approx([2.5, 0.5])


def test_a_rectangle_turns_with_its_motion() -> None:
    """It sets out along x and is driven off along y: after a while it points there."""
    motion = {"position": [0.0, 0.0], "velocity": [1.0, 0.0], "acceleration": [0.0, 1.0]}
    obstacle = {"id": "r", "shape": {"rectangle": [2.0, 0.5]}, "motion": motion}
    times = np.array([0.0, 50.0])
    centres = np.stack([times, times**2 / 2.0], axis=1)
    # At first it has hardly any speed by what it has later: only the disc within is known.
    assert signed_distance(obstacle, times, centres + np.array([3.0, 0.0]))[0] == pytest.approx(3.0 - 0.25)
    heading = math.atan2(50.0, 1.0)
    ahead = centres + 3.0 * np.array([math.cos(heading), math.sin(heading)])
    assert signed_distance(obstacle, times, ahead)[1] == pytest.approx(2.0)


def test_a_course_with_headings_turns_its_shape_as_they_say() -> None:
    motion = {"time": [0.0, 2.0], "position": [[0.0, 0.0], [2.0, 0.0]], "heading": [0.0, 0.5 * math.pi]}
    obstacle = {"id": "r", "shape": {"rectangle": [2.0, 1.0]}, "motion": motion}
    times = np.array([0.0, 1.0, 2.0])
    diagonal = math.sqrt(0.5)
    away = np.array([[3.0, 0.0], [1.0 + 3.0 * diagonal, 3.0 * diagonal], [2.0, 3.0]])
    assert signed_distance(obstacle, times, away) == pytest.approx([2.0, 2.0, 2.0])


def test_every_future_that_is_possible_is_kept_clear_of() -> None:
    position, duration = straight_trip()
    beside, on_the_way = ({"position": [10.0, y]} for y in (5.0, 0.0))
    for weights, names in (((1.0, 0.0), set()), ((0.9, 0.1), {"clearance"})):
        futures = [{"weight": w, "motion": m} for w, m in zip(weights, (beside, on_the_way), strict=True)]
        data = scenario(obstacles=[{"id": "p", "shape": {"disc": 0.3}, "motion": {"futures": futures}}])
        report = check_trip(data, position, 0.0, duration)
        assert refused(report) == names
        assert {one.subject for one in report.violations} == ({"p[1]"} if names else set())


def test_a_future_with_a_covariance_that_has_no_region_is_improbable_enough() -> None:
    position, duration = straight_trip()
    course = {"time": [0.0, 9.0], "position": [[10.0, 0.0], [10.0, 0.0]], "covariance": [[0.01, 0.0], [0.0, 0.01]]}
    motion = {"futures": [{"weight": 1.0, "motion": course}]}
    data = scenario(obstacles=[{"id": "p", "shape": {"disc": 0.3}, "motion": motion}])
    assert not refused(check_trip(data, position, 0.0, duration))
    assert refused(check_trip(data, position, 0.0, duration, regions={"p[0]": 1.0})) == {"clearance"}


def test_a_polygon_with_a_region_is_nearer_by_what_the_region_reaches() -> None:
    square = [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]]
    course = {"time": [0.0, 1.0], "position": [[0.0, 0.0], [0.0, 0.0]], "covariance": [[0.04, 0.0], [0.0, 0.01]]}
    obstacle = {"id": "s", "shape": {"polygon": square}, "motion": course}
    for place, reached in (([5.0, 0.0], 0.4), ([0.0, 5.0], 0.2)):
        found = distance_to_uncertain(obstacle, np.zeros(1), np.array([place]), 4.0)
        assert found == pytest.approx([4.0 - reached], abs=1e-6)


def _standing_somewhere(shape: dict[str, Any]) -> dict[str, Any]:
    course = {"time": [0.0, 1.0], "position": [[0.0, 0.0], [0.0, 0.0]], "covariance": [[0.3, 0.1], [0.1, 0.2]]}
    return {"id": "s", "shape": {**shape, "heading": 0.4}, "motion": course}


@pytest.mark.parametrize("shape", [{"rectangle": [3.0, 1.0]}, {"ellipse": [1.5, 0.4]}])
@pytest.mark.parametrize("side", [3.0, 30.0])
def test_the_least_distance_from_a_region_is_that_of_each_sample_by_itself(shape: dict[str, Any], side: float) -> None:
    obstacle, times = _standing_somewhere(shape), np.linspace(0.0, 1.0, 701)
    places = np.stack([40.0 * times - 15.0, side + 2.0 * np.sin(5.0 * times)], axis=1)
    alone = [distance_to_uncertain(obstacle, times[k : k + 1], places[k : k + 1], 2.0)[0] for k in range(times.size)]
    found = distance_to_uncertain(obstacle, times, places, 2.0)
    assert found.min() == pytest.approx(min(alone), rel=1e-12)
    assert np.argmin(found) == np.argmin(alone)
    assert (found >= np.array(alone) - 1e-12).all()
