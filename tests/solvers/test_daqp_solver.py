"""DAQP: warm starts, its status, its limits."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from programs import SEEDS, known_program, optimality

from scp_planner.solvers import (
    QuadraticProgram,
    SolverStatus,
    solver_named,
)
from scp_planner.solvers.interface import LONGEST_SOLVE

pytestmark = pytest.mark.numerics


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("guess", ["right", "wrong", "everything", "nothing"])
def test_daqp_takes_any_guess_of_the_active_constraints(seed: int, guess: str) -> None:
    program, x = known_program(seed, weak=True)
    solver = solver_named("daqp")
    right = np.sign(np.round(solver.solve(program).multipliers, 9)).astype(np.int8)
    active = {
        "right": right,
        "wrong": np.where(right == 0, np.random.default_rng(seed).integers(-1, 2, len(right)), 0).astype(np.int8),
        "everything": np.ones(len(right), dtype=np.int8),
        "nothing": np.zeros(len(right), dtype=np.int8),
    }[guess]
    active[len(x) :] = np.maximum(active[len(x) :], 0)  # rows have one side
    solution = solver.solve(replace(program, active=active))
    assert solution.status is SolverStatus.OPTIMAL
    assert solution.x == pytest.approx(x, abs=1e-8)


@pytest.mark.parametrize("guess", ["none", "everything"])
def test_programs_of_very_many_rows_may_take_many_iterations(guess: str) -> None:
    """On the border of a ball, each of whose 3,000 tangents may become active on the way to the minimiser."""
    rng = np.random.default_rng(0)
    size, rows = 100, 3000
    normals = rng.normal(size=(rows, size))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    program = QuadraticProgram(
        1e-3 * np.eye(size),
        rng.normal(size=size),
        np.full(size, -10.0),
        np.full(size, 10.0),
        normals,
        1.0 + rng.uniform(0.0, 0.02, rows),
        0,
        active=None if guess == "none" else np.ones(size + rows, dtype=np.int8),
        time_limit=LONGEST_SOLVE,
    )
    solution = solver_named("daqp").solve(program)
    assert solution.status is SolverStatus.OPTIMAL
    assert optimality(program, solution) < 1e-8
