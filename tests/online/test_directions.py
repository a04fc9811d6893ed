"""In which directions a vehicle sets out, and that one that drives both ways backs out of a passage."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scenes import scene

import scp_planner as sp
from scp_planner.certificate.ends import EndState, can_reverse, start_violations
from scp_planner.online.arguments import can_turn, direction
from scp_planner.online.planner import Planner
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
