"""OSQP: operator splitting. Its progress depends on the scaling, which is therefore ours, and so is the polishing."""

from __future__ import annotations

from dataclasses import replace
from time import perf_counter

import numpy as np
import osqp
from scipy.sparse import csc_matrix

from scp_planner.solvers.interface import QuadraticProgram, Solution, SolverStatus
from scp_planner.solvers.polishing import polish
from scp_planner.solvers.scaling import equilibrate
from scp_planner.solvers.sparse_rows import stacked

# Iterations until the answer is polished. Splitting alone needs thousands, or does not get there, where polishing
# nearly always succeeds after the first round.
_SETTINGS = {
    "verbose": False,
    "scaling": 0,
    "polishing": False,
    "check_termination": 25,
    # Every so many iterations: the clock's choice would make runs differ.
    "adaptive_rho_interval": 100,
    "eps_abs": 1e-9,
    "eps_rel": 1e-9,
    "eps_prim_inf": 1e-6,
    "eps_dual_inf": 1e-6,
}
_STATUS = {
    osqp.SolverStatus.OSQP_SOLVED: SolverStatus.OPTIMAL,
    osqp.SolverStatus.OSQP_PRIMAL_INFEASIBLE: SolverStatus.INFEASIBLE,
    osqp.SolverStatus.OSQP_PRIMAL_INFEASIBLE_INACCURATE: SolverStatus.INFEASIBLE,
}
_GOING_ON = (osqp.SolverStatus.OSQP_MAX_ITER_REACHED, osqp.SolverStatus.OSQP_SOLVED_INACCURATE)


class OsqpSolver:
    """Adapter of :class:`osqp.OSQP`: a new one for each program, as a used one starts from its last answer."""

    name = "osqp"

    def solve(self, program: QuadraticProgram) -> Solution:
        """Solve one quadratic program."""
        deadline = perf_counter() + program.time_limit
        scaling = equilibrate(program)
        scaled = scaling.program
        solver = _set_up(scaled)
        solution = Solution(
            SolverStatus.FAILED, np.zeros(len(program.gradient)), np.zeros(len(program.gradient) + len(program.bound))
        )
        for iterations in (250, 1000, 4000):
            left = deadline - perf_counter()
            if left <= 0.0:
                solution = replace(solution, status=SolverStatus.FAILED)
                break
            solver.update_settings(max_iter=iterations, time_limit=left)
            answer = solver.solve(raise_error=False)
            reached = answer.info.status_val
            solution = Solution(_STATUS.get(reached, SolverStatus.FAILED), np.array(answer.x), np.array(answer.y))
            if solution.status is SolverStatus.INFEASIBLE:
                return scaling.original(solution)
            polished = polish(scaled, solution, deadline)
            if polished is not None:
                return scaling.original(polished)
            if reached not in _GOING_ON:
                break
        return scaling.original(solution)


def _set_up(program: QuadraticProgram) -> osqp.OSQP:
    size, (lower, upper) = len(program.gradient), program.all_bounds(-np.inf)
    solver = osqp.OSQP()
    solver.setup(
        csc_matrix(np.triu(program.hessian)),
        program.gradient.copy(),  # the package keeps what it is given, and writes to it
        stacked(program.matrix, np.arange(size), np.arange(len(program.bound))),
        lower,
        upper,
        **_SETTINGS,
    )
    return solver
