"""Quadratic programs with known answers, through all solvers."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from time import perf_counter
from types import SimpleNamespace
from typing import Any

import clarabel
import numpy as np
import osqp
import pytest
from scenes import CROSSERS, scene

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
    StepOrigin,
    daqp_solver,
    solver_named,
)
from scp_planner.solvers.interface import LONGEST_SOLVE, SOLVERS
from scp_planner.solvers.polishing import polish
from scp_planner.solvers.scaling import equilibrate
from scp_planner.threat_zones.of_scenario import zones

pytestmark = pytest.mark.numerics

Array = np.ndarray
NAMES = tuple(SOLVERS)
SEEDS = range(12)


@pytest.fixture(params=NAMES)
def solver(request: pytest.FixtureRequest) -> QpSolver:
    return solver_named(request.param)


def known_program(
    seed: int,
    *,
    weak: bool = False,
    scale: float = 0.0,
    size: int | None = None,
    rows: int | None = None,
    equalities: int | None = None,
) -> tuple[QuadraticProgram, Array]:
    """A strictly convex program made from its answer: x, active constraints and multipliers first, the gradient last.

    With ``weak`` a third of the active constraints has no multiplier; with ``scale`` every variable and row is
    multiplied by a random power of ten up to this one.
    """
    rng = np.random.default_rng(seed)
    size = int(rng.integers(3, 40)) if size is None else size
    rows = int(rng.integers(3, 100)) if rows is None else rows
    equalities = int(rng.integers(0, 3)) if equalities is None else equalities
    turn = np.linalg.qr(rng.normal(size=(size, size)))[0]
    hessian = (turn * np.geomspace(1e-3, 1.0, size)) @ turn.T
    matrix = rng.normal(size=(rows, size))
    x = rng.normal(size=size)
    values = np.concatenate([x, matrix @ x])
    upper = values + rng.uniform(0.1, 2.0, size + rows)
    lower = x - rng.uniform(0.1, 2.0, size)
    upper[size : size + equalities] = values[size : size + equalities]
    multipliers = np.zeros(size + rows)
    multipliers[size : size + equalities] = rng.normal(size=equalities)
    others = np.concatenate([np.arange(size), np.arange(size + equalities, size + rows)])
    for count, index in enumerate(rng.permutation(others)[: int(rng.integers(0, size - equalities))]):
        price = 0.0 if weak and count % 3 == 0 else rng.uniform(0.1, 2.0)
        if index < size and rng.random() < 0.5:
            lower[index], multipliers[index] = x[index], -price
        else:
            upper[index], multipliers[index] = values[index], price
    gradient = -(hessian @ x + multipliers[:size] + matrix.T @ multipliers[size:])
    column, row = 10.0 ** rng.uniform(-scale, scale, size), 10.0 ** rng.uniform(-scale, scale, rows)
    program = QuadraticProgram(
        hessian * column * column[:, None],
        gradient * column,
        lower / column,
        upper[:size] / column,
        matrix * column * row[:, None],
        upper[size:] * row,
        equalities,
    )
    return program, x / column


def box(size: int, radius: float = 1.0) -> QuadraticProgram:
    """Nearest point to (2, 2, ...) in a box around 0, without rows."""
    return QuadraticProgram(
        np.eye(size),
        np.full(size, -2.0),
        np.full(size, -radius),
        np.full(size, radius),
        np.zeros((0, size)),
        np.zeros(0),
        0,
    )


def with_rows(program: QuadraticProgram, matrix: list[list[float]], bound: list[float], equalities: int = 0) -> Any:
    return replace(program, matrix=np.array(matrix, dtype=float), bound=np.array(bound), equalities=equalities)


def optimality(program: QuadraticProgram, solution: Solution) -> float:
    """Largest residual of the Karush-Kuhn-Tucker conditions."""
    x, size = solution.x, len(solution.x)
    on_bounds, on_rows = solution.multipliers[:size], solution.multipliers[size:]
    stationary = program.hessian @ x + program.gradient + on_bounds + program.matrix.T @ on_rows
    left = program.bound - program.matrix @ x
    equal, loose = left[: program.equalities], left[program.equalities :]
    prices = on_rows[program.equalities :]
    return max(
        float(np.abs(part).max(initial=0.0))
        for part in (
            stationary,
            equal,
            np.minimum(loose, 0.0),
            np.minimum(prices, 0.0),
            prices * loose,
            np.minimum(program.upper - x, 0.0),
            np.minimum(x - program.lower, 0.0),
            np.maximum(on_bounds, 0.0) * (program.upper - x),
            np.minimum(on_bounds, 0.0) * (x - program.lower),
        )
    )


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


INFEASIBLE_PROGRAM = with_rows(box(2), [[1, 1]], [-3.0])


@pytest.mark.parametrize("flag", range(-8, 3))
def test_every_status_of_daqp_is_mapped(monkeypatch: pytest.MonkeyPatch, flag: int) -> None:
    answer = (np.zeros(2), 0.0, flag, {"lam": np.zeros(3)})
    monkeypatch.setattr("daqp.solve", lambda *_, **__: answer)
    expected = {1: SolverStatus.OPTIMAL, 2: SolverStatus.OPTIMAL, -1: SolverStatus.INFEASIBLE}
    expected[-6] = SolverStatus.INFEASIBLE  # of the equalities alone, as nothing else is taken as active here
    assert solver_named("daqp").solve(INFEASIBLE_PROGRAM).status is expected.get(flag, SolverStatus.FAILED)


@pytest.mark.parametrize("status", [name for name in dir(clarabel.SolverStatus) if name[0].isupper()])
def test_every_status_of_clarabel_is_mapped(monkeypatch: pytest.MonkeyPatch, status: str) -> None:
    class Stub:
        def __init__(self, hessian: Any, gradient: Array, matrix: Any, bound: Array, *_: Any) -> None:
            self._sizes = len(gradient), len(bound)

        def solve(self) -> SimpleNamespace:
            size, rows = self._sizes
            return SimpleNamespace(
                status=getattr(clarabel.SolverStatus, status), x=np.zeros(size), z=np.zeros(rows), s=np.zeros(rows)
            )

    monkeypatch.setattr("clarabel.DefaultSolver", Stub)
    expected = {
        "Solved": SolverStatus.OPTIMAL,
        "AlmostSolved": SolverStatus.OPTIMAL,
        "PrimalInfeasible": SolverStatus.INFEASIBLE,
        "AlmostPrimalInfeasible": SolverStatus.INFEASIBLE,
    }
    assert solver_named("clarabel").solve(INFEASIBLE_PROGRAM).status is expected.get(status, SolverStatus.FAILED)


@pytest.mark.parametrize("status", list(osqp.SolverStatus), ids=lambda status: status.name)
def test_every_status_of_osqp_is_mapped(monkeypatch: pytest.MonkeyPatch, status: osqp.SolverStatus) -> None:
    def answer(*_: Any, **__: Any) -> SimpleNamespace:
        return SimpleNamespace(x=np.zeros(2), y=np.zeros(3), info=SimpleNamespace(status_val=int(status)))

    monkeypatch.setattr("osqp.OSQP.solve", answer)
    expected = {
        osqp.SolverStatus.OSQP_SOLVED: SolverStatus.OPTIMAL,
        osqp.SolverStatus.OSQP_PRIMAL_INFEASIBLE: SolverStatus.INFEASIBLE,
        osqp.SolverStatus.OSQP_PRIMAL_INFEASIBLE_INACCURATE: SolverStatus.INFEASIBLE,
    }
    assert solver_named("osqp").solve(INFEASIBLE_PROGRAM).status is expected.get(status, SolverStatus.FAILED)


@pytest.mark.parametrize(
    ("status", "expected"),
    [
        ("infeasible", SolverStatus.INFEASIBLE),
        ("infeasible_inaccurate", SolverStatus.INFEASIBLE),
        ("unbounded", SolverStatus.FAILED),
        ("unbounded_inaccurate", SolverStatus.FAILED),
        ("infeasible_or_unbounded", SolverStatus.FAILED),
        ("optimal_inaccurate", SolverStatus.FAILED),
        ("user_limit", SolverStatus.FAILED),
        ("solver_error", SolverStatus.FAILED),
    ],
)
def test_every_status_of_cvxpy_is_mapped(monkeypatch: pytest.MonkeyPatch, status: str, expected: SolverStatus) -> None:
    import cvxpy as cp

    monkeypatch.setattr(cp.Problem, "solve", lambda *_, **__: None)
    monkeypatch.setattr(cp.Problem, "status", status)
    assert solver_named("cvxpy").solve(INFEASIBLE_PROGRAM).status is expected


def test_cvxpy_answer_that_breaks_a_row_is_not_optimal(monkeypatch: pytest.MonkeyPatch) -> None:
    import cvxpy as cp

    def careless(problem: cp.Problem, **_: Any) -> None:
        for variable in problem.variables():
            variable.save_value(np.zeros(variable.shape))
        for constraint in problem.constraints:
            constraint.save_dual_value(np.zeros(constraint.shape))

    monkeypatch.setattr(cp.Problem, "solve", careless)
    monkeypatch.setattr(cp.Problem, "status", "optimal")
    assert solver_named("cvxpy").solve(INFEASIBLE_PROGRAM).status is SolverStatus.FAILED


def test_cvxpy_solver_that_raises_has_failed(monkeypatch: pytest.MonkeyPatch) -> None:
    import cvxpy as cp

    def broken(*_: Any, **__: Any) -> None:
        raise cp.SolverError("nothing works today")

    monkeypatch.setattr(cp.Problem, "solve", broken)
    solution = solver_named("cvxpy").solve(box(2))
    assert solution.status is SolverStatus.FAILED
    assert not solution.x.any()


def test_unknown_solver_is_refused_with_the_known_ones() -> None:
    with pytest.raises(ValueError, match=r"'gurobi'.*daqp, clarabel, osqp, cvxpy"):
        solver_named("gurobi")


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


def test_cvxpy_is_compiled_once_for_programs_of_about_the_same_size() -> None:
    from scp_planner.solvers.cvxpy_solver import CvxpySolver

    written = []

    def extra(values: Any) -> list[Any]:
        written.append(values.shape)
        return []

    solver = CvxpySolver(extra=extra)
    for seed, (size, rows) in enumerate([(33, 101), (40, 110), (36, 105), (38, 112)]):
        program, x = known_program(seed, size=size, rows=rows, equalities=1)
        solution = solver.solve(replace(program, origin=StepOrigin(np.zeros(30), np.ones(30))))
        assert solution.status is SolverStatus.OPTIMAL
        assert solution.x == pytest.approx(x, abs=1e-5)  # not polished, as polishing does not know extra constraints
    assert written == [(30,)]


def test_only_the_chosen_solver_is_imported() -> None:
    code = (
        "import sys; from scp_planner.solvers import solver_named; solver_named('daqp');"
        "print(sorted({'cvxpy', 'osqp', 'clarabel'} & set(sys.modules)))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


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


@pytest.mark.parametrize("seed", SEEDS)
def test_polish_completes_a_rough_answer(seed: int) -> None:
    program, x = known_program(seed)
    exact = solver_named("daqp").solve(program)
    rng = np.random.default_rng(seed)
    rough = Solution(
        SolverStatus.FAILED,
        exact.x + 1e-3 * rng.normal(size=len(x)),
        exact.multipliers + 1e-3 * rng.normal(size=len(exact.multipliers)),
    )
    polished = polish(program, rough)
    assert polished is not None
    assert polished.status is SolverStatus.OPTIMAL
    assert polished.x == pytest.approx(x, abs=1e-9)


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


def long_program() -> QuadraticProgram:
    """A program whose minimiser lies in a corner of many rows, far from where a solver begins."""
    rng = np.random.default_rng(0)
    size, rows = 60, 600
    return QuadraticProgram(
        1e-3 * np.eye(size),
        100.0 * rng.normal(size=size),
        np.full(size, -np.inf),
        np.full(size, np.inf),
        rng.normal(size=(rows, size)),
        np.abs(rng.normal(size=rows)) + 0.1,
        0,
    )


def test_a_solver_that_has_no_time_left_fails(solver: QpSolver) -> None:
    program = long_program()
    assert solver.solve(program).status is SolverStatus.OPTIMAL
    assert solver.solve(replace(program, time_limit=1e-6)).status is SolverStatus.FAILED


def test_daqp_ends_at_its_limit_of_iterations(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(daqp_solver._SETTINGS, "iter_limit", 50)
    assert solver_named("daqp").solve(long_program()).status is SolverStatus.FAILED


class _Watched:
    """DAQP that notes the limits of time that it is given."""

    name = "watched"

    def __init__(self) -> None:
        self.limits: list[float] = []

    def solve(self, program: QuadraticProgram) -> Solution:
        self.limits.append(program.time_limit)
        return solver_named("daqp").solve(program)


def test_what_is_left_until_the_deadline_is_the_limit_of_the_solver() -> None:
    scenario = scene(*CROSSERS)
    problem, solver = build_problem(scenario, zones(scenario), Settings()), _Watched()
    start, loop = next(iter(bows(problem))), ScpLoop(problem, solver)
    loop.run(start, 3)
    assert set(solver.limits) == {LONGEST_SOLVE}
    solver.limits.clear()
    loop.run(start, 3, deadline=perf_counter() + 0.5 * LONGEST_SOLVE)
    assert solver.limits
    assert all(0.0 < limit <= 0.5 * LONGEST_SOLVE for limit in solver.limits)
    assert np.all(np.diff(solver.limits) < 0.0)


def test_what_daqp_did_not_write_is_a_failure_and_no_warning(monkeypatch: pytest.MonkeyPatch) -> None:
    """Memory may hold numbers that are none and signal that to whoever adds them up."""
    signalling = np.full(3, 0x7FF0000000000001, dtype=np.uint64).view(float)

    def unwritten(*_: Any, **__: Any) -> tuple[Array, float, int, dict[str, Array]]:
        return np.zeros(2), 0.0, 1, {"lam": signalling}

    monkeypatch.setattr("daqp.solve", unwritten)
    program = QuadraticProgram(
        np.eye(2), np.ones(2), -np.ones(2), np.ones(2), np.ones((1, 2)), np.ones(1), 0, time_limit=LONGEST_SOLVE
    )
    found = solver_named("daqp").solve(program)
    assert found.status is SolverStatus.FAILED
    assert np.isfinite(found.multipliers).all()
