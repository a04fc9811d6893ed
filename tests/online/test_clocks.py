"""Stamps that the clock of the replans contradicts: ahead of it, absurd, long past."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from replanning import begin, follow
from scenes import scene

import scp_planner as sp
from scp_planner.online.planner import Planner

pytestmark = pytest.mark.numerics

STEP = 0.1
SLOW = {"max_speed": 1.0, "max_acceleration": 1.0, "max_deceleration": 1.0}


def walker(time: float) -> np.ndarray:
    return np.array([10.0, -8.0 + 0.7 * time])


def planner_of_one(model: Any, clock: float = 0.0, **online: Any) -> Planner:
    scenario = scene(vehicle=SLOW, start={"time": clock, "speed": 0.0})
    planner = Planner(scenario, online=sp.OnlineSettings(**online))
    planner.add_obstacle("p", {"disc": 0.4}, covariance=0.03**2 * np.eye(2), model=model)
    return planner


def missed(planner: Planner, time: float, place: np.ndarray) -> float:
    """How far a place is outside the zone of the walker's centre, m."""
    (zone,) = planner.zones
    return float(zone.signed_distance(time, place)) + 0.4


@pytest.mark.parametrize(
    ("ahead", "model", "clock", "by_tracker"),
    [
        (0.5, "car", 0.0, False),
        (2.0, "pedestrian", 0.0, False),
        (2.0, "car", 1.7e9, False),
        (5.0, "pedestrian", 1.7e9, False),
        (5.0, "car", 0.0, False),
        (1e12, {"order": 1}, 0.0, False),
        (0.5, "pedestrian", 0.0, True),
        (5.0, "pedestrian", 0.0, True),
    ],
)
def test_one_stamp_ahead_leaves_the_obstacle_in_its_zone(
    ahead: float, model: Any, clock: float, by_tracker: bool
) -> None:
    planner, rng = planner_of_one(model, clock), np.random.default_rng(0)
    seen = {k: walker(STEP * k) + 0.03 * rng.standard_normal(2) for k in range(-20, 70)}

    def tell(stamp: float, place: np.ndarray) -> None:
        if by_tracker:
            planner.update_obstacle("p", stamp, place, (0.0, 0.7), covariance=np.diag([0.01, 0.01, 0.04, 0.04]))
        else:
            planner.observe("p", stamp, place)

    for k in range(-20, 0):
        tell(clock + STEP * k, seen[k])
    for k in range(70):
        tell(clock + STEP * k + (ahead if k == 10 else 0.0), seen[k])
        time = clock + STEP * k
        if k == 0:
            planner.replan(time, (0.0, 0.0), 0.0, 0.0)
        else:
            follow(planner, time)
        assert missed(planner, time, walker(STEP * k)) < 0.05
    assert any("ahead of the clock of the replans, and held back" in note or "beyond" in note for note in planner.notes)


def test_what_is_held_back_is_used_when_its_time_has_come() -> None:
    planner = planner_of_one({"order": 0}, period=0.1)
    planner.observe("p", 1.0, (10.0, 3.0))
    for k in range(10):
        follow(planner, STEP * k) if k else planner.replan(0.0, (0.0, 0.0), 0.0, 0.0)
        assert planner.zones == ()
    follow(planner, 1.0)
    assert planner.zones[0].center(1.0) == pytest.approx([10.0, 3.0])


@pytest.mark.parametrize("lead", [0.8, 3.0])
def test_a_clock_that_is_ahead_all_the_time_is_told_once(lead: float) -> None:
    planner = planner_of_one("pedestrian")
    for k in range(40):
        planner.observe("p", STEP * k + lead, walker(STEP * k))
        follow(planner, STEP * k) if k else planner.replan(0.0, (0.0, 0.0), 0.0, 0.0)
    told = [doubt for doubt in planner.doubts if "ahead of the clock" in doubt]
    assert len(told) == 1 and f"about {lead:.3g} s ahead" in told[0] and "stamps of p" in told[0]


def test_single_wrong_stamps_are_no_lead_of_a_clock() -> None:
    planner, rng = planner_of_one("pedestrian"), np.random.default_rng(1)
    for k in range(80):
        wrong = rng.uniform(1.0, 500.0) if k % 4 == 0 else 0.0
        planner.observe("p", STEP * k + wrong, walker(STEP * k) + 0.03 * rng.standard_normal(2))
        follow(planner, STEP * k) if k else planner.replan(0.0, (0.0, 0.0), 0.0, 0.0)
    assert not any("ahead of the clock" in doubt for doubt in planner.doubts)


def test_a_late_replan_is_no_fault_of_the_stamps() -> None:
    planner, rng = planner_of_one("pedestrian", period=0.1), np.random.default_rng(0)
    begin(planner, planner.scenario)
    for k in range(1, 31):
        planner.observe("p", STEP * k, walker(STEP * k) + 0.03 * rng.standard_normal(2))
    follow(planner, 3.0)
    assert not planner.notes and len(planner.obstacles.tracks["p"].times) == 30


@pytest.mark.parametrize("stamp", [0.0, -1e12, 1e300])
@pytest.mark.parametrize("first", [True, False])
def test_stamps_of_other_times_do_not_matter_or_make_large_zones(stamp: float, first: bool) -> None:
    """A driver that never sets its stamp, at unix time."""
    clock = 1.7e9
    planner, rng = planner_of_one({"order": 1}, clock), np.random.default_rng(0)
    for k in range(30):
        time, place = clock + STEP * k, walker(STEP * k) + 0.03 * rng.standard_normal(2)
        if first or k > 0:
            planner.observe("p", stamp, place)
        planner.observe("p", time, place)
        follow(planner, time) if k else planner.replan(time, (0.0, 0.0), 0.0, 0.0)
        assert missed(planner, time, walker(STEP * k)) < 0.05
    assert planner.notes


def test_a_motion_without_a_time_while_driving_holds_at_the_start_and_is_noted() -> None:
    planner = planner_of_one("pedestrian", clock=100.0)
    begin(planner, planner.scenario)
    planner.update_motion("p", {"position": [10.0, 4.0], "velocity": [0.0, 0.5]})
    planner.replan(104.0, (0.0, 0.0), 0.0, 0.0)
    assert planner.zones[0].center(104.0) == pytest.approx([10.0, 6.0])
    assert planner.notes[-1] == "p: its motion has no time, and is taken to hold at the start, 100.000 s"
    planner.update_motion("p", {"time": 104.0, "position": [10.0, 4.0], "velocity": [0.0, 0.5]})
    planner.add_obstacle({"id": "q", "shape": {"disc": 0.3}, "motion": {"position": [12.0, 4.0]}})
    planner.replan(104.1, (0.0, 0.0), 0.0, 0.0)
    assert planner.zones[0].center(104.1) == pytest.approx([10.0, 4.05])
    assert len(planner.notes) == 1  # what stands needs no time


@pytest.mark.parametrize("clock", [0.0, 1.7e9])
def test_the_scenario_of_a_replan_has_obstacles_where_they_are(clock: float) -> None:
    moving = {"id": "m", "shape": {"disc": 0.4}, "motion": {"position": [9.0, 3.0], "velocity": [0.1, 0.3]}}
    planner = Planner(scene(moving, start={"time": clock}))
    begin(planner, planner.scenario)
    follow(planner, clock + 2.0)
    for zones in (planner.zones, sp.zones(planner.scenario)):
        assert zones[0].center(clock + 2.0) == pytest.approx([9.2, 3.6], abs=1e-6)


def test_a_speed_above_the_limit_is_taken_and_told_once() -> None:
    planner = Planner(scene())
    for k in range(5):
        plan = planner.replan(STEP * k, (0.3 * k, 0.0), 0.0, 3.0 * 1.003)
        assert plan.speed(STEP * k) == pytest.approx(3.009)
    (told,) = [doubt for doubt in planner.doubts if "above its limit" in doubt]
    assert told == "t = 0.000 s: the vehicle drives at 3.009 m/s, 0.3 % above its limit"
