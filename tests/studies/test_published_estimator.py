"""The published estimators beside ours: the same numbers, in exact arithmetic where floating point fails them."""

from __future__ import annotations

from fractions import Fraction
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

import scp_planner as sp
from scp_planner.studies.published_estimator import published_estimate, variance_factor

SECONDS = st.lists(st.integers(-40, 40), min_size=6, max_size=25, unique=True)


def observations(times: NDArray[np.float64], seed: int) -> NDArray[np.float64]:
    random = np.random.default_rng(seed)
    track = np.array([3.0, -2.0]) + np.outer(times, [0.7, 1.1]) + np.outer(times**2, [0.05, -0.02])
    seen: NDArray[np.float64] = track + random.multivariate_normal(
        np.zeros(2), [[0.04, 0.01], [0.01, 0.02]], len(times)
    )
    return seen


def exactly(values: NDArray[np.float64]) -> NDArray[Any]:
    """The same numbers as fractions."""
    return np.vectorize(Fraction, otypes=[object])(values)


@given(SECONDS, st.integers(0, 1000))
def test_our_estimates_are_the_published_ones(tenths: list[int], seed: int) -> None:
    times = np.array(sorted(tenths)) / 10.0
    seen = observations(times, seed)
    ours, published = sp.estimate_motion(times, seen), published_estimate(times, seen)
    last = times[-1]
    assert ours.position(0.0) == pytest.approx(published.position, abs=1e-6)
    assert ours.velocity == pytest.approx(published.velocity + 2.0 * last * published.half_acceleration, abs=1e-6)
    assert ours.acceleration == pytest.approx(2.0 * published.half_acceleration, abs=1e-6)
    assert ours.noise_covariance == pytest.approx(published.noise_covariance, abs=1e-8)
    for t in (-5.0, 0.0, 1.0, 8.0):
        assert ours.position(t) == pytest.approx(published.center(t), abs=1e-6)
        assert ours.covariance(t) == pytest.approx(published.covariance(t), rel=1e-5, abs=1e-8)


def test_our_estimates_keep_their_digits_on_any_clock() -> None:
    """On a clock of 1e6 s power sums in floating point are worthless; in exact arithmetic they are the oracle."""
    times = 1e6 + np.linspace(-2.0, 0.0, 21)
    seen = observations(times - 1e6, seed=5)
    exact = published_estimate(exactly(times), exactly(seen))
    ours, rounded = sp.estimate_motion(times, seen), published_estimate(times, seen)
    t = 1e6 + 3.0
    true_center = exact.center(Fraction(t)).astype(float)
    true_covariance = exact.covariance(Fraction(t)).astype(float)
    assert ours.position(t) == pytest.approx(true_center, abs=1e-8)
    assert ours.covariance(t) == pytest.approx(true_covariance, rel=1e-7)
    assert np.abs(rounded.center(t) - true_center).max() > 1.0


def test_the_variance_factor_is_the_inverse_of_the_normal_matrix() -> None:
    times = [Fraction(k, 7) for k in (0, 1, 2, 4, 7, 11)]
    rows = np.array([[Fraction(1), t, t * t] for t in times])
    for t in (Fraction(-1), Fraction(0), Fraction(5, 2)):
        x = np.array([Fraction(1), t, t * t])
        # h = x' z with X'X z = x, checked without inverting: X'X z = x holds for the z that solves it
        normal = rows.T @ rows
        z = _solve(normal, x)
        assert normal @ z == pytest.approx(x)
        assert variance_factor(np.array(times), t) == x @ z


def _solve(matrix: NDArray[Any], right: NDArray[Any]) -> NDArray[Any]:
    """Gauss elimination, exact for fractions."""
    size = len(right)
    a = np.concatenate([matrix, right[:, None]], axis=1)
    for k in range(size):
        a[k] = a[k] / a[k, k]
        for other in range(size):
            if other != k:
                a[other] = a[other] - a[other, k] * a[k]
    return a[:, -1]


def test_the_variance_falls_like_one_over_n() -> None:
    """With n observations in a fixed window; so errors of zones fall like n^-1/2."""
    factors = [variance_factor(np.linspace(-10.0, 0.0, n), 6.0) * n for n in (100, 1000, 10_000)]
    assert factors == pytest.approx([factors[-1]] * 3, rel=0.05)


def test_residuals_give_the_noise() -> None:
    times = np.linspace(-10.0, 0.0, 20_000)
    published = published_estimate(times, observations(times, seed=11))
    assert published.noise_covariance == pytest.approx(np.array([[0.04, 0.01], [0.01, 0.02]]), abs=2e-3)
