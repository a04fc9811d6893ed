"""What speaks for dodges: nearness that fades, harm of the worst moment."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.integrate import quad

from scp_planner.online.dodge_worth import MOMENT_WIDTHS, a_moment, harm, nearness
from scp_planner.scenario.models import Vehicle


def test_nearness_is_an_integral_that_fades() -> None:
    """At a constant clearance of a width, against a quadrature of another kind; and what comes later counts less."""
    time = np.linspace(0.0, 12.0, 4001)
    expected, _ = quad(lambda t: math.exp(-1.0 / (0.25 + t / 20.0)) / (1.0 + 0.9 * t), 0.0, 5.0)
    assert nearness(time, np.ones((1, len(time))))[0] == pytest.approx(expected, rel=1e-2)
    soon, late = np.ones((2, len(time)))
    soon[(time > 0.5) & (time < 1.0)] = late[(time > 3.0) & (time < 3.5)] = 0.1
    near = nearness(time, np.stack([np.ones(len(time)), late, soon]))
    assert near[0] < near[1] < near[2]


def test_harm_is_that_of_the_worst_moment() -> None:
    time = np.array([0.0, 1.0, 2.0])
    found = harm(time, np.array([[0.5, 0.1, 0.0], [0.5, -0.3, -0.4], [0.5, 0.4, -0.4]]))
    assert found == pytest.approx([0.0, 50.0 * (0.3 + 1.0 / 6.0) / 1.9, 50.0 * (0.4 + 1.0 / 6.0) / 2.8])


@pytest.mark.parametrize("acceleration", [0.5, 1.0, 4.0])
def test_a_moment_is_as_long_as_most_of_its_width_takes_from_a_stand(acceleration: float) -> None:
    """Against steps of a drive that speeds up evenly to its top speed."""
    vehicle = Vehicle(radius=0.3, max_speed=1.0, max_acceleration=acceleration, max_deceleration=1.0)
    time = np.linspace(0.0, a_moment(vehicle), 20001)
    speed = np.minimum(acceleration * time, 1.0)
    assert np.trapezoid(speed, time) == pytest.approx(MOMENT_WIDTHS * 0.6, rel=1e-6)
