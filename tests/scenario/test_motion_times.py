"""A known motion holds at its time, by default at the start: whatever the clock shows."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import jsonschema
import numpy as np
import pytest
from scenes import disc, scene

import scp_planner as sp
from scp_planner.scenario.motions import Course, Futures, Motion
from verification.dense_check import check_trip

pytestmark = pytest.mark.numerics

CLOCKS = [-50.0, 100.0, 1.7e9]
BOX = {
    "id": "box",
    "shape": {"rectangle": [2.0, 1.0]},
    "motion": {"position": [12.0, 3.0], "velocity": [-0.2, -0.6], "acceleration": [0.01, 0.05]},
}
FORK = {
    "id": "fork",
    "shape": {"disc": 0.4},
    "motion": {
        "futures": [
            {"weight": 0.5, "motion": {"position": [14.0, -4.0], "velocity": [0.0, 0.8]}},
            {"weight": 0.5, "motion": {"position": [14.0, -4.0], "velocity": [0.3, 0.0]}},
        ]
    },
}


def at_clock(clock: float, *obstacles: dict[str, Any]) -> sp.Scenario:
    return scene(*obstacles, start={"time": clock})


@pytest.mark.parametrize("clock", CLOCKS)
def test_a_plan_is_that_of_time_0_whatever_the_clock_shows(clock: float) -> None:
    obstacles = disc("ahead", (10.0, 0.1), (0.3, 0.0)), BOX, FORK
    first, later = at_clock(0.0, *obstacles), at_clock(clock, *obstacles)
    digits = 4.0 * np.spacing(abs(clock))  # that a clock has, s
    expected, found = sp.plan(first), sp.plan(later)
    assert expected.certified and found.certified
    assert found.travel_time == pytest.approx(expected.travel_time, abs=1e-9 + digits)
    times = np.linspace(0.0, expected.travel_time, 50)
    assert found.position(clock + times) == pytest.approx(expected.position(times), abs=1e-7 + 10.0 * digits)
    if digits < 1e-12:  # the check takes differences over shorter times than a clock of 1.7e9 s can show
        assert check_trip(later.to_dict(), found.position, found.start_time, found.arrival_time).ok
    for zone, same in zip(sp.zones(later), sp.zones(first), strict=True):
        assert zone.center(clock + times) == pytest.approx(same.center(times), abs=1e-9 + 10.0 * digits)
    assert sp.certify(later, found).clearance.minimum == pytest.approx(expected.clearance.minimum, abs=1e-5)


@pytest.mark.parametrize("clock", CLOCKS)
def test_a_motion_may_hold_at_any_time(clock: float) -> None:
    position, velocity, acceleration = np.array([10.0, -4.0]), np.array([0.2, 0.9]), np.array([0.05, -0.1])
    moved, motion = 3.0, {"velocity": velocity.tolist(), "acceleration": acceleration.tolist()}
    earlier = {"id": "a", "shape": {"disc": 0.5}, "motion": {"time": clock - moved, "position": [10.0, -4.0], **motion}}
    (zone,) = sp.zones(at_clock(clock, earlier))
    for t in (0.0, 2.5):
        lag = moved + t
        expected = position + velocity * lag + acceleration * lag**2 / 2.0
        assert zone.center(clock + t) == pytest.approx(expected, abs=1e-5)


@pytest.mark.parametrize("clock", [0.0, *CLOCKS])
def test_files_say_when_motions_hold(
    clock: float, tmp_path: Path, scenario_schema: jsonschema.Draft202012Validator
) -> None:
    scenario = at_clock(clock, disc("a", (10.0, 3.0), (0.3, 0.0)), FORK)
    data = scenario.to_dict()
    assert data["obstacles"][0]["motion"]["time"] == clock
    assert [one["motion"]["time"] for one in data["obstacles"][1]["motion"]["futures"]] == [clock, clock]
    scenario_schema.validate(json.loads(json.dumps(data)))
    for time in ({}, {"time": clock}, {"time": None}):
        motion = {"position": [10.0, 3.0], **time}
        scenario_schema.validate({**data, "obstacles": [{"id": "a", "shape": {"disc": 0.5}, "motion": motion}]})
    for name in ("a.yaml", "a.json"):
        scenario.save(tmp_path / name)
        assert sp.Scenario.load(tmp_path / name) == scenario
    data["obstacles"][0]["motion"]["time"] = None
    assert sp.Scenario(**data) == scenario


def test_a_copy_with_another_start_leaves_obstacles_where_they_are() -> None:
    scenario = at_clock(5.0, disc("a", (10.0, 3.0), (0.3, 0.0)))
    later = scenario.model_copy(update={"start": scenario.start.model_copy(update={"time": 7.0})})
    assert sp.zones(later)[0].center(7.0) == pytest.approx([10.6, 3.0])
    new = sp.Obstacle(id="b", shape={"disc": 0.5}, motion=Motion(position=(9.0, 3.0), velocity=(0.5, 0.0)))
    assert isinstance(new.motion, Motion) and new.motion.time is None
    both = later.model_copy(update={"obstacles": (*later.obstacles, new)})
    assert [zone.center(7.0)[0] for zone in sp.zones(both)] == pytest.approx([10.6, 9.0])


def test_motions_are_told_from_courses_by_their_times() -> None:
    course = {"time": np.array([0.0, 1.0]), "position": [[9.0, 4.0], [9.0, 5.0]]}
    kinds: list[tuple[Any, type]] = [
        ({"position": [9.0, 4.0]}, Motion),
        ({"time": None, "position": [9.0, 4.0]}, Motion),
    ]
    kinds += [({"time": 3, "position": [9.0, 4.0]}, Motion), (course, Course), (FORK["motion"], Futures)]
    for motion, kind in kinds:
        assert type(sp.Obstacle(id="a", shape={"disc": 0.5}, motion=motion).motion) is kind
    with pytest.raises(ValueError, match=r"start\.time of a scenario"):
        _ = Motion(position=(9.0, 4.0)).reference_time
    with pytest.raises(sp.ScenarioError, match=r"motion\.time"):
        sp.Obstacle(id="a", shape={"disc": 0.5}, motion={"time": "noon", "position": [9.0, 4.0]})


@pytest.mark.parametrize("clock", CLOCKS)
def test_a_start_inside_an_obstacle_is_refused_at_any_clock(clock: float) -> None:
    with pytest.raises(sp.ScenarioError, match="from obstacles"):
        at_clock(clock, disc("a", (0.1, 0.0), (5.0, 0.0)))


@pytest.mark.parametrize("clock", [100.0, 1.7e9])
def test_a_simulation_is_that_of_time_0(clock: float) -> None:
    obstacle = disc("a", (8.0, -3.0), (0.0, 0.5))
    first, later = (sp.simulate(at_clock(time, obstacle), noise=0.0, rate=5.0, seed=0) for time in (0.0, clock))
    assert first.arrived and later.arrived
    assert later.travel_time == pytest.approx(first.travel_time, abs=0.2)
    assert later.least_clearance == pytest.approx(first.least_clearance, abs=0.05)
