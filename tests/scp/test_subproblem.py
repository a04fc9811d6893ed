"""What one subproblem's solution is worth."""

from __future__ import annotations

from typing import Any

import cvxpy as cp
import numpy as np
import pytest
from scenes import CROSSERS, scene

import scp_planner as sp
from scp_planner.constraints.drive import DriveRows
from scp_planner.problem.build import build_problem
from scp_planner.scp.evaluation import evaluate_trip
from scp_planner.scp.linearisation import TrustRegion, linearise
from scp_planner.scp.loop import ScpLoop
from scp_planner.scp.subproblem import build_subproblem
from scp_planner.search.first_trips import bows
from scp_planner.solvers import solver_named

pytestmark = pytest.mark.numerics
PROBLEM = build_problem(scene(*CROSSERS), sp.zones(scene(*CROSSERS)), sp.Settings())
START = next(iter(bows(PROBLEM)))


def test_a_step_is_the_solution_of_its_program_inside_the_trust_region() -> None:
    trust, drive = TrustRegion(0.5, 1.0, 0.2), DriveRows(PROBLEM)
    rows = linearise(PROBLEM, evaluate_trip(PROBLEM, START), trust)
    weights = np.full(sum(PROBLEM.sizes), 5.0)
    sub = build_subproblem(PROBLEM, drive, START, rows, weights, trust)
    program = sub.program.whole()
    x = cp.Variable(len(program.gradient))
    left = program.matrix @ x - program.bound
    constraints: list[Any] = [x >= program.lower, x <= program.upper, left[:1] == 0, left[1:] <= 0]
    wanted = cp.Problem(
        cp.Minimize(0.5 * cp.quad_form(x, cp.psd_wrap(program.hessian)) + program.gradient @ x),  # type: ignore[attr-defined]
        constraints,
    ).solve(solver="CLARABEL")  # type: ignore[no-untyped-call]
    z = solver_named("daqp").solve(program).x
    assert 0.5 * z @ program.hessian @ z + program.gradient @ z == pytest.approx(wanted, rel=1e-6, abs=1e-7)
    free = PROBLEM.ends.free
    count = free.stop - free.start
    assert np.all(np.abs(z[:count]) <= trust.theta * PROBLEM.space.tables.leverage[free] + 1e-9)
    assert abs(z[sub.step_size - 1]) <= trust.rho + 1e-9
    # A second call writes into its own program, not into the first one's
    before = program.matrix.copy()
    build_subproblem(
        PROBLEM,
        drive,
        ScpLoop(PROBLEM, solver_named("daqp")).run(START, 1).evaluation.trajectory,
        rows,
        weights,
        trust,
    )
    np.testing.assert_array_equal(sub.program.whole().matrix, before)
