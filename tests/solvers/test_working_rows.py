"""Programs of very many rows: the answer is that of all rows, and few are looked at."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from programs import known_program, optimality, without_slacks

from scp_planner.solvers.interface import QuadraticProgram, Solution, SolverStatus, solver_named
from scp_planner.solvers.working_rows import solved_with_few_rows


class Told:
    """A solver that tells how many rows it was given."""

    def __init__(self, name: str = "daqp", status: SolverStatus | None = None) -> None:
        self.solver, self.status = solver_named(name), status
        self.rows: list[int] = []

    def solve(self, program: QuadraticProgram) -> Solution:
        self.rows.append(len(program.bound))
        found = self.solver.solve(program)
        return found if self.status is None else replace(found, status=self.status)


def large(seed: int, equalities: int = 2) -> tuple[QuadraticProgram, np.ndarray]:
    return known_program(seed, size=40, rows=4000, equalities=equalities)


@pytest.mark.parametrize("name", ["daqp", "clarabel", "osqp"])
@pytest.mark.parametrize("seed", range(4))
def test_the_answer_is_that_of_all_rows(name: str, seed: int) -> None:
    program, x = large(seed)
    told = Told(name)
    found = solved_with_few_rows(without_slacks(program), told.solve)
    assert found.status is SolverStatus.OPTIMAL
    assert max(told.rows) < 1000
    np.testing.assert_allclose(found.x, x, atol=1e-7)
    assert optimality(program, found) < 1e-6


def test_rows_that_bind_though_others_seem_nearer_are_found() -> None:
    """The row that binds is far from the start; a thousand that are nearer are passed on the other side."""
    size, rows = 40, 4000
    away = np.zeros((rows, size))
    away[:, 0] = -1.0  # x0 >= -bound
    away[-1] = 0.0
    away[-1, 0] = 1.0  # x0 <= 0.9
    bound = np.linspace(0.01, 0.02, rows)
    bound[-1] = 0.9
    gradient = np.zeros(size)
    gradient[0] = -5.0
    program = QuadraticProgram(np.eye(size), gradient, -np.ones(size), np.ones(size), away, bound, 0)
    told = Told()
    found = solved_with_few_rows(without_slacks(program), told.solve)
    assert found.x[0] == pytest.approx(0.9, abs=1e-9)
    assert found.multipliers[-1] == pytest.approx(4.1, abs=1e-8)
    assert len(told.rows) == 2


def test_rows_without_entries_are_never_met() -> None:
    """And nothing is said of dividing their bounds, however large, by what they use of them."""
    program, x = large(1)
    empty, far = np.zeros((100, 40)), np.full(100, 1e3)
    wider = replace(
        program,
        matrix=np.vstack([program.matrix, empty]),
        bound=np.concatenate([program.bound, far]),
        active=None if program.active is None else np.concatenate([program.active, np.zeros(100, dtype=np.int8)]),
    )
    told = Told()
    with np.errstate(all="raise", under="ignore"):
        found = solved_with_few_rows(without_slacks(wider), told.solve)
    assert max(told.rows) < 1000
    np.testing.assert_allclose(found.x, x, atol=1e-7)


def test_what_no_row_subset_allows_is_infeasible() -> None:
    program, x = large(2, equalities=0)
    contradiction = np.zeros((2, 40))
    contradiction[:, 0] = 1.0, -1.0
    program = replace(
        program,
        matrix=np.concatenate([program.matrix, contradiction]),
        bound=np.concatenate([program.bound, [x[0], -x[0] - 0.05]]),
    )
    found = solved_with_few_rows(without_slacks(program), Told().solve)
    assert found.status is SolverStatus.INFEASIBLE
    assert len(found.multipliers) == 40 + len(program.bound)


def test_where_the_solver_fails_all_rows_are_taken() -> None:
    program, _ = large(3)
    failing = Told(status=SolverStatus.FAILED)
    assert solved_with_few_rows(without_slacks(program), failing.solve).status is SolverStatus.FAILED
    assert failing.rows[1:] == [4000]


def test_without_time_nothing_is_begun() -> None:
    told = Told()
    assert (
        solved_with_few_rows(without_slacks(replace(large(0)[0], time_limit=0.0)), told.solve).status
        is SolverStatus.FAILED
    )
    assert told.rows == []
