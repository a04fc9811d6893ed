"""DAQP: a dense dual active-set method. The default: fastest on these small dense programs."""

from __future__ import annotations

import daqp
import numpy as np

from scp_planner.solvers.interface import QuadraticProgram, Solution, SolverStatus

ACTIVE, LOWER, EQUALITY = 1, 2, 5
_STATUS = {1: SolverStatus.OPTIMAL, 2: SolverStatus.OPTIMAL, -1: SolverStatus.INFEASIBLE}
_PRIMAL_TOLERANCE = 1e-9
_ITERATION_LIMIT = 2000


class DaqpSolver:
    """Adapter of :func:`daqp.solve`."""

    name = "daqp"

    def solve(self, program: QuadraticProgram) -> Solution:
        """Solve one quadratic program."""
        size = len(program.gradient)
        rows = len(program.bound)
        upper = np.concatenate([program.upper, program.bound])
        lower = np.full(size + rows, -1e30)
        lower[:size] = program.lower
        lower[size : size + program.equalities] = program.bound[: program.equalities]
        sense = np.zeros(size + rows, dtype=np.int32)
        if program.active is not None:
            sense[program.active > 0] = ACTIVE
            sense[program.active < 0] = ACTIVE + LOWER
        sense[size : size + program.equalities] = EQUALITY
        x, _, flag, info = daqp.solve(
            program.hessian,
            program.gradient,
            program.matrix,
            upper,
            lower,
            sense,
            primal_tol=_PRIMAL_TOLERANCE,
            iter_limit=_ITERATION_LIMIT,
        )
        return Solution(_STATUS.get(int(flag), SolverStatus.FAILED), np.asarray(x), np.asarray(info["lam"]))
