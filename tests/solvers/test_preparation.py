"""Programs that cannot be prepared within their limit of time are refused before that is begun."""

from __future__ import annotations

from dataclasses import replace
from typing import NoReturn

import daqp
import numpy as np
import pytest

from scp_planner.solvers import clarabel_solver
from scp_planner.solvers.clarabel_solver import ClarabelSolver
from scp_planner.solvers.daqp_solver import DaqpSolver
from scp_planner.solvers.interface import QpSolver, QuadraticProgram, SolverStatus
from scp_planner.solvers.preparation import dense_preparation, sparse_preparation


def program(rows: int, columns: int) -> QuadraticProgram:
    """Minimise about the origin, which keeps all rows."""
    rng = np.random.default_rng(0)
    hessian, upper = np.eye(columns) + 0.01, np.ones(columns)
    return QuadraticProgram(
        hessian, 0.1 * np.ones(columns), -upper, upper, rng.normal(size=(rows, columns)), np.full(rows, 10.0), 0
    )


def never(*_: object, **__: object) -> NoReturn:
    raise AssertionError("it was begun")


@pytest.mark.parametrize("solver", [DaqpSolver(), ClarabelSolver()], ids=lambda solver: solver.name)
def test_what_cannot_be_prepared_in_time_is_not_begun(solver: QpSolver, monkeypatch: pytest.MonkeyPatch) -> None:
    large = replace(program(400, 100), time_limit=1e-3)
    with monkeypatch.context() as context:
        context.setattr(daqp, "solve", never)
        context.setattr(clarabel_solver, "equilibrate_sparse", never)
        answer = solver.solve(large)
    assert answer.status is SolverStatus.FAILED
    assert (answer.x.shape, answer.multipliers.shape) == ((100,), (500,))
    assert solver.solve(replace(large, time_limit=10.0)).status is SolverStatus.OPTIMAL


def test_what_is_large_takes_longer_than_it_has() -> None:
    """A program of 5,545 rows and 771 columns took DAQP 5 s before its first iteration, with a limit of one."""
    wide = replace(program(1, 771), matrix=np.ones((5545, 771)))
    assert 3.0 < dense_preparation(wide) < 10.0
    small = replace(program(1, 218), matrix=np.ones((3086, 218)))
    assert dense_preparation(small) < 0.2
    assert dense_preparation(replace(small, hessian=np.eye(218))) == 0.0
    # With the slacks of its obstacles it is sparse, and what interior-point methods factorise smaller.
    sparse = wide.matrix.copy()
    sparse[:, 150:] = 0.0
    assert sparse_preparation(replace(wide, matrix=sparse)) < 0.1 * sparse_preparation(wide)
