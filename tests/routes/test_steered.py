"""Switching poses of legs: derivatives against differences, and legs that are spared."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scenes import disc, scene

from scp_planner.mathematics.frames import PlanningFrame
from scp_planner.routes.manoeuvres import Manoeuvre
from scp_planner.routes.steered import STEERING, Drive, Steering
from scp_planner.threat_zones.batch import ZoneBatch
from scp_planner.threat_zones.of_scenario import ZonesOf


def steering_to(goal: tuple[float, float], heading: float, walker: bool = False) -> Steering:
    walks = disc("walker", (4.0, 3.0), (-0.2, -0.9), radius=0.3)
    limits = {"max_speed": 1.0, "max_acceleration": 1.0, "max_deceleration": 1.5, "max_curvature": 0.5}
    scenario = scene(
        *([walks] if walker else []),
        vehicle={**limits, "discs": [0.0, 1.0], "reverse": {"max_speed": 0.6, "max_acceleration": 0.5}},
        start={"speed": 0.0},
        goal={"position": goal, "heading": heading, "speed": 0.0},
    )
    zones = ZoneBatch.of(ZonesOf(scenario), PlanningFrame((0.0, 0.0), 0.0, 0.0), 0.5)
    return Steering(scenario, zones, 0.5, 0.5)


def manoeuvre(*legs: tuple[float, float]) -> Manoeuvre:
    """Legs of curvatures, 1/m, and lengths, m."""
    bends, lengths = np.array(legs).T
    return Manoeuvre(np.zeros(3), bends, lengths, 0.0)


@pytest.mark.parametrize("variable", ["bend", "length", "slower", "wait"])
def test_clearances_times_and_poses_have_the_derivatives_of_differences(variable: str) -> None:
    steering = steering_to((3.0, 1.0), 0.0, walker=True)
    drive = steering.along(manoeuvre((0.3, 4.0), (-0.2, -2.0), (0.1, 3.0)))
    x = drive.x.copy()
    x[-6:] = 0.7, 0.4, 0.2, 0.3, 0.5, 0.1
    drive, legs = replace(drive, x=x), len(drive.signs)
    place = {"bend": 30, "length": -3 * legs + 1, "slower": -2 * legs + 1, "wait": -legs + 1}[variable]
    step, sides = 1e-6, list[Drive]()
    for sign in (-1.0, 1.0):
        moved = x.copy()
        moved[place] += sign * step
        sides.append(replace(drive, x=moved))
    low, high = sides
    assert (high.poses - low.poses) / (2 * step) == pytest.approx(drive.jacobian[..., place], abs=1e-6)
    if variable != "bend":  # a bend costs no time here, where nothing limits lateral accelerations
        assert (high.time - low.time) / (2 * step) == pytest.approx(drive.time_gradient[place], abs=1e-3)
    rows, rooms = drive.clear_rows()
    assert len(rooms) == len(high.clear_rows()[1]) == len(low.clear_rows()[1]) > 10
    differences = (high.clear_rows()[1] - low.clear_rows()[1]) / (2 * step)
    assert differences == pytest.approx(rows[:, place], abs=2e-3)


def test_a_leg_that_is_not_needed_is_left_out() -> None:
    steering = steering_to((6.0, 0.5), 0.0)
    with_all, drive = steering.among_standing(manoeuvre((0.05, 3.2), (0.0, -0.2), (-0.05, 3.2)))
    (alone,) = steering.among_standing(manoeuvre((0.02, 3.0), (-0.02, 3.0)))
    assert with_all.signs == (1.0, -1.0, 1.0) and drive.signs == (1.0,)
    assert drive.missed <= STEERING.missed
    assert drive.time == pytest.approx(alone.time, rel=1e-3)


def test_a_leg_that_is_needed_stays() -> None:
    # beside the start, with the same heading: no way ahead alone is shorter than two turns
    steering = steering_to((0.0, 0.8), 0.0)
    (drive,) = steering.among_standing(manoeuvre((0.3, 2.0), (-0.3, -2.0)))
    assert drive.signs == (1.0, -1.0) and drive.missed <= STEERING.missed


def test_a_leg_is_driven_slower_or_waited_before_to_let_somebody_pass() -> None:
    steering = steering_to((6.0, 0.0), 0.0, walker=True)
    (among_standing,) = steering.among_standing(manoeuvre((0.0, 6.0)))
    steered = steering.improved(among_standing)
    assert steered.good and replace(among_standing, zones=steering.zones).deep > 0.1
    assert among_standing.time < steered.time < among_standing.time + 3.0
