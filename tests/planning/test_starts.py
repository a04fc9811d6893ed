"""What a further trip has to be faster than."""

from __future__ import annotations

import math
from typing import Any, cast

import numpy as np
import pytest
from clock import FakeClock
from scenes import disc, scene

import scp_planner as sp
from scp_planner import plan
from scp_planner.certificate.verdict import off_a_step
from scp_planner.pauses import Budget
from scp_planner.planning.runs import CheckedRuns, ScpRun
from scp_planner.planning.sources.refinements import REFINEMENT, commanded_in_steps
from scp_planner.planning.sources.sides import Sides
from scp_planner.planning.starts import SCENE, OverGuide, Start, TripSearch
from scp_planner.planning.task import Task
from scp_planner.problem.build import build_problem
from scp_planner.scp.evaluation import evaluate_trip
from scp_planner.scp.goal import ArrivalSteps, to_beat
from scp_planner.scp.loop import ScpLoop
from scp_planner.scp.merit import Penalties
from scp_planner.scp.parameters import LOOP
from scp_planner.scp.record import LoopRun, LoopStatus
from scp_planner.settings.planning import Settings, for_scene
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


# Runs that go on from where they were cut short


class Scripted:
    """A loop whose runs come to nothing, and end as is written."""

    def __init__(self, runs: CheckedRuns, start: Trajectory, *ends: LoopStatus) -> None:
        evaluation = evaluate_trip(runs.problem, start)
        self.left = [LoopRun(end, evaluation, Penalties.uniform(runs.problem, 5.0)) for end in ends]

    def run(self, *_: Any, **__: Any) -> LoopRun:
        return self.left.pop(0)


@pytest.mark.parametrize(
    ("further", "told"),
    [(LoopStatus.INFEASIBLE, LoopStatus.INFEASIBLE), (LoopStatus.STALLED, LoopStatus.ITERATION_LIMIT)],
)
def test_a_run_that_nothing_comes_nearer_to_than_it_is_was_not_cut_short(further: LoopStatus, told: LoopStatus) -> None:
    """Else the same start is tried again, with patience, and as much in vain."""
    scenario = scene(disc("in the way", (10.0, 0.0)))
    runs = CheckedRuns(Task(scenario, sp.zones(scenario), Settings()))
    problem = runs.problem
    start = Trajectory.of(problem.space, problem.ends.theta, np.zeros(problem.space.acceleration_size))
    loop = Scripted(runs, start, LoopStatus.ITERATION_LIMIT, further)
    attempt = runs.attempt(start, loop=cast(ScpLoop, loop))
    assert not loop.left
    assert attempt.run.status is told
    assert not attempt.holds


def test_a_run_that_circles_what_is_a_little_too_narrow_makes_room() -> None:
    """Among crossers every 4 m on 200 m one run stays wrong by some thousandths: it took 160 of 278 iterations."""
    along = np.arange(15.0, 195.0, 4.0)
    rng = np.random.default_rng(0)
    pace = rng.choice([-1.0, 1.0], len(along)) * rng.uniform(0.4, 1.5, len(along))
    when = along / 3.0 + rng.uniform(-3.0, 3.0, len(along))
    crossers = [disc(f"o{k}", (x, -v * t), (0.0, v)) for k, (x, v, t) in enumerate(zip(along, pace, when, strict=True))]
    found = sp.plan(scene(*crossers, goal={"position": [200.0, 0.0]}))
    assert found.certified
    assert found.lower_bound is not None
    assert found.travel_time < 1.002 * found.lower_bound
    assert found.iterations < 150


# Ways round that are tried, and arcs where there are none

STANDING = scene(disc("right", (6.0, 0.2)), disc("left", (10.0, -0.4), radius=0.8), disc("last", (14.0, 0.3)))


def search_in(scenario: sp.Scenario, settings: Settings | None = None, deadline: float = np.inf) -> TripSearch:
    budget = Budget(deadline, begun=0.0)
    task = Task(scenario, sp.zones(scenario), for_scene(settings or Settings()), budget)
    return TripSearch(CheckedRuns(task))


def explored(search: TripSearch) -> ScpRun | None:
    search.sources = [Sides(search)]
    return search.explore(Start(SCENE, OverGuide(search.runs)))


def test_a_class_may_turn_out_better_than_its_estimate_by_as_much_as_another_did() -> None:
    """The second class is estimated to be slower than what the first led to, and turns out to be faster."""
    search = search_in(STANDING)
    search.sources = [Sides(search, estimate_error=0.0)]
    found = search.explore(Start(SCENE, OverGuide(search.runs)))
    first, *others = search.log.skeletons
    assert others and found is not None and found.holds
    assert found.travel_time < first.travel_time


def test_after_a_search_that_takes_most_of_the_time_there_is_enough_for_one_arc(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    clock = FakeClock(0.0)
    clock.rule(monkeypatch)
    search = search_in(STANDING, deadline=0.5)
    clock.tick = 1.0
    explored(search)
    assert search.log.tried == {"arc": 1}


@pytest.mark.parametrize("covered", [False, True])
def test_a_goal_that_is_covered_for_good_takes_a_single_arc(covered: bool) -> None:
    lid = disc("lid", (20.0, 0.2 if covered else 3.0), radius=1.0)
    search = search_in(scene(lid))
    explored(search)
    assert (search.log.tried == {"arc": 1}) is covered


# Trips are found that the scenario's guide does not lead to


def test_over_another_guide_only_what_may_be_faster_is_gone_on_with() -> None:
    search = search_in(scene(disc("post", (10.0, 2.0)), guide=[[0.0, 0.0], [10.0, 3.0], [20.0, 0.0]]))
    best = explored(search)
    assert best is not None and best.holds
    done = search.log.iterations
    faster, about_as_fast = (TripSearch(search.runs, share * best.travel_time) for share in (0.8, 1.01))
    assert explored(faster) is None
    assert search.log.iterations - done < 0.5 * done
    again = explored(about_as_fast)
    assert again is not None and again.holds
