"""The solver of the subproblems, with another one to fall back on, within what is left of the time."""

from __future__ import annotations

from dataclasses import dataclass, replace
from time import perf_counter

from scp_planner.solvers.interface import QpSolver, Solution, SolverStatus, solver_named
from scp_planner.solvers.slacked import SlackedProgram
from scp_planner.solvers.working_rows import solved_with_few_rows


@dataclass(frozen=True)
class StepSolver:
    """Solves subproblems."""

    solver: QpSolver
    fallback: str | None  # name of the solver to try when the solver fails
    shortest: float  # wall time that a solver is given at least, s

    def solve(self, program: SlackedProgram, deadline: float) -> Solution | None:
        """Return the step, or None; a solver has what is left of the time, or else of its own limit."""
        solution = self._solved(self.solver, program, deadline)
        if solution.status is SolverStatus.FAILED and self.fallback is not None and perf_counter() < deadline:
            solution = self._solved(solver_named(self.fallback), program, deadline)
        return solution if solution.status is SolverStatus.OPTIMAL else None

    def _solved(self, solver: QpSolver, program: SlackedProgram, deadline: float) -> Solution:
        left = max(deadline - perf_counter(), self.shortest)
        limited = program if left >= program.time_limit else replace(program, time_limit=left)
        return solved_with_few_rows(limited, solver.solve)
