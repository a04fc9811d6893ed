"""Sizes of zones by the level that is asked for."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy import stats

import scp_planner as sp
from scp_planner.estimation.confidence import uniform_scale
from scp_planner.estimation.error_laws import NormalErrors
from scp_planner.online import many_zones
from scp_planner.online.many_zones import Level

pytestmark = pytest.mark.numerics


def test_what_holds_at_one_time_asks_for_no_lengths() -> None:
    def unasked() -> np.ndarray:
        raise AssertionError("lengths do not matter")

    level = Level(sp.Confidence(probability=0.9, level="per_time"), 4)
    assert level.scales(3, unasked) == pytest.approx(3 * [stats.chi2(2).ppf(0.9)])


def test_what_holds_at_all_times_is_larger_the_longer_the_way() -> None:
    lengths = np.array([0.5, 2.0, 8.0])
    level = Level(sp.Confidence(probability=0.9, level="joint"), 4)
    found = level.scales(3, lambda: lengths, 3)
    alpha = 1.0 - 0.9**0.25
    assert found == pytest.approx([uniform_scale(alpha, float(one), NormalErrors(), 3) for one in lengths])
    assert np.all(np.diff(found) > 0.0) and found[0] > stats.chi2(2).ppf(1.0 - alpha)


def test_who_has_been_seen_for_as_long_is_solved_for_once(monkeypatch: pytest.MonkeyPatch) -> None:
    solved: list[float] = []

    def counted(alpha: float, length: float, *others: Any) -> float:
        solved.append(length)
        return uniform_scale(alpha, length, *others)

    monkeypatch.setattr(many_zones, "uniform_scale", counted)
    lengths = np.array([2.0, 0.5, 2.0, 2.0])
    found = Level(sp.Confidence(probability=0.9, level="per_obstacle"), 4).scales(4, lambda: lengths)
    assert sorted(solved) == [0.5, 2.0]
    # The probability to leave a region of scale q over a way of length l is exp(-q / 2) + l sqrt(q / 2 pi) exp(-q / 2)
    assert np.exp(-found / 2.0) * (1.0 + lengths * np.sqrt(found / (2.0 * np.pi))) == pytest.approx(0.1, rel=1e-9)
