"""Interval arithmetic encloses what numbers give."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from reference_trips import (
    Array,
)

from scp_planner.mathematics.intervals import Interval

pytestmark = pytest.mark.numerics


@st.composite
def intervals(draw: st.DrawFn) -> tuple[Interval, Array]:
    """Intervals and points in them, both ends among them."""
    number = st.floats(-1e3, 1e3, allow_nan=False, width=32)
    ends = np.sort(np.array(draw(st.lists(st.tuples(number, number), min_size=3, max_size=3))), axis=1)
    share = np.array([0.0, 1.0, *draw(st.lists(st.floats(0.0, 1.0), min_size=3, max_size=3))])
    inside = ends[:, :1] + share * (ends[:, 1:] - ends[:, :1])
    return Interval(ends[:, 0], ends[:, 1]), np.clip(inside, ends[:, :1], ends[:, 1:])


def encloses(interval: Interval, values: Array) -> bool:
    room = 1e-12 * (1.0 + np.abs(values))
    return bool(np.all(values >= interval.lower[:, None] - room) and np.all(values <= interval.upper[:, None] + room))


@given(intervals(), intervals(), st.floats(-100.0, 100.0))
def test_interval_arithmetic_encloses(
    first: tuple[Interval, Array], second: tuple[Interval, Array], factor: float
) -> None:
    (a, x), (b, y) = first, second
    for k in range(x.shape[1]):
        other = np.roll(y, k, axis=1)
        assert encloses(a + b, x + other)
        assert encloses(a - b, x - other)
        assert encloses(a * b, x * other)
    assert encloses(-a, -x)
    assert encloses(a.scaled(factor), factor * x)
    assert encloses(a.squared(), x * x)
    assert np.all(a.squared().lower >= 0.0)
    assert encloses(Interval(np.zeros(3), a.magnitude()), np.abs(x))
    around = Interval.around(0.5 * (a.lower + a.upper), 0.5 * (a.upper - a.lower))
    assert encloses(around, x)
    positive, z = Interval(np.abs(a.lower) + 0.1, np.abs(a.lower) + 0.1 + (a.upper - a.lower)), x - a.lower[:, None]
    for exponent in (-1.0, -3.0, -5.0):
        assert encloses(positive.power(exponent), (positive.lower[:, None] + z) ** exponent)
