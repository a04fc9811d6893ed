"""Quadratic programs with known answers, through all solvers."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from programs import SEEDS, box, known_program, long_program, optimality, with_rows

from scp_planner.problem.build import build_problem
from scp_planner.scenario.models import Scenario
from scp_planner.scp.loop import ScpLoop
from scp_planner.search.first_trips import bows
from scp_planner.settings.planning import Settings
from scp_planner.solvers import (
    QpSolver,
    QuadraticProgram,
    Solution,
    SolverStatus,
    solver_named,
)
from scp_planner.solvers.interface import SOLVERS
from scp_planner.threat_zones.of_scenario import zones

pytestmark = pytest.mark.numerics

NAMES = tuple(SOLVERS)


@pytest.fixture(params=NAMES)
def solver(request: pytest.FixtureRequest) -> QpSolver:
    return solver_named(request.param)


@pytest.mark.parametrize("weak", [False, True], ids=["strict", "degenerate"])
@pytest.mark.parametrize("seed", SEEDS)
def test_solve_finds_the_known_answer(solver: QpSolver, seed: int, weak: bool) -> None:
    program, x = known_program(seed, weak=weak)
    solution = solver.solve(program)
    assert solution.status is SolverStatus.OPTIMAL
    assert solution.x == pytest.approx(x, abs=1e-6)
    assert optimality(program, solution) < 1e-7


@pytest.mark.parametrize("seed", SEEDS)
def test_solve_bears_bad_scaling(solver: QpSolver, seed: int) -> None:
    program, x = known_program(seed, scale=2.0)
    solution = solver.solve(program)
    assert solution.status is SolverStatus.OPTIMAL
    assert np.abs(solution.x - x) == pytest.approx(np.zeros(len(x)), abs=1e-6 * max(1.0, float(np.abs(x).max())))


@pytest.mark.parametrize("seed", SEEDS)
def test_solve_with_equalities_only(solver: QpSolver, seed: int) -> None:
    program, _ = known_program(seed, size=9, rows=4, equalities=4)
    program = replace(program, lower=np.full(9, -1e3), upper=np.full(9, 1e3))
    # Minimiser on a plane by elimination, x = particular + kernel w
    _, _, rotation = np.linalg.svd(program.matrix)
    kernel = rotation[4:].T
    particular = np.linalg.lstsq(program.matrix, program.bound, rcond=None)[0]
    w = np.linalg.solve(
        kernel.T @ program.hessian @ kernel, -kernel.T @ (program.gradient + program.hessian @ particular)
    )
    solution = solver.solve(program)
    assert solution.status is SolverStatus.OPTIMAL
    assert solution.x == pytest.approx(particular + kernel @ w, abs=1e-6)


def test_solve_without_rows(solver: QpSolver) -> None:
    solution = solver.solve(box(3))
    assert solution.status is SolverStatus.OPTIMAL
    assert solution.x == pytest.approx(np.ones(3), abs=1e-9)
    assert solution.multipliers == pytest.approx(np.ones(3), abs=1e-9)


def test_solve_without_bounds(solver: QpSolver) -> None:
    program = with_rows(box(3, np.inf), [[1, 1, 1], [1, 0, 0]], [3.0, np.inf])
    solution = solver.solve(program)
    assert solution.status is SolverStatus.OPTIMAL
    assert solution.x == pytest.approx(np.ones(3), abs=1e-9)
    assert solution.multipliers == pytest.approx([0, 0, 0, 1, 0], abs=1e-9)


def test_solve_with_a_fixed_variable(solver: QpSolver) -> None:
    program = with_rows(box(2, 5.0), [[1, 1]], [3.0])
    program = replace(program, lower=np.array([0.5, -5.0]), upper=np.array([0.5, 5.0]))
    solution = solver.solve(program)
    assert solution.status is SolverStatus.OPTIMAL
    assert solution.x == pytest.approx([0.5, 2.0], abs=1e-9)


def test_solve_with_rows_that_depend_on_each_other(solver: QpSolver) -> None:
    rows = [[1.0, 1.0], [1.0, 1.0], [2.0, 2.0], [1.0, 0.0], [0.0, 1.0]]
    solution = solver.solve(with_rows(box(2, 5.0), rows, [2.0, 2.0, 4.0, 1.0, 1.0]))
    assert solution.status is SolverStatus.OPTIMAL
    assert solution.x == pytest.approx([1.0, 1.0], abs=1e-8)


@pytest.mark.parametrize(
    "program",
    [
        with_rows(box(2), [[1, 1]], [-3.0]),
        with_rows(box(2), [[1, 1], [-1, -1]], [-0.5, 0.4]),
        with_rows(box(2), [[1, 1], [1, 1]], [0.0, 1.0], 2),
        with_rows(box(2), [[1, -1], [1, 1]], [0.0, -2.1], 1),
    ],
    ids=["beyond the bounds", "rows apart", "equalities apart", "equality and row apart"],
)
def test_solve_reports_an_infeasible_program(solver: QpSolver, program: QuadraticProgram) -> None:
    assert solver.solve(program).status is SolverStatus.INFEASIBLE


@pytest.mark.parametrize("seed", range(6))
def test_solve_reports_random_infeasible_programs(solver: QpSolver, seed: int) -> None:
    program, _ = known_program(seed)
    # By Farkas: a positive combination of rows that bounds nothing from below, asked to be negative
    rng = np.random.default_rng(seed)
    last = -(rng.uniform(0.2, 1.0, len(program.bound)) @ program.matrix)
    share = np.abs(last) @ np.maximum(program.upper, -program.lower)
    program = replace(
        program,
        matrix=np.concatenate([program.matrix, last[None]]),
        bound=np.append(program.bound, -share - 1.0),
    )
    assert solver.solve(program).status is SolverStatus.INFEASIBLE


def test_same_program_gives_the_same_bits(solver: QpSolver) -> None:
    first, second = known_program(1)[0], known_program(2)[0]
    before = solver.solve(first)
    solver.solve(second)
    again = solver.solve(first)
    fresh = solver_named(solver.name).solve(first)
    for other in (again, fresh):
        assert other.status is before.status
        assert np.array_equal(other.x, before.x)
        assert np.array_equal(other.multipliers, before.multipliers)


def test_solve_leaves_the_program_alone(solver: QpSolver) -> None:
    program, _ = known_program(3)
    kept = {name: np.copy(value) for name, value in vars(program).items() if isinstance(value, np.ndarray)}
    solution = solver.solve(program)
    solver.solve(known_program(4)[0])
    for name, value in kept.items():
        assert np.array_equal(getattr(program, name), value), name
    assert not any(np.shares_memory(solution.x, getattr(program, name)) for name in kept)


def test_unknown_solver_is_refused_with_the_known_ones() -> None:
    with pytest.raises(ValueError, match=r"'gurobi'.*daqp, clarabel, osqp, cvxpy"):
        solver_named("gurobi")


def test_only_the_chosen_solver_is_imported() -> None:
    code = (
        "import sys; from scp_planner.solvers import solver_named; solver_named('daqp');"
        "print(sorted({'cvxpy', 'osqp', 'clarabel'} & set(sys.modules)))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


class _Recorder:
    """Solves with daqp and keeps the programs."""

    name = "recorder"

    def __init__(self) -> None:
        self.inner = solver_named("daqp")
        self.programs: list[QuadraticProgram] = []

    def solve(self, program: QuadraticProgram) -> Solution:
        arrays: dict[str, Any] = {
            name: np.copy(value) for name, value in vars(program).items() if isinstance(value, np.ndarray)
        }
        self.programs.append(replace(program, **arrays))
        return self.inner.solve(program)


@pytest.fixture(scope="module")
def programs_of_the_loop(reference_scenarios: Path) -> list[QuadraticProgram]:
    """Every third program of runs from two bows each."""
    recorder = _Recorder()
    for name in ("crossing5-4", "headon-2", "crossing20-0"):
        scenario = Scenario.load(reference_scenarios / f"{name}.json")
        problem = build_problem(scenario, zones(scenario), Settings())
        for start in list(bows(problem))[:2]:
            ScpLoop(problem, recorder).run(start, 15)
    assert len(recorder.programs) > 30
    return recorder.programs[::3]


def test_solvers_agree_on_the_programs_of_the_loop(
    solver: QpSolver, programs_of_the_loop: list[QuadraticProgram]
) -> None:
    reference = solver_named("daqp")
    for program in programs_of_the_loop:
        expected, solution = reference.solve(program), solver.solve(program)
        assert solution.status is expected.status
        if expected.status is SolverStatus.OPTIMAL:
            assert solution.x == pytest.approx(expected.x, abs=1e-9)
            assert optimality(program, solution) < 1e-9


def test_a_solver_that_has_no_time_left_fails(solver: QpSolver) -> None:
    program = long_program()
    assert solver.solve(program).status is SolverStatus.OPTIMAL
    assert solver.solve(replace(program, time_limit=1e-6)).status is SolverStatus.FAILED
