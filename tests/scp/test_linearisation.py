"""What a step could violate, linearised: nothing is left out that it could."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from slopes import curved_problem_and_trip, differences, problem_and_trip

from scp_planner.constraints.lateral import fixed_sites
from scp_planner.scp.evaluation import evaluate_trip
from scp_planner.scp.linearisation import TrustRegion, linearise, rows_within
from scp_planner.trips.trajectory import Trajectory

pytestmark = pytest.mark.numerics

Array = np.ndarray


@pytest.mark.parametrize("made", [problem_and_trip, curved_problem_and_trip])
def test_rows_out_of_reach_are_left_out_and_cannot_be_violated(made: Any) -> None:
    problem, trip = made(0)
    base = evaluate_trip(problem, trip)
    trust = TrustRegion(0.05, 0.1, 0.01)
    some, every = linearise(problem, base, trust), linearise(problem, base, trust.scaled(1e6))
    assert 0 < len(some.gap) < len(every.gap)
    again = rows_within(problem, every, trust)
    np.testing.assert_array_equal(again.key, some.key)
    np.testing.assert_array_equal(again.matrix, some.matrix)
    box = np.full(every.matrix.shape[1], trust.beta)
    free = problem.ends.free
    box[: free.stop - free.start] = trust.theta * problem.space.tables.leverage[free]
    box[-1] = trust.rho
    rng = np.random.default_rng(4)
    left = every.take(np.flatnonzero(~np.isin(every.key, some.key)))
    assert len(left.gap) == len(every.gap) - len(some.gap)
    for _ in range(200):
        assert np.all(left.matrix @ (box * rng.choice([-1.0, 1.0], len(box))) <= left.gap)


def test_a_straight_path_is_kept_from_bending_too_much_in_one_step() -> None:
    problem, trip = problem_and_trip(0)
    straight = Trajectory.of(problem.space, problem.ends.theta, trip.beta, trip.travel_time)
    base, trust = evaluate_trip(problem, straight), TrustRegion(1.0, 1.0, 0.1)
    assert np.abs(fixed_sites(straight).lateral).max() < 0.1 * problem.limits.lateral_acceleration
    rows = linearise(problem, base, trust)

    def lateral(other: Trajectory) -> Array:
        return fixed_sites(other).lateral / problem.limits.lateral_acceleration

    use, rng = differences(problem, straight, lateral, 1e-5), np.random.default_rng(5)
    free = problem.ends.free
    for _ in range(20):
        z = np.zeros(problem.step_size)
        count = free.stop - free.start
        z[:count] = trust.theta * problem.space.tables.leverage[free] * rng.choice([-1.0, 1.0], count)
        worst = float(np.abs(use @ z).max()) - 1.0
        assert worst > 0.0, "the step is to bend too much"
        assert float((rows.matrix @ z - rows.gap).max()) >= worst - 1e-3
