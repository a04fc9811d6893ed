"""Units in which parameters of motion models are near 1."""

from __future__ import annotations

import numpy as np
import pytest

from scp_planner.estimation.track_files import Track
from scp_planner.estimation.track_units import unit_of, usual_parameters
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


def test_usual_parameters_are_of_the_speed_of_the_tracks_and_in_their_units() -> None:
    usual, other = usual_parameters(walked(1.0, 1.0)), usual_parameters(walked(8.0, 0.5))
    assert usual["velocity_deviation"] == pytest.approx(0.5 / 0.4 / np.sqrt(2.0))  # along one axis of two
    assert 0.4 < usual["time_constant"] < 5 * 0.4
    # A velocity that reverts keeps its variance where diffusion / 2 * time constant is that variance.
    assert usual["diffusion"] * usual["time_constant"] / 2.0 == pytest.approx(usual["velocity_deviation"] ** 2)
    powers = {"velocity_deviation": (1, -1), "time_constant": (0, 1), "diffusion": (2, -3), "noise_deviation": (1, 0)}
    assert set(usual) == set(powers)
    for name, (length, time) in powers.items():
        assert other[name] == pytest.approx(8.0**length * 0.5**time * usual[name]), name


def test_usual_parameters_of_what_stands_are_none() -> None:
    standing = Tracks([Track("one", np.arange(3.0), np.zeros((3, 2)))])
    assert usual_parameters(standing)["velocity_deviation"] == usual_parameters(standing)["diffusion"] == 0.0
