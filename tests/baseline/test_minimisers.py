"""Minimisers of penalty descent, on convex quadratic functions on a box."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import lsq_linear

from scp_planner.arrays import Array
from scp_planner.baseline.descent_run import DescentSettings, Variant
from scp_planner.baseline.minimisers import MINIMISERS


class LeastSquares:
    """|A y - b|^2 on a box; what is best is kept."""

    def __init__(self, matrix: Array, wanted: Array) -> None:
        self.settings, self.random = DescentSettings(tolerance=1e-14), np.random.default_rng(5)
        self.lower, self.upper = np.full(matrix.shape[1], -0.5), np.full(matrix.shape[1], 0.5)
        self.matrix, self.wanted = matrix, wanted
        self.evaluations, self.noted, self.best = 0, 0, np.inf

    def evaluate(self, y: Array, *, gradient: bool = True) -> tuple[float, Array]:
        assert np.all((self.lower <= y) & (y <= self.upper))
        self.evaluations += 1
        off = self.matrix @ y - self.wanted
        self.best = min(self.best, float(off @ off))
        return float(off @ off), 2.0 * self.matrix.T @ off if gradient else np.zeros(0)

    def note(self, y: Array) -> None:
        self.noted += 1


@pytest.mark.parametrize("variant", Variant)
def test_minimum_on_a_box_is_found(variant: Variant) -> None:
    rng = np.random.default_rng(6)
    task = LeastSquares(rng.normal(size=(8, 4)), rng.normal(size=8))
    answer = lsq_linear(task.matrix, task.wanted, (task.lower, task.upper))
    assert np.any(answer.active_mask)  # the box matters
    MINIMISERS[variant](task, np.zeros(4), 4000)
    assert task.best == pytest.approx(2.0 * answer.cost, rel=1e-6) and task.best >= 2.0 * answer.cost * (1.0 - 1e-9)
    assert 0 < task.noted < task.evaluations <= 4001


@pytest.mark.parametrize("variant", Variant)
def test_no_more_is_evaluated_than_is_allowed(variant: Variant) -> None:
    rng = np.random.default_rng(7)
    task = LeastSquares(rng.normal(size=(30, 12)), rng.normal(size=30))
    MINIMISERS[variant](task, np.zeros(12), 6)
    assert 1 <= task.evaluations <= 7
