"""Units in which parameters of motion models are near 1."""

from __future__ import annotations

import numpy as np
import pytest

from scp_planner.estimation.track_files import Track
from scp_planner.estimation.track_units import unit_of
from scp_planner.estimation.tracks import Tracks


def walked(length: float, time: float) -> Tracks:
    """Somebody who goes half a metre every 0.4 s, in other units."""
    count = np.arange(6.0)
    return Tracks([Track("one", 0.4 * time * count, 0.5 * length * np.stack([count, np.zeros(6)], axis=1))])


@pytest.mark.parametrize(
    ("name", "length_power", "time_power"),
    [("time_constant", 0, 1), ("noise_deviation", 1, 0), ("velocity_deviation", 1, -1), ("diffusion", 2, -3)],
)
def test_units_follow_the_dimension(name: str, length_power: int, time_power: int) -> None:
    assert unit_of(name, walked(1.0, 1.0)) == unit_of(name, walked(3.0, 0.4)) == 1.0
    long, slow = 2.0**-8, 2.0**16
    assert unit_of(name, walked(long, slow)) == long**length_power * slow**time_power


def test_tracks_without_a_step_have_the_usual_units() -> None:
    assert unit_of("diffusion", Tracks([Track("one", np.array([1.0]), np.array([[2.0, 3.0]]))])) == 1.0
