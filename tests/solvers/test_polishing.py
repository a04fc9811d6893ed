"""Polishing, and scaling, of programs and answers."""

from __future__ import annotations

import tracemalloc
from dataclasses import replace

import numpy as np
import pytest
from programs import INFEASIBLE_PROGRAM, SEEDS, box, known_program, optimality

from scp_planner.solvers import (
    Solution,
    SolverStatus,
    solver_named,
)
from scp_planner.solvers.polishing import polish
from scp_planner.solvers.scaling import equilibrate

pytestmark = pytest.mark.numerics


@pytest.mark.parametrize("seed", SEEDS)
def test_equilibrate_evens_out_the_matrix_and_maps_answers_both_ways(seed: int) -> None:
    program, _ = known_program(seed, scale=3.0)
    scaling = equilibrate(program)
    scaled = scaling.program
    columns = np.maximum(np.abs(scaled.hessian / scaling.cost).max(axis=0), np.abs(scaled.matrix).max(axis=0))
    assert columns == pytest.approx(np.ones(len(columns)), abs=0.1)
    assert np.abs(scaled.matrix).max(axis=1) == pytest.approx(np.ones(len(scaled.bound)), abs=0.1)

    solution = solver_named("daqp").solve(scaled)
    back = scaling.original(solution)
    assert scaling.scaled(back).x == pytest.approx(solution.x, rel=1e-12)
    assert scaling.scaled(back).multipliers == pytest.approx(solution.multipliers, rel=1e-12)
    stationary = program.hessian @ back.x + program.gradient + back.multipliers[: len(back.x)]
    stationary += program.matrix.T @ back.multipliers[len(back.x) :]
    # In the units of the gradient, which differ from variable to variable by many powers of ten
    assert stationary * scaling.columns * scaling.cost == pytest.approx(np.zeros(len(back.x)), abs=1e-9)


@pytest.mark.parametrize("seed", SEEDS)
def test_polish_completes_a_rough_answer(seed: int) -> None:
    program, x = known_program(seed)
    exact = solver_named("daqp").solve(program)
    rng = np.random.default_rng(seed)
    rough = Solution(
        SolverStatus.FAILED,
        exact.x + 1e-3 * rng.normal(size=len(x)),
        exact.multipliers + 1e-3 * rng.normal(size=len(exact.multipliers)),
    )
    polished = polish(program, rough)
    assert polished is not None
    assert polished.status is SolverStatus.OPTIMAL
    assert polished.x == pytest.approx(x, abs=1e-9)


def test_polish_gives_up_where_rounding_has_made_the_hessian_indefinite() -> None:
    program, _ = known_program(0)
    exact = solver_named("daqp").solve(program)
    steepest = float(np.linalg.eigvalsh(program.hessian)[-1])
    _, ways = np.linalg.eigh(program.hessian)
    weakest = -1e-12 * steepest - float(np.linalg.eigvalsh(program.hessian)[0])
    spoilt = replace(program, hessian=program.hessian + weakest * np.outer(ways[:, 0], ways[:, 0]))
    assert polish(spoilt, exact) is None


@pytest.mark.parametrize("seed", range(40))
def test_polish_mends_even_a_wrong_answer(seed: int) -> None:
    program, x = known_program(seed, weak=True)
    rng = np.random.default_rng(seed)
    nonsense = Solution(SolverStatus.OPTIMAL, rng.normal(size=len(x)), rng.normal(size=len(x) + len(program.bound)))
    polished = polish(program, nonsense)
    assert polished is not None
    assert polished.x == pytest.approx(x, abs=1e-9)


def test_polish_finds_nothing_in_an_infeasible_program() -> None:
    assert polish(INFEASIBLE_PROGRAM, Solution(SolverStatus.OPTIMAL, np.zeros(2), np.zeros(3))) is None


def test_a_large_program_is_not_copied() -> None:
    """By Clarabel with all that goes before and after it: of rows that are mostly zeros only the others are."""
    size, rows = 60, 12_000
    matrix = np.zeros((rows, size))
    matrix[np.arange(rows), np.arange(rows) % size] = 1.0
    matrix[np.arange(rows), (np.arange(rows) // size) % size] += 0.5
    bound = np.where(np.arange(rows) < size, 0.9, 3.0)
    program = replace(box(size), matrix=matrix, bound=bound)
    tracemalloc.start()
    solution = solver_named("clarabel").solve(program)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert solution.status is SolverStatus.OPTIMAL
    assert optimality(program, solution) < 1e-9
    assert peak < 0.6 * matrix.nbytes
