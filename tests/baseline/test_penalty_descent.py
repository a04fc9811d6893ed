"""Penalty descent: the same kind of plan and certificate as sequential convex programming, from the same starts."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from clock import FakeClock
from scenes import CROSSERS, disc, scene
from scipy.optimize import lsq_linear

import scp_planner as sp
from scp_planner import builtin
from scp_planner.arrays import Array
from scp_planner.baseline.coordinates import path_scaling
from scp_planner.baseline.descent import Descent, checked_descent
from scp_planner.baseline.descent_run import DescentSettings, DescentStatus, Variant
from scp_planner.baseline.minimisers import MINIMISERS
from scp_planner.planning.plan import PlanStatus
from scp_planner.problem.build import build_problem
from scp_planner.scp.loop import ScpLoop
from scp_planner.search.first_trips import arcs
from scp_planner.search.starts import starts
from scp_planner.settings.planning import Settings
from scp_planner.solvers import solver_named
from scp_planner.threat_zones.of_scenario import zones
from scp_planner.trips.trajectory import Trajectory

ROOT = Path(__file__).resolve().parents[2]
SMALL = Settings(path_span=2.5, acceleration_spans=8, samples=80)
BLOCKED = disc("on-goal", (20.0, 0.5), radius=2.0)


@pytest.mark.parametrize(
    "name", [name if name == "headon" else pytest.param(name, marks=pytest.mark.slow) for name in builtin.names()]
)
def test_built_in_scenarios_have_certified_plans_as_fast_as_those_of_scp(name: str) -> None:
    scenario = builtin.load(name)
    plan, best = sp.penalty_descent(scenario), sp.plan(scenario)
    assert plan.status is PlanStatus.CERTIFIED, plan.reason
    assert sp.certify(scenario, plan).holds
    assert (plan.method, plan.solver) == ("penalty-descent", "l-bfgs")
    assert plan.lower_bound <= plan.travel_time <= 1.03 * best.travel_time
    assert plan.iterations > 0


@pytest.mark.parametrize(
    "variant",
    [each if each is Variant.LBFGS else pytest.param(each, marks=pytest.mark.slow) for each in Variant],
)
def test_every_variant_is_certified_and_ends_where_scp_does_from_the_same_start(variant: Variant) -> None:
    scenario = scene(CROSSERS[0])
    threat_zones = zones(scenario)
    problem = build_problem(scenario, threat_zones, SMALL)
    _, start = next(starts(problem, 4))
    reference = ScpLoop(problem, solver_named("daqp")).run(start, 60).evaluation.trajectory
    checked = checked_descent(problem, threat_zones, Descent(problem, start, DescentSettings(variant=variant)))
    assert checked.certificate is not None
    assert checked.certificate.holds, checked.certificate.violations
    allowed = {Variant.LBFGS: 3e-3, Variant.GRADIENT: 1e-2, Variant.MONTE_CARLO: 3e-2}[variant]
    assert checked.run.trajectory.travel_time == pytest.approx(reference.travel_time, abs=allowed)


def test_a_plan_or_a_trajectory_may_be_the_start() -> None:
    scenario = scene(CROSSERS[0])
    reference = sp.plan(scenario, SMALL)
    from_plan = sp.penalty_descent(scenario, SMALL, start=reference)
    from_trajectory = sp.penalty_descent(scenario, SMALL, start=reference.trip.trajectory)
    assert from_plan.certified
    assert from_plan.travel_time == from_trajectory.travel_time
    assert from_plan.travel_time == pytest.approx(reference.travel_time, abs=3e-3)


def test_a_start_with_other_splines_is_refused() -> None:
    scenario = scene(CROSSERS[0])
    with pytest.raises(ValueError, match=r"start: it has 16 and 20 control points, not 11 and 8"):
        sp.penalty_descent(scenario, SMALL, start=sp.plan(scenario, Settings()))


def test_a_start_that_never_arrives_is_refused() -> None:
    problem = build_problem(scene(), (), SMALL)
    space = problem.space
    standing = Trajectory.of(space, np.zeros(space.path_size), np.full(space.acceleration_size, -1.0))
    with pytest.raises(ValueError, match="never arrives"):
        sp.penalty_descent(scene(), SMALL, start=standing)


ASKED = {
    "a goal speed": scene(CROSSERS[0], goal={"position": [20.0, 0.0], "speed": 0.8}),
    "an acceleration at the start": scene(CROSSERS[0], start={"acceleration": -0.5}),
    "a radius of the goal": scene(disc("lid", (20.0, 1.0), radius=1.2), goal={"position": [20.0, 0.0], "radius": 2.0}),
    "a bent guide": scene(disc("post", (9.0, 1.5), radius=0.6), guide=[[0.0, 0.0], [10.0, 2.0], [20.0, 0.0]]),
    "a workspace box": scene(CROSSERS[0], bounds={"min": [-1.0, -1.5], "max": [21.0, 1.5]}),
}


@pytest.mark.parametrize("name", ASKED)
def test_what_a_scenario_asks_for_is_certified(name: str) -> None:
    plan = sp.penalty_descent(ASKED[name], SMALL)
    assert plan.certified, plan.reason
    assert plan.travel_time == pytest.approx(sp.plan(ASKED[name], SMALL).travel_time, rel=0.02)


def test_a_queue_that_has_to_be_waited_for_is_waited_for() -> None:
    """Wide hinges and low prices lead through one of the discs; the second, careful attempt stays behind them."""
    queue = [disc(f"cart-{k}", (10.0, -8.0 + 2.0 * k), (0.0, 1.0), radius=1.2) for k in range(5)]
    plan = sp.penalty_descent(scene(*queue), Settings())
    assert plan.certified, plan.reason


def test_without_obstacles_the_trip_is_as_fast_as_possible() -> None:
    plan = sp.penalty_descent(scene(), SMALL)
    assert plan.certified
    assert plan.travel_time == pytest.approx(plan.lower_bound, rel=3e-3)


@pytest.mark.slow
def test_a_goal_under_an_obstacle_is_reported_not_hidden() -> None:
    plan = sp.penalty_descent(scene(BLOCKED), SMALL)
    assert plan.status is PlanStatus.INFEASIBLE
    assert plan.reason is not None
    assert "clearance to on-goal" in plan.reason


def test_obstacles_that_no_trip_can_meet_are_left_out() -> None:
    far = [disc(f"far-{k}", (10.0 + k, 300.0), radius=0.5) for k in range(20)]
    plans = [sp.penalty_descent(scene(*CROSSERS, *some), SMALL) for some in ((), far)]
    assert plans[1].certified, plans[1].reason
    assert plans[1].travel_time == plans[0].travel_time
    assert plans[1].iterations == plans[0].iterations


def test_what_was_left_out_and_met_all_the_same_cannot_be_mended_by_margins() -> None:
    scenario = scene(disc("on-the-line", (10.0, 0.0), radius=0.1))
    problem = build_problem(scenario, zones(scenario), SMALL)
    _, start = next(starts(build_problem(scene(), (), SMALL), 4))
    without = problem.among(problem.zones.subset(np.zeros(0, dtype=np.intp)))
    descent = Descent(without, start, DescentSettings())
    checked = checked_descent(without, zones(scenario), descent)
    assert checked.certificate is not None
    assert {violation.obstacle for violation in checked.certificate.violations} == {"on-the-line"}
    assert descent.tighten(checked.certificate) is None


def test_the_time_limit_is_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    """By a clock that goes on by a millisecond a look; what is left to do after it takes a few looks."""
    FakeClock(1e-3).rule(monkeypatch)
    iterations = []
    for limit in (0.0, 0.02, 0.05):
        plan = sp.penalty_descent(scene(*CROSSERS), time_limit=limit)
        assert plan.wall_time <= limit + 0.02
        iterations.append(plan.iterations)
    assert iterations[2] > iterations[1] > iterations[0] == 0


def test_no_ways_are_looked_for_after_the_deadline() -> None:
    problem = build_problem(scene(*CROSSERS), zones(scene(*CROSSERS)), SMALL)
    estimate, start = next(starts(problem, 4, deadline=0.0))
    assert estimate == 0.0 < next(starts(problem, 4))[0]
    assert np.array_equal(start.theta, next(arcs(problem)).theta)


def test_a_run_out_of_time_says_so() -> None:
    problem = build_problem(scene(*CROSSERS), zones(scene(*CROSSERS)), SMALL)
    _, start = next(starts(problem, 4))
    run = Descent(problem, start, DescentSettings(), deadline=0.0).run()
    assert run.status is DescentStatus.TIME_LIMIT
    assert run.evaluations == 0
    assert run.trajectory.travel_time == pytest.approx(start.travel_time)


def test_the_same_seed_gives_the_same_plan() -> None:
    scenario, descent = scene(CROSSERS[0]), DescentSettings(variant=Variant.MONTE_CARLO, evaluations=6)
    times = [sp.penalty_descent(scenario, SMALL, descent=descent, seed=seed).travel_time for seed in (1, 1, 2)]
    assert times[0] == times[1]
    assert times[0] != times[2]


def test_iterates_are_all_told() -> None:
    problem = build_problem(scene(CROSSERS[0]), zones(scene(CROSSERS[0])), SMALL)
    _, start = next(starts(problem, 4))
    run = Descent(problem, start, DescentSettings(), keep_iterates=True).run()
    assert len(run.iterates) == run.iterations
    evaluations = [iterate.evaluations for iterate in run.iterates]
    seconds = [iterate.seconds for iterate in run.iterates]
    assert evaluations == sorted(evaluations)
    assert seconds == sorted(seconds)
    assert evaluations[-1] <= run.evaluations


def test_scaled_offsets_have_unit_curvature_of_the_arc_length() -> None:
    """In the scaled coordinates the Hessian of L / v_max at the straight path is 1, but for the part for regularity."""
    problem = build_problem(scene(start={"heading": None}), (), SMALL)
    scaling, free = path_scaling(problem), problem.ends.free
    space = problem.space

    def slope(y: np.ndarray) -> np.ndarray:
        theta = np.zeros(space.path_size)
        theta[free] = scaling @ y
        gradient: np.ndarray = (
            scaling.T @ Trajectory.of(space, theta, np.zeros(space.acceleration_size)).path.final_gradient[free]
        )
        return gradient / problem.limits.speed

    step = 1e-4
    size = free.stop - free.start
    hessian = np.array([(slope(step * unit) - slope(-step * unit)) / (2.0 * step) for unit in np.eye(size)])
    values = np.linalg.eigvalsh(hessian)
    assert values.max() <= 1.0 + 1e-6
    assert values.min() > 0.8


# Minimisers of penalty descent, on convex quadratic functions on a box


class LeastSquares:
    """|A y - b|^2 on a box; what is best is kept."""

    def __init__(self, matrix: Array, wanted: Array) -> None:
        self.settings, self.random = DescentSettings(tolerance=1e-14), np.random.default_rng(5)
        self.lower, self.upper = np.full(matrix.shape[1], -0.5), np.full(matrix.shape[1], 0.5)
        self.matrix, self.wanted = matrix, wanted
        self.evaluations, self.noted, self.best = 0, 0, np.inf

    def evaluate(self, y: Array, *, gradient: bool = True) -> tuple[float, Array]:
        assert np.all((self.lower <= y) & (y <= self.upper))
        self.evaluations += 1
        off = self.matrix @ y - self.wanted
        self.best = min(self.best, float(off @ off))
        return float(off @ off), 2.0 * self.matrix.T @ off if gradient else np.zeros(0)

    def note(self, y: Array) -> None:
        self.noted += 1


@pytest.mark.parametrize("variant", Variant)
def test_minimum_on_a_box_is_found(variant: Variant) -> None:
    rng = np.random.default_rng(6)
    task = LeastSquares(rng.normal(size=(8, 4)), rng.normal(size=8))
    answer = lsq_linear(task.matrix, task.wanted, (task.lower, task.upper))
    assert np.any(answer.active_mask)  # the box matters
    MINIMISERS[variant](task, np.zeros(4), 4000)
    assert task.best == pytest.approx(2.0 * answer.cost, rel=1e-6) and task.best >= 2.0 * answer.cost * (1.0 - 1e-9)
    assert 0 < task.noted < task.evaluations <= 4001


@pytest.mark.parametrize("variant", Variant)
def test_no_more_is_evaluated_than_is_allowed(variant: Variant) -> None:
    rng = np.random.default_rng(7)
    task = LeastSquares(rng.normal(size=(30, 12)), rng.normal(size=30))
    MINIMISERS[variant](task, np.zeros(12), 6)
    assert 1 <= task.evaluations <= 7
