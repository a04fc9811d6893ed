"""One quadratic program, one function, one small vocabulary of outcomes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum
from importlib import import_module
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from scp_planner.arrays import Array

LONGEST_SOLVE = 10.0  # s of wall time, where no deadline asks for less: a thousand times what steps usually take


class SolverStatus(Enum):
    """Outcome of a quadratic program; it failed also where the limit of iterations or of time was reached."""

    OPTIMAL = "optimal"
    INFEASIBLE = "infeasible"
    FAILED = "failed"


@dataclass
class StepOrigin:
    """Point from which the first k variables x of a program are steps: they lead to ``start + scale * x``.

    Attributes
    ----------
    start, scale : (k,) arrays
        In the unit of each variable.
    """

    start: Array
    scale: Array


@dataclass
class QuadraticProgram:
    """minimise x'Hx/2 + f'x subject to lower <= x <= upper, A x <= b, with the first rows of A equalities.

    All are scaled and have no unit.

    Attributes
    ----------
    hessian : (n, n) array
        Positive definite.
    gradient : (n,) array
    lower, upper : (n,) arrays
    matrix : (m, n) array
    bound : (m,) array
    equalities : int
        Number of leading rows that hold with equality.
    active : (n + m,) array of int or None
        Warm start, without a unit: -1 at the lower bound, +1 at the upper bound or on the row, 0 inactive.
    origin : StepOrigin or None
        What the first variables are steps from; no part of the program, but for constraints that users add to it.
    time_limit : float
        Wall time in s after which a solver gives up, its status then FAILED.
    """

    hessian: Array
    gradient: Array
    lower: Array
    upper: Array
    matrix: Array
    bound: Array
    equalities: int
    active: NDArray[np.int8] | None = None
    origin: StepOrigin | None = None
    time_limit: float = LONGEST_SOLVE

    def all_bounds(self, none: float) -> tuple[Array, Array]:
        """Lower and upper bounds of variables, then rows, (n + m,) each, no unit; ``none`` stands for no lower one."""
        size, upper = len(self.gradient), np.concatenate([self.upper, self.bound])
        lower = np.full(len(upper), none)
        lower[:size] = self.lower
        lower[size : size + self.equalities] = self.bound[: self.equalities]
        return lower, upper


@dataclass(frozen=True)
class Solution:
    """An answer to a quadratic program, scaled and without a unit as that is.

    Attributes
    ----------
    status : SolverStatus
    x : (n,) array
        Meaningful only when the status is OPTIMAL.
    multipliers : (n + m,) array
        Of the bounds (negative at a lower one), then of the rows.
    """

    status: SolverStatus
    x: Array
    multipliers: Array


class QpSolver(Protocol):
    """A solver of quadratic programs. It may keep memory between calls, but the answer may not depend on it.

    It is to give up where a program takes too many iterations, or more than its limit of time.

    Attributes
    ----------
    name : str
        That plans made with it bear.
    """

    name: str

    def solve(self, program: QuadraticProgram) -> Solution:
        """Solve one quadratic program."""
        ...


SOLVERS = {
    "daqp": "scp_planner.solvers.daqp_solver:DaqpSolver",
    "clarabel": "scp_planner.solvers.clarabel_solver:ClarabelSolver",
    "osqp": "scp_planner.solvers.osqp_solver:OsqpSolver",
    "cvxpy": "scp_planner.solvers.cvxpy_solver:CvxpySolver",
}


def solver_named(name: str) -> QpSolver:
    """Return a new solver by its name; the package behind it is imported only now.

    Parameters
    ----------
    name : str

    Returns
    -------
    QpSolver

    Raises
    ------
    ValueError
        If no solver has that name.
    """
    if name not in SOLVERS:
        raise ValueError(f"solver: no solver is named {name!r}; there are {', '.join(SOLVERS)}")
    module, attribute = SOLVERS[name].split(":")
    factory: Callable[[], QpSolver] = getattr(import_module(module), attribute)
    return factory()
