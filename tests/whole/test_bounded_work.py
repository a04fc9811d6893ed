"""Work has bounds: what would not fit into memory or time is made coarser, or refused by name."""

from __future__ import annotations

import ctypes
import os
import re
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from memory import MEGABYTE, T, traced
from scenes import disc, observed, scene

import scp_planner as sp
from scp_planner.baseline.penalty_descent import penalty_descent
from scp_planner.certificate.lower_bound import kinematic_bound, lower_bound, no_trip_within
from scp_planner.certificate.verdict import BEYOND_ZONES
from scp_planner.errors import TooLargeError
from scp_planner.planning.runs import CheckedRuns
from scp_planner.planning.task import Task
from scp_planner.problem.build import build_problem
from scp_planner.problem.guides import guide_along
from scp_planner.scenario.units import NaturalUnits
from scp_planner.search.ways import WaySearch
from scp_planner.settings.planning import Settings, for_scene
from scp_planner.trips.guide import StraightGuide
from scp_planner.trips.path import Path as TripPath
from scp_planner.trips.smoothing import check_pieces, smooth_guide
from scp_planner.trips.space import SIZE, TripSpace
from scp_planner.trips.trajectory import Trajectory
from scp_planner.trips.trip import Trip


def peak_of(work: Callable[[], T]) -> tuple[T, int]:
    """Result of a search, and the most bytes that it takes at once.

    Asked of Linux, where one can: tracemalloc, which notes each allocation, takes ten times as long as the search.
    Memory that earlier tests have freed is given back first: it would be taken again without a trace.
    """
    status, marks = Path("/proc/self/status"), Path("/proc/self/clear_refs")
    give_back = getattr(ctypes.CDLL(None), "malloc_trim", None) if os.access(marks, os.W_OK) else None
    if give_back is None:
        return traced(work)

    def bytes_of(line: str) -> int:
        return 1024 * int(re.search(rf"^{line}:\s+(\d+) kB", status.read_text(), re.M)[1])  # type: ignore[index]

    give_back(0)
    marks.write_text("5")  # forgets the peak so far
    before = bytes_of("VmRSS")
    result = work()
    return result, bytes_of("VmHWM") - before


def test_the_peak_is_what_was_taken_at_once() -> None:
    def take() -> int:
        for _ in range(6):
            last = np.ones(4_000_000)
        return int(last.sum())

    result, peak = peak_of(take)
    assert result == 4_000_000
    # two at once, 64 MB, and perhaps a third that the allocator keeps; all six would be 192
    assert 30 * MEGABYTE < peak < 130 * MEGABYTE


def test_a_plan_is_told_at_many_times_part_by_part() -> None:
    plan = sp.plan(scene())
    times = np.linspace(plan.start_time, plan.arrival_time, 333_333).reshape(3, -1)
    places, peak = peak_of(lambda: plan.position(times))
    assert peak < 200 * MEGABYTE  # all at once they took 1.2 GB
    np.testing.assert_allclose(places[1, ::9999], plan.position(times[1, ::9999]), atol=1e-12)


def test_the_grid_of_a_trip_of_two_hundred_kilometres_fits_into_memory() -> None:
    scenario = scene(disc("near", (10.0, 0.3)), goal={"position": [2e5, 0.0]})
    inside = NaturalUnits.of(scenario).scenario(scenario)
    problem = build_problem(inside, sp.zones(inside), for_scene(Settings()))
    way, peak = peak_of(WaySearch(problem).best)
    assert way is not None
    assert peak < 300 * MEGABYTE


def discs(count: int) -> list[dict[str, Any]]:
    return [disc(f"o{k}", (10.0, 5.0 + k)) for k in range(count)]


def seen(count: int) -> list[dict[str, Any]]:
    return [observed(f"s{k}", k) for k in range(count)]


def torn(count: int) -> list[dict[str, Any]]:
    """One that may go on in so many ways."""
    times, place = np.linspace(0.0, 8.0, 5), np.array([10.0, 5.0])
    ways = [(place + times[:, None] * [0.5, 0.01 * k]).tolist() for k in range(count)]
    spread = [[0.01, 0.0], [0.0, 0.01]]
    futures = [
        {"weight": 1.0 / count, "motion": {"time": times.tolist(), "position": way, "covariance": spread}}
        for way in ways
    ]
    return [{"id": "torn", "shape": {"disc": 0.3}, "motion": {"futures": futures}}]


MANY = pytest.mark.parametrize(
    "many", [seen(400), torn(400)], ids=["observed", "futures"]
)  # ten times as many as can be made ready in the least time that there is for that


@MANY
def test_what_cannot_be_made_ready_in_time_is_answered_with_what_to_change(many: list[dict[str, Any]]) -> None:
    told = r"time_limit: most of 1e-09 s is over .* fewer observations"
    answer = sp.plan(scene(*many), time_limit=1e-9)
    assert answer.status == "infeasible" and not answer.certified
    assert answer.reason is not None and re.search(told, answer.reason)
    assert np.isfinite(answer.travel_time) and answer.clearance.minimum == -np.inf
    with pytest.raises(TooLargeError, match=told):
        penalty_descent(scene(*many), time_limit=1e-9)


@MANY
def test_a_bound_among_what_cannot_be_made_ready_in_time_is_the_kinematic_one(
    many: list[dict[str, Any]],
) -> None:
    scenario = scene(*many)
    assert lower_bound(scenario, time_limit=1e-9) == kinematic_bound(scenario)


def test_a_scene_of_few_obstacles_is_planned_however_short_the_time() -> None:
    few = scene(*discs(8), *seen(4))
    assert np.isfinite(sp.plan(few, time_limit=1e-9).travel_time)


def test_a_long_curve_is_refused_by_name() -> None:
    with pytest.raises(TooLargeError, match=r"guide: a curve of 1e\+06 .* in pieces of 0.3 .* path_span"):
        check_pieces(1e6, 0.3)


def test_too_many_spans_are_refused_before_anything_is_allocated() -> None:
    def refused() -> None:
        with pytest.raises(TooLargeError, match=r"path: 5000 spans .* at most \d+ spans"):
            TripSpace(StraightGuide(100.0), 1.0, 3, 5000, 0, (0.0, 1.0))
        with pytest.raises(TooLargeError, match=r"acceleration: 9000 spans"):
            TripSpace(StraightGuide(100.0), 1.0, 3, 5, 0, tuple(np.linspace(0.0, 1.0, 9001).tolist()))

    assert traced(refused)[1] < MEGABYTE


def test_the_largest_spaces_take_what_they_are_said_to_take() -> None:
    space, peak = traced(lambda: TripSpace(StraightGuide(100.0), 1.0, 5, 300, 0, (0.0, 1.0)))
    assert space.path_size == 305
    assert peak < SIZE.most_bytes * (300 / 650) ** 2 * 1.3


def test_a_guide_of_4000_jittered_points_takes_little_memory() -> None:
    rng = np.random.default_rng(0)
    points = np.stack([np.linspace(0.0, 400.0, 4000), rng.normal(0.0, 0.05, 4000)], axis=1)
    points[[0, -1], 1] = 0.0
    curve, peak = traced(lambda: smooth_guide(points, 2.0))
    assert curve.length > 400.0
    assert peak < 400 * MEGABYTE


def test_a_bound_that_would_take_too_much_is_the_kinematic_one() -> None:
    scenario = scene(disc("in the way", (10.0, 0.0), radius=3.0), bounds={"min": [-1.0, -5.0], "max": [21.0, 5.0]})
    kinematic = kinematic_bound(scenario)
    zones = sp.zones(scenario)
    assert lower_bound(scenario, at_most=2.0 * kinematic) > kinematic
    assert lower_bound(scenario, at_most=2.0 * kinematic, time_limit=0.0) == kinematic
    assert not no_trip_within(scenario, 1.001 * kinematic, zones, deadline=time.perf_counter())


def test_a_proof_about_an_endless_horizon_is_not_begun() -> None:
    wall = {"id": "wall", "shape": {"rectangle": [1.0, 30.0], "heading": 0.0}, "motion": {"position": [10.0, 0.0]}}
    scenario = scene(wall, bounds={"min": [-5.0, -5.0], "max": [25.0, 5.0]})
    zones = sp.zones(scenario)
    no_trip_within(scenario, 10.0, zones)  # what is loaded once is no part of it
    shown, peak = traced(lambda: no_trip_within(scenario, 1e9, zones))
    assert not shown and peak < MEGABYTE


def test_the_run_along_a_new_guide_starts_with_a_trip_that_arrives() -> None:
    """The accelerations of the last trip may end just before a guide that has become a little longer."""
    scenario = scene(start={"heading": 0.3, "speed": 2.0})
    runs = CheckedRuns(Task(scenario, sp.zones(scenario), Settings()))
    beta = np.full(runs.problem.space.acceleration_size, -0.11)  # stands after 18 m
    assert runs.problem.space.travel_time(20.0, beta) == np.inf
    attempt = runs.along_the_guide(beta, 8.0, np.inf)
    assert attempt.holds
    assert attempt.travel_time < 8.0


def test_a_trip_that_takes_no_time_is_not_certified() -> None:
    plan = sp.plan(scene())
    trajectory = plan.trip.trajectory
    trip = Trip(plan.trip.frame, Trajectory(trajectory.path, trajectory.beta, 0.0))
    certificate = sp.certify(scene(), replace(plan, trip=trip))
    assert [violation.what for violation in certificate.violations] == ["travel time"]


@pytest.mark.parametrize(("earliest", "certified"), [(130.0, False), (110.0, True), (None, True)])
def test_a_trip_beyond_the_horizon_of_estimated_zones_is_not_certified(earliest: float | None, certified: bool) -> None:
    seen = {"time": [-0.2, -0.1, 0.0], "position": [[0.0, 900.0]] * 3, "covariance": [[0.01, 0.0], [0.0, 0.01]]}
    far = {"id": "far", "shape": {"disc": 0.1}, "observations": seen, "model": {"order": 0}}
    scenario = scene(far, goal={"earliest_arrival": earliest})
    plan = sp.plan(scenario)
    assert plan.certified == certified
    certificate = sp.certify(scenario, plan)
    assert certificate.holds == certified
    if certified:
        return
    assert [violation.what for violation in certificate.violations] == [BEYOND_ZONES]
    assert certificate.violations[0].allowed == pytest.approx(120.0)  # in a scene whose units are metres and seconds
    assert plan.reason is not None
    assert "nothing is known of observed obstacles" in plan.reason
    # With the same obstacle where it is known to be, there is no such end.
    there = {"id": "far", "shape": {"disc": 0.1}, "motion": {"position": [0.0, 900.0]}}
    assert sp.certify(scene(there, goal={"earliest_arrival": earliest}), plan).holds


def test_a_vehicle_that_turns_in_wide_bends_to_a_goal_nearby_has_not_more_spans_than_its_bends_need() -> None:
    scenario = scene(
        start={"heading": 2.0}, goal={"position": [3.0, 0.0], "heading": -2.0}, vehicle={"max_curvature": 0.02}
    )
    units = NaturalUnits.of(scenario)
    problem = build_problem(units.scenario(scenario), (), for_scene(Settings(), units))
    space = problem.space
    assert 20 <= len(space.path.widths) <= 30
    assert space.length / len(space.path.widths) < 100.0 / units.length  # m: its bends have a radius of 100 m
    again = guide_along(TripPath(space, np.zeros(space.path_size)), Settings())
    assert again.pieces <= 5 * 250
