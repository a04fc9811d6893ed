"""Solvers for the convex subproblem, behind one function.

May import arrays and errors alone. Begin with `interface`.
"""

from __future__ import annotations

from scp_planner.solvers.interface import QpSolver, QuadraticProgram, Solution, SolverStatus, StepOrigin, solver_named

__all__ = ["QpSolver", "QuadraticProgram", "Solution", "SolverStatus", "StepOrigin", "solver_named"]
