"""DAQP: a dense dual active-set method. The default: fastest on these small dense programs."""

from __future__ import annotations

from dataclasses import dataclass, replace
from time import perf_counter

import daqp
import numpy as np
from numpy.typing import NDArray

from scp_planner.arrays import Array
from scp_planner.solvers.interface import QuadraticProgram, Solution, SolverStatus
from scp_planner.solvers.preparation import dense_preparation, given_up
from scp_planner.solvers.scaling import equilibrate
from scp_planner.solvers.tolerances import ACTIVE_AT_START, ROW_TOLERANCE

_ACTIVE, _LOWER, _EQUALITY = 1, 2, 5


@dataclass(frozen=True)
class DaqpSettings:
    """Codes and limits of DAQP."""

    contradiction: int = -6  # of the constraints taken as active at first: the guess, and the equalities
    no_bound: float = 1e30
    # at most, and for each variable and row; what takes twice as many as others did is in a cycle
    iterations: tuple[int, int] = (500, 2)


DAQP = DaqpSettings()
_STATUS = {1: SolverStatus.OPTIMAL, 2: SolverStatus.OPTIMAL, -1: SolverStatus.INFEASIBLE}


class DaqpSolver:
    """Adapter of :func:`daqp.solve`, which keeps nothing between calls."""

    name = "daqp"

    def solve(self, program: QuadraticProgram) -> Solution:
        """Solve one quadratic program."""
        began, preparation = perf_counter(), dense_preparation(program)
        if preparation > program.time_limit:
            return given_up(program)
        solution = _solve(program, program.active)
        left = program.time_limit - (perf_counter() - began)
        if solution.status is SolverStatus.FAILED and left > preparation:
            # Bad scaling, or a guess with dependent rows that led into a cycle: once more in even units, from nothing.
            scaling = equilibrate(replace(program, time_limit=left))
            solution = scaling.original(_solve(scaling.program, np.zeros(len(solution.multipliers), dtype=np.int8)))
        return solution


def _solve(program: QuadraticProgram, active: NDArray[np.int8] | None) -> Solution:
    size, equalities = len(program.gradient), program.equalities
    lower, upper = program.all_bounds(-DAQP.no_bound)
    sense = _touching_origin(lower, upper) if active is None else _sense(active)
    sense[size : size + equalities] = 0
    guessed = sense.any()
    sense[size : size + equalities] = _EQUALITY
    most = DAQP.iterations[0] + DAQP.iterations[1] * (size + len(program.bound))
    settings = {"primal_tol": ROW_TOLERANCE, "iter_limit": most, "time_limit": program.time_limit}
    x, _, flag, info = daqp.solve(program.hessian, program.gradient, program.matrix, upper, lower, sense, **settings)
    status = _STATUS.get(int(flag), SolverStatus.FAILED)
    if flag == DAQP.contradiction and not guessed:
        status = SolverStatus.INFEASIBLE
    x, multipliers = np.asarray(x), np.asarray(info["lam"])
    # It may call nothing a number and the best; what it did not write is whatever stood there, and cannot be summed.
    if not (np.isfinite(x).all() and np.isfinite(multipliers).all()):
        status, x, multipliers = SolverStatus.FAILED, np.zeros(len(x)), np.zeros(len(multipliers))
    return Solution(status, x, multipliers)


def _sense(active: NDArray[np.int8]) -> NDArray[np.int32]:
    sense = np.zeros(len(active), dtype=np.int32)
    sense[active > 0] = _ACTIVE
    sense[active < 0] = _ACTIVE + _LOWER
    return sense


def _touching_origin(lower: Array, upper: Array) -> NDArray[np.int32]:
    sense = np.zeros(len(upper), dtype=np.int32)
    sense[np.abs(upper) <= ACTIVE_AT_START] = _ACTIVE
    sense[np.abs(lower) <= ACTIVE_AT_START] = _ACTIVE + _LOWER
    return sense
