"""Solvers and constraints of one's own: what plan() does with them, and what it does not do behind one's back."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import cvxpy as cp
import numpy as np
import pytest

import scp_planner as sp
from scp_planner import builtin
from scp_planner.problem.build import build_problem
from scp_planner.problem.problem import Problem
from scp_planner.scp.given import GivenConstraints, TripVariables
from scp_planner.settings.planning import Settings
from scp_planner.solvers import QuadraticProgram, Solution, SolverStatus, solver_named
from scp_planner.solvers.cvxpy_solver import CvxpySolver
from scp_planner.threat_zones.of_scenario import zones
from scp_planner.trips.trajectory import Trajectory

pytestmark = pytest.mark.numerics

WITHOUT_TYPES: Any = cp
NORM = WITHOUT_TYPES.norm


@pytest.fixture(scope="module")
def scenario() -> sp.Scenario:
    """The built-in crossing, turned and moved, so that its guide is not the x axis; clocks start at 100 s."""
    return sp.Scenario(
        vehicle=sp.Vehicle(radius=0.3, max_speed=3.0, max_acceleration=1.5, max_deceleration=2.0, max_curvature=1.0),
        start=sp.Start(time=100.0, position=(1.0, 2.0), heading=None, speed=1.0),
        goal=sp.Goal(position=(13.0, 11.0)),
        obstacles=[
            sp.Obstacle(id="in-the-way", shape=sp.Disc(disc=1.0), motion=sp.Motion(position=(7.0, 6.6))),
        ],
    )


class Recording:
    """Passes programs on to a known solver, and counts them."""

    name = "recording"

    def __init__(self) -> None:
        self.solved = 0
        self._solver = solver_named("clarabel")

    def solve(self, program: QuadraticProgram) -> Solution:
        self.solved += 1
        return self._solver.solve(program)


class Failing:
    """Never finds anything."""

    name = "failing"

    def solve(self, program: QuadraticProgram) -> Solution:
        return Solution(SolverStatus.FAILED, np.zeros(len(program.gradient)), np.zeros(0))


def test_a_solver_of_ones_own_solves_every_subproblem(scenario: sp.Scenario) -> None:
    solver = Recording()
    plan = sp.plan(scenario, solver=solver)
    assert plan.certified and plan.solver == "recording"
    assert solver.solved >= plan.iterations > 0
    assert plan.travel_time == pytest.approx(sp.plan(scenario).travel_time, rel=1e-4)


def test_no_other_solver_takes_the_place_of_ones_own(scenario: sp.Scenario) -> None:
    # First trips know nothing of the jerk, nor routes of what moves; else one of them is certified without a program.
    jerky = scenario.model_copy(update={"vehicle": scenario.vehicle.model_copy(update={"max_jerk": 1.0})})
    motion = sp.Motion(time=100.0, position=(7.0, 6.6), velocity=(0.05, 0.0))
    moving = scenario.obstacles[0].model_copy(update={"motion": motion})
    plan = sp.plan(jerky.model_copy(update={"obstacles": (moving,)}), solver=Failing())
    assert plan.status == "failed" and plan.solver == "failing"
    assert plan.reason is not None and "the solver failed on the last subproblem" in plan.reason


def test_a_solver_of_ones_own_plans_while_driving(scenario: sp.Scenario) -> None:
    solver = Recording()
    run = sp.simulate(scenario, noise=0.01, rate=5.0, solver=solver)
    assert run.arrived and solver.solved >= run.outcomes["improved"] > 1
    assert {plan.solver for plan in run.plans} == {"recording"}


def problem_of(scenario: sp.Scenario, **changes: Any) -> Problem:
    return build_problem(scenario, zones(scenario), replace(Settings(), **changes))


@pytest.mark.parametrize("degree", [0, 1])
@pytest.mark.parametrize("guide", [None, ((1.0, 2.0), (9.0, 3.0), (13.0, 11.0))])
def test_variables_say_what_the_trip_does(scenario: sp.Scenario, guide: Any, degree: int) -> None:
    """At the values of a trip the expressions are the trip's own offsets, positions, distances, speeds and times."""
    problem = problem_of(scenario.model_copy(update={"guide": guide}), acceleration_degree=degree)
    rng = np.random.default_rng(5)
    theta = problem.ends.theta.copy()
    free = problem.ends.free
    theta[free] += rng.uniform(-0.5, 0.5, free.stop - free.start)
    trajectory = Trajectory.of(problem.space, theta, rng.uniform(0.0, 0.4, problem.space.acceleration_size))
    seen: list[TripVariables] = []

    def remember(trip: TripVariables) -> list[Any]:
        seen.append(trip)
        return [trip.travel_time >= 0.0]

    given = GivenConstraints(problem, remember)
    assert given.worst(trajectory) == 0.0
    (trip,) = seen
    stations = np.array([0.0, 1.3, 7.0, trip.length])
    points = trajectory.path.points(stations / trip.length)
    assert trip.offset(stations).value == pytest.approx(points.offset, abs=1e-9)
    assert trip.position(stations).value == pytest.approx(problem.frame.to_world(points.position), abs=1e-9)
    times = np.linspace(0.0, 1.0, 7)
    there = trajectory.at(problem.space.time_table(times))
    driven = trajectory.path.arc_length_at(there.parameter)
    assert trip.distance(times).value == pytest.approx(driven, abs=1e-6)
    tau = trajectory.travel_time
    assert trip.speed_times_travel_time(times).value == pytest.approx(tau * there.speed, abs=1e-9)
    assert trip.travel_time.value == pytest.approx(tau)
    assert trip.arrival_time.value == pytest.approx(100.0 + tau)
    assert np.all(np.diff(trip.stations) > 0) and trip.stations[-1] == pytest.approx(trip.length)


def test_control_points_bound_the_offset_everywhere(scenario: sp.Scenario) -> None:
    free = sp.plan(scenario)
    plan = sp.plan(scenario, constraints=lambda trip: [trip.offset_control_points >= -0.1])
    across = np.array([-0.6, 0.8])  # to the left of the way from (1, 2) to (13, 11)
    times = np.linspace(0.0, 1.0, 1001)
    offsets = [
        (p.position(p.start_time + p.travel_time * times) - scenario.start.position) @ across for p in (free, plan)
    ]
    assert offsets[0].min() < -1.0  # the faster side is the other one
    assert plan.certified and plan.solver == "cvxpy"
    assert offsets[1].min() >= -0.1 - 2e-4
    assert plan.travel_time > free.travel_time


def test_an_appointment_is_kept(scenario: sp.Scenario) -> None:
    plan = sp.plan(scenario, constraints=lambda trip: [trip.arrival_time == 109.0])
    assert plan.certified
    assert plan.arrival_time == pytest.approx(109.0, abs=2e-4)


def test_a_cone_is_kept(scenario: sp.Scenario) -> None:
    """Half way, the path passes within 0.2 m of a given point that it would not come near to."""
    gate = np.array([6.0, 8.0])

    def through_the_gate(trip: TripVariables) -> list[Any]:
        return [NORM(trip.position(trip.length / 2)[0] - gate) <= 0.2]

    def least_distance(plan: sp.Plan) -> float:
        times = np.linspace(plan.start_time, plan.arrival_time, 2001)
        return float(np.linalg.norm(plan.position(times) - gate, axis=1).min())

    plan = sp.plan(scenario, constraints=through_the_gate, solver=CvxpySolver("CLARABEL"))
    assert least_distance(sp.plan(scenario)) > 0.5
    assert plan.certified and least_distance(plan) <= 0.201


@pytest.fixture(scope="module")
def few() -> sp.Plan:
    """A plan whose offsets are 2 cm at most."""
    crossing, largest = builtin.load("crossing"), WITHOUT_TYPES.norm_inf
    return sp.plan(crossing, constraints=lambda trip: [largest(trip.offset_control_points) <= 0.02])


@pytest.mark.parametrize("name", ["sum of squares", "norm", "p-norm"])
def test_a_constraint_that_contains_another_one_that_works_works_too(name: str, few: sp.Plan) -> None:
    crossing, cvxpy = builtin.load("crossing"), WITHOUT_TYPES
    sizes = {"sum of squares": cvxpy.sum_squares, "norm": cvxpy.norm, "p-norm": lambda points: cvxpy.pnorm(points, 3)}
    size = sizes[name]

    def more(trip: TripVariables) -> list[Any]:
        assert 0.02 * np.sqrt(trip.offset_control_points.size) < 1.0  # all that few allows
        return [size(trip.offset_control_points) <= 1.0]

    outer = sp.plan(crossing, constraints=more)
    assert few.certified and outer.certified, outer.reason
    assert outer.travel_time < few.travel_time


def test_a_slow_passage_is_kept(scenario: sp.Scenario) -> None:
    middle = np.linspace(0.4, 0.6, 41)
    plan = sp.plan(scenario, constraints=lambda trip: [trip.speed_times_travel_time(middle) <= 1.2 * trip.travel_time])
    assert plan.certified
    assert plan.speed(plan.start_time + middle * plan.travel_time).max() <= 1.2 + 1e-4


def test_what_cannot_be_kept_is_not_certified_and_said(scenario: sp.Scenario) -> None:
    plan = sp.plan(scenario, constraints=lambda trip: [trip.travel_time >= 0, trip.arrival_time <= 103.0])
    assert not plan.certified
    assert plan.reason is not None and "excess over given constraint 2" in plan.reason
    assert "constraint 1" not in plan.reason


def test_another_solver_than_cvxpy_is_refused(scenario: sp.Scenario) -> None:
    def none(trip: TripVariables) -> list[Any]:
        return []

    for solver in ("osqp", "daqp", Recording()):
        with pytest.raises(ValueError, match=r"solver: '(osqp|daqp|recording)' cannot take constraints of one's own"):
            sp.plan(scenario, constraints=none, solver=solver)
    assert sp.plan(scenario, constraints=none, solver="cvxpy").certified


def test_constraints_must_be_convex_constraints(scenario: sp.Scenario) -> None:
    with pytest.raises(ValueError, match="constraints: number 2 is not convex"):
        sp.plan(scenario, constraints=lambda trip: [trip.travel_time >= 0, NORM(trip.offset_control_points) >= 1])
    with pytest.raises(TypeError, match="constraints: number 1 must be a constraint of cvxpy, not True"):
        sp.plan(scenario, constraints=lambda trip: [True])


def test_extra_constraints_need_an_origin() -> None:
    program = QuadraticProgram(np.eye(1), np.zeros(1), -np.ones(1), np.ones(1), np.zeros((0, 1)), np.zeros(0), 0)
    with pytest.raises(ValueError, match="need a program with an origin"):
        CvxpySolver(extra=lambda values: [values >= 0.5]).solve(program)
