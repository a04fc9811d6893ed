"""Several trips at once: the same as one after the other."""

from __future__ import annotations

from dataclasses import fields
from typing import Any

import numpy as np
import pytest
from scenes import CROSSERS, scene
from slopes import problem_and_trip

import scp_planner as sp
from scp_planner.problem.build import build_problem
from scp_planner.problem.problem import Problem
from scp_planner.scp.evaluation import Evaluation, evaluate_trip, evaluate_trips
from scp_planner.scp.linearisation import TrustRegion, linearise, linearise_trips
from scp_planner.scp.loop import ScpLoop
from scp_planner.scp.record import LoopRun, LoopStatus
from scp_planner.search.first_trips import bows
from scp_planner.settings.planning import Settings
from scp_planner.solvers import solver_named
from scp_planner.trips.bundle import TripBundle
from scp_planner.trips.trajectory import Trajectory

pytestmark = pytest.mark.numerics

TRUSTS = [TrustRegion(1.0, 3.0, 0.3), TrustRegion(0.3, 1.0, 0.1), TrustRegion(0.1, 0.5, 0.05)]


def shaped() -> tuple[Problem, list[Trajectory]]:
    """A truck to be overtaken, a pillar and a curved guide."""
    scenario = scene(
        {"id": "truck", "shape": {"rectangle": [4.0, 2.0]}, "motion": {"position": [3.0, 0.0], "velocity": [1.0, 0.2]}},
        {"id": "pillar", "shape": {"disc": 0.4}, "motion": {"position": [8.0, 2.0]}},
        goal={"position": [10.0, 12.0]},
        guide=[[0.0, 0.0], [10.0, 0.0], [10.0, 12.0]],
        bounds={"min": [-1.0, -3.0], "max": [14.0, 14.0]},
    )
    problem = build_problem(scenario, sp.zones(scenario), Settings())
    return problem, list(bows(problem))


def loud(degree: int) -> tuple[Problem, list[Trajectory]]:
    problem, _ = problem_and_trip(degree)
    trips = []
    for seed in range(4):
        rng = np.random.default_rng(seed)
        theta = problem.ends.theta.copy()
        free = problem.ends.free
        # From trips that bend hardly to trips that bend too much: some have peaks of the lateral acceleration
        theta[free] = 0.1 * seed * rng.normal(size=free.stop - free.start)
        trips.append(Trajectory.of(problem.space, theta, rng.uniform(-0.2, 0.5, problem.space.acceleration_size)))
    return problem, trips


@pytest.fixture(params=["shaped", 0, 1], ids=["curved-guide", "constant", "linear"])
def family(request: pytest.FixtureRequest) -> tuple[Problem, list[Trajectory]]:
    return shaped() if request.param == "shaped" else loud(request.param)


def assert_same(left: Any, right: Any, where: str = "") -> None:
    """Compare dataclasses of arrays, field by field."""
    assert type(left) is type(right), where
    if isinstance(left, np.ndarray):
        np.testing.assert_allclose(left, right, rtol=1e-9, atol=1e-9, err_msg=where)
    elif isinstance(left, float):
        assert left == pytest.approx(right, rel=1e-9, abs=1e-9), where
    elif isinstance(left, tuple):
        assert len(left) == len(right)
        for one, other in zip(left, right, strict=True):
            assert_same(one, other, where)
    elif left is not None and not isinstance(left, Trajectory):
        for each in fields(left):
            if each.name == "batch":
                continue  # only a trip that was evaluated alone has one
            if (where + each.name).endswith("peaks.bendvalue") and len(left.curvature) == 0:
                continue  # of nothing it may be (0,), or the (1,) that stands for 0 everywhere
            assert_same(getattr(left, each.name), getattr(right, each.name), f"{where}.{each.name}")


def test_trips_are_evaluated_together_as_alone(family: tuple[Problem, list[Trajectory]]) -> None:
    problem, trips = family
    together = evaluate_trips(problem, trips, 1.5)
    for trip, evaluation in zip(trips, together, strict=True):
        assert_same(evaluation, evaluate_trip(problem, trip, 1.5))


def test_trips_are_linearised_together_as_alone(family: tuple[Problem, list[Trajectory]]) -> None:
    problem, trips = family
    evaluations = evaluate_trips(problem, trips, 1.5)
    trusts = (TRUSTS * len(trips))[: len(trips)]
    together = linearise_trips(problem, evaluations, trusts, 1.5)
    for evaluation, trust, rows in zip(evaluations, trusts, together, strict=True):
        alone = linearise(problem, evaluation, trust, 1.5)
        np.testing.assert_array_equal(rows.key, alone.key)
        np.testing.assert_array_equal(rows.group, alone.group)
        np.testing.assert_allclose(rows.matrix, alone.matrix, rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(rows.gap, alone.gap, rtol=1e-9, atol=1e-9)
        assert len(rows.gap) > 0


def test_a_bundle_finds_places_on_each_path(family: tuple[Problem, list[Trajectory]]) -> None:
    _, trips = family
    bundle = TripBundle(trips)
    owner = np.arange(len(trips)).repeat(50)
    lengths = np.concatenate([np.linspace(0.0, trip.path.arc_length, 50) for trip in trips])
    parameters = bundle.parameter_at(owner, lengths)
    np.testing.assert_allclose(bundle.arc_length_at(owner, parameters), lengths, atol=1e-9)
    arrivals = bundle.arrivals(owner, lengths)
    np.testing.assert_allclose(bundle.at(owner, arrivals.sigma).distance, lengths, atol=1e-7)


def crossing() -> tuple[Problem, ScpLoop, list[Trajectory]]:
    scenario = scene(*CROSSERS)
    problem = build_problem(scenario, sp.zones(scenario), Settings())
    return problem, ScpLoop(problem, solver_named("daqp")), list(bows(problem))


def test_runs_in_step_end_as_they_do_alone() -> None:
    _, loop, starts = crossing()
    together = list(loop.run_all(starts, 60))
    assert any(run.status is LoopStatus.CONVERGED for run in together)
    for start, run in zip(starts, together, strict=True):
        alone = loop.run(start, 60)
        assert run.status is alone.status
        # Rounding may decide a step of a run that does not get anywhere
        if run.status is LoopStatus.CONVERGED:
            assert run.evaluation.trajectory.travel_time == pytest.approx(
                alone.evaluation.trajectory.travel_time, abs=1e-4
            )


def test_a_race_is_won_by_the_fastest_and_cuts_off_others() -> None:
    _, loop, starts = crossing()
    alone, race = list(loop.run_all(starts, 60)), list(loop.run_all(starts, 60, race=True))

    def best(runs: list[LoopRun]) -> float:
        return min(run.evaluation.trajectory.travel_time for run in runs if run.status is LoopStatus.CONVERGED)

    assert best(race) == pytest.approx(best(alone), rel=2e-3)
    assert sum(len(run.record) for run in race) <= sum(len(run.record) for run in alone)
    assert any(run.status is LoopStatus.SLOWER for run in race)


def test_evaluations_are_independent_of_the_trips_beside_them() -> None:
    problem, trips = loud(0)
    first: Evaluation = evaluate_trips(problem, trips[:2], 1.5)[1]
    second = evaluate_trips(problem, trips[1:], 1.5)[0]
    assert_same(first, second)
