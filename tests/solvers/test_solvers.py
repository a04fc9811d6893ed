"""Quadratic programs with known answers, through all solvers."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from memory import traced
from programs import INFEASIBLE_PROGRAM, SEEDS, box, known_program, long_program, optimality, with_rows

from scp_planner.problem.build import build_problem
from scp_planner.scenario.models import Scenario
from scp_planner.scp.loop import ScpLoop
from scp_planner.search.first_trips import arcs
from scp_planner.settings.planning import Settings
from scp_planner.solvers import (
    QpSolver,
    QuadraticProgram,
    Solution,
    SolverStatus,
    StepOrigin,
    solver_named,
)
from scp_planner.solvers.interface import LONGEST_SOLVE, SOLVERS
from scp_planner.solvers.polishing import polish
from scp_planner.solvers.scaling import equilibrate
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


BY_HAND = {
    "without rows": (box(3), [1, 1, 1], [1, 1, 1]),
    "without bounds": (with_rows(box(3, np.inf), [[1, 1, 1], [1, 0, 0]], [3.0, np.inf]), [1, 1, 1], [0, 0, 0, 1, 0]),
    "with a fixed variable": (
        replace(with_rows(box(2, 5.0), [[1, 1]], [3.0]), lower=np.array([0.5, -5.0]), upper=np.array([0.5, 5.0])),
        [0.5, 2.0],
        None,
    ),
    "with rows that depend on each other": (
        with_rows(box(2, 5.0), [[1, 1], [1, 1], [2, 2], [1, 0], [0, 1]], [2.0, 2.0, 4.0, 1.0, 1.0]),
        [1, 1],
        None,
    ),
}


@pytest.mark.parametrize("name", BY_HAND)
def test_programs_that_are_solved_by_hand(solver: QpSolver, name: str) -> None:
    program, x, multipliers = BY_HAND[name]
    solution = solver.solve(program)
    assert solution.status is SolverStatus.OPTIMAL
    assert solution.x == pytest.approx(np.array(x, dtype=float), abs=1e-8)
    assert multipliers is None or solution.multipliers == pytest.approx(np.array(multipliers, dtype=float), abs=1e-9)


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
    """Every third program of runs from two arcs each."""
    recorder = _Recorder()
    for name in ("crossing5-4", "headon-2", "crossing20-0"):
        scenario = Scenario.load(reference_scenarios / f"{name}.json")
        problem = build_problem(scenario, zones(scenario), Settings())
        for start in list(arcs(problem))[:2]:
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


# CVXPY: other solvers behind it, and constraints of a user


def test_unknown_solver_of_cvxpy_is_refused_with_the_installed_ones() -> None:
    from scp_planner.solvers.cvxpy_solver import CvxpySolver

    with pytest.raises(ValueError, match=r"'nonsense'.*CLARABEL"):
        CvxpySolver(solver="nonsense")


@pytest.mark.parametrize("inner", ["OSQP", "SCS"])
def test_cvxpy_opens_other_solvers(inner: str) -> None:
    from scp_planner.solvers.cvxpy_solver import CvxpySolver

    program, x = known_program(5, size=12, rows=30, equalities=1)
    solution = CvxpySolver(solver=inner).solve(program)
    assert solution.status is SolverStatus.OPTIMAL
    assert solution.x == pytest.approx(x, abs=1e-6)


def test_cvxpy_keeps_extra_constraints_on_what_steps_lead_to() -> None:
    import cvxpy

    cp: Any = cvxpy  # whose names come by way of stars

    from scp_planner.solvers.cvxpy_solver import CvxpySolver

    # Nearest point to (2, 2, 2, 2) with a cone on what the first two variables lead to, (0.5 + x, 2 x)
    origin = StepOrigin(np.array([0.5, 0.0]), np.array([1.0, 2.0]))
    program = replace(box(4, 3.0), origin=origin)
    solution = CvxpySolver(extra=lambda values: [cp.norm(values) <= 1.0]).solve(program)
    assert solution.status is SolverStatus.OPTIMAL
    assert solution.x[2:] == pytest.approx([2.0, 2.0], abs=1e-6)
    # The nearest point of an ellipse, by its angle
    angle = np.linspace(0.0, np.pi, 2_000_001)
    outline = np.stack([np.cos(angle) - 0.5, np.sin(angle) / 2.0], axis=1)
    nearest = outline[np.argmin(np.sum((outline - 2.0) ** 2, axis=1))]
    assert solution.x[:2] == pytest.approx(nearest, abs=1e-5)

    impossible = CvxpySolver(extra=lambda values: [values[0] >= 4.0]).solve(program)
    assert impossible.status is SolverStatus.INFEASIBLE


# DAQP: warm starts, its status, its limits


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("guess", ["right", "wrong", "everything", "nothing"])
def test_daqp_takes_any_guess_of_the_active_constraints(seed: int, guess: str) -> None:
    program, x = known_program(seed, weak=True)
    solver = solver_named("daqp")
    right = np.sign(np.round(solver.solve(program).multipliers, 9)).astype(np.int8)
    active = {
        "right": right,
        "wrong": np.where(right == 0, np.random.default_rng(seed).integers(-1, 2, len(right)), 0).astype(np.int8),
        "everything": np.ones(len(right), dtype=np.int8),
        "nothing": np.zeros(len(right), dtype=np.int8),
    }[guess]
    active[len(x) :] = np.maximum(active[len(x) :], 0)  # rows have one side
    solution = solver.solve(replace(program, active=active))
    assert solution.status is SolverStatus.OPTIMAL
    assert solution.x == pytest.approx(x, abs=1e-8)


@pytest.mark.parametrize("guess", ["none", "everything"])
def test_programs_of_very_many_rows_may_take_many_iterations(guess: str) -> None:
    """On the border of a ball, each of whose 3,000 tangents may become active on the way to the minimiser."""
    rng = np.random.default_rng(0)
    size, rows = 100, 3000
    normals = rng.normal(size=(rows, size))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    program = QuadraticProgram(
        1e-3 * np.eye(size),
        rng.normal(size=size),
        np.full(size, -10.0),
        np.full(size, 10.0),
        normals,
        1.0 + rng.uniform(0.0, 0.02, rows),
        0,
        active=None if guess == "none" else np.ones(size + rows, dtype=np.int8),
        time_limit=LONGEST_SOLVE,
    )
    solution = solver_named("daqp").solve(program)
    assert solution.status is SolverStatus.OPTIMAL
    assert optimality(program, solution) < 1e-8


# Polishing, and scaling, of programs and answers


@pytest.mark.parametrize("seed", SEEDS)
def test_equilibrate_evens_out_the_matrix_and_maps_answers_both_ways(seed: int) -> None:
    program, _ = known_program(seed, scale=3.0)
    scaling = equilibrate(program)
    scaled = scaling.program
    columns = np.maximum(np.abs(scaled.hessian / scaling.cost).max(axis=0), np.abs(scaled.matrix).max(axis=0))
    assert columns == pytest.approx(np.ones(len(columns)), abs=0.1)
    assert np.abs(scaled.matrix).max(axis=1) == pytest.approx(np.ones(len(scaled.bound)), abs=0.1)

    solution = solver_named("daqp").solve(scaled)
    back = scaling.original(solution)
    assert scaling.scaled(back).x == pytest.approx(solution.x, rel=1e-12)
    assert scaling.scaled(back).multipliers == pytest.approx(solution.multipliers, rel=1e-12)
    stationary = program.hessian @ back.x + program.gradient + back.multipliers[: len(back.x)]
    stationary += program.matrix.T @ back.multipliers[len(back.x) :]
    # In the units of the gradient, which differ from variable to variable by many powers of ten
    assert stationary * scaling.columns * scaling.cost == pytest.approx(np.zeros(len(back.x)), abs=1e-9)


def test_polish_gives_up_where_rounding_has_made_the_hessian_indefinite() -> None:
    program, _ = known_program(0)
    exact = solver_named("daqp").solve(program)
    steepest = float(np.linalg.eigvalsh(program.hessian)[-1])
    _, ways = np.linalg.eigh(program.hessian)
    weakest = -1e-12 * steepest - float(np.linalg.eigvalsh(program.hessian)[0])
    spoilt = replace(program, hessian=program.hessian + weakest * np.outer(ways[:, 0], ways[:, 0]))
    assert polish(spoilt, exact) is None


@pytest.mark.parametrize("seed", range(40))
def test_polish_mends_even_a_wrong_answer(seed: int) -> None:
    program, x = known_program(seed, weak=True)
    rng = np.random.default_rng(seed)
    nonsense = Solution(SolverStatus.OPTIMAL, rng.normal(size=len(x)), rng.normal(size=len(x) + len(program.bound)))
    polished = polish(program, nonsense)
    assert polished is not None
    assert polished.x == pytest.approx(x, abs=1e-9)


def test_polish_finds_nothing_in_an_infeasible_program() -> None:
    assert polish(INFEASIBLE_PROGRAM, Solution(SolverStatus.OPTIMAL, np.zeros(2), np.zeros(3))) is None


def test_a_large_program_is_not_copied() -> None:
    """By Clarabel with all that goes before and after it: of rows that are mostly zeros only the others are."""
    size, rows = 60, 12_000
    matrix = np.zeros((rows, size))
    matrix[np.arange(rows), np.arange(rows) % size] = 1.0
    matrix[np.arange(rows), (np.arange(rows) // size) % size] += 0.5
    bound = np.where(np.arange(rows) < size, 0.9, 3.0)
    program = replace(box(size), matrix=matrix, bound=bound)
    solution, peak = traced(lambda: solver_named("clarabel").solve(program))
    assert solution.status is SolverStatus.OPTIMAL
    assert optimality(program, solution) < 1e-9
    assert peak < 0.6 * matrix.nbytes
