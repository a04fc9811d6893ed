"""Goals, walls and limits that change while driving: the plan holds in the new world, or it is not called safe."""

from __future__ import annotations

import copy
import pickle
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from shapely.geometry import Point
from shapely.geometry import Polygon as Area

import scp_planner as sp

VEHICLE = {
    "radius": 0.3,
    "max_speed": 2.0,
    "max_acceleration": 1.0,
    "max_deceleration": 1.5,
    "max_curvature": 1.0,
}
WALL = [[-1.0, 4.0], [4.0, 4.0], [4.0, 4.3], [-1.0, 4.3]]


def made(**changes: object) -> sp.Planner:
    return sp.Planner(
        sp.Scenario(
            vehicle=VEHICLE,
            start={"time": 0.0, "position": [0.0, 0.0], "heading": 0.0, "speed": 0.0},
            goal={"position": [10.0, 0.0], "speed": 0.0},
            **changes,
        ),
        online=sp.OnlineSettings(period=0.11),
    )


class Drive:
    """A vehicle that follows its plans."""

    def __init__(self, planner: sp.Planner) -> None:
        self.planner, self.time, self.position, self.heading, self.speed = planner, 0.0, np.zeros(2), 0.0, 0.0

    def on(self, until: float) -> list[sp.OnlinePlan]:
        plans = []
        while self.time < until - 1e-9:
            plan = self.planner.replan(self.time, self.position, self.heading, self.speed)
            plans.append(plan)
            if plan.arrived:
                break
            self.time = round(self.time + 0.1, 6)
            ends = plan.arrival_time <= self.time
            self.position, self.heading = plan.position(self.time), float(plan.heading(self.time))
            self.speed = 0.0 if ends else float(plan.speed(self.time))
        return plans


@pytest.mark.parametrize("goal", [(5.0, 6.0), (-8.0, 3.0), (20.0, -15.0), (4.5, 0.5)])
def test_another_goal_is_driven_to_about_as_fast_as_by_a_new_planner(goal: tuple[float, float]) -> None:
    drive = Drive(made())
    drive.on(2.0)
    there = {"position": goal, "speed": 0.0}
    start = {"time": drive.time, "position": drive.position, "heading": drive.heading, "speed": drive.speed}
    fresh = Drive(sp.Planner(sp.Scenario(vehicle=VEHICLE, start=start, goal=there)))
    fresh.time, fresh.position, fresh.heading, fresh.speed = drive.time, drive.position, drive.heading, drive.speed
    drive.planner.set_goal(there)
    plans = drive.on(70.0)
    assert plans[-1].arrived and all(plan.safe for plan in plans)
    fresh.on(70.0)
    assert drive.time - 2.0 <= 1.1 * (fresh.time - 2.0) + 0.6


@pytest.mark.parametrize("far", [2.5e3, 5e4])
def test_a_goal_far_behind_is_driven_to(far: float) -> None:
    """A turn of a metre or two, and a way that is thousands of times as long."""
    drive = Drive(made())
    drive.on(0.25)
    drive.planner.set_goal({"position": [-far, 30.0]})
    plan = drive.on(0.35)[-1]
    assert plan.safe
    assert not plan.certified or plan.arrival_time > far / VEHICLE["max_speed"]


def test_a_goal_after_one_that_was_reached() -> None:
    drive = Drive(made())
    assert drive.on(20.0)[-1].arrived
    drive.planner.set_goal({"position": [10.0, 5.0], "heading": 1.5, "speed": 0.0})
    assert drive.on(40.0)[-1].arrived
    assert drive.position == pytest.approx([10.0, 5.0], abs=0.3)


def test_mistakes_are_named_before_anything_changes() -> None:
    planner = made(bounds={"min": [-5.0, -8.0], "max": [15.0, 8.0]})
    before = planner.scenario
    mistakes: list[tuple[Callable[[], None], str]] = [
        (lambda: planner.set_goal({"position": [30.0, 0.0]}), "goal.position"),
        (lambda: planner.set_goal({"position": [3.0, 0.0], "speed": 5.0}), "goal.speed"),
        (lambda: planner.set_walls([[[0.0, 0.0], [1.0, 0.0]]]), "walls"),
        (lambda: planner.set_limits(max_sped=3.0), "max_speed"),
        (lambda: planner.set_limits(max_speed=-1.0), "vehicle.max_speed"),
        (lambda: planner.set_ground(wall=[]), "walls"),
    ]
    for call, name in mistakes:
        with pytest.raises(sp.ScenarioError, match=name):
            call()
    assert planner.scenario == before


def test_walls_that_come_up_are_kept_clear_of() -> None:
    drive = Drive(made())
    drive.planner.set_goal({"position": [2.0, 7.0], "speed": 0.0})
    drive.on(1.0)
    drive.planner.set_walls([WALL])
    plans = drive.on(30.0)
    assert plans[-1].arrived
    for plan in plans:
        begins = plan.trip.frame.time
        ends = plan.arrival_time if plan.certified else begins
        outline, places = Area(WALL), plan.position(np.linspace(begins, ends, 50))
        assert all(outline.distance(Point(*place)) >= 0.3 - 1e-6 for place in places)


def test_a_wall_on_the_way_that_no_stop_avoids_is_not_called_safe() -> None:
    drive = Drive(made())
    drive.on(2.5)
    x = float(drive.position[0]) + 0.5
    drive.planner.set_walls([[[x, -5.0], [x + 0.2, -5.0], [x + 0.2, 5.0], [x, 5.0]]])
    (plan,) = drive.on(drive.time + 0.1)
    assert not plan.safe and plan.obstacle == "walls"


def test_a_lower_limit_is_kept_after_braking() -> None:
    drive = Drive(made())
    drive.on(2.5)
    drive.planner.set_limits(max_speed=0.8)
    plans = drive.on(6.0)
    assert plans[-1].certified
    assert plans[-1].speed(np.linspace(5.9, plans[-1].arrival_time, 100)).max() <= 0.8 + 1e-6
    assert any("above its limit" in doubt for doubt in drive.planner.doubts)


def test_copies_go_on_to_the_goal_that_was_set() -> None:
    drive = Drive(made())
    drive.on(1.0)
    drive.planner.set_goal({"position": [5.0, 6.0], "speed": 0.0})
    for other in (pickle.loads(pickle.dumps(drive.planner)), copy.copy(drive.planner)):
        assert other.scenario.goal.position == pytest.approx((5.0, 6.0))
        going = Drive(other)
        going.time, going.position, going.heading, going.speed = drive.time, drive.position, drive.heading, drive.speed
        plan = going.on(4.0)[-1]
        assert plan.position(plan.arrival_time) == pytest.approx([5.0, 6.0], abs=0.1)


def test_changes_are_recorded(tmp_path: Path) -> None:
    drive = Drive(made())
    with drive.planner.record(tmp_path / "drive.jsonl"):
        drive.on(0.5)
        drive.planner.set_goal({"position": [5.0, 6.0], "speed": 0.0})
        drive.planner.set_walls([WALL])
        drive.on(1.0)
    run = sp.Run.load(tmp_path / "drive.jsonl")
    assert [change.start.time for change in run.changes] == pytest.approx([0.4, 0.4])
    assert run.scenario.goal.position == (10.0, 0.0)
    assert run.last_scenario.goal.position == (5.0, 6.0) and len(run.last_scenario.walls) == 1
    recording = run.recording()
    assert recording.places == ((10.0, 0.0),) and recording.goal == (5.0, 6.0)
    run.save(tmp_path / "run.json")
    assert sp.Run.load(tmp_path / "run.json") == run


SLOW_ZONE = {"from": 0.0, "to": 50.0, "speed": 0.8, "line": [[0.0, 0.0], [60.0, 0.0]]}


@pytest.mark.parametrize("jerk", [None, 2.0])
@pytest.mark.parametrize(
    ("change", "limit"),
    [
        (lambda planner: planner.set_limits(max_speed=1.0), 1.0),
        (lambda planner: planner.set_ground(speed_limits=[SLOW_ZONE]), 0.8),
    ],
)
def test_limit_that_is_lowered_under_way_is_braked_for_at_once(
    change: Callable[[sp.Planner], None], limit: float, jerk: float | None
) -> None:
    """At 3 m/s; braking takes (3 m/s - limit) / 2 m/s2, and with a jerk limit 0.5 s more."""
    vehicle = {"radius": 0.3, "max_speed": 3.0, "max_acceleration": 1.5, "max_deceleration": 2.0, "max_jerk": jerk}
    start = {"time": 0.0, "position": [0.0, 0.0], "heading": 0.0, "speed": 3.0}
    scenario = sp.Scenario.model_validate({"vehicle": vehicle, "start": start, "goal": {"position": [60.0, 0.0]}})
    planner = sp.Planner(scenario, online=sp.OnlineSettings(period=0.1))
    state, acceleration = ((0.0, 0.0), 0.0, 3.0), 0.0
    for time in 0.1 * np.arange(22):
        if time == 0.1:
            change(planner)
        plan = planner.replan(float(time), *state, acceleration=None if jerk is None else acceleration)
        assert plan.safe
        late = 0.1 + (0.0 if jerk is None else 0.5)
        assert state[2] <= max(limit, 3.0 - 2.0 * max(time - late, 0.0)) + 1e-5
        x, y = plan.position(time + 0.1)
        state = ((float(x), float(y)), float(plan.heading(time + 0.1)), float(plan.speed(time + 0.1)))
        acceleration = float(plan.acceleration(time + 0.1))
    assert state[2] <= limit + 1e-6


def test_slow_zone_that_is_too_near_is_named_and_braked_for() -> None:
    vehicle = {"radius": 0.3, "max_speed": 3.0, "max_acceleration": 1.5, "max_deceleration": 2.0}
    start = {"time": 0.0, "position": [0.0, 0.0], "heading": 0.0, "speed": 3.0}
    scenario = sp.Scenario.model_validate({"vehicle": vehicle, "start": start, "goal": {"position": [60.0, 0.0]}})
    planner = sp.Planner(scenario, online=sp.OnlineSettings(period=0.1))
    planner.replan(0.0, (0.0, 0.0), 0.0, 3.0)
    planner.set_ground(speed_limits=[SLOW_ZONE | {"from": 1.0}])
    plan = planner.replan(0.1, (0.3, 0.0), 0.0, 3.0)
    assert (
        not plan.safe
        and plan.reason is not None
        and "speed_limits[0]" in plan.reason
        and "allowed 0.8 m/s" in plan.reason
    )
    assert float(plan.speed(0.6)) == pytest.approx(2.0, abs=0.03)
