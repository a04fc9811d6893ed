"""Programs of very many rows: the answer is that of all rows, and few are looked at."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from programs import known_program, optimality, without_slacks

from scp_planner.solvers.interface import QuadraticProgram, Solution, SolverStatus, solver_named
from scp_planner.solvers.slacked import SlackedProgram
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


# Programs whose matrix is told by its parts: what they say of rows is what the matrix says


def slacked(seed: int, steps: int, slacks: int, hard: int, soft: int) -> SlackedProgram:
    """A program with the matrix that the test below writes out, feasible for slacks that are large enough."""
    rng = np.random.default_rng(seed)
    size = steps + slacks
    gradient = np.append(rng.normal(size=steps), np.full(slacks, 3.0))
    return SlackedProgram(
        np.diag(np.append(np.ones(steps), np.full(slacks, 1e-2))),
        gradient,
        np.append(np.full(steps, -1.0), np.zeros(slacks)),
        np.append(np.full(steps, 1.0), np.full(slacks, 1e3)),
        rng.normal(size=(hard, steps)),
        rng.normal(size=(soft, steps)),
        steps + rng.integers(slacks, size=soft),
        np.append(np.abs(rng.normal(size=hard)), rng.normal(size=soft)),
        0,
        rng.integers(-1, 2, size + hard + soft).astype(np.int8),
    )


@pytest.mark.parametrize("seed", range(3))
def test_parts_say_what_the_matrix_says(seed: int) -> None:
    program = slacked(seed, 6, 4, 5, 30)
    rng = np.random.default_rng(100 + seed)
    matrix = np.zeros((35, 10))
    matrix[:5, :6], matrix[5:, :6] = program.hard, program.soft
    for row, column in enumerate(program.slack, start=5):
        matrix[row, column] = -1.0
    whole = program.whole()
    assert np.array_equal(whole.matrix, matrix)
    assert (whole.bound is program.bound) and (whole.active is program.active)
    x, half = rng.normal(size=10), rng.uniform(size=10)
    assert program.of_rows(x) == pytest.approx(matrix @ x, abs=1e-12)
    assert program.reach_of_rows(half) == pytest.approx(np.abs(matrix) @ half, abs=1e-12)
    for chosen in (np.array([0, 3, 4, 7, 34]), np.array([9, 10]), np.array([1, 2]), np.arange(35)):
        some = program.only(chosen, program.active, 0.5)
        assert np.array_equal(some.matrix, matrix[chosen]) and np.array_equal(some.bound, program.bound[chosen])
        assert program.active is not None and some.active is not None
        assert np.array_equal(some.active, np.append(program.active[:10], program.active[10 + chosen]))
        assert some.time_limit == 0.5


@pytest.mark.parametrize("seed", range(3))
def test_with_few_rows_it_has_the_answer_of_all(seed: int) -> None:
    program, rows = replace(slacked(seed, 30, 20, 40, 3000), active=None), []

    def solve(given: QuadraticProgram) -> Solution:
        rows.append(len(given.bound))
        return solver_named("daqp").solve(given)

    found = solved_with_few_rows(program, solve)
    assert found.status is SolverStatus.OPTIMAL
    assert max(rows) < 1500
    assert optimality(program.whole(), found) < 1e-6
    assert found.x == pytest.approx(solver_named("clarabel").solve(program.whole()).x, abs=1e-6)
