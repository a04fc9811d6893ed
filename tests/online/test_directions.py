"""In which directions a vehicle sets out, and that one that drives both ways backs out of a passage."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scenes import scene

import scp_planner as sp
from scp_planner.certificate.ends import EndState, can_reverse, start_violations
from scp_planner.online.directions import can_turn, direction
from scp_planner.online.dodge_courses import Profiles
from scp_planner.online.dodge_outlooks import Driven
from scp_planner.online.dodges import Dodges
from scp_planner.online.evasion import Evasion
from scp_planner.online.planner import Planner
from scp_planner.online.remaining import State
from scp_planner.scenario.limits import Limits
from scp_planner.scenario.models import Steering
from scp_planner.settings.online import OnlineSettings

PERIOD = 0.4


def vehicle(steering: Steering) -> sp.Vehicle:
    return sp.Vehicle(radius=0.3, max_speed=1.0, max_acceleration=1.0, max_deceleration=1.0, steering=steering)


@pytest.mark.parametrize(
    ("steering", "standing", "driving"),
    [
        (Steering.AHEAD, 2.0, 2.0),
        (Steering.BOTH_WAYS, 2.0 - math.pi, 2.0),
        (Steering.ON_THE_SPOT, None, 2.0),
        (Steering.ANY, None, None),
    ],
)
def test_direction_of_a_vehicle_whose_goal_is_behind_it(
    steering: Steering, standing: float | None, driving: float | None
) -> None:
    robot, goal = vehicle(steering), (0.0, -5.0)
    assert direction(robot, (0.0, 0.0), 2.0, 0.0, goal) == (None if standing is None else pytest.approx(standing))
    assert direction(robot, (0.0, 0.0), 2.0, 0.5, goal) == driving
    assert direction(robot, (0.0, 0.0), 2.0, 0.0, (0.0, 5.0)) == (2.0 if standing is not None else None)
    assert direction(robot, (0.0, 0.0), None, 0.5, goal) is None
    assert can_reverse(robot, 0.0) == (steering is Steering.BOTH_WAYS) and not can_reverse(robot, 0.5)
    assert can_turn(robot, 0.0) == (standing is None) and can_turn(robot, 0.5) == (driving is None)


def test_dodges_backwards_are_those_forwards_turned_round() -> None:
    limits = Limits(1.5, 1.0, 1.5, 1.5, 2.0)
    profiles = Profiles.of(0.0, limits, 0.6, 0.5)
    both = Dodges.of(0.3, profiles, 0.0, limits, 0.3, 0.5, both_ways=True)
    ahead = Dodges.of(0.3, profiles, 0.0, limits, 0.3, 0.5)
    count = len(ahead.position)
    assert len(both.position) == 2 * count and np.all(both.position[:count] == ahead.position)
    assert both.position[count:] == pytest.approx(-ahead.position, abs=1e-12)


@pytest.mark.parametrize(
    ("steering", "speed", "turn", "refused"),
    [
        (Steering.BOTH_WAYS, 0.0, math.pi, False),
        (Steering.BOTH_WAYS, 0.0, 0.1, True),
        (Steering.BOTH_WAYS, 0.5, math.pi, True),
        (Steering.AHEAD, 0.0, math.pi, True),
    ],
)
def test_certificate_lets_only_who_stands_and_drives_both_ways_set_out_backwards(
    steering: Steering, speed: float, turn: float, refused: bool
) -> None:
    asked = scene(start={"speed": speed, "heading": 2.0}, vehicle={"steering": steering})
    begins = EndState(asked.start.time, asked.start.position, 2.0 + turn, speed, 0.0)
    assert bool(list(start_violations(asked, begins))) == refused


@pytest.mark.parametrize("steering", [Steering.AHEAD, Steering.BOTH_WAYS])
def test_only_who_drives_both_ways_backs_out_of_a_passage(steering: Steering) -> None:
    """A passage too narrow to turn in, and somebody who comes along it: nobody fits past."""
    walls = [
        {"id": f"wall{side}", "shape": {"rectangle": [20.0, 0.4], "heading": 0.0}, "motion": {"position": [0.0, side]}}
        for side in (-0.8, 0.8)
    ]
    walker = {"id": "walker", "shape": {"disc": 0.3}, "motion": {"position": [2.4, 0.0], "velocity": [-0.8, 0.0]}}
    scenario = scene(
        *walls,
        walker,
        start={"speed": 0.0, "heading": 0.0},
        goal={"position": (8.0, 0.0)},
        vehicle={"max_speed": 1.0, "max_curvature": 1.0, "steering": steering},
    )
    planner = Planner(scenario, online=OnlineSettings(period=PERIOD))
    plan, apart, safe = planner.replan(0.0, (0.0, 0.0), 0.0, 0.0), math.inf, True
    for k in range(1, 9):
        time = k * PERIOD
        place = plan.position(time)
        apart = min(apart, float(np.hypot(*(place - (2.4 - 0.8 * time, 0.0)))))
        plan = planner.replan(time, place, float(plan.heading(time)), max(float(plan.speed(time)), 0.0))
        safe &= plan.safe
    if steering is Steering.BOTH_WAYS:
        assert safe and apart >= 0.6 and place[0] < -1.0
    else:
        assert not safe and apart < 0.6


def test_way_left_is_that_of_the_tightest_bends_that_are_driven() -> None:
    scenario = scene(vehicle={"max_curvature": 0.875, "steering": Steering.BOTH_WAYS, "max_lateral_acceleration": None})
    planner = Planner(scenario)
    evasion = Evasion(planner._means)
    moment = planner._means.moment(State(0.0, (0.0, 0.0), 0.0, 0.0))
    dodges = evasion._dodges(moment)
    turned = np.abs(np.diff(dodges.heading, axis=1))
    driven = np.linalg.norm(np.diff(dodges.position, axis=1), axis=2)
    bends = (turned[driven > 1e-3] / driven[driven > 1e-3]).max()
    assert 1.0 / evasion.outlooks.tightest(moment) == pytest.approx(bends, rel=0.05) and bends > 0.0


def test_stop_of_a_vehicle_that_drives_both_ways_counts_as_one_that_it_backs_out_of() -> None:
    """Somebody walks at it: it is hit if it stands, not if it backs out. Other dodges are judged as before."""
    walker = {"id": "walker", "shape": {"disc": 0.3}, "motion": {"position": [3.0, 0.0], "velocity": [-0.9, 0.0]}}
    scenario = scene(
        walker,
        goal={"position": (8.0, 0.0)},
        vehicle={"max_speed": 1.0, "max_curvature": 1.0, "steering": Steering.BOTH_WAYS},
    )
    planner = Planner(scenario)
    evasion = Evasion(planner._means)
    moment = planner._means.moment(State(0.0, (0.0, 0.0), 0.0, 0.3))
    dodges = evasion._dodges(moment)
    room = dodges.room(moment.batch, evasion.outlooks.box(moment), moment.scenario.vehicle)
    driven = Driven(dodges.times, dodges.position, dodges.heading, dodges.until)
    before = evasion.outlooks.seen(moment, driven, room, room)
    after = evasion.outlooks.of(moment, dodges)
    at_once = np.arange(len(after.worth)) % len(dodges.families[0].profiles.stands) == 0
    assert np.all(after.worth[at_once] > before.worth[at_once])
    assert np.array_equal(after.worth[~at_once], before.worth[~at_once]) and np.array_equal(after.clear, before.clear)
