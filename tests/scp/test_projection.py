"""Where steps lead, and the nearest trips that keep their limits, against what is driven at many moments."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scenes import scene

import scp_planner as sp
from scp_planner.constraints.drive import DriveRows
from scp_planner.constraints.rows import Rows
from scp_planner.problem.build import build_problem
from scp_planner.problem.problem import Problem
from scp_planner.scp.parameters import LOOP
from scp_planner.scp.projection import Projection, trip_after
from scp_planner.scp.record import FEASIBILITY
from scp_planner.scp.step_solver import StepSolver
from scp_planner.solvers import solver_named
from scp_planner.trips.trajectory import Trajectory

pytestmark = pytest.mark.numerics

MOMENTS = np.linspace(0.0, 1.0, 4001)


def problem_of(**changes: Any) -> Problem:
    scenario = scene(**changes)
    return build_problem(scenario, sp.zones(scenario), sp.Settings())


def trip_of(problem: Problem, acceleration: float) -> Trajectory:
    """A trip that always accelerates as much, m/s2."""
    return Trajectory.of(problem.space, problem.ends.theta, np.full(problem.space.acceleration_size, acceleration))


def projection_of(problem: Problem) -> Projection:
    drive = DriveRows(problem)
    return Projection(problem, drive, StepSolver(solver_named("daqp"), None, LOOP.shortest_solve), LOOP)


def test_a_step_moves_the_path_and_the_drive_and_the_trip_still_ends_at_the_goal() -> None:
    problem = problem_of()
    start, free = trip_of(problem, 0.1), problem.ends.free
    rng = np.random.default_rng(3)
    step = 0.05 * rng.normal(size=problem.step_size)
    moved = trip_after(problem, start, step)
    assert moved is not None
    count = free.stop - free.start
    np.testing.assert_allclose(moved.theta[free] - start.theta[free], step[:count], atol=1e-12)
    # In the share of the time that has passed the acceleration has changed by its step, the time by its share.
    assert problem.ends.start_acceleration is None
    changed = (start.beta + step[count : count + len(start.beta)]) / (1.0 + step[count + len(start.beta)]) ** 2
    np.testing.assert_allclose(moved.beta, changed, rtol=1e-12)
    # What its speed adds up to is the length of its path, and what its acceleration adds up to is its speed.
    drive, time = moved.drive_at(MOMENTS), moved.travel_time * MOMENTS
    assert np.trapezoid(drive.speed, time) == pytest.approx(moved.path.arc_length, rel=1e-6)
    between = moved.drive_at(0.5 * (MOMENTS[1:] + MOMENTS[:-1])).acceleration
    gained = np.concatenate([[0.0], np.cumsum(np.diff(time) * between)])
    np.testing.assert_allclose(drive.speed, drive.speed[0] + gained, atol=1e-4)  # jumps times a step of 3 ms


def test_a_step_after_which_the_vehicle_never_arrives_leads_nowhere() -> None:
    problem = problem_of()
    start = trip_of(problem, 0.1)
    step = np.zeros(problem.step_size)
    count = problem.ends.free.stop - problem.ends.free.start
    step[count : count + len(start.beta)] = -1.0  # from 1 m/s it stands after half a metre
    assert trip_after(problem, start, step) is None


def test_a_trip_beyond_its_limits_is_brought_within_them() -> None:
    problem = problem_of()
    projection, fast = projection_of(problem), trip_of(problem, 0.5)
    assert fast.drive_at(MOMENTS).speed.max() > 1.4 * 3.0
    kept = projection.within_limits(fast, np.inf)
    assert kept is not None
    drive = kept.drive_at(MOMENTS)
    assert drive.speed.max() < 3.0 * (1.0 + 1e-2) and drive.speed.min() > 0.0
    assert -2.0 * 1.01 < drive.acceleration.min() and drive.acceleration.max() < 1.5 * 1.01
    assert np.trapezoid(drive.speed, kept.travel_time * MOMENTS) == pytest.approx(kept.path.arc_length, rel=1e-6)


def test_a_trip_within_its_limits_is_left_alone() -> None:
    problem = problem_of()
    projection, slow = projection_of(problem), trip_of(problem, 0.1)
    assert projection.drive.excess(slow) <= FEASIBILITY
    assert projection.within_limits(slow, np.inf) is None
    near = projection.mended(slow, Rows.none(problem.step_size), 0, np.inf)
    assert near is not None
    np.testing.assert_allclose(near.beta, slow.beta, atol=1e-6)
    assert near.travel_time == pytest.approx(slow.travel_time, rel=1e-6)


def test_the_speed_of_the_goal_is_missed_by_what_is_driven_there() -> None:
    asked = problem_of(goal={"speed": 2.0})
    # v^2 = 1 + 2 a 20: on arrival it is as fast as it is to be with a = 3 / 40.
    assert not projection_of(asked).misses_goal_speed(trip_of(asked, 3.0 / 40.0))
    assert projection_of(asked).misses_goal_speed(trip_of(asked, 3.01 / 40.0))
    assert not projection_of(problem_of()).misses_goal_speed(trip_of(problem_of(), 3.01 / 40.0))
