"""What a further trip has to be faster than."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scenes import scene

from scp_planner import plan
from scp_planner.certificate.verdict import off_a_step
from scp_planner.planning.attempts import to_beat


def step_of(travel_time: float, step: float) -> int:
    """The first step that is not missed by a trip, counted up to it."""
    number = 0
    while number * step + off_a_step(step) < travel_time:
        number += 1
    return number


def test_only_a_trip_for_an_earlier_step_beats_another() -> None:
    assert to_beat(3.2, None) == 3.2
    for step in (0.1, 0.25, 1.0):
        off = off_a_step(step)
        for travel_time in (*np.linspace(1.3, 4.7, 35).tolist(), 3.0, 3.0 + 0.5 * off, 3.0 + 2.0 * off):
            limit = to_beat(travel_time, step)
            here = step_of(travel_time, step)
            assert step_of(limit - 1e-9, step) < here
            assert step_of(limit + 1e-9, step) == here
            assert limit == pytest.approx((here - 1) * step + off)


def test_no_step_is_given_away() -> None:
    """The step is that of the fastest trip, which is looked for no further than it takes to know."""
    start = {"speed": 1.0}
    fastest = plan(scene(start=start)).travel_time
    for step in (0.3, 0.7):
        timed = plan(scene(start=start, goal={"arrival_step": step}))
        assert timed.certified
        assert timed.travel_time == pytest.approx(step * math.ceil(fastest / step), abs=off_a_step(step))
