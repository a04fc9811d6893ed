"""States between which CommonRoad's official checker finds inputs; verdicts as its release 2025.4.0 gave them."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from scp_planner.planning.commonroad_referee import STEERING, findable, found, joined
from scp_planner.scenario.commonroad_models import CARS

BMW = CARS["BMW_320i"]

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
    assert found(before, driven(before, np.array([0.0, acceleration]), step), step, BMW) == verdict


def test_a_steering_angle_next_to_nothing_leads_it_there() -> None:
    states = [np.array([0.0, 0.0, 0.0, 12.0, 0.4])]
    for acceleration in (5.0, 4.983, 4.9):
        states.append(driven(states[-1], np.array([0.0, acceleration]), 0.25))
    table = np.array(states)
    assert not all(found(*pair, 0.25, BMW) for pair in pairwise(table))
    shown = findable(table, 0.25, BMW)
    assert all(found(*pair, 0.25, BMW) for pair in pairwise(shown))
    others = [k for k in range(5) if k != STEERING]
    assert np.array_equal(shown[:, others], table[:, others])
    assert 0.0 < np.abs(shown - table).max() <= 1e-4


def test_inputs_that_change_much_in_a_step_are_not_found() -> None:
    """From full braking to full acceleration, in the middle of a step and at its end."""
    first = np.array([0.0, 0.0, 0.01, 5.0, 0.4])
    braking, pushing = np.array([0.0, -11.0]), np.array([0.0, 11.0])
    half = driven(driven(first, braking, 0.05), pushing, 0.05)
    ends = np.array([first, half, driven(half, pushing, 0.1)])
    assert joined(ends, 0.1, BMW) is None
    assert joined(np.array([first, driven(first, braking, 0.1)]), 0.1, BMW) is not None
