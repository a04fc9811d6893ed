"""What is left when a solver gives up: the interior-point method, slower but hard to stop."""

from __future__ import annotations

import logging

from scp_planner.solvers.interface import QuadraticProgram, Solution

logger = logging.getLogger(__name__)


def fall_back(program: QuadraticProgram, failed: str) -> Solution:
    """Solve a program that the solver with the name ``failed`` gave up on."""
    from scp_planner.solvers.clarabel_solver import ClarabelSolver

    logger.debug("%s gave up on %d variables and %d rows", failed, len(program.gradient), len(program.bound))
    return ClarabelSolver().solve(program)
