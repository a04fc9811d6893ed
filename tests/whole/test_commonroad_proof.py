"""The bound that shows that no car solves ZAM_Merge-1_1: it is one, and it is tight enough."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchmarks import commonroad_proof as proof


def test_the_goal_is_missed_by_more_than_a_hand() -> None:
    assert proof.least_miss(2.3, 115) == pytest.approx(0.144, abs=1e-3)
    assert proof.least_miss(2.2, 110) > 0.5
    assert proof.least_miss(2.3, 115, ahead=-1.0) > 6.0


@pytest.mark.parametrize("seed", range(8))
def test_cars_that_are_driven_are_not_nearer(seed: int) -> None:
    """Single tracks with inputs at random, within the limits: the bound holds for where each of them ends."""
    rng, car, count = np.random.default_rng(seed), proof.CAR, 2000
    time, h = 1.5, 1.5 / count
    speed, heading, place = proof.SPEED, proof.HEADING, np.zeros(2)
    place -= car.rear_axle * np.array([np.cos(heading), np.sin(heading)])
    turn = rng.uniform(0.3, 1.2)  # rad/s
    part = rng.uniform(-0.5, 1.0)
    for _ in range(count):
        rate = 0.0 if heading > -0.15 else min(turn, 0.9 * car.acceleration / speed)
        most = np.sqrt(car.acceleration**2 - (speed * rate) ** 2)
        push = min(part * most, car.acceleration * car.switching_speed / speed)
        speed, heading = speed + push * h, heading + rate * h
        place += speed * h * np.array([np.cos(heading), np.sin(heading)])
    direction = np.array([np.cos(heading), np.sin(heading)])
    middle = place + car.rear_axle * direction
    # A goal round where it is: the bound must not miss it, with a hundredth of the square for the coarse steps.
    allowed = max(proof.GOAL.allowed, abs(heading))
    goal = replace(proof.GOAL, middle=tuple(middle.tolist()), length=0.05, width=0.05, allowed=allowed)
    assert proof.least_miss(time, 75, goal=goal) < 1e-6
