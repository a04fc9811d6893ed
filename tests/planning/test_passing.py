"""Places to pass on the way, in their order: offline, by the certificate, and while driving."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scenes import SLOW_VEHICLE

import scp_planner as sp

POST = {"id": "post", "shape": {"rectangle": [3.0, 1.0]}, "motion": {"position": [3.0, 0.0]}}
WALKER = {"id": "walker", "shape": {"disc": 0.5}, "motion": {"position": [8.0, 3.0], "velocity": [-0.3, 0.0]}}


def scene(goals: Sequence[Mapping[str, Any]], goal: Sequence[float], **changes: Any) -> sp.Scenario:
    start = {"time": 0.0, "position": [0.0, 0.0], "heading": 0.0, "speed": 0.0}
    return sp.Scenario(
        **{"vehicle": SLOW_VEHICLE, "start": start, "goal": {"position": goal}, "goals": goals, **changes}
    )


def first_passes(
    time: NDArray[np.float64], place: NDArray[np.float64], goals: Sequence[Mapping[str, Any]]
) -> list[float]:
    """Times at which places are passed by dense samples, one after the other; inf where one is not."""
    found, begin = [], 0
    for goal in goals:
        near = np.hypot(*(place[begin:] - goal["position"]).T) <= float(goal.get("radius", 0.3)) + 1e-4
        begin += int(np.argmax(near))
        found.append(float(time[begin]) if near.any() else np.inf)
    return found


@pytest.mark.parametrize(
    ("goals", "goal", "more"),
    [
        ([{"position": [5.0, 2.0]}, {"position": [10.0, -2.0]}], [15.0, 0.0], {}),
        ([{"position": [6.0, 0.0], "radius": 0.05}], [1.0, 1.0], {}),
        ([{"position": [6.0, 0.0]}, {"position": [6.0, 6.0]}], [0.0, 6.0], {"obstacles": [POST, WALKER]}),
    ],
    ids=["slalom", "there and back", "round a post"],
)
def test_places_are_passed_in_their_order(goals: list[dict[str, Any]], goal: list[float], more: dict[str, Any]) -> None:
    plan = sp.plan(scene(goals, goal, **more))
    assert plan.certified
    time = np.linspace(0.0, plan.travel_time, 20_001)
    times = first_passes(time, plan.position(time), goals)
    assert np.isfinite(times).all()
    # No leg is faster than a straight drive at the top speed
    places = [[0.0, 0.0], *(one["position"] for one in goals), goal]
    least = np.hypot(*np.diff(np.array(places), axis=0).T) - 0.6
    assert np.all(np.diff([0.0, *times, plan.travel_time]) >= least / 2.0)


def test_one_trip_is_faster_than_its_legs_one_after_the_other() -> None:
    one = sp.plan(scene([{"position": [6.0, 0.0]}, {"position": [6.0, 6.0]}], [0.0, 6.0]))
    start, arrival = {"time": 0.0, "position": [0.0, 0.0], "heading": 0.0, "speed": 0.0}, 0.0
    for goal in (
        {"position": [6.0, 0.0], "radius": 0.3},
        {"position": [6.0, 6.0], "radius": 0.3},
        {"position": [0, 6]},
    ):
        leg = sp.plan(sp.Scenario(vehicle=SLOW_VEHICLE, start=start, goal=goal))
        arrival = leg.arrival_time
        end = {"position": leg.position(arrival), "heading": float(leg.heading(arrival))}
        start = {"time": arrival, "speed": float(leg.speed(arrival)), **end}
    assert one.certified
    assert one.travel_time < arrival


def test_heading_and_time_at_a_place_are_kept() -> None:
    turned = sp.plan(scene([{"position": [6.0, 0.0], "heading_range": [1.2, 1.9]}], [12.0, 0.0]))
    time = np.linspace(0.0, turned.travel_time, 20_001)
    near = np.hypot(*(turned.position(time) - [6.0, 0.0]).T) <= 0.3
    heading = turned.heading(time)[near]
    assert turned.certified
    assert np.any((heading >= 1.2) & (heading <= 1.9))
    timed = sp.plan(scene([{"position": [6.0, 0.0], "earliest_arrival": 8.0, "latest_arrival": 9.0}], [12.0, 0.0]))
    assert timed.certified
    assert np.hypot(*(timed.position(np.linspace(8.0, 9.0, 1001)) - [6.0, 0.0]).T).min() <= 0.3


def test_the_certificate_finds_a_place_that_is_missed_or_passed_too_soon() -> None:
    there = scene([{"position": [6.0, 0.0]}], [12.0, 0.0])
    plan = sp.plan(there)
    for goals in (
        [{"position": [6.0, 1.0]}],
        [{"position": [8.0, 0.0]}, {"position": [4.0, 0.0]}],
        [{"position": [6.0, 0.0], "earliest_arrival": 6.5}],
        [{"position": [6.0, 0.0], "heading_range": [0.5, 1.0]}],
    ):
        found = sp.certify(scene(goals, [12.0, 0.0]), plan)
        assert not found.holds
        assert [one.what.startswith("distance from goals") for one in found.violations] == [True]
    assert sp.certify(there, plan).holds
    time = np.linspace(0.0, plan.travel_time, 400)
    samples = sp.SampledTrajectory(time, plan.position(time))
    assert not any("goals" in one.what for one in sp.certify(there, samples).violations)
    elsewhere = scene([{"position": [6.0, 1.0]}], [12.0, 0.0])
    assert any("goals" in one.what for one in sp.certify(elsewhere, samples).violations)


def test_places_are_read_written_and_checked(tmp_path: Path) -> None:
    given = scene([{"position": [6.0, 0.0], "radius": 0.5}, {"position": [6.0, 6.0]}], [0.0, 6.0])
    given.save(tmp_path / "places.yaml")
    assert sp.Scenario.load(tmp_path / "places.yaml") == given
    bounds = {"min": [-1.0, -1.0], "max": [7.0, 7.0]}
    with pytest.raises(sp.ScenarioError, match=r"goals\[1\]\.position"):
        scene([{"position": [6.0, 0.0]}, {"position": [6.0, 9.0]}], [0.0, 6.0], bounds=bounds)
    with pytest.raises(sp.ScenarioError, match=r"goals\[0\]\.position"):
        scene([{"position": [0.0, 0.0]}], [0.0, 6.0])
    with pytest.raises(sp.ScenarioError, match=r"vehicle\.reverse"):
        scene([{"position": [6.0, 0.0]}], [0.0, 6.0], vehicle={**SLOW_VEHICLE, "reverse": {"max_speed": 0.5}})


def test_a_planner_goes_on_to_the_next_place() -> None:
    goals = [{"position": [5.0, 0.0]}, {"position": [5.0, 5.0]}]
    planner = sp.Planner(scene(goals, [0.0, 5.0], obstacles=[WALKER]))
    time, place, heading, speed, driven = 0.0, np.zeros(2), 0.0, 0.0, [np.zeros(2)]
    while time < 30.0:
        plan = planner.replan(time, place, heading, speed)
        assert plan.safe
        if plan.arrived:
            break
        if time == 0.5:
            planner.set_goal({"position": [1.0, 6.0]}, goals=[*goals, {"position": [3.0, 7.0]}])
        time = round(time + 0.1, 6)
        ends = plan.arrival_time <= time
        place, heading = plan.position(time), float(plan.heading(time))
        speed = 0.0 if ends else float(plan.speed(time))
        driven.append(place)
    assert plan.arrived
    assert planner.scenario.goals == ()
    times = first_passes(
        np.linspace(0.0, 0.1 * len(driven), len(driven), endpoint=False),
        np.array(driven),
        [{**one, "radius": 0.4} for one in goals],
    )
    assert np.isfinite(times).all()
    assert np.hypot(*(np.array(driven) - [3.0, 7.0]).T).min() <= 0.4
