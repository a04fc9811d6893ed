"""Quadratic programs with known answers."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from scp_planner.solvers import (
    QuadraticProgram,
    Solution,
)
from scp_planner.solvers.slacked import SlackedProgram

Array = np.ndarray
SEEDS = range(12)


def known_program(
    seed: int,
    *,
    weak: bool = False,
    scale: float = 0.0,
    size: int | None = None,
    rows: int | None = None,
    equalities: int | None = None,
) -> tuple[QuadraticProgram, Array]:
    """A strictly convex program made from its answer: x, active constraints and multipliers first, the gradient last.

    With ``weak`` a third of the active constraints has no multiplier; with ``scale`` every variable and row is
    multiplied by a random power of ten up to this one.
    """
    rng = np.random.default_rng(seed)
    size = int(rng.integers(3, 40)) if size is None else size
    rows = int(rng.integers(3, 100)) if rows is None else rows
    equalities = int(rng.integers(0, 3)) if equalities is None else equalities
    turn = np.linalg.qr(rng.normal(size=(size, size)))[0]
    hessian = (turn * np.geomspace(1e-3, 1.0, size)) @ turn.T
    matrix = rng.normal(size=(rows, size))
    x = rng.normal(size=size)
    values = np.concatenate([x, matrix @ x])
    upper = values + rng.uniform(0.1, 2.0, size + rows)
    lower = x - rng.uniform(0.1, 2.0, size)
    upper[size : size + equalities] = values[size : size + equalities]
    multipliers = np.zeros(size + rows)
    multipliers[size : size + equalities] = rng.normal(size=equalities)
    others = np.concatenate([np.arange(size), np.arange(size + equalities, size + rows)])
    for count, index in enumerate(rng.permutation(others)[: int(rng.integers(0, size - equalities))]):
        price = 0.0 if weak and count % 3 == 0 else rng.uniform(0.1, 2.0)
        if index < size and rng.random() < 0.5:
            lower[index], multipliers[index] = x[index], -price
        else:
            upper[index], multipliers[index] = values[index], price
    gradient = -(hessian @ x + multipliers[:size] + matrix.T @ multipliers[size:])
    column, row = 10.0 ** rng.uniform(-scale, scale, size), 10.0 ** rng.uniform(-scale, scale, rows)
    program = QuadraticProgram(
        hessian * column * column[:, None],
        gradient * column,
        lower / column,
        upper[:size] / column,
        matrix * column * row[:, None],
        upper[size:] * row,
        equalities,
    )
    return program, x / column


def box(size: int, radius: float = 1.0) -> QuadraticProgram:
    """Nearest point to (2, 2, ...) in a box around 0, without rows."""
    return QuadraticProgram(
        np.eye(size),
        np.full(size, -2.0),
        np.full(size, -radius),
        np.full(size, radius),
        np.zeros((0, size)),
        np.zeros(0),
        0,
    )


def with_rows(program: QuadraticProgram, matrix: list[list[float]], bound: list[float], equalities: int = 0) -> Any:
    return replace(program, matrix=np.array(matrix, dtype=float), bound=np.array(bound), equalities=equalities)


def optimality(program: QuadraticProgram, solution: Solution) -> float:
    """Largest residual of the Karush-Kuhn-Tucker conditions."""
    x, size = solution.x, len(solution.x)
    on_bounds, on_rows = solution.multipliers[:size], solution.multipliers[size:]
    stationary = program.hessian @ x + program.gradient + on_bounds + program.matrix.T @ on_rows
    left = program.bound - program.matrix @ x
    equal, loose = left[: program.equalities], left[program.equalities :]
    prices = on_rows[program.equalities :]
    return max(
        float(np.abs(part).max(initial=0.0))
        for part in (
            stationary,
            equal,
            np.minimum(loose, 0.0),
            np.minimum(prices, 0.0),
            prices * loose,
            np.minimum(program.upper - x, 0.0),
            np.minimum(x - program.lower, 0.0),
            np.maximum(on_bounds, 0.0) * (program.upper - x),
            np.minimum(on_bounds, 0.0) * (x - program.lower),
        )
    )


INFEASIBLE_PROGRAM = with_rows(box(2), [[1, 1]], [-3.0])


def long_program() -> QuadraticProgram:
    """A program whose minimiser lies in a corner of many rows, far from where a solver begins."""
    rng = np.random.default_rng(0)
    size, rows = 60, 600
    return QuadraticProgram(
        1e-3 * np.eye(size),
        100.0 * rng.normal(size=size),
        np.full(size, -np.inf),
        np.full(size, np.inf),
        rng.normal(size=(rows, size)),
        np.abs(rng.normal(size=rows)) + 0.1,
        0,
    )


def without_slacks(program: QuadraticProgram) -> SlackedProgram:
    """A program in which no row has a slack."""
    size = len(program.gradient)
    return SlackedProgram(
        program.hessian,
        program.gradient,
        program.lower,
        program.upper,
        program.matrix,
        np.zeros((0, size)),
        np.zeros(0, dtype=np.intp),
        program.bound,
        program.equalities,
        program.active,
        program.origin,
        program.time_limit,
    )
