"""CVXPY: other solvers behind it, and constraints of a user."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from programs import box, known_program

from scp_planner.solvers import (
    SolverStatus,
    StepOrigin,
)

pytestmark = pytest.mark.numerics


def test_unknown_solver_of_cvxpy_is_refused_with_the_installed_ones() -> None:
    from scp_planner.solvers.cvxpy_solver import CvxpySolver

    with pytest.raises(ValueError, match=r"'nonsense'.*CLARABEL"):
        CvxpySolver(solver="nonsense")


@pytest.mark.parametrize("inner", ["OSQP", "SCS"])
def test_cvxpy_opens_other_solvers(inner: str) -> None:
    from scp_planner.solvers.cvxpy_solver import CvxpySolver

    program, x = known_program(5, size=12, rows=30, equalities=1)
    solution = CvxpySolver(solver=inner).solve(program)
    assert solution.status is SolverStatus.OPTIMAL
    assert solution.x == pytest.approx(x, abs=1e-6)


def test_cvxpy_keeps_extra_constraints_on_what_steps_lead_to() -> None:
    import cvxpy

    cp: Any = cvxpy  # whose names come by way of stars

    from scp_planner.solvers.cvxpy_solver import CvxpySolver

    # Nearest point to (2, 2, 2, 2) with a cone on what the first two variables lead to, (0.5 + x, 2 x)
    origin = StepOrigin(np.array([0.5, 0.0]), np.array([1.0, 2.0]))
    program = replace(box(4, 3.0), origin=origin)
    solution = CvxpySolver(extra=lambda values: [cp.norm(values) <= 1.0]).solve(program)
    assert solution.status is SolverStatus.OPTIMAL
    assert solution.x[2:] == pytest.approx([2.0, 2.0], abs=1e-6)
    # The nearest point of an ellipse, by its angle
    angle = np.linspace(0.0, np.pi, 2_000_001)
    outline = np.stack([np.cos(angle) - 0.5, np.sin(angle) / 2.0], axis=1)
    nearest = outline[np.argmin(np.sum((outline - 2.0) ** 2, axis=1))]
    assert solution.x[:2] == pytest.approx(nearest, abs=1e-5)

    impossible = CvxpySolver(extra=lambda values: [values[0] >= 4.0]).solve(program)
    assert impossible.status is SolverStatus.INFEASIBLE
