"""Several targets on the way: met within their radius and window, in the order that is given or the fastest one."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import permutations
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scenes import SLOW_VEHICLE
from slopes import differences

import scp_planner as sp
from scp_planner.cli.summaries import of_plan
from scp_planner.plotting.recording import record_plan
from scp_planner.problem.build import build_problem
from scp_planner.settings.planning import Settings
from scp_planner.trips.trajectory import Trajectory

START = {"time": 2.0, "position": [-8.0, 0.0], "heading": 0.0, "speed": 0.0}
WALKER = {"id": "walker", "shape": {"disc": 0.5}, "motion": {"position": [-1.0, 2.0], "velocity": [0.1, -0.3]}}


def moving(position: Sequence[float], velocity: Sequence[float], **more: Any) -> dict[str, Any]:
    return {"target": {"motion": {"position": position, "velocity": velocity}}, "radius": 0.4, **more}


NEAR = moving([-4.0, 2.0], [0.3, -0.2])
FAR = moving([3.0, -3.0], [0.0, 0.5])
LATE = moving([3.0, -3.0], [0.0, 0.3], earliest_arrival=12.0, latest_arrival=13.0)
PLACE = {"position": [0.0, 3.0], "radius": 0.4}


def scene(goals: Sequence[Mapping[str, Any]], **more: Any) -> sp.Scenario:
    return sp.Scenario(
        **{"vehicle": SLOW_VEHICLE, "start": START, "goal": {"position": [8.0, 0.0]}, "goals": goals, **more}
    )


def first_meetings(plan: Any, goals: Sequence[Mapping[str, Any]], ordered: bool = True) -> list[float]:
    """Times of the dense samples at which each is met, after those before it, within its window; inf if it is not."""
    time = np.linspace(plan.start_time, plan.arrival_time, 20_001)
    position, found, begin = plan.position(time), [], plan.start_time
    for goal in goals:
        place = np.array(goal.get("position", [0.0, 0.0]))
        if "target" in goal:
            motion = goal["target"]["motion"]
            place = np.array(motion["position"]) + (time[:, None] - START["time"]) * np.array(motion["velocity"])
        met = np.hypot(*(position - place).T) <= goal["radius"] + 1e-4
        met &= (time >= goal.get("earliest_arrival", 0.0)) & (time <= goal.get("latest_arrival", np.inf))
        met &= time >= begin
        found.append(float(time[np.argmax(met)]) if met.any() else np.inf)
        begin = found[-1] if ordered else begin
    return found


@pytest.mark.parametrize(
    ("goals", "more"),
    [([NEAR, FAR], {}), ([NEAR, PLACE, LATE], {}), ([NEAR, FAR], {"obstacles": [WALKER]})],
    ids=["two", "with a place and a window", "past a walker"],
)
def test_targets_are_met_in_the_given_order(goals: list[dict[str, Any]], more: dict[str, Any]) -> None:
    given = scene(goals, **more)
    plan = sp.plan(given)
    assert plan.certified
    times = first_meetings(plan, goals)
    assert np.isfinite(times).all()
    told = sp.meetings(given, plan)
    assert list(told) == list(range(len(goals)))
    np.testing.assert_allclose([one.time for one in told.values()], times, atol=0.02)
    assert max(one.distance for one in told.values()) <= 0.4 + 1e-6
    assert sp.certify(given, plan).holds


def test_the_fastest_order_is_that_of_the_fastest_plan() -> None:
    for goals in ([FAR, NEAR], [PLACE, {"position": [-4.0, -2.0], "radius": 0.4}]):
        plan = sp.plan(scene(goals, goals_order="fastest"))
        each = [sp.plan(scene(list(order))) for order in permutations(goals)]
        assert plan.certified
        assert plan.travel_time <= min(one.travel_time for one in each if one.certified) * (1.0 + 1e-6)
        assert np.isfinite(first_meetings(plan, goals, ordered=False)).all()
        assert list(sp.meetings(scene(goals, goals_order="fastest"), plan)) == [1, 0]


def test_the_certificate_refuses_targets_that_are_missed() -> None:
    given = scene([NEAR, FAR])
    plan = sp.plan(given)
    time = np.linspace(plan.start_time, plan.arrival_time, 600)
    samples = sp.SampledTrajectory(time, plan.position(time))
    for goals in (
        [FAR, NEAR],
        [NEAR, moving([3.0, -3.0], [0.0, -0.5])],
        [moving([-4.0, 2.0], [0.3, -0.2], latest_arrival=4.0), FAR],
        [NEAR, moving([3.0, -3.0], [0.0, 0.5], offset=[0.0, -2.0])],
    ):
        for tampered in (plan, samples):
            found = sp.certify(scene(goals), tampered)
            assert [one.what.startswith("distance from goals") for one in found.violations].count(True) == 1
    assert not any("goals" in one.what for one in sp.certify(given, samples).violations)
    assert sp.certify(scene([FAR, NEAR], goals_order="fastest"), plan).holds
    boat = {"id": "boat", "shape": {"disc": 0.2}, "motion": FAR["target"]["motion"]}
    named = [NEAR, {"target": "boat", "radius": 0.4}]
    assert sp.certify(scene(named, obstacles=[boat]), plan).holds
    faster = {**boat, "motion": {"position": [3.0, -3.0], "velocity": [0.0, -0.5]}}
    assert not sp.certify(scene(named, obstacles=[faster]), plan).holds


def test_gradient_of_the_least_distance_is_that_of_differences() -> None:
    window = {"earliest_arrival": 6.5, "latest_arrival": 7.0}  # the trip is there earlier
    given = scene([NEAR, moving([3.0, -3.0], [0.0, 0.5], **window)], guide=[[-8.0, 0.0], [-2.0, 1.5], [8.0, 0.0]])
    problem = build_problem(given, (), Settings())
    theta = problem.ends.theta + 0.05 * np.sin(np.arange(problem.space.path_size))
    theta[: problem.ends.free.start] = problem.ends.theta[: problem.ends.free.start]
    trip = Trajectory.of(problem.space, theta, np.linspace(0.4, -0.1, problem.space.acceleration_size))
    met = next(one for one in problem.constraints if one.name == "goals met")
    expected = differences(problem, trip, met.excess, 1e-6)
    found = met.gradient(trip, np.arange(2))
    np.testing.assert_allclose(found, expected, atol=2e-2 * np.abs(expected).max())


def test_targets_on_the_way_are_read_written_told_and_drawn(tmp_path: Path) -> None:
    given = scene([NEAR, FAR])
    given.save(tmp_path / "targets.yaml")
    assert sp.Scenario.load(tmp_path / "targets.yaml") == given
    plan = sp.plan(given)
    told, met = of_plan(given, plan), sp.meetings(given, plan)
    assert told["goals_passed"] == [0, 1]
    assert told["times_of_passing"] == [one.time for one in met.values()]
    recording = record_plan(plan, given)
    assert {one.id for one in recording.obstacles} == {"goals[0]", "goals[1]"}
    np.testing.assert_allclose(recording.places, [one.place for one in met.values()])


@pytest.mark.parametrize(
    ("goals", "more", "key"),
    [
        ([{**NEAR, "heading_range": [0.0, 1.0]}], {}, r"goals\[0\]\.heading_range"),
        ([{**PLACE, "offset": [1.0, 0.0]}], {}, r"goals\[0\]\.offset"),
        ([{"target": "nobody"}], {}, r"goals\[0\]\.target"),
        ([NEAR] * 9, {"goals_order": "fastest"}, "goals = 9"),
        ([NEAR], {"goals_order": "fastest", "guide": [[-8.0, 0.0], [8.0, 0.0]]}, "guide"),
        ([NEAR], {"goals_order": "any"}, "goals_order"),
    ],
)
def test_what_is_not_allowed_is_refused_by_its_key(goals: list[Any], more: dict[str, Any], key: str) -> None:
    with pytest.raises(sp.ScenarioError, match=key):
        scene(goals, **more)


def test_planners_that_drive_refuse_targets_on_the_way() -> None:
    with pytest.raises(sp.ScenarioError, match=r"goals\[0\]\.target"):
        sp.Planner(scene([NEAR]))
    with pytest.raises(sp.ScenarioError, match="goals_order"):
        sp.simulate(scene([PLACE], goals_order="fastest"))
    planner = sp.Planner(scene([PLACE]))
    with pytest.raises(sp.ScenarioError, match=r"goals\[0\]\.target"):
        planner.set_goal({"position": [8.0, 0.0]}, goals=[NEAR])
    assert len(planner.scenario.goals) == 1
