"""Places to pass and targets to meet on the way, in the given order or the fastest: plans, certificates, planners."""

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
from scp_planner.arrays import Array
from scp_planner.cli.summaries import of_plan
from scp_planner.plotting.recording import record_plan
from scp_planner.problem.build import build_problem
from scp_planner.settings.planning import Settings
from scp_planner.trips.trajectory import Trajectory

AT_ONCE = {"time": 0.0, "position": [0.0, 0.0], "heading": 0.0, "speed": 0.0}
LATER = {"time": 2.0, "position": [-8.0, 0.0], "heading": 0.0, "speed": 0.0}
POST = {"id": "post", "shape": {"rectangle": [3.0, 1.0]}, "motion": {"position": [3.0, 0.0]}}
WALKER = {"id": "walker", "shape": {"disc": 0.5}, "motion": {"position": [8.0, 3.0], "velocity": [-0.3, 0.0]}}
CROSSER = {"id": "crosser", "shape": {"disc": 0.5}, "motion": {"position": [-1.0, 2.0], "velocity": [0.1, -0.3]}}


def moving(position: Sequence[float], velocity: Sequence[float], **more: Any) -> dict[str, Any]:
    return {"target": {"motion": {"position": position, "velocity": velocity}}, "radius": 0.4, **more}


NEAR = moving([-4.0, 2.0], [0.3, -0.2])
FAR = moving([3.0, -3.0], [0.0, 0.5])
LATE = moving([3.0, -3.0], [0.0, 0.3], earliest_arrival=12.0, latest_arrival=13.0)
PLACE = {"position": [0.0, 3.0], "radius": 0.4}


def passing(goals: Sequence[Mapping[str, Any]], goal: Sequence[float], **more: Any) -> sp.Scenario:
    """A trip from the origin over places."""
    return sp.Scenario(
        **{"vehicle": SLOW_VEHICLE, "start": AT_ONCE, "goal": {"position": goal}, "goals": goals, **more}
    )


def meeting(goals: Sequence[Mapping[str, Any]], **more: Any) -> sp.Scenario:
    """A trip of 16 m that begins at 2 s, over targets."""
    return passing(goals, [8.0, 0.0], **{"start": LATER, **more})


def first_meetings(time: Array, position: Array, goals: Sequence[Mapping[str, Any]], ordered: bool = True) -> Array:
    """Times of dense samples at which each is met, after those before it, within its window; inf if it is not."""
    found, begin = [], time[0]
    for goal in goals:
        place = np.array(goal.get("position", [0.0, 0.0]))
        if "target" in goal:
            motion = goal["target"]["motion"]
            place = np.array(motion["position"]) + (time[:, None] - time[0]) * np.array(motion["velocity"])
        met = np.hypot(*(position - place).T) <= goal.get("radius", 0.3) + 1e-4
        met &= (time >= goal.get("earliest_arrival", 0.0)) & (time <= goal.get("latest_arrival", np.inf))
        met &= time >= begin
        found.append(float(time[np.argmax(met)]) if met.any() else np.inf)
        begin = found[-1] if ordered else begin
    return np.array(found)


def densely(plan: sp.Plan) -> tuple[Array, Array]:
    time = np.linspace(plan.start_time, plan.arrival_time, 20_001)
    return time, plan.position(time)


@pytest.mark.parametrize(
    ("goals", "goal", "more"),
    [
        ([{"position": [5.0, 2.0]}, {"position": [10.0, -2.0]}], [15.0, 0.0], {}),
        ([{"position": [6.0, 0.0], "radius": 0.05}], [1.0, 1.0], {}),
        ([{"position": [6.0, 0.0]}, {"position": [6.0, 6.0]}], [0.0, 6.0], {"obstacles": [POST, WALKER]}),
        ([{"position": [6.0, 0.0], "earliest_arrival": 8.0, "latest_arrival": 9.0}], [12.0, 0.0], {}),
    ],
    ids=["slalom", "there and back", "round a post", "in a window"],
)
def test_places_are_passed_in_their_order(goals: list[dict[str, Any]], goal: list[float], more: dict[str, Any]) -> None:
    plan = sp.plan(passing(goals, goal, **more))
    assert plan.certified
    times = first_meetings(*densely(plan), goals)
    assert np.isfinite(times).all()
    # No leg is faster than a straight drive at the top speed
    places = [[0.0, 0.0], *(one["position"] for one in goals), goal]
    least = np.hypot(*np.diff(np.array(places), axis=0).T) - 0.6
    assert np.all(np.diff([0.0, *times, plan.travel_time]) >= least / 2.0)


@pytest.mark.parametrize(
    ("goals", "more"),
    [([NEAR, FAR], {}), ([NEAR, PLACE, LATE], {}), ([NEAR, FAR], {"obstacles": [CROSSER]})],
    ids=["two", "with a place and a window", "past a walker"],
)
def test_targets_are_met_in_their_order(goals: list[dict[str, Any]], more: dict[str, Any]) -> None:
    given = meeting(goals, **more)
    plan = sp.plan(given)
    assert plan.certified
    times, told = first_meetings(*densely(plan), goals), sp.meetings(given, plan)
    assert list(told) == list(range(len(goals)))
    np.testing.assert_allclose([one.time for one in told.values()], times, atol=0.02)
    assert max(one.distance for one in told.values()) <= 0.4 + 1e-6
    assert sp.certify(given, plan).holds


def test_one_trip_is_faster_than_its_legs_one_after_the_other() -> None:
    goals = [{"position": [6.0, 0.0], "radius": 0.3}, {"position": [6.0, 6.0], "radius": 0.3}]
    one = sp.plan(passing(goals, [0.0, 6.0]))
    start, arrival = AT_ONCE, 0.0
    for goal in (*goals, {"position": [0, 6]}):
        leg = sp.plan(sp.Scenario(vehicle=SLOW_VEHICLE, start=start, goal=goal))
        arrival = leg.arrival_time
        end = {"position": leg.position(arrival), "heading": float(leg.heading(arrival))}
        start = {"time": arrival, "speed": float(leg.speed(arrival)), **end}
    assert one.certified
    assert one.travel_time < arrival


def test_heading_at_a_place_is_kept() -> None:
    plan = sp.plan(passing([{"position": [6.0, 0.0], "heading_range": [1.2, 1.9]}], [12.0, 0.0]))
    time, position = densely(plan)
    heading = plan.heading(time)[np.hypot(*(position - [6.0, 0.0]).T) <= 0.3]
    assert plan.certified
    assert np.any((heading >= 1.2) & (heading <= 1.9))


def test_the_fastest_order_is_that_of_the_fastest_plan() -> None:
    for goals in ([FAR, NEAR], [PLACE, {"position": [-4.0, -2.0], "radius": 0.4}]):
        given = meeting(goals, goals_order="fastest")
        plan = sp.plan(given)
        each = [sp.plan(meeting(list(order))) for order in permutations(goals)]
        assert plan.certified
        assert plan.travel_time <= min(one.travel_time for one in each if one.certified) * (1.0 + 1e-6)
        assert np.isfinite(first_meetings(*densely(plan), goals, ordered=False)).all()
        assert list(sp.meetings(given, plan)) == [1, 0]


BY_PLACES = ([{"position": [6.0, 0.0]}], [12.0, 0.0], AT_ONCE)
BY_TARGETS = ([NEAR, FAR], [8.0, 0.0], LATER)


@pytest.mark.parametrize(
    ("driven", "missed", "by_samples"),
    [
        (BY_PLACES, [{"position": [6.0, 1.0]}], True),
        (BY_PLACES, [{"position": [8.0, 0.0]}, {"position": [4.0, 0.0]}], True),
        (BY_PLACES, [{"position": [6.0, 0.0], "earliest_arrival": 6.5}], True),
        (BY_PLACES, [{"position": [6.0, 0.0], "heading_range": [0.5, 1.0]}], False),  # it may turn between samples
        (BY_TARGETS, [FAR, NEAR], True),
        (BY_TARGETS, [NEAR, moving([3.0, -3.0], [0.0, -0.5])], True),
        (BY_TARGETS, [moving([-4.0, 2.0], [0.3, -0.2], latest_arrival=4.0), FAR], True),
        (BY_TARGETS, [NEAR, moving([3.0, -3.0], [0.0, 0.5], offset=[0.0, -2.0])], True),
    ],
)
def test_the_certificate_finds_what_is_missed(driven: Any, missed: list[dict[str, Any]], by_samples: bool) -> None:
    goals, goal, start = driven
    there, elsewhere = passing(goals, goal, start=start), passing(missed, goal, start=start)
    plan = sp.plan(there)
    time = np.linspace(plan.start_time, plan.arrival_time, 600)
    samples = sp.SampledTrajectory(time, plan.position(time))
    assert sp.certify(there, plan).holds
    assert not any("goals" in one.what for one in sp.certify(there, samples).violations)
    for trip in (plan, samples) if by_samples else (plan,):
        found = [one.what for one in sp.certify(elsewhere, trip).violations]
        assert [what.startswith("distance from goals") for what in found].count(True) == 1


def test_the_certificate_knows_any_order_and_targets_by_their_names() -> None:
    plan = sp.plan(meeting([NEAR, FAR]))
    assert sp.certify(meeting([FAR, NEAR], goals_order="fastest"), plan).holds
    boat = {"id": "boat", "shape": {"disc": 0.2}, "motion": FAR["target"]["motion"]}
    named = [NEAR, {"target": "boat", "radius": 0.4}]
    assert sp.certify(meeting(named, obstacles=[boat]), plan).holds
    faster = {**boat, "motion": {"position": [3.0, -3.0], "velocity": [0.0, -0.5]}}
    assert not sp.certify(meeting(named, obstacles=[faster]), plan).holds


def test_gradient_of_the_least_distance_is_that_of_differences() -> None:
    window = {"earliest_arrival": 6.5, "latest_arrival": 7.0}  # the trip is there earlier
    given = meeting([NEAR, moving([3.0, -3.0], [0.0, 0.5], **window)], guide=[[-8.0, 0.0], [-2.0, 1.5], [8.0, 0.0]])
    problem = build_problem(given, (), Settings())
    theta = problem.ends.theta + 0.05 * np.sin(np.arange(problem.space.path_size))
    theta[: problem.ends.free.start] = problem.ends.theta[: problem.ends.free.start]
    trip = Trajectory.of(problem.space, theta, np.linspace(0.4, -0.1, problem.space.acceleration_size))
    met = next(one for one in problem.constraints if one.name == "goals met")
    expected = differences(problem, trip, met.excess, 1e-6)
    found = met.gradient(trip, np.arange(2))
    np.testing.assert_allclose(found, expected, atol=2e-2 * np.abs(expected).max())


def test_goals_on_the_way_are_read_written_told_and_drawn(tmp_path: Path) -> None:
    given = meeting([NEAR, PLACE, FAR])
    given.save(tmp_path / "goals.yaml")
    assert sp.Scenario.load(tmp_path / "goals.yaml") == given
    plan = sp.plan(given)
    told, met = of_plan(given, plan), sp.meetings(given, plan)
    assert told["goals_passed"] == [0, 1, 2]
    assert told["times_of_passing"] == [one.time for one in met.values()]
    recording = record_plan(plan, given)
    assert {one.id for one in recording.obstacles} == {"goals[0]", "goals[2]"}
    np.testing.assert_allclose(np.array(recording.places)[[0, 2]], [met[k].place for k in (0, 2)])


@pytest.mark.parametrize(
    ("goals", "more", "key"),
    [
        ([{**NEAR, "heading_range": [0.0, 1.0]}], {}, r"goals\[0\]\.heading_range"),
        ([{**PLACE, "offset": [1.0, 0.0]}], {}, r"goals\[0\]\.offset"),
        ([{"target": "nobody"}], {}, r"goals\[0\]\.target"),
        ([NEAR] * 9, {"goals_order": "fastest"}, "goals = 9"),
        ([NEAR], {"goals_order": "fastest", "guide": [[-8.0, 0.0], [8.0, 0.0]]}, "guide"),
        ([NEAR], {"goals_order": "any"}, "goals_order"),
        ([PLACE, {"position": [6.0, 9.0]}], {"bounds": {"min": [-9, -1], "max": [9, 7]}}, r"goals\[1\]\.position"),
        ([{"position": [-8.0, 0.0]}], {}, r"goals\[0\]\.position"),
    ],
)
def test_what_is_not_allowed_is_refused_by_its_key(goals: list[Any], more: dict[str, Any], key: str) -> None:
    with pytest.raises(sp.ScenarioError, match=key):
        meeting(goals, **more)


def test_a_planner_goes_on_to_the_next_place() -> None:
    goals = [{"position": [5.0, 0.0], "radius": 0.4}, {"position": [5.0, 5.0], "radius": 0.4}]
    planner = sp.Planner(passing([{"position": one["position"]} for one in goals], [0.0, 5.0], obstacles=[WALKER]))
    time, place, heading, speed, driven = 0.0, np.zeros(2), 0.0, 0.0, [np.zeros(2)]
    while time < 30.0:
        plan = planner.replan(time, place, heading, speed)
        assert plan.safe
        if plan.arrived:
            break
        if time == 0.5:
            more = [{"position": one["position"]} for one in goals]
            planner.set_goal({"position": [1.0, 6.0]}, goals=[*more, {"position": [3.0, 7.0]}])
        time = round(time + 0.1, 6)
        ends = plan.arrival_time <= time
        place, heading = plan.position(time), float(plan.heading(time))
        speed = 0.0 if ends else float(plan.speed(time))
        driven.append(place)
    assert plan.arrived
    assert planner.scenario.goals == ()
    assert np.isfinite(
        first_meetings(np.linspace(0.0, 0.1 * len(driven), len(driven), endpoint=False), np.array(driven), goals)
    ).all()
    assert np.hypot(*(np.array(driven) - [3.0, 7.0]).T).min() <= 0.4
