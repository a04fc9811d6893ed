"""Minimisers of a function on a box: L-BFGS-B, plain gradient descent, and a Monte Carlo search without gradient."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

import numpy as np
from scipy.optimize import minimize

from scp_planner.arrays import Array
from scp_planner.baseline.descent_run import DescentSettings, Variant


class Minimisation(Protocol):
    """A minimisation: function, start and minimiser."""

    settings: DescentSettings
    lower: Array  # (K,)
    upper: Array  # (K,)
    random: np.random.Generator

    @property
    def evaluations(self) -> int: ...

    def evaluate(self, y: Array, *, gradient: bool = True) -> tuple[float, Array]:
        """Return value and gradient; the best y is kept."""
        ...

    def note(self, y: Array) -> None:
        """Count an accepted step."""
        ...


def _lbfgs(task: Minimisation, start: Array, until: int) -> None:
    budget = until - task.evaluations
    minimize(
        task.evaluate,
        start,
        jac=True,
        method="L-BFGS-B",
        bounds=list(zip(task.lower, task.upper, strict=True)),
        callback=task.note,
        options={
            "maxcor": task.settings.memory,
            "maxfun": budget,
            "maxiter": budget,
            "ftol": task.settings.tolerance,
            "gtol": 1e-5,
        },
    )


def _gradient_descent(task: Minimisation, start: Array, until: int) -> None:
    """Steps against the gradient, projected onto the bounds; the step is doubled after success, halved until Armijo."""
    y, length, small = start, 1.0, 0
    value, slope = task.evaluate(y)
    while task.evaluations < until and small < 3:
        trial = np.clip(y - length * slope, task.lower, task.upper)
        step = trial - y
        if not np.abs(step).max() > 1e-12:
            return
        trial_value, trial_slope = task.evaluate(trial)
        if trial_value > value + 1e-4 * float(slope @ step):
            length *= 0.5
            continue
        small = small + 1 if value - trial_value < task.settings.tolerance * abs(value) else 0
        y, value, slope, length = trial, trial_value, trial_slope, 2.0 * length
        task.note(y)


def _monte_carlo(task: Minimisation, start: Array, until: int) -> None:
    """Random steps of some coordinates; the step grows after success and shrinks after failure (the 1/5 rule)."""
    y, spread = start, 0.3
    value, _ = task.evaluate(y, gradient=False)
    while task.evaluations < until and spread > 1e-7:
        moved = task.random.random(len(y)) < max(2.0 / len(y), 0.2)
        trial = np.clip(y + spread * moved * task.random.normal(size=len(y)), task.lower, task.upper)
        trial_value, _ = task.evaluate(trial, gradient=False)
        if trial_value < value:
            y, value, spread = trial, trial_value, spread * 1.5
            task.note(y)
        else:
            spread *= 1.5**-0.25


MINIMISERS: dict[Variant, Callable[[Minimisation, Array, int], None]] = {
    Variant.LBFGS: _lbfgs,
    Variant.GRADIENT: _gradient_descent,
    Variant.MONTE_CARLO: _monte_carlo,
}
"""Each begins at y, (K,), and ends after so many evaluations in all."""
