"""What a further trip has to be faster than."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scenes import scene

from scp_planner import plan
from scp_planner.certificate.verdict import off_a_step
from scp_planner.planning.refinements import REFINEMENT, commanded_in_steps
from scp_planner.problem.build import build_problem
from scp_planner.scp.evaluation import evaluate_trip
from scp_planner.scp.goal import ArrivalSteps, to_beat
from scp_planner.scp.parameters import LOOP
from scp_planner.settings.planning import Settings
from scp_planner.trips.trajectory import Trajectory


def step_of(travel_time: float, step: float) -> int:
    """The first step that is not missed by a trip, counted up to it."""
    number = 0
    while number * step + off_a_step(step) < travel_time:
        number += 1
    return number


def test_only_a_trip_for_an_earlier_step_beats_another() -> None:
    assert to_beat(3.2, None) == 3.2
    for step in (0.1, 0.25, 1.0):
        off = off_a_step(step)
        for travel_time in (*np.linspace(1.3, 4.7, 35).tolist(), 3.0, 3.0 + 0.5 * off, 3.0 + 2.0 * off):
            limit = to_beat(travel_time, step)
            here = step_of(travel_time, step)
            assert step_of(limit - 1e-9, step) < here
            assert step_of(limit + 1e-9, step) == here
            assert limit == pytest.approx((here - 1) * step + off)


def test_no_step_is_given_away() -> None:
    """The step is that of the fastest trip, which is looked for no further than it takes to know."""
    start = {"speed": 1.0}
    fastest = plan(scene(start=start)).travel_time
    for step in (0.3, 0.7):
        timed = plan(scene(start=start, goal={"arrival_step": step}))
        assert timed.certified
        assert timed.travel_time == pytest.approx(step * math.ceil(fastest / step), abs=off_a_step(step))


def test_a_trip_does_for_its_step_if_an_earlier_one_is_out_of_reach() -> None:
    problem = build_problem(scene(start={"speed": 1.0}), (), Settings())
    drive = np.zeros(problem.space.acceleration_size)
    trip = evaluate_trip(problem, Trajectory.of(problem.space, problem.ends.theta, drive))
    assert trip.worst_violation == 0.0
    time, step = trip.trajectory.travel_time, 0.3 * trip.trajectory.travel_time
    steps = ArrivalSteps(step, np.inf)
    assert steps.after(time) == pytest.approx(4 * step)
    gap = time - 3 * step
    assert steps.as_good(trip, 0.2 * gap, LOOP)
    assert not steps.as_good(trip, gap / LOOP.hope * 1.1, LOOP)  # one more such step may do it
    assert not ArrivalSteps(step, 3.9 * step).as_good(trip, 0.0, LOOP)  # it would be late


def test_changes_within_long_steps_are_noticed() -> None:
    """Who commands one acceleration a step ends such a step elsewhere: by an eighth of the change times its square."""
    problem = build_problem(scene(start={"speed": 1.0}), (), Settings())
    edges = problem.space.acceleration.breakpoints
    beta = np.where(edges[:-1] < edges[len(edges) // 2], 0.4, 0.0)
    trip = Trajectory.of(problem.space, problem.ends.theta, beta)
    changed = edges[len(edges) // 2] * trip.travel_time
    assert commanded_in_steps(trip, 0.5 * changed, 1e-6)
    elsewhere = 0.125 * 0.4 * (2.0 * changed / 3.0) ** 2  # in the middle of the second step
    assert commanded_in_steps(trip, 2.0 * changed / 3.0, 1.01 * elsewhere / REFINEMENT.straying)
    assert not commanded_in_steps(trip, 2.0 * changed / 3.0, 0.99 * elsewhere / REFINEMENT.straying)
