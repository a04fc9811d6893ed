"""The published estimators: what is printed of them, least squares, and ours beside them.

Exact arithmetic, where floating point fails them.
"""

from __future__ import annotations

from fractions import Fraction
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

import scp_planner as sp
from scp_planner.studies.published_estimator import published_estimate, substitution, variance_factor

SECONDS = st.lists(st.integers(-40, 40), min_size=6, max_size=25, unique=True)


def observations(times: NDArray[np.float64], seed: int) -> NDArray[np.float64]:
    random = np.random.default_rng(seed)
    track = np.array([3.0, -2.0]) + np.outer(times, [0.7, 1.1]) + np.outer(times**2, [0.05, -0.02])
    seen: NDArray[np.float64] = track + random.multivariate_normal(
        np.zeros(2), [[0.04, 0.01], [0.01, 0.02]], len(times)
    )
    return seen


def exactly(values: NDArray[np.float64]) -> NDArray[Any]:
    """Numbers as fractions."""
    return np.vectorize(Fraction, otypes=[object])(values)


def test_the_coefficients_are_the_printed_ones() -> None:
    """At the printed times, 1 to T, here T = 5: c1 = 15, c2 = 55, c3 = 225 and c4 = 979."""
    sums = substitution(exactly(np.arange(1.0, 6.0)))
    assert (sums.count, sums.c1, sums.c2, sums.c3, sums.c4) == (5, 15, 55, 225, 979)
    assert sums.a == Fraction(15 * 55, 5) - 225 == -60
    assert sums.b == 55 - Fraction(15**2, 5) == 10
    assert sums.d == 979 - Fraction(55**2, 5) - Fraction(60**2, 10) == 14


@given(SECONDS, st.integers(0, 1000))
def test_the_estimates_solve_the_three_equations(tenths: list[int], seed: int) -> None:
    """Exactly; and what each step of the substitution leaves is the next equation with a, b and d in it."""
    times = exactly(np.array(tenths, dtype=float)) / 10
    seen = exactly(observations(np.array(tenths) / 10.0, seed))
    estimate, sums = published_estimate(times, seen), substitution(times)
    eta0, v, w = estimate.position, estimate.velocity, estimate.half_acceleration
    s0, s1, s2 = ((times[:, None] ** power * seen).sum(axis=0) for power in range(3))
    assert (sums.count * eta0 + sums.c1 * v + sums.c2 * w == s0).all()
    assert (sums.c1 * eta0 + sums.c2 * v + sums.c3 * w == s1).all()
    assert (sums.c2 * eta0 + sums.c3 * v + sums.c4 * w == s2).all()
    assert (sums.b * v - sums.a * w == s1 - sums.c1 * s0 / sums.count).all()
    third = s2 - sums.c2 * s0 / sums.count
    assert (-sums.a * v + (sums.d + sums.a**2 / sums.b) * w == third).all()
    assert (sums.d * w == third + sums.a / sums.b * (s1 - sums.c1 * s0 / sums.count)).all()


@given(SECONDS, st.integers(0, 1000))
def test_the_estimates_are_least_squares(tenths: list[int], seed: int) -> None:
    """By the singular values of the design, which know nothing of power sums."""
    times = np.array(tenths) / 10.0
    seen = observations(times, seed)
    exact = published_estimate(exactly(times), exactly(seen))
    design = np.vander(times, 3, increasing=True)
    found, squares, rank, _ = np.linalg.lstsq(design, seen)
    assert rank == 3
    published = np.stack([exact.position, exact.velocity, exact.half_acceleration]).astype(float)
    size = np.abs(seen).max()
    for power, (ours, theirs) in enumerate(zip(published, found, strict=True)):
        assert ours == pytest.approx(theirs, rel=1e-9, abs=1e-9 * size / np.abs(times).max() ** power)
    noise = np.diagonal(exact.noise_covariance).astype(float)
    assert noise * (len(times) - 3) == pytest.approx(squares, rel=1e-9)
    for t in (-5.0, 0.0, 8.0):
        row = np.linalg.pinv(design).T @ np.array([1.0, t, t * t])
        assert float(variance_factor(exactly(times), Fraction(t))) == pytest.approx(row @ row, rel=1e-9)


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
    """On a clock of 1e6 s power sums in floating point are worthless; in exact arithmetic they are the oracle.

    Worthless however they are rounded: a unit in the last place of c4 is much more than the whole of d.
    """
    times = 1e6 + np.linspace(-2.0, 0.0, 21)
    seen = observations(times - 1e6, seed=5)
    exact = published_estimate(exactly(times), exactly(seen))
    ours, sums = sp.estimate_motion(times, seen), substitution(exactly(times))
    t = 1e6 + 3.0
    true_center = exact.center(Fraction(t)).astype(float)
    true_covariance = exact.covariance(Fraction(t)).astype(float)
    assert ours.position(t) == pytest.approx(true_center, abs=1e-8)
    assert ours.covariance(t) == pytest.approx(true_covariance, rel=1e-7)
    assert 0.0 < float(sums.d) < 1e-8 * np.spacing(float(sums.c4))


def test_the_variance_falls_like_one_over_n() -> None:
    """With n observations in a fixed window; so errors of zones fall like n^-1/2."""
    factors = [variance_factor(np.linspace(-10.0, 0.0, n), 6.0) * n for n in (100, 1000, 10_000)]
    assert factors == pytest.approx([factors[-1]] * 3, rel=0.05)
