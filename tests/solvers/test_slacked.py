"""Programs whose matrix is told by its parts: what they say of rows is what the matrix says."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from programs import optimality

from scp_planner.solvers.interface import QuadraticProgram, Solution, SolverStatus, solver_named
from scp_planner.solvers.slacked import SlackedProgram
from scp_planner.solvers.working_rows import solved_with_few_rows

pytestmark = pytest.mark.numerics


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
