"""Limits of a vehicle as they are planned with."""

from __future__ import annotations

import math

import pytest

from scp_planner.scenario.limits import Limits


@pytest.mark.parametrize(("along", "across"), [((1.5, 2.0), 2.0), ((3.0, 1.0), math.inf), ((0.2, 0.3), 0.4)])
def test_accelerations_along_and_across_together_keep_a_total_one(along: tuple[float, float], across: float) -> None:
    limits = Limits(3.0, *along, across, 1.0)
    both = limits.both_within(1.9)
    most = math.hypot(max(both.acceleration, both.deceleration), both.lateral_acceleration)
    assert most <= 1.9 * (1.0 + 1e-12)
    assert both.acceleration * limits.deceleration == pytest.approx(limits.acceleration * both.deceleration)
    assert (both.speed, both.curvature) == (limits.speed, limits.curvature)
    # None is smaller than it has to be
    assert most == pytest.approx(1.9) or both == limits


def test_without_a_total_one_limits_stay() -> None:
    limits = Limits(3.0, 1.5, 2.0, math.inf, 1.0)
    assert limits.both_within(None) is limits
