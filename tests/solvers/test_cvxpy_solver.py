"""CVXPY: other solvers behind it, and constraints of a user."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from programs import INFEASIBLE_PROGRAM, box, known_program

from scp_planner.solvers import (
    SolverStatus,
    StepOrigin,
    solver_named,
)

pytestmark = pytest.mark.numerics


@pytest.mark.parametrize(
    ("status", "expected"),
    [
        ("infeasible", SolverStatus.INFEASIBLE),
        ("infeasible_inaccurate", SolverStatus.INFEASIBLE),
        ("unbounded", SolverStatus.FAILED),
        ("unbounded_inaccurate", SolverStatus.FAILED),
        ("infeasible_or_unbounded", SolverStatus.FAILED),
        ("optimal_inaccurate", SolverStatus.FAILED),
        ("user_limit", SolverStatus.FAILED),
        ("solver_error", SolverStatus.FAILED),
    ],
)
def test_every_status_of_cvxpy_is_mapped(monkeypatch: pytest.MonkeyPatch, status: str, expected: SolverStatus) -> None:
    import cvxpy as cp

    monkeypatch.setattr(cp.Problem, "solve", lambda *_, **__: None)
    monkeypatch.setattr(cp.Problem, "status", status)
    assert solver_named("cvxpy").solve(INFEASIBLE_PROGRAM).status is expected


def test_cvxpy_answer_that_breaks_a_row_is_not_optimal(monkeypatch: pytest.MonkeyPatch) -> None:
    import cvxpy as cp

    def careless(problem: cp.Problem, **_: Any) -> None:
        for variable in problem.variables():
            variable.save_value(np.zeros(variable.shape))
        for constraint in problem.constraints:
            constraint.save_dual_value(np.zeros(constraint.shape))

    monkeypatch.setattr(cp.Problem, "solve", careless)
    monkeypatch.setattr(cp.Problem, "status", "optimal")
    assert solver_named("cvxpy").solve(INFEASIBLE_PROGRAM).status is SolverStatus.FAILED


def test_cvxpy_solver_that_raises_has_failed(monkeypatch: pytest.MonkeyPatch) -> None:
    import cvxpy as cp

    def broken(*_: Any, **__: Any) -> None:
        raise cp.SolverError("nothing works today")

    monkeypatch.setattr(cp.Problem, "solve", broken)
    solution = solver_named("cvxpy").solve(box(2))
    assert solution.status is SolverStatus.FAILED
    assert not solution.x.any()


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


def test_cvxpy_is_compiled_once_for_programs_of_about_the_same_size() -> None:
    from scp_planner.solvers.cvxpy_solver import CvxpySolver

    written = []

    def extra(values: Any) -> list[Any]:
        written.append(values.shape)
        return []

    solver = CvxpySolver(extra=extra)
    for seed, (size, rows) in enumerate([(33, 101), (40, 110), (36, 105), (38, 112)]):
        program, x = known_program(seed, size=size, rows=rows, equalities=1)
        solution = solver.solve(replace(program, origin=StepOrigin(np.zeros(30), np.ones(30))))
        assert solution.status is SolverStatus.OPTIMAL
        assert solution.x == pytest.approx(x, abs=1e-5)  # not polished, as polishing does not know extra constraints
    assert written == [(30,)]
