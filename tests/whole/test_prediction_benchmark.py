"""Measure of predicted regions: families, areas, shares, recordings."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.prediction import families
from benchmarks.prediction.measure import ANGLES, DIRECTIONS, LEADS, Errors, _area, predict_family, summarise
from benchmarks.prediction.motion import Family, Motion


@pytest.mark.parametrize("name", families.NAMES)
def test_families_are_reproducible_and_physical(name: str) -> None:
    first, again = families.make(name, 2, 3), families.make(name, 2, 3)
    for one, two in zip(first.scenes, again.scenes, strict=True):
        for a, b in zip(one, two, strict=True):
            assert np.array_equal(a.positions, b.positions)
            assert np.hypot(*np.diff(a.positions, axis=0).T).max() < 0.02 * 16.0  # m in 20 ms
            assert a.times[-1] == pytest.approx(60.0, abs=0.03)


def test_areas_are_those_of_ellipses() -> None:
    """Sides at the support of an ellipse: a polygon about it, within 1 % at 32 sides."""
    support = np.hypot(2.0 * DIRECTIONS[:, 0], 0.5 * DIRECTIONS[:, 1])
    assert _area(support) == pytest.approx(np.pi, rel=0.05)
    assert _area(np.ones(len(ANGLES))) == pytest.approx(np.pi, rel=0.01)


def test_shares_and_best_radii_are_those_of_the_errors() -> None:
    """Errors that are |N(0, 1)| in both directions, the same at all leads: the best constant radius is 2.45."""
    rng = np.random.default_rng(0)
    error = np.linalg.norm(rng.standard_normal((20000, 2)), axis=1)[:, None] * np.ones(len(LEADS))
    radius = np.full(error.shape, 3.0)
    errors = Errors(error, radius, error <= radius, np.full(20000, np.nan), np.zeros(20000))
    found = summarise(errors, 0.04, "per_obstacle")
    assert found.best == pytest.approx(np.full(3, 2.448), rel=0.02)
    assert found.tube == pytest.approx(1.0 - np.exp(-4.5), abs=0.003)
    assert found.ratio == pytest.approx(3.1 / 2.548, rel=0.02)


def test_a_steady_motion_is_held() -> None:
    times = np.linspace(0.0, 12.0, 601)
    motion = Motion(times, np.stack([times, 0.5 * times], axis=1), np.array([8.0]), "pedestrian")
    found = predict_family(Family("steady", [[motion]]), "per_obstacle")
    assert set(found.after[~np.isnan(found.after)]) == {0.2, 0.5, 1.0}
    one = np.isfinite(found.error)
    assert found.held[one].mean() > 0.99
    assert found.error[one].max() < 2.0
