"""Row and column scaling of a quadratic program, for solvers whose steps are not invariant to it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.sparse import coo_array, csr_array

from scp_planner.arrays import Array
from scp_planner.solvers.interface import QuadraticProgram, Solution
from scp_planner.solvers.tolerances import NARROWEST


@dataclass(frozen=True)
class ScalingSettings:
    """Passes of equilibration, and bounds that are none."""

    passes: int = 12
    no_bound: float = 1e20  # bounds beyond this are none: as rows they would hurt the scaling


SCALING = ScalingSettings()


@dataclass(frozen=True)
class Scaling:
    """A program in scaled variables and units, and the way between them."""

    # in y = x / columns, its rows multiplied by ``rows`` and its objective by ``cost``. Missing bounds are infinite.
    # Its matrix may be a sparse one
    program: QuadraticProgram
    columns: Array  # (n,)
    rows: Array  # (m,)
    cost: float

    def scaled(self, solution: Solution) -> Solution:
        """Return a solution of the original program as one of the scaled program."""
        return Solution(solution.status, solution.x / self.columns, solution.multipliers * self._prices * self.cost)

    def original(self, solution: Solution) -> Solution:
        """Return a solution of the scaled program as one of the original program."""
        return Solution(solution.status, solution.x * self.columns, solution.multipliers / (self._prices * self.cost))

    @property
    def _prices(self) -> Array:
        return np.concatenate([self.columns, 1.0 / self.rows])


def equilibrate(program: QuadraticProgram) -> Scaling:
    """Scale a program so that all rows and columns of its KKT matrix have about the same largest entry.

    Ruiz, "A scaling algorithm to equilibrate both rows and columns norms in matrices" (2001), on
    [[H, A'], [A, 0]], then one factor for the objective as in OSQP (Stellato et al. 2020, algorithm 2).

    Parameters
    ----------
    program : QuadraticProgram

    Returns
    -------
    Scaling
    """
    columns, rows = _factors(program.hessian, coo_array(program.matrix))
    matrix = program.matrix * columns
    matrix *= rows[:, None]
    return _scaling(program, columns, rows, matrix)


def equilibrate_sparse(program: QuadraticProgram) -> Scaling:
    """Scale a program as `equilibrate` does; its rows become a sparse matrix, which holds no zeros."""
    matrix = coo_array(program.matrix)
    columns, rows = _factors(program.hessian, matrix)
    row, column = matrix.coords
    scaled = coo_array((matrix.data * columns[column] * rows[row], (row, column)), shape=matrix.shape)
    return _scaling(program, columns, rows, scaled.tocsr())


def _factors(hessian: Array, matrix: coo_array) -> tuple[Array, Array]:
    """Factors of the columns and of the rows of a program."""
    hessian, values = np.abs(hessian), np.abs(matrix.data)
    row, column = matrix.coords
    columns, rows = np.ones(matrix.shape[1]), np.ones(matrix.shape[0])
    for _ in range(SCALING.passes):
        widest, highest = hessian.max(axis=0), np.zeros(len(rows))
        np.maximum.at(widest, column, values)
        np.maximum.at(highest, row, values)
        across, along = _inverse_root(widest), _inverse_root(highest)
        hessian *= across * across[:, None]
        values *= across[column]
        values *= along[row]
        columns *= across
        rows *= along
    return columns, rows


def _scaling(program: QuadraticProgram, columns: Array, rows: Array, matrix: Array | csr_array) -> Scaling:
    """A scaling with known factors, of which the matrix has been multiplied."""
    hessian = np.abs(program.hessian) * (columns * columns[:, None])
    gradient = program.gradient * columns
    cost = 1.0 / max(float(hessian.max(axis=0).mean()), float(np.abs(gradient).max()), NARROWEST)
    scaled = replace(
        program,
        hessian=program.hessian * (cost * columns * columns[:, None]),
        gradient=gradient * cost,
        lower=np.where(program.lower > -SCALING.no_bound, program.lower, -np.inf) / columns,
        upper=np.where(program.upper < SCALING.no_bound, program.upper, np.inf) / columns,
        matrix=matrix,
        bound=np.where(program.bound < SCALING.no_bound, program.bound, np.inf) * rows,
    )
    return Scaling(scaled, columns, rows, cost)


def _inverse_root(norm: Array) -> Array:
    return np.where(norm > NARROWEST, 1.0 / np.sqrt(np.maximum(norm, NARROWEST)), 1.0)
