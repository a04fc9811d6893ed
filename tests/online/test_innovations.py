"""Tests of windows of innovations against numbers that are as they are taken for."""

from __future__ import annotations

import numpy as np

from scp_planner.online.innovations import WINDOWS, windows_of


def test_windows_are_as_rare_as_they_say() -> None:
    rng = np.random.default_rng(6)
    innovations = rng.standard_normal((20_000, WINDOWS[-1], 2))
    share = (windows_of(innovations, 0.02) > 1.0).mean(axis=0)
    # trend and size of a window: either may be rare; cut innovations make trends a little rarer
    assert np.all(share > 0.5 * 0.02) and np.all(share < 2.0 * 0.02 + 0.005)
