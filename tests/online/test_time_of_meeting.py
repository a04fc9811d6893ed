"""Time of a meeting that one plan after the other is made for, against the first root of its own equation."""

from __future__ import annotations

from dataclasses import dataclass
from math import hypot, sqrt
from typing import Any, cast

import numpy as np
import pytest
from scipy.optimize import brentq

import scp_planner as sp
from scp_planner.arrays import Array
from scp_planner.mathematics.polynomials import PiecewisePolynomials
from scp_planner.online.moving_goal import MovingGoal
from scp_planner.threat_zones.target import TargetMotion

pytestmark = pytest.mark.numerics

TOP, RATE, NOW = 2.0, 1.0, 7.0
TARGET = {"motion": {"position": [10.0, 0.0], "velocity": [0.0, 0.0]}}
LIMITS = {"max_speed": TOP, "max_acceleration": RATE, "max_deceleration": RATE, "max_lateral_acceleration": 2.0}
SCENARIO = sp.Scenario(
    vehicle={"radius": 0.3, **LIMITS},
    start={"time": NOW, "position": [0.0, 0.0], "speed": 0.0},
    goal={"target": TARGET},
    obstacles=[],
)


@dataclass
class Late:
    """A plan that arrives at a place so much later, s, than straight on from standstill."""

    place: tuple[float, float]
    delay: float

    @property
    def arrival_time(self) -> float:
        return NOW + self.delay + straight(hypot(*self.place))

    def position(self, _: float) -> tuple[float, float]:
        return self.place


def straight(distance: float) -> float:
    rise = TOP / RATE
    return sqrt(2.0 * distance / RATE) if distance < 0.5 * TOP * rise else 0.5 * rise + distance / TOP


def accelerating(rng: np.random.Generator) -> PiecewisePolynomials:
    place, velocity = rng.normal(0.0, 12.0, 2), rng.normal(0.0, 0.4 * TOP, 2)
    return PiecewisePolynomials.single(NOW, np.array([place, velocity, rng.normal(0.0, 0.1, 2)]))


def turning(rng: np.random.Generator) -> PiecewisePolynomials:
    """A polygon's corners on a circle, each reached at the speed of the last side."""
    place, course, pace, turn = rng.normal(0.0, 12.0, 2), *rng.uniform([-3.0, 0.5, -0.6], [3.0, 1.8, 0.6])
    pieces = list[list[Array]]()
    for side in range(60):
        velocity = pace * np.array([np.cos(course + side * turn), np.sin(course + side * turn)])
        pieces.append([place, velocity])
        place = place + velocity
    return PiecewisePolynomials((NOW + np.arange(61.0))[None], np.array(pieces)[None])


def first_root(motion: TargetMotion, delay: float) -> float | None:
    """First time at which a vehicle that sets off after a delay can have driven as far as the target is away, s."""

    def late(time: float) -> float:
        return delay + straight(hypot(*motion.place(NOW + time))) - time

    times = np.linspace(0.0, 60.0, 2401)
    early = np.flatnonzero(np.array([late(time) for time in times]) <= 0.0)
    return None if not len(early) else float(brentq(late, times[early[0] - 1], times[early[0]]))


@pytest.mark.parametrize("kind", [accelerating, turning])
def test_time_settles_on_the_first_meeting_from_any_plan(kind: Any) -> None:
    """As the target accelerates, a line along its velocity would miss the meeting after a plan that arrives late."""
    rng, met = np.random.default_rng(5), 0
    for _ in range(60):
        motion, delay = TargetMotion(kind(rng)), rng.uniform(0.0, 4.0)
        wanted = first_root(motion, delay)
        if wanted is None:
            continue
        met += 1
        time, moving = NOW + wanted * rng.uniform(0.3, 5.0), MovingGoal(motion, SCENARIO.goal, 0.0, 0.1, 0.1)
        for _ in range(2):
            time = moving.meeting(SCENARIO, cast(Any, Late(motion.place(time), delay)))
        assert time - NOW == pytest.approx(wanted, rel=1e-4)
    assert met > 20


def test_target_that_gets_away_after_a_delay_is_met_as_early_as_can_be() -> None:
    motion = TargetMotion(PiecewisePolynomials.single(NOW, np.array([[3.0, 0.0], [0.0, 0.0], [0.02, 0.0]])))
    moving = MovingGoal(motion, SCENARIO.goal, 0.0, 0.1, 0.1)
    assert first_root(motion, 30.0) is None
    late = moving.meeting(SCENARIO, cast(Any, Late((3.0, 0.0), 30.0)))
    assert late - NOW == pytest.approx(first_root(motion, 0.0), rel=1e-5)
