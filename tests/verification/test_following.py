"""Who follows an answer from elsewhere than it begins: where it ends, by closed forms."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scenes import VEHICLE, scene

from scp_planner.arrays import Array
from verification.following import Allowed, Told, arrived, beginning, followed

SPEED, BRAKES = 2.0, 2.0
STANDS = SPEED / BRAKES
EXACT = Allowed(1e-6, 1e-3, 1e-3)


def stop(times: Array) -> Array:
    """Brake from 2 m/s at 2 m/s2, along +x."""
    time = np.clip(np.asarray(times), 0.0, STANDS)
    return np.stack([SPEED * time - 0.5 * BRAKES * time**2, 0.0 * time], axis=1)


TOLD = Told(0.0, np.zeros(2), 0.0, SPEED)


def test_an_answer_that_begins_as_told_begins_so() -> None:
    assert all(each.ok for each in beginning(TOLD, stop, STANDS, EXACT))


@pytest.mark.parametrize(
    ("name", "told"),
    [
        ("start_position", replace(TOLD, position=np.array([0.0, 0.01]))),
        ("start_speed", replace(TOLD, speed=2.1)),
        ("start_heading", replace(TOLD, heading=0.1)),
    ],
)
def test_each_part_that_does_not_is_found(name: str, told: Told) -> None:
    assert [each.name for each in beginning(told, stop, STANDS, EXACT) if not each.ok] == [name]


@pytest.mark.parametrize("factor", [1.0, 1.2, 2.0])
def test_who_is_faster_brakes_fully_and_stands_later(factor: float) -> None:
    times, places = followed(VEHICLE, replace(TOLD, speed=factor * SPEED), stop, STANDS)
    assert places[-1, 0] == pytest.approx((factor * SPEED) ** 2 / (2.0 * BRAKES), abs=0.02)
    assert times[-1] == pytest.approx(factor * STANDS, abs=0.06)


def test_who_is_slower_lags_and_who_is_beside_stays_there() -> None:
    def even(times: Array) -> Array:
        return np.stack([SPEED * np.asarray(times), 0.0 * np.asarray(times)], axis=1)

    _, places = followed(VEHICLE, Told(0.0, np.array([0.0, 0.3]), 0.0, 0.5), even, 4.0)
    assert places[-1] == pytest.approx([8.0 - 1.5**2 / (2.0 * 1.5), 0.3], abs=0.02)


@pytest.mark.parametrize(
    ("goal", "told", "speed", "wrong"),
    [
        ({"radius": 0.5, "speed": 0.0, "heading": 0.0}, {"position": [19.6, 0.0]}, 0.0, []),
        ({"radius": 0.5}, {"position": [19.4, 0.0]}, 0.0, ["goal_position"]),
        ({"speed": 0.0}, {"speed": 1.0}, 0.0, ["goal_speed"]),
        ({"heading": 1.0}, {}, 0.0, ["goal_heading"]),
        ({"heading": 1.0}, {"heading": None}, 0.0, []),
        ({"region": [[19.0, 1.0], [21.0, 1.0], [20.0, 2.0]]}, {}, 0.0, ["goal_region"]),
        ({"speed_range": [1.0, 2.0]}, {}, 0.0, ["goal_speed_range"]),
        ({}, {"speed": 1.0}, 1.0, ["stands"]),
    ],
)
def test_who_has_arrived_is_where_the_goal_asks(
    goal: dict[str, Any], told: dict[str, Any], speed: float, wrong: list[str]
) -> None:
    data = scene().to_dict()
    data["goal"].update(goal)
    here = {"position": [20.0, 0.0], "heading": 0.0, "speed": 0.0, **told}
    state = Told(5.0, np.array(here["position"]), here["heading"], here["speed"])
    assert [each.name for each in arrived(data, state, EXACT, speed) if not each.ok] == wrong
