"""The independent check must pass exact trips that drive at their limits, and catch the smallest excess."""

from __future__ import annotations

import ast
import itertools
import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from exact_trips import arc_trip, refused, scenario, straight_trip
from scenes import VEHICLE
from scipy.interpolate import make_interp_spline

import verification
from scp_planner.arrays import Array
from verification.dense_check import check_trip
from verification.differences import end_heading
from verification.findings import Tolerances


def test_exact_trip_at_speed_and_acceleration_limits_holds() -> None:
    position, duration = straight_trip()
    report = check_trip(scenario(), position, 0.0, duration)
    assert report.ok, str(report)
    assert report["speed"].value == pytest.approx(3.0, abs=1e-7)
    assert report["acceleration"].value == pytest.approx(1.5, abs=1e-6)
    assert report.travel_time == pytest.approx(7.0 + 1.0 / 9.0)


@pytest.mark.parametrize(("radius", "speed"), [(1.0, math.sqrt(2.0)), (4.5, 3.0), (1.0, 0.05)])
def test_exact_arcs_at_curvature_and_lateral_limits_hold(radius: float, speed: float) -> None:
    position, duration, data = arc_trip(radius, speed)
    report = check_trip(data, position, 0.0, duration)
    assert report.ok, str(report)
    assert report["curvature"].value == pytest.approx(1.0 / radius, rel=1e-5)
    assert report["lateral_acceleration"].value == pytest.approx(speed**2 / radius, rel=1e-5)


def test_bang_bang_turning_trip_at_three_limits_holds() -> None:
    """Full acceleration, then full braking; the path jumps from left to right at the curvature limit."""
    half = 1.0  # s
    middle_speed = 0.2 + 1.2 * half
    angle_at_half = 0.2 * half + 1.2 * half**2 / 2.0

    def position(t: Array) -> Array:
        late = np.maximum(t - half, 0.0)
        early = np.minimum(t, half)
        distance = 0.2 * early + 1.2 * early**2 / 2.0 + middle_speed * late - late**2
        first = np.minimum(distance, angle_at_half)
        second = np.maximum(distance - angle_at_half, 0.0)
        # Left arc of radius 1, then a right arc of radius 1 from where it ended.
        x = np.sin(first) + (np.sin(angle_at_half) - np.sin(angle_at_half - second))
        y = (1.0 - np.cos(first)) + (np.cos(angle_at_half - second) - np.cos(angle_at_half))
        return np.stack([x, y], axis=1)

    duration = half + middle_speed / 2.0  # until it stands
    end = position(np.array([duration]))[0]
    data = scenario(
        vehicle=VEHICLE | {"max_acceleration": 1.2, "max_lateral_acceleration": middle_speed**2},
        start={"time": 0.0, "position": [0.0, 0.0], "heading": 0.0, "speed": 0.2},
        goal={"position": end.tolist(), "heading": None, "speed": 0.0},
    )
    report = check_trip(data, position, 0.0, duration)
    assert report.ok, str(report)
    assert report["deceleration"].value == pytest.approx(2.0, abs=5e-4)
    assert report["curvature"].value == pytest.approx(1.0, abs=1e-5)


@pytest.mark.parametrize("samples", [240, 310, 400])
def test_a_curve_that_tightens_while_the_vehicle_brakes_holds(samples: int) -> None:
    """Always at the limit of the lateral acceleration: whatever the chords, of few samples, no more is seen of it."""
    first, braking, lateral = 1.8, 4.4, 3.8
    share = lateral / (2.0 * braking)  # the heading is minus so many times the logarithm of the squared speed's ratio

    def position(t: Array) -> Array:
        ratio = (1.0 - braking * t / first) ** 2

        def integrals(u: Array) -> Array:
            angle = share * np.log(u)
            cosine, sine = np.cos(angle), np.sin(angle)
            both = np.stack([cosine + share * sine, share * cosine - sine], axis=-1)
            return u[..., None] * both / (1.0 + share**2)

        return first**2 / (2.0 * braking) * (integrals(np.ones(1)) - integrals(ratio))

    end = position(np.array([0.2]))[0]
    data = scenario(
        vehicle=VEHICLE | {"max_deceleration": braking, "max_lateral_acceleration": lateral, "max_curvature": None},
        start={"time": 0.0, "position": [0.0, 0.0], "heading": 0.0, "speed": first},
        goal={"position": end.tolist(), "heading": None, "speed": None},
    )
    report = check_trip(data, position, 0.0, 0.2, samples=samples)
    assert report["lateral_acceleration"].value == pytest.approx(lateral, rel=5e-5)
    assert report["lateral_acceleration"].excess <= report["lateral_acceleration"].tolerance


def test_stop_and_go_on_a_curve_holds() -> None:
    """Braking to a stand and driving on: the heading must not be read off a displacement of nothing."""

    def position(t: Array) -> Array:
        # speed 1 - t until it stands at t = 1, waits until 2, then accelerates at 1.
        distance = np.where(t < 1.0, t - t**2 / 2.0, 0.5 + np.maximum(t - 2.0, 0.0) ** 2 / 2.0)
        phi = distance / 2.0
        return 2.0 * np.stack([np.sin(phi), 1.0 - np.cos(phi)], axis=1)

    end = position(np.array([3.5]))[0]
    data = scenario(goal={"position": end.tolist(), "heading": None, "speed": 1.5})
    report = check_trip(data, position, 0.0, 3.5)
    assert report.ok, str(report)
    assert report["curvature"].value == pytest.approx(0.5, rel=1e-4)


@pytest.mark.parametrize(
    ("drive", "name"), [({"top_speed": 3.003}, "speed"), ({"acceleration": 1.5015}, "acceleration")]
)
def test_a_thousandth_too_much_along_the_way_is_caught(drive: dict[str, float], name: str) -> None:
    position, duration = straight_trip(**drive)
    assert refused(check_trip(scenario(), position, 0.0, duration)) == {name}


def test_a_thousandth_of_deceleration_too_much_is_caught() -> None:
    def position(t: Array) -> Array:
        return np.stack([t - 2.002 * t**2 / 2.0, np.zeros_like(t)], axis=1)

    end = position(np.array([0.4]))[0]
    data = scenario(goal={"position": end.tolist(), "heading": None, "speed": None})
    assert refused(check_trip(data, position, 0.0, 0.4)) == {"deceleration"}


@pytest.mark.parametrize(
    ("radius", "speed", "name"),
    [
        (1.0 / 1.001, 0.05, "curvature"),
        (1.0 / 1.001, 1.0, "curvature"),
        (4.0, math.sqrt(2.002 * 4.0), "lateral_acceleration"),
    ],
)
def test_a_thousandth_too_much_across_the_way_is_caught(radius: float, speed: float, name: str) -> None:
    position, duration, data = arc_trip(radius, speed)
    assert refused(check_trip(data, position, 0.0, duration)) == {name}


def test_a_corner_taken_at_standstill_is_caught() -> None:
    """Time differences see nothing there: the speed is zero. The path has a corner all the same."""

    def position(t: Array) -> Array:
        before = np.minimum(t, 1.0)
        after = np.maximum(t - 1.0, 0.0)
        return np.stack([before - before**2 / 2.0, 0.75 * after**2], axis=1)

    data = scenario(goal={"position": [0.5, 0.75], "heading": None, "speed": 1.5})
    assert "curvature" in refused(check_trip(data, position, 0.0, 2.0))


def test_driving_backwards_is_caught() -> None:
    """At -2 m/s2 from 1 m/s the vehicle stands after half a second; 0.05 s later it is 2.5 mm back."""

    def position(t: Array) -> Array:
        return np.stack([t - t**2, np.zeros_like(t)], axis=1)

    for end, backward_speed in ((0.5, 0.0), (0.55, -0.1)):
        goal = {"position": position(np.array([end]))[0].tolist(), "heading": None, "speed": None}
        report = check_trip(scenario(goal=goal), position, 0.0, end)
        assert ("reversing" in refused(report)) == (backward_speed < 0.0)
        assert report["reversing"].value == pytest.approx(backward_speed, abs=2e-3)


@pytest.mark.parametrize(
    ("change", "name"),
    [
        ({"start": {"time": 0.0, "position": [0.0, 1e-5], "heading": 0.0, "speed": 1.0}}, "start_position"),
        ({"start": {"time": 0.0, "position": [0.0, 0.0], "heading": 1e-3, "speed": 1.0}}, "start_heading"),
        ({"start": {"time": 0.0, "position": [0.0, 0.0], "heading": 0.0, "speed": 1.001}}, "start_speed"),
        ({"start": {"time": 0.1, "position": [0.0, 0.0], "heading": 0.0, "speed": 1.0}}, "start_time"),
        ({"goal": {"position": [20.00001, 0.0], "heading": None, "speed": None}}, "goal_position"),
        ({"goal": {"position": [20.0, 0.0], "heading": 1e-3, "speed": None}}, "goal_heading"),
        ({"goal": {"position": [20.0, 0.0], "heading": None, "speed": 2.999}}, "goal_speed"),
        ({"bounds": {"min": [-1.0, -0.299], "max": [21.0, 1.0]}}, "bounds"),
    ],
)
def test_each_end_condition_is_checked(change: dict[str, Any], name: str) -> None:
    position, duration = straight_trip()
    assert refused(check_trip(scenario(**change), position, 0.0, duration)) == {name}


def test_free_ends_and_a_goal_radius_are_free() -> None:
    position, duration = straight_trip()
    data = scenario(
        start={"time": 0.0, "position": [0.0, 0.0], "heading": None, "speed": 1.0},
        goal={"position": [20.4, 0.3], "heading": None, "speed": None, "radius": 0.5},
        bounds={"min": [-1.0, -0.3], "max": [21.0, 0.3]},
    )
    assert check_trip(data, position, 0.0, duration).ok


def test_a_position_that_is_not_a_number_is_refused() -> None:
    position, duration = straight_trip()

    def broken(t: Array) -> Array:
        return np.where(t[:, None] > 2.0, np.nan, position(t))

    report = check_trip(scenario(), broken, 0.0, duration)
    assert not report.ok
    assert report.violations[0].time == pytest.approx(2.0, abs=1e-3)


def test_tolerances_are_honoured() -> None:
    position, duration = straight_trip(top_speed=3.003)
    assert check_trip(scenario(), position, 0.0, duration, tolerances=Tolerances(speed=0.0031)).ok


def test_recorded_samples_and_scenario_files_give_the_same_verdict(tmp_path: Path) -> None:
    position, duration, data = arc_trip(2.0, 1.9)
    path = tmp_path / "scenario.json"
    path.write_text(json.dumps(data), encoding="utf-8")
    times = np.linspace(0.0, duration, 200)
    recorded = check_trip(path, make_interp_spline(times, position(times), k=5), 0.0, duration)
    exact = check_trip(data, position, 0.0, duration)
    assert recorded.ok and exact.ok, f"{recorded} / {exact}"
    assert recorded["curvature"].value == pytest.approx(exact["curvature"].value, abs=1e-5)


def test_unusable_input_is_refused() -> None:
    position, duration = straight_trip()
    with pytest.raises(ValueError, match="start_time < arrival_time"):
        check_trip(scenario(), position, 1.0, 1.0)
    with pytest.raises(ValueError, match="shape"):
        check_trip(scenario(), lambda t: t, 0.0, duration)
    seen: dict[str, Any] = {
        "id": "seen",
        "shape": {"disc": 0.5},
        "observations": {"time": [0.0], "position": [[1.0, 1.0]]},
    }
    with pytest.raises(ValueError, match="'seen' has no exact motion"):
        check_trip(scenario(obstacles=[seen]), position, 0.0, duration)
    odd = {"id": "odd", "shape": {"star": 5}, "motion": {"position": [5.0, 5.0]}}
    with pytest.raises(ValueError, match="'odd'"):
        check_trip(scenario(obstacles=[odd]), position, 0.0, duration)


def test_the_check_imports_nothing_of_the_planner() -> None:
    files = sorted(Path(str(verification.__file__)).parent.glob("*.py"))
    assert len(files) > 1
    trees = [ast.parse(file.read_text(encoding="utf-8")) for file in files]
    imported = set()
    for node in itertools.chain.from_iterable(map(ast.walk, trees)):
        if isinstance(node, ast.Import):
            imported |= {alias.name.split(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            imported.add((node.module or "").split(".")[0])
    assert "scp_planner" not in imported
    standard = {"__future__", "itertools", "json", "math", "os", "collections", "dataclasses", "pathlib", "typing"}
    assert imported <= standard | {"numpy", "scipy", "shapely", "verification"}


def test_a_jump_of_the_acceleration_just_after_the_start_is_no_wrong_speed() -> None:
    jump = 2.5e-4  # s

    def position(t: Array) -> Array:
        later = np.maximum(t - jump, 0.0)
        return np.stack([t + 0.75 * t**2 - 1.5 * later**2, np.zeros_like(t)], axis=1)

    goal = {"position": position(np.array([0.5]))[0].tolist(), "heading": None, "speed": None}
    assert check_trip(scenario(goal=goal), position, 0.0, 0.5).ok
    start = {"time": 0.0, "position": [0.0, 0.0], "heading": 0.0, "speed": 1.0005}
    assert refused(check_trip(scenario(start=start, goal=goal), position, 0.0, 0.5)) == {"start_speed"}


@pytest.mark.parametrize("change", [60.0, 1500.0])
@pytest.mark.parametrize("from_rest", [True, False])
def test_headings_at_ends_are_exact_where_the_curvature_changes_fast(from_rest: bool, change: float) -> None:
    """A path that leaves in a bend of 10 /m, whose curvature changes so much in a m, at rest or at once at 0.5 m/s."""
    bend = -10.0

    def position(times: Array) -> Array:
        along = 0.5 * times**2 if from_rest else 0.5 * times
        # Integrals of the direction over the way, by Gauss-Legendre.
        nodes, weights = np.polynomial.legendre.leggauss(20)
        inner = 0.5 * along[:, None] * (1.0 + nodes)
        angle = 0.3 + bend * inner + 0.5 * change * inner**2
        return 0.5 * along[:, None] * np.stack([np.cos(angle) @ weights, np.sin(angle) @ weights], axis=1)

    found = end_heading(position, 0.5, 0.0, 1)
    assert found == pytest.approx(0.3, abs=2e-5)


@pytest.mark.parametrize("power", [2, 6])
def test_the_heading_of_what_turns_almost_standing_is_exact(power: int) -> None:
    """A path that leaves in a bend of 750 /m, which gets a third as sharp every 2 mm, at rest and slowly."""
    first, bend, length = 0.3, -750.0, 2e-3

    def position(times: Array) -> Array:
        along = times**power
        nodes, weights = np.polynomial.legendre.leggauss(20)
        inner = 0.5 * along[:, None] * (1.0 + nodes)
        angle = first + bend * length * -np.expm1(-inner / length)
        return 0.5 * along[:, None] * np.stack([np.cos(angle) @ weights, np.sin(angle) @ weights], axis=1)

    assert end_heading(position, 0.5, 0.0, 1) == pytest.approx(first, abs=2e-5)
    start = {"time": 0.0, "position": [0.0, 0.0], "heading": first + 1e-3, "speed": 0.0}
    goal = {"position": position(np.array([0.5]))[0].tolist(), "heading": None, "speed": None}
    assert "start_heading" in refused(check_trip(scenario(start=start, goal=goal), position, 0.0, 0.5))


@pytest.mark.parametrize(("radius", "speed", "leg"), [(0.0076, 3.0, 1.0), (0.005, 1.0, 15.0), (0.0004, 0.3, 1.0)])
def test_a_sharp_turn_in_the_middle_is_no_acceleration_along_the_way(radius: float, speed: float, leg: float) -> None:
    """The last two are too sharp for any number of samples that is looked at."""
    turn = 1.5

    def position(times: Array) -> Array:
        driven = speed * times
        angle = np.clip((driven - leg) / radius, 0.0, turn)
        after = np.maximum(driven - leg - turn * radius, 0.0)
        x = np.minimum(driven, leg) + radius * np.sin(angle) + after * math.cos(turn)
        return np.stack([x, radius * (1.0 - np.cos(angle)) + after * math.sin(turn)], axis=1)

    duration = (2.0 * leg + turn * radius) / speed
    data = scenario(
        start={"time": 0.0, "position": [0.0, 0.0], "heading": 0.0, "speed": speed},
        goal={"position": position(np.array([duration]))[0].tolist(), "heading": turn, "speed": speed},
    )
    data["vehicle"].update(
        max_lateral_acceleration=None, max_curvature=None, max_acceleration=1e-3, max_deceleration=1e-3
    )
    assert check_trip(data, position, 0.0, duration).ok
    data["vehicle"]["max_speed"] = speed - 2e-5
    assert refused(check_trip(data, position, 0.0, duration)) == {"speed"}


def test_the_speed_at_the_goal_may_be_judged_less_closely_than_that_at_the_start() -> None:
    def position(times: Array) -> Array:
        return np.stack([times, np.zeros_like(times)], axis=1)

    asked = {"start": {"time": 0.0, "position": [0.0, 0.0], "heading": 0.0, "speed": 1.0}}
    goal = {"position": [2.0, 0.0], "heading": None, "speed": 1.0005}
    data = scenario(**asked, goal=goal)
    assert refused(check_trip(data, position, 0.0, 2.0)) == {"goal_speed"}
    promised = Tolerances(goal_speed=6e-4)
    assert check_trip(data, position, 0.0, 2.0, tolerances=promised).ok
    data["start"]["speed"] = 1.0005
    assert refused(check_trip(data, position, 0.0, 2.0, tolerances=promised)) == {"start_speed"}
