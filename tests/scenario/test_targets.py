"""Goals that move: how they are given, checked and scaled."""

from __future__ import annotations

import math
from typing import Any

import pytest

import scp_planner as sp
from scp_planner.scenario.units import NaturalUnits
from scp_planner.threat_zones.target import TargetMotion

VEHICLE = {"radius": 0.3, "max_speed": 3.0, "max_acceleration": 2.0, "max_deceleration": 2.0}
START = {"time": 5.0, "position": [1.0, 2.0], "speed": 0.0}
BOAT = {"id": "boat", "shape": {"disc": 0.5}, "motion": {"position": [20.0, 0.0], "velocity": [-1.0, 1.0]}}


def scenario(goal: dict[str, Any], **more: Any) -> sp.Scenario:
    return sp.Scenario(vehicle=VEHICLE, start=START, goal=goal, **{"obstacles": [BOAT], **more})


@pytest.mark.parametrize(
    "target",
    [
        "boat",
        {"obstacle": "boat"},
        {"motion": BOAT["motion"]},
        {"course": {"time": [5.0, 65.0], "position": [[20.0, 0.0], [-40.0, 60.0]]}},
        {
            "observations": {
                "time": [3.0, 3.5, 4.0, 4.5],
                "position": [[22.0, -2.0], [21.5, -1.5], [21.0, -1.0], [20.5, -0.5]],
                "covariance": [[0.01, 0.0], [0.0, 0.01]],
            },
            "model": {"order": 1},
        },
        {
            "estimate": {
                "time": 5.0,
                "position": [20.0, 0.0],
                "velocity": [-1.0, 1.0],
                "covariance": [[0.1 if i == j else 0.0 for j in range(4)] for i in range(4)],
            },
            "model": {"order": 1},
        },
    ],
)
def test_a_target_is_given_as_an_obstacle_is(target: Any) -> None:
    given = scenario({"target": target, "offset": [0.0, 3.0]})
    motion = TargetMotion.of(given)
    assert motion is not None
    assert motion.place(7.0) == pytest.approx((18.0, 5.0))
    assert motion.velocity(7.0) == pytest.approx((-1.0, 1.0))
    assert sp.Scenario(**given.to_dict()) == given
    # The place that is aimed at is reached at the vehicle's top speed when the target is there.
    x, y = given.goal.position
    assert (x - 20.0, y) == pytest.approx((-(5.0 - 5.0 + y), y))
    assert math.dist((x, y), START["position"]) == pytest.approx(VEHICLE["max_speed"] * y)  # type: ignore[arg-type]


def test_a_target_moves_alike_in_natural_units() -> None:
    given = scenario({"target": "boat", "offset": [0.0, 3.0]})
    units = NaturalUnits.of(given)
    inside, outside = TargetMotion.of(units.scenario(given)), TargetMotion.of(given)
    assert inside is not None
    assert outside is not None
    assert inside.place(units.instant(8.0)) == pytest.approx(units.place(outside.place(8.0)))


@pytest.mark.parametrize(
    ("goal", "more", "place", "said"),
    [
        ({"target": "ship"}, {}, "goal.target", "no obstacle of this id"),
        ({"target": {"motion": {"position": [1.0, 2.0]}}}, {}, "goal.position", "the start's"),
        ({"target": {}}, {}, "goal.target.motion", "missing"),
        ({"target": {"motion": BOAT["motion"], "obstacle": "boat"}}, {}, "goal.target.obstacle", "left out"),
        ({"target": "boat", "match_velocity": True, "speed": 1.0}, {}, "goal.speed", "match_velocity"),
        ({"target": "boat", "arrival_step": 0.5}, {}, "goal.arrival_step", "target"),
        ({"position": [9.0, 9.0], "offset": [1.0, 0.0]}, {}, "goal.offset", "no target"),
        ({"position": [9.0, 9.0], "match_velocity": True}, {}, "goal.match_velocity", "no target"),
        ({"target": "boat"}, {"guide": [[1.0, 2.0], [20.0, 0.0]]}, "guide", "target"),
        ({"target": "boat"}, {"speed_limits": [{"from": 0.0, "speed": 1.0}]}, "speed_limits[0].line", "target"),
    ],
)
def test_faults_are_named(goal: dict[str, Any], more: dict[str, Any], place: str, said: str) -> None:
    with pytest.raises(sp.ScenarioError) as caught:
        scenario(goal, **more)
    assert any(fault.path == place and said in str(fault) for fault in caught.value.faults), str(caught.value)
