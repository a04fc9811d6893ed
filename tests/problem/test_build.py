"""Problems against their scenarios: limits, switching times of the textbook, ends that every trip keeps."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from memory import MEGABYTE, traced
from scenes import CROSSERS, disc, scene

import scp_planner as sp
from scp_planner.errors import TooLargeError
from scp_planner.planning.checked import ReadyProblem
from scp_planner.problem.build import build_problem
from scp_planner.problem.memory import MOST_BYTES, check_memory, check_obstacles, plan_bytes
from scp_planner.problem.near_zones import BEYOND, without_far_zones
from scp_planner.problem.problem import Problem
from scp_planner.settings.planning import Settings
from scp_planner.trips.path import Path
from scp_planner.trips.trajectory import Trajectory

pytestmark = pytest.mark.numerics

MARGIN = 1e-3


def problem_of(*obstacles: dict[str, Any], **changes: Any) -> Problem:
    scenario = scene(*obstacles, **changes)
    return build_problem(scenario, sp.zones(scenario), Settings(limit_margin=MARGIN))


def test_limits_are_those_of_the_vehicle_less_the_margin() -> None:
    problem = problem_of(*CROSSERS)
    vehicle, limits = problem.scenario.vehicle, problem.limits
    for name in ("speed", "acceleration", "deceleration", "lateral_acceleration", "curvature"):
        assert getattr(limits, name) == pytest.approx(getattr(vehicle, f"max_{name}") * (1.0 - MARGIN), rel=1e-12)
    assert problem.zones.ids == tuple(one["id"] for one in CROSSERS)
    radii = [one["shape"]["disc"] + vehicle.radius + problem.settings.clearance_margin for one in CROSSERS]
    assert problem.zones.radius == pytest.approx(radii, rel=1e-12)


@pytest.mark.parametrize("goal_speed", [None, 0.0, 1.2])
def test_breakpoints_are_where_the_fastest_straight_drive_switches(goal_speed: float | None) -> None:
    """From 1 to 3 m/s, on, and down to the goal's speed, in 20 m; the top speed is reached."""
    problem = problem_of(goal={"speed": goal_speed})
    top, a, d = 3.0 * (1.0 - MARGIN), 1.5 * (1.0 - MARGIN), 2.0 * (1.0 - MARGIN)
    rise, end = (top - 1.0) / a, top if goal_speed is None else goal_speed
    fall = (top - end) / d
    cruise = (20.0 - 0.5 * (1.0 + top) * rise - 0.5 * (top + end) * fall) / top
    assert cruise > 0.0
    breaks = problem.space.acceleration.breakpoints
    for switch in {rise, rise + cruise if fall else rise}:
        assert np.abs(breaks - switch / (rise + cruise + fall)).min() < 1e-11
    assert breaks[0] == 0.0 and breaks[-1] == 1.0 and np.all(np.diff(breaks) > 0.0)


@pytest.mark.parametrize("seed", range(4))
def test_every_path_keeps_both_ends_and_their_headings(seed: int) -> None:
    """A polynomial through points of the outer spans has the derivatives of the path, whatever is free."""
    rng = np.random.default_rng(seed)
    start, goal = rng.uniform(-0.6, 0.6, 2)
    problem = problem_of(start={"heading": float(start)}, goal={"heading": float(goal)})
    theta = problem.ends.theta.copy()
    theta[problem.ends.free] = rng.uniform(-1.0, 1.0, len(theta[problem.ends.free]))
    path = Path(problem.space, theta)
    degree, span = problem.settings.path_degree, 1.0 / len(problem.space.path.widths)
    shares = 0.5 - 0.5 * np.cos(np.pi * np.arange(degree + 1) / degree)
    for parameter, inside, heading, place in ((0.0, span, start, (0.0, 0.0)), (1.0, -span, goal, (20.0, 0.0))):
        points = problem.frame.to_world(path.points(parameter + inside * shares).position)
        assert points[0] == pytest.approx(place, abs=1e-12)
        slopes = [np.polynomial.Polynomial.fit(shares, points[:, k], degree).deriv()(0.0) for k in (0, 1)]
        found = math.atan2(slopes[1] / inside, slopes[0] / inside)
        assert found == pytest.approx(heading, abs=1e-9)


# What a problem says of itself, and the tightened one, against the scenario's own numbers

BOX = {"min": [-1.0, -4.0], "max": [21.0, 5.0]}


def of_crossers(**changes: object) -> Problem:
    scenario = scene(*CROSSERS, **changes)
    return build_problem(scenario, sp.zones(scenario), Settings())


def test_a_tightened_problem_has_larger_zones_lower_limits_and_a_smaller_box() -> None:
    problem = of_crossers(bounds=BOX)
    inflation = np.array([0.1, 0.0, 0.25])
    tight = problem.tightened(inflation, {"lateral_acceleration": 0.2, "curvature": 0.05, "workspace bounds": 0.3})
    times, places = np.linspace(0.0, 6.0, 7), np.random.default_rng(3).uniform(-4.0, 20.0, (7, 2))
    for number, one in enumerate(CROSSERS):
        motion = {key: np.array(value) for key, value in one["motion"].items()}
        t = times[:, None]
        center = motion["position"] + t * motion["velocity"] + 0.5 * t**2 * motion["acceleration"]
        margin = problem.settings.clearance_margin
        radius = one["shape"]["disc"] + problem.scenario.vehicle.radius + margin + inflation[number]
        frame = problem.frame.to_frame(places)
        found = tight.zones.distances(times - problem.frame.time, frame, np.inf)[:, number]
        assert found == pytest.approx(np.hypot(*(places - center).T) - radius, abs=1e-6)  # rounded to 1e-7
    rng, space = np.random.default_rng(4), problem.space
    theta = 0.3 * rng.normal(size=space.path_size)
    trip = Trajectory.of(space, theta, rng.uniform(-0.2, 0.5, space.acceleration_size))
    before, after = (
        {one.name: one.worst(trip, one.excess(trip)).max() for one in each.constraints} for each in (problem, tight)
    )
    assert tight.zones.radius - problem.zones.radius == pytest.approx(inflation, abs=1e-12)
    assert after["curvature"] == pytest.approx((before["curvature"] + 1.0) / 0.95 - 1.0, rel=1e-12)
    assert after["lateral_acceleration"] == pytest.approx((before["lateral_acceleration"] + 1.0) / 0.8 - 1.0, rel=1e-9)
    assert after["workspace bounds"] == pytest.approx(before["workspace bounds"] + 0.3, abs=1e-12)
    assert after["speed"] == before["speed"] and tight.limits.speed == problem.limits.speed
    assert problem.among(tight.zones).zones is tight.zones and problem.among(tight.zones).limits is problem.limits


@pytest.mark.parametrize("given", [None, -0.5])
def test_accelerations_are_bounded_by_the_vehicle_but_for_the_given_one(given: float | None) -> None:
    problem = of_crossers(start={"acceleration": given})
    highest, lowest = problem.highest_accelerations, problem.lowest_accelerations
    assert len(highest) == len(lowest) == problem.space.acceleration_size
    assert highest[1:] == pytest.approx(1.5, rel=1e-3) and lowest[1:] == pytest.approx(-2.0, rel=1e-3)
    if given is not None:
        assert (highest[0], lowest[0]) == (given, given)


# Zones that no trip can meet are left out, and no other

LONGEST = 12.0  # s


def test_only_what_stays_away_from_all_trips_is_left_out() -> None:
    rng = np.random.default_rng(9)
    place, velocity = rng.uniform([-30.0, -40.0], [50.0, 40.0], (60, 2)), rng.normal(size=(60, 2))
    rows = np.concatenate([place, velocity], axis=1).tolist()
    scenario = scene(*(disc(f"d{k}", (x, y), (u, v)) for k, (x, y, u, v) in enumerate(rows)))
    problem = build_problem(scenario, sp.zones(scenario), Settings())
    near = without_far_zones(problem, LONGEST)

    times = np.linspace(0.0, LONGEST, 400)[:, None, None]
    center = place + times * velocity
    reach = problem.settings.max_offset + BEYOND
    start, goal = np.array(scenario.start.position), np.array(scenario.goal.position)
    nearest = np.clip(center, np.minimum(start, goal) - reach, np.maximum(start, goal) + reach)
    clearance = (np.linalg.norm(center - nearest, axis=2) - problem.zones.radius).min(axis=0)
    kept = np.isin(problem.zones.ids, near.zones.ids)
    assert np.all(kept[clearance < 0.0]) and (clearance < 0.0).sum() > 8
    wide = 0.5 * LONGEST / 32 * np.linalg.norm(velocity, axis=1)  # of an interval in which a zone is looked at
    assert not np.any(kept[clearance > 2.0 * wide + 1e-6]) and (~kept).sum() > 8


def test_few_zones_are_all_kept() -> None:
    scenario = scene(disc("far", (500.0, 500.0)))
    problem = build_problem(scenario, sp.zones(scenario), Settings())
    assert without_far_zones(problem, LONGEST) is problem


# What planning takes is known before it is taken, and what is too much is refused at once

QUICK: dict[str, Any] = {"max_runs": 1, "max_iterations": 2, "searches": 1}


def seen(count: int) -> list[dict[str, Any]]:
    """Obstacles that were seen through noise, all over the trip."""
    rng = np.random.default_rng(count)
    times = np.linspace(-1.0, 0.0, 5)
    found = []
    for k in range(count):
        place, velocity = rng.uniform((3.0, -5.0), (19.0, 5.0)), rng.uniform(-0.3, 0.3, 2)
        positions = place + times[:, None] * velocity + 0.01 * rng.normal(size=(5, 2))
        observations = {
            "time": times.tolist(),
            "position": positions.tolist(),
            "covariance": [[1e-4, 0.0], [0.0, 1e-4]],
        }
        found.append(
            {"id": f"o{k}", "shape": {"disc": 0.02}, "observations": observations, "model": {"order": 1}},
        )
    return found


@pytest.mark.parametrize(("spans", "samples", "count"), [(160, 30, 1), (12, 800, 10)])
def test_a_plan_takes_no_more_than_was_estimated_and_not_much_less(spans: int, samples: int, count: int) -> None:
    settings = Settings(path_span=20.0 / spans, max_path_spans=200, samples=samples, acceleration_spans=10, **QUICK)
    estimate = plan_bytes(spans, 12, samples, count)
    sp.plan(scene(*seen(1)), Settings(**QUICK))  # what is loaded once is no part of it
    _, peak = traced(lambda: sp.plan(scene(*seen(count)), settings))
    search = 25 * MEGABYTE  # which has limits of its own
    assert 0.15 * estimate < peak < estimate + search


def test_too_many_obstacles_are_refused_at_once() -> None:
    with pytest.raises(TooLargeError, match=r"obstacles: 60000 of them .* at 160 samples .* MB .* fewer samples"):
        check_memory(13, 24, 160, 60_000)


def test_too_many_spans_are_refused_before_their_tables_are_made() -> None:
    def refused() -> None:
        with pytest.raises(TooLargeError, match=r"path: 5000 spans .* larger path_span"):
            build_problem(scene(), (), Settings(), spans=5000)

    assert traced(refused)[1] < 5 * MEGABYTE


def test_what_needs_least_is_never_refused() -> None:
    check_memory(13, 24, 160, 300)
    check_memory(200, 200, 160, 10)
    assert plan_bytes(13, 24, 160, 300) < 0.1 * MOST_BYTES
    assert ReadyProblem.of(build_problem(scene(), (), Settings())).near.zones.size == 0


def test_more_obstacles_than_can_be_made_ready_are_refused_at_once() -> None:
    """Two hundred thousand took 1.5 GB before what may be met of them was counted."""
    check_obstacles(80_000)
    with pytest.raises(TooLargeError, match=r"obstacles: 200000 of them would take 800 MB .* at most 83750"):
        check_obstacles(200_000)
