"""States between which CommonRoad's official checker finds inputs; verdicts as its release 2025.4.0 gave them."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from scp_planner.formats.commonroad.cars import CARS, VehicleModel
from scp_planner.formats.commonroad.checker import STEERING, found, joined

KS, BMW = VehicleModel.KS, CARS["BMW_320i"]

Array = np.ndarray


def driven(before: Array, inputs: Array, step: float) -> Array:
    """A step of the kinematic single track, within its limits."""

    def rate(_: float, x: Array) -> list[float]:
        turn = x[3] * np.tan(x[2]) / BMW.wheelbase
        return [x[3] * np.cos(x[4]), x[3] * np.sin(x[4]), inputs[0], inputs[1], turn]

    return np.asarray(solve_ivp(rate, (0.0, step), before, rtol=1e-10, atol=1e-10).y[:, -1])


@pytest.mark.parametrize(
    ("speed", "steering", "acceleration", "step", "verdict"),
    [
        (13.05, 0.0, 4.983, 0.25, False),  # beyond 5.9 m/s^2, at which it is cut off, all are the same
        (13.05, 1e-4, 4.983, 0.25, True),
        (16.31, 0.0, 4.32, 0.25, False),
        (16.31, 1e-4, 4.32, 0.25, False),
        (13.05, 0.0, 4.983, 0.1, True),
        (9.5, 0.0, -11.3, 0.25, True),
    ],
)
def test_what_the_checker_finds(speed: float, steering: float, acceleration: float, step: float, verdict: bool) -> None:
    before = np.array([0.0, 0.0, steering, speed, 0.4])
    assert found(before, driven(before, np.array([0.0, acceleration]), step), step, KS, BMW) == verdict


def test_a_steering_angle_next_to_nothing_leads_it_there() -> None:
    states = [np.array([0.0, 0.0, 0.0, 12.0, 0.4])]
    for acceleration in (5.0, 4.983, 4.9):
        states.append(driven(states[-1], np.array([0.0, acceleration]), 0.25))
    table = np.array(states)
    assert not all(found(*pair, 0.25, KS, BMW) for pair in pairwise(table))
    shown = joined(table, 0.25, KS, BMW)
    assert shown is not None and all(found(*pair, 0.25, KS, BMW) for pair in pairwise(shown))
    others = [k for k in range(5) if k != STEERING]
    assert np.array_equal(shown[:, others], table[:, others])
    assert 0.0 < np.abs(shown - table).max() <= 1e-4


def test_inputs_that_change_much_in_a_step_are_not_found() -> None:
    """From full braking to full acceleration, in the middle of a step and at its end."""
    first = np.array([0.0, 0.0, 0.01, 5.0, 0.4])
    braking, pushing = np.array([0.0, -11.0]), np.array([0.0, 11.0])
    half = driven(driven(first, braking, 0.05), pushing, 0.05)
    ends = np.array([first, half, driven(half, pushing, 0.1)])
    assert joined(ends, 0.1, KS, BMW) is None
    assert joined(np.array([first, driven(first, braking, 0.1)]), 0.1, KS, BMW) is not None


def test_a_search_that_ends_at_once_is_seen_wherever_it_does() -> None:
    """A step of a car that pulls out gently, far from all limits, as the checker refused it in a solution."""
    before = np.array([5.274694424206719, 19.774999895983747, 0.032655137521377116, 2.7192096674875543, 0.0])
    after = np.array([5.578674001415093, 19.75698492614418, 0.038755684414629524, 3.3709031951505484, 0.0])
    before[4], after[4] = -0.061243273547674455, -0.057025545222057564
    assert not found(before, after, 0.1, KS, BMW)
    shown = joined(np.array([before, after]), 0.1, KS, BMW)
    assert shown is not None and 0.0 < np.abs(shown - [before, after]).max() <= 1e-4


def test_point_masses_join_what_constant_accelerations_do() -> None:
    first = np.array([3.0, -2.0, 0.0, 8.0, 0.3])
    velocity = 8.0 * np.array([np.cos(0.3), np.sin(0.3)])
    for push, verdict in (([2.0, -3.0], True), ([9.0, 8.0], False)):  # the circle is of 11.5 m/s^2
        later = velocity + 0.1 * np.array(push)
        place = first[:2] + 0.05 * (velocity + later)
        last = np.array([*place, 0.0, np.hypot(*later), np.arctan2(later[1], later[0])])
        assert found(first, last, 0.1, VehicleModel.PM, BMW) == verdict
    last[0] += 0.05
    assert joined(np.array([first, last]), 0.1, VehicleModel.PM, BMW) is None
