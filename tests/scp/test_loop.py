"""How runs of the loop end."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from itertools import islice
from typing import Any

import cvxpy as cp
import numpy as np
import pytest
from clock import FakeClock
from scenes import CROSSERS, scene

import scp_planner as sp
from scp_planner.arrays import Array, Index
from scp_planner.constraints.constraint import Constraint
from scp_planner.constraints.drive import DriveRows
from scp_planner.problem.build import build_problem
from scp_planner.scp.evaluation import evaluate_trip
from scp_planner.scp.linearisation import TrustRegion, linearise
from scp_planner.scp.loop import ScpLoop
from scp_planner.scp.parameters import LOOP, LoopParameters
from scp_planner.scp.record import LoopStatus
from scp_planner.scp.step_solver import StepSolver
from scp_planner.scp.subproblem import build_subproblem
from scp_planner.search.first_trips import arcs
from scp_planner.solvers.interface import QpSolver, QuadraticProgram, Solution, SolverStatus, solver_named
from scp_planner.solvers.slacked import SlackedProgram
from scp_planner.trips.path import Path
from scp_planner.trips.trajectory import Trajectory

pytestmark = pytest.mark.numerics
PROBLEM = build_problem(scene(*CROSSERS), sp.zones(scene(*CROSSERS)), sp.Settings())
START = next(iter(arcs(PROBLEM)))


def test_a_run_ends_at_its_limits_and_else_converges(monkeypatch: pytest.MonkeyPatch) -> None:
    FakeClock(1.0).rule(monkeypatch)
    loop = ScpLoop(PROBLEM, solver_named("daqp"))
    whole = loop.run(START, 60)
    assert whole.status is LoopStatus.CONVERGED and whole.feasible
    short = loop.run(START, 2)
    assert short.status is LoopStatus.ITERATION_LIMIT and len(short.record) == 2 < len(whole.record)
    FakeClock(1.0).rule(monkeypatch)
    late = loop.run(START, 60, deadline=-1.0)
    assert late.status is LoopStatus.TIME_LIMIT and late.record == []
    assert late.evaluation.trajectory is START


@pytest.mark.filterwarnings("ignore:overflow", "ignore:invalid", "ignore:divide")
@pytest.mark.parametrize("far", [1e60, 1e150, 1e300, np.nan])
def test_a_run_from_a_path_that_is_no_path_ends(far: float) -> None:
    path = START.path
    theta = path.theta + far * np.cos(3.0 * np.arange(path.theta.size)).reshape(path.theta.shape)
    wild = Trajectory(Path(path.space, theta), START.beta, START.travel_time)
    assert ScpLoop(PROBLEM, solver_named("daqp")).run(wild, 60).status is LoopStatus.SOLVER_FAILED


@pytest.mark.parametrize("spans", [7, 11])
def test_a_run_ends_where_it_goes_the_way_of_a_trip_of_other_splines(spans: int) -> None:
    settings = sp.Settings(acceleration_spans=spans)
    other = build_problem(scene(*CROSSERS), sp.zones(scene(*CROSSERS)), settings)
    rival = ScpLoop(other, solver_named("daqp")).run(next(iter(arcs(other))), 60)
    run = ScpLoop(PROBLEM, solver_named("daqp")).run(START, 60, rival=rival.evaluation)
    assert run.status is LoopStatus.SAME_WAY
    # between the samples that the two have in common it is the way of the rival, too
    times = np.linspace(0.0, 1.0, 101)
    ways = [each.trajectory.at(each.trajectory.space.time_table(times)) for each in (run.evaluation, rival.evaluation)]
    assert np.abs(ways[0].path.position - ways[1].path.position).max() < LOOP.same_way * 1.1


def test_a_run_goes_on_with_the_prices_of_another() -> None:
    first = ScpLoop(PROBLEM, solver_named("daqp")).run(START, 60)
    end, dear = first.evaluation, first.penalties.copied()
    dear.raise_where(dear.weights > 0.0, 600.0)
    known = dear.weights.copy()
    again = ScpLoop(PROBLEM, solver_named("daqp"), penalties=dear).run(end.trajectory, 1)
    assert (dear.weights == known).all(), "those that were given stay as they are"
    assert (again.penalties.weights >= known).all()


@pytest.mark.parametrize("speed", [0.3, 2.4])
def test_runs_arrive_at_the_speed_of_the_goal_to_rounding(speed: float) -> None:
    wanted = scene(*CROSSERS, goal={"speed": speed})
    problem = build_problem(wanted, sp.zones(wanted), sp.Settings())
    for start in islice(arcs(problem), 1, 3):
        run = ScpLoop(problem, solver_named("daqp")).run(start, 60)
        assert run.status is LoopStatus.CONVERGED and run.feasible
        assert run.evaluation.trajectory.final_speed == pytest.approx(problem.ends.goal_speed, abs=1e-6)


def test_a_run_leaves_time_for_what_comes_after_it(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of 20 s it leaves four times what its last iteration took."""
    ended = []
    for spared in (0.0, 4.0):
        clock = FakeClock(1.0)
        clock.rule(monkeypatch)
        loop = ScpLoop(PROBLEM, solver_named("daqp"), parameters=replace(LOOP, spared=spared))
        run = loop.run(START, 60, deadline=20.0)
        assert run.status is LoopStatus.TIME_LIMIT
        ended.append(clock())
        each = ended[-1] / (1 + len(run.record))
    assert ended[0] > 20.0
    assert 20.0 - 5.5 * each < ended[1] <= 20.0 - 3.0 * each


@dataclass(frozen=True)
class Watched(Constraint):
    """A limit that is always kept, and tells each time that trips are evaluated and linearised."""

    name = "watched"

    on_gradient: Callable[[], None] = lambda: None
    evaluated: list[Trajectory] = field(default_factory=list)
    linearised: list[Trajectory] = field(default_factory=list)

    def excess(self, trip: Trajectory) -> Array:
        self.evaluated.append(trip)
        return np.array([-1.0])

    def gradient(self, trip: Trajectory, index: Index) -> Array:
        self.linearised.append(trip)
        self.on_gradient()
        return np.zeros((len(index), PROBLEM.step_size))


def watched(limit: Watched, parameters: LoopParameters = LOOP, solver: QpSolver | None = None) -> ScpLoop:
    problem = replace(PROBLEM, constraints=(*PROBLEM.constraints, limit))
    return ScpLoop(problem, solver or solver_named("daqp"), parameters=parameters)


class Slow:
    """A solver, told of each program."""

    name = "slow"

    def __init__(self, on_solve: Callable[[], None] = lambda: None) -> None:
        self.on_solve = on_solve
        self.solved = 0

    def solve(self, program: QuadraticProgram) -> Solution:
        self.solved += 1
        self.on_solve()
        return solver_named("daqp").solve(program)


@pytest.mark.parametrize("part", ["linearise", "solve"])
def test_an_iteration_ends_between_its_parts_when_the_time_is_up(part: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """The clock stands still but for one part, which takes too long: none of what would follow is begun."""
    clock = FakeClock(0.0)
    clock.rule(monkeypatch)

    def late() -> None:
        clock.tick = 1.0

    limit = Watched(PROBLEM, late) if part == "linearise" else Watched(PROBLEM)
    solver = Slow(late) if part == "solve" else Slow()
    run = watched(limit, solver=solver).run(START, 60, deadline=0.5)
    assert run.status is (LoopStatus.TIME_LIMIT)
    assert len(limit.linearised) == 1 and solver.solved == (part == "solve")
    assert len(run.record) == (part == "solve")


@pytest.mark.slow
def test_after_a_short_step_nothing_is_linearised_again() -> None:
    """What such a step is off the minimum by is of no account: the trip is the one that another look would keep."""
    ended, looks = {}, {}
    for short in (LOOP.short, 0.0):
        limit = Watched(PROBLEM)
        ended[short] = [watched(limit, replace(LOOP, short=short)).run(arc, 60) for arc in arcs(PROBLEM)]
        looks[short] = len(limit.linearised)
    assert looks[LOOP.short] < looks[0.0]
    for sooner, later in zip(*ended.values(), strict=True):
        assert sooner.status is later.status
        times = (run.evaluation.trajectory.travel_time for run in (sooner, later))
        assert next(times) == pytest.approx(next(times), abs=PROBLEM.settings.tolerance)


# What one subproblem's solution is worth


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


# The solver of the subproblems: what it is given of the time, and when another one takes its place

# The nearest point to (1, 2) with x + y <= 1: (0, 1).
PROGRAM = SlackedProgram(
    hessian=np.eye(2),
    gradient=np.array([-1.0, -2.0]),
    lower=np.full(2, -5.0),
    upper=np.full(2, 5.0),
    hard=np.ones((1, 2)),
    soft=np.zeros((0, 2)),
    slack=np.zeros(0, dtype=np.intp),
    bound=np.ones(1),
    equalities=0,
    time_limit=5.0,
)


class Answers:
    """A solver that says the same of every program, and keeps how long it was given for each."""

    name = "answers"

    def __init__(self, status: SolverStatus) -> None:
        self.status = status
        self.given: list[float] = []

    def solve(self, program: QuadraticProgram) -> Solution:
        self.given.append(program.time_limit)
        return Solution(self.status, np.array([7.0, 7.0]), np.zeros(3))


@pytest.mark.parametrize(
    ("left", "limit", "given"), [(2.0, 5.0, 2.0), (9.0, 5.0, 5.0), (np.inf, 5.0, 5.0), (-1.0, 5.0, 0.1)]
)
def test_a_solver_has_what_is_left_of_the_time(
    left: float, limit: float, given: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    FakeClock(0.0).rule(monkeypatch)
    solver = Answers(SolverStatus.OPTIMAL)
    found = StepSolver(solver, None, shortest=0.1).solve(replace(PROGRAM, time_limit=limit), left)
    assert solver.given == [given]
    assert found is not None and found.x.tolist() == [7.0, 7.0]


@pytest.mark.parametrize(
    ("status", "fallback", "left", "asked"),
    [
        (SolverStatus.FAILED, "clarabel", 1.0, True),
        (SolverStatus.FAILED, "clarabel", -1.0, False),
        (SolverStatus.FAILED, None, 1.0, False),
        (SolverStatus.INFEASIBLE, "clarabel", 1.0, False),
    ],
)
def test_another_solver_answers_only_where_one_failed_in_time(
    status: SolverStatus, fallback: str | None, left: float, asked: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    FakeClock(0.0).rule(monkeypatch)
    found = StepSolver(Answers(status), fallback, shortest=0.1).solve(PROGRAM, left)
    assert (found is not None) == asked


@pytest.mark.numerics
def test_the_step_is_that_of_the_program() -> None:
    failed = StepSolver(Answers(SolverStatus.FAILED), "clarabel", shortest=0.1)
    for solver in (StepSolver(solver_named("daqp"), None, shortest=0.1), failed):
        found = solver.solve(PROGRAM, np.inf)
        assert found is not None and found.x == pytest.approx([0.0, 1.0], abs=1e-7)
