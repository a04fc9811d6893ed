"""Tests of windows of innovations against numbers that are as they are taken for."""

from __future__ import annotations

import numpy as np

from scp_planner.online.innovations import WILD, WINDOWS, cut, windows_of


def test_windows_are_as_rare_as_they_say() -> None:
    rng = np.random.default_rng(6)
    x, y, squares = cut(rng.standard_normal((2, WINDOWS[-1], 20_000)))
    share = (windows_of(x, y, squares, 0.02) > 1.0).mean(axis=1)
    # trend and size of a window: either may be rare; cut innovations make trends a little rarer
    assert np.all(share > 0.5 * 0.02) and np.all(share < 2.0 * 0.02 + 0.005)


def test_innovations_are_cut_along_their_direction() -> None:
    innovations = np.array([[0.3, 30.0, 0.0], [0.4, -40.0, 0.0]])
    x, y, squares = cut(innovations)
    assert np.allclose(x, [0.3, 0.6 * WILD, 0.0]) and np.allclose(y, [0.4, -0.8 * WILD, 0.0])
    assert np.allclose(squares, x * x + y * y)


def test_windows_say_the_same_with_half_of_the_digits() -> None:
    seen = cut(2.0 * np.random.default_rng(7).standard_normal((2, 5, WINDOWS[-1], 40)))
    whole, half = windows_of(*seen), windows_of(*seen.astype(np.float32))
    assert half.dtype == np.float32
    assert np.abs(half - whole).max() < 1e-5 * whole.max()
