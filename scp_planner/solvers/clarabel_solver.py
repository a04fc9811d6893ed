"""Clarabel: an interior-point method. No warm start, and so no memory: the fallback, and the oracle of the tests."""

from __future__ import annotations

from time import perf_counter

import clarabel
import numpy as np
from scipy.sparse import csc_matrix

from scp_planner.solvers.interface import QuadraticProgram, Solution, SolverStatus
from scp_planner.solvers.polishing import polish
from scp_planner.solvers.preparation import given_up, sparse_preparation
from scp_planner.solvers.scaling import equilibrate_sparse
from scp_planner.solvers.sparse_rows import stacked
from scp_planner.solvers.tolerances import GAP_TOLERANCE, REDUCED_TOLERANCE

_STATUS = {
    "Solved": SolverStatus.OPTIMAL,
    "AlmostSolved": SolverStatus.OPTIMAL,
    "PrimalInfeasible": SolverStatus.INFEASIBLE,
    "AlmostPrimalInfeasible": SolverStatus.INFEASIBLE,
}


class ClarabelSolver:
    """Adapter of :class:`clarabel.DefaultSolver`."""

    name = "clarabel"

    def __init__(self) -> None:
        settings = clarabel.DefaultSettings()
        settings.verbose = False
        settings.max_threads = 1
        settings.max_iter = 200
        settings.direct_solve_method = "qdldl"
        settings.presolve_enable = False  # it would drop rows, and we drop those without a bound ourselves
        settings.equilibrate_enable = False  # done with better scaling here
        settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = GAP_TOLERANCE
        settings.reduced_tol_gap_abs = settings.reduced_tol_gap_rel = REDUCED_TOLERANCE
        settings.reduced_tol_feas = REDUCED_TOLERANCE
        self._settings = settings

    def solve(self, program: QuadraticProgram) -> Solution:
        """Solve one quadratic program."""
        deadline = perf_counter() + program.time_limit
        if sparse_preparation(program) > program.time_limit:
            return given_up(program)
        scaling = equilibrate_sparse(program)
        answer = self._solve_scaled(scaling.program)
        if answer.status is not SolverStatus.INFEASIBLE:
            # Polishing checks what it returns, so that it may also save an answer that fell short.
            answer = polish(scaling.program, answer, deadline) or answer
        return scaling.original(answer)

    def _solve_scaled(self, program: QuadraticProgram) -> Solution:
        size, equalities = len(program.gradient), program.equalities
        fixed = np.flatnonzero(program.lower == program.upper)
        free = program.lower != program.upper
        equal = np.arange(equalities)
        rows = equalities + np.flatnonzero(np.isfinite(program.bound[equalities:]))
        below = np.flatnonzero(free & np.isfinite(program.upper))
        above = np.flatnonzero(free & np.isfinite(program.lower))
        upper, lower = program.upper, program.lower
        bound = [upper[fixed], program.bound[equal], program.bound[rows], upper[below], -lower[above]]
        ends = np.cumsum([len(part) for part in bound])
        self._settings.time_limit = program.time_limit
        answer = clarabel.DefaultSolver(
            csc_matrix(np.triu(program.hessian)),
            program.gradient,
            stacked(program.matrix, fixed, np.concatenate([equal, rows]), below, above),
            np.concatenate(bound),
            [clarabel.ZeroConeT(ends[1]), clarabel.NonnegativeConeT(ends[-1] - ends[1])],
            self._settings,
        ).solve()
        dual = np.split(np.array(answer.z), ends[:-1])
        multipliers = np.zeros(size + len(program.bound))
        multipliers[fixed] = dual[0]
        multipliers[size + equal] = dual[1]
        multipliers[size + rows] = dual[2]
        multipliers[below] += dual[3]
        multipliers[above] -= dual[4]
        # An infeasible program's answer is a certificate of that, with finite numbers in it: only the status tells.
        status = _STATUS.get(str(answer.status), SolverStatus.FAILED)
        return Solution(status, np.array(answer.x), multipliers)
