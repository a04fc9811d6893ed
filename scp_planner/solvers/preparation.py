"""Time that solvers take before they first check the clock, by the size of a program."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from scp_planner.solvers.interface import QuadraticProgram, Solution, SolverStatus
from scp_planner.solvers.slacked import SlackedProgram


@dataclass(frozen=True)
class Cost:
    """Times that solvers take for a number."""

    # s for a number of a matrix, times its columns: while it fits into a cache, or not
    cached: float = 0.5e-9
    uncached: float = 1.5e-9
    cache_size: int = 2_000_000  # numbers
    written: float = 10e-9  # s for a number of a large matrix that is made anew
    pair: float = 15e-9  # s for a pair of numbers in a row: to factorise what they make, in as few iterations as may be


COST = Cost()


def dense_preparation(program: QuadraticProgram) -> float:
    """Return how long a dense method needs at least, s: its rows are turned into those of an even Hessian."""
    rows, columns = program.matrix.shape
    if np.count_nonzero(program.hessian) <= columns:
        return 0.0  # on the diagonal alone: nothing but a factor for each column
    return (COST.cached if rows * columns <= COST.cache_size else COST.uncached) * rows * columns**2


def whole_preparation(program: SlackedProgram) -> float:
    """Return how long it takes at least to put down all rows of a program with slacks, s."""
    return COST.written * len(program.bound) * len(program.gradient)


def sparse_preparation(program: QuadraticProgram) -> float:
    """Return how long a sparse interior-point method needs at least, s: it factorises a system of all rows."""
    return COST.pair * float((np.count_nonzero(program.matrix, axis=1).astype(float) ** 2).sum())


def given_up(program: QuadraticProgram | SlackedProgram) -> Solution:
    """Return the answer to a program for which there is no time."""
    size, rows = len(program.gradient), len(program.bound)
    return Solution(SolverStatus.FAILED, np.zeros(size), np.zeros(size + rows))
