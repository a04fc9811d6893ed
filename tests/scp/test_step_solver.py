"""The solver of the subproblems: what it is given of the time, and when another one takes its place."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from clock import FakeClock

from scp_planner.scp import step_solver
from scp_planner.scp.step_solver import StepSolver
from scp_planner.solvers.interface import QuadraticProgram, Solution, SolverStatus, solver_named
from scp_planner.solvers.slacked import SlackedProgram

# The nearest point to (1, 2) with x + y <= 1: (0, 1).
PROGRAM = SlackedProgram(
    hessian=np.eye(2),
    gradient=np.array([-1.0, -2.0]),
    lower=np.full(2, -5.0),
    upper=np.full(2, 5.0),
    hard=np.ones((1, 2)),
    soft=np.zeros((0, 2)),
    slack=np.zeros(0, dtype=np.intp),
    bound=np.ones(1),
    equalities=0,
    time_limit=5.0,
)


class Answers:
    """A solver that says the same of every program, and keeps how long it was given for each."""

    name = "answers"

    def __init__(self, status: SolverStatus) -> None:
        self.status = status
        self.given: list[float] = []

    def solve(self, program: QuadraticProgram) -> Solution:
        self.given.append(program.time_limit)
        return Solution(self.status, np.array([7.0, 7.0]), np.zeros(3))


@pytest.mark.parametrize(
    ("left", "limit", "given"), [(2.0, 5.0, 2.0), (9.0, 5.0, 5.0), (np.inf, 5.0, 5.0), (-1.0, 5.0, 0.1)]
)
def test_a_solver_has_what_is_left_of_the_time(
    left: float, limit: float, given: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    FakeClock(0.0).rule(monkeypatch)
    solver = Answers(SolverStatus.OPTIMAL)
    found = StepSolver(solver, None, shortest=0.1).solve(replace(PROGRAM, time_limit=limit), left)
    assert solver.given == [given]
    assert found is not None and found.x.tolist() == [7.0, 7.0]


@pytest.mark.parametrize(
    ("status", "fallback", "left", "asked"),
    [
        (SolverStatus.FAILED, "clarabel", 1.0, True),
        (SolverStatus.FAILED, "clarabel", -1.0, False),
        (SolverStatus.FAILED, None, 1.0, False),
        (SolverStatus.INFEASIBLE, "clarabel", 1.0, False),
    ],
)
def test_another_solver_is_asked_only_where_one_failed_in_time(
    status: SolverStatus, fallback: str | None, left: float, asked: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    FakeClock(0.0).rule(monkeypatch)
    other = Answers(SolverStatus.OPTIMAL)
    monkeypatch.setattr(step_solver, "solver_named", {"clarabel": other}.__getitem__)
    found = StepSolver(Answers(status), fallback, shortest=0.1).solve(PROGRAM, left)
    assert (found is not None) == asked
    assert other.given == ([1.0] if asked else [])


@pytest.mark.numerics
def test_the_step_is_that_of_the_program() -> None:
    failed = StepSolver(Answers(SolverStatus.FAILED), "clarabel", shortest=0.1)
    for solver in (StepSolver(solver_named("daqp"), None, shortest=0.1), failed):
        found = solver.solve(PROGRAM, np.inf)
        assert found is not None and found.x == pytest.approx([0.0, 1.0], abs=1e-7)
