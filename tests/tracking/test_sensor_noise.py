"""Tests of the noise of a sensor against numbers drawn from what it is said to be."""

from __future__ import annotations

import math

import numpy as np
import pytest

from scp_planner.arrays import Array
from scp_planner.tracking.noticing import NoiseWatch, is_misfit, neighbour_differences

STEP = 0.1


def test_third_differences_see_noise_and_not_motion() -> None:
    rng = np.random.default_rng(3)
    times = np.cumsum(rng.uniform(0.05, 0.2, 4000))
    motion = np.stack([1.0 + times - 0.2 * times**2, 3.0 * times], axis=1)
    sigma = np.array([[0.02, 0.01], [0.01, 0.03]])
    whiten = np.linalg.inv(np.linalg.cholesky(sigma))
    assert neighbour_differences(times[:50], motion[:50], whiten).max() < 1e-18
    squares = neighbour_differences(times, motion + rng.multivariate_normal(np.zeros(2), sigma, 4000), whiten)
    # chi-square with 2 degrees of freedom, of which neighbours depend on each other
    assert squares.mean() == pytest.approx(2.0, rel=0.1)
    assert np.median(squares) == pytest.approx(2.0 * math.log(2.0), rel=0.1)


@pytest.mark.parametrize(("factor", "low", "high"), [(1.0, 1.0, 1.0), (3.0, 7.0, 11.0)])
def test_noise_is_seen_to_be_larger(factor: float, low: float, high: float) -> None:
    rng = np.random.default_rng(4)
    watch = NoiseWatch()
    for _ in range(100):
        places: Array = factor * rng.normal(0, 0.1, (4, 2))
        watch.take_in(neighbour_differences(STEP * np.arange(4.0), places, 10.0 * np.eye(2)))
    assert low <= watch.factor <= high


def test_outliers_are_no_noise() -> None:
    rng = np.random.default_rng(5)
    watch, places = NoiseWatch(), rng.normal(0.0, 0.1, (400, 2))
    places[rng.random(400) < 0.02] += 5.0
    watch.take_in(neighbour_differences(STEP * np.arange(400.0), places, 10.0 * np.eye(2)))
    assert watch.factor == 1.0


def residual_noise(times: Array, positions: Array, order: int) -> Array:
    design = np.vander(times, order + 1)
    left = positions - design @ np.linalg.lstsq(design, positions, rcond=None)[0]
    found: Array = left.T @ left / (len(times) - order - 1)
    return found


@pytest.mark.parametrize("count", [12, 20, 64])
@pytest.mark.parametrize("order", [0, 1, 2])
def test_residuals_of_white_noise_are_hardly_ever_a_misfit(count: int, order: int) -> None:
    rng, times = np.random.default_rng(6), STEP * np.arange(float(count))
    found = 0
    for _ in range(500):
        places = np.outer(times**order, [1.0, -0.5]) + rng.multivariate_normal(
            np.zeros(2), [[2.0, 1.0], [1.0, 3.0]], count
        )
        found += is_misfit(times.tolist(), places.tolist(), residual_noise(times, places, order))
    assert found <= 8


@pytest.mark.parametrize("noise", [0.0, 0.01, 0.03])
def test_residuals_of_another_motion_are_a_misfit(noise: float) -> None:
    rng, times = np.random.default_rng(7), STEP * np.arange(60.0)
    turning = 2.0 * np.stack([np.cos(times), np.sin(times)], axis=1) + noise * rng.normal(size=(60, 2))
    assert is_misfit(times.tolist(), turning.tolist(), residual_noise(times, turning, 1))
    straight = np.outer(times, [1.0, 0.3]) + noise * rng.normal(size=(60, 2))
    assert not is_misfit(times.tolist(), straight.tolist(), residual_noise(times, straight, 1) + 1e-30 * np.eye(2))
