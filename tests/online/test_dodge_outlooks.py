"""What is seen of dodges before they are certified."""

from __future__ import annotations

import numpy as np
import pytest

from scp_planner.online.dodge_outlooks import Driven, until_over


def test_end_of_a_dodge_is_looked_at_between_samples() -> None:
    """Somebody comes nearer by 1 m/s: when the dodges end, at 1.4 s and at 2 s, clearances are what is left then."""
    times = np.array([0.0, 1.0, 2.0, 3.0])
    driven = Driven(times, np.zeros((2, 4, 2)), np.zeros((2, 4)), np.array([1.4, 2.0]))
    found = until_over(np.tile(1.5 - times, (2, 1)), driven)
    assert found[0] == pytest.approx([1.5, 0.5, 0.1, np.inf]) and found[1] == pytest.approx([1.5, 0.5, -0.5, -0.5])
