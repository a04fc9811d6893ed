"""What the loop knows of a trip, against dense samples of it."""

from __future__ import annotations

import numpy as np
import pytest
from slopes import problem_and_trip

from scp_planner.scp.evaluation import evaluate_trip
from scp_planner.scp.merit import Limit, Penalties

pytestmark = pytest.mark.numerics


@pytest.mark.parametrize("degree", [0, 1, 2])
@pytest.mark.parametrize("seed", range(4))
def test_violations_are_those_of_dense_samples_and_the_merit_is_their_price(degree: int, seed: int) -> None:
    problem, trip = problem_and_trip(degree, seed=seed)
    found = evaluate_trip(problem, trip, 1.0)
    points = trip.at(problem.space.time_table(np.linspace(0.0, 1.0, 20_001)))
    entry = -problem.zones.distances(points.time, points.path.position, np.inf).min(axis=0)
    # Between samples the minimum of a parabola is looked at: no deeper than the deepest, and nearer to it
    deepest, sampled = np.maximum(entry, 0.0), np.maximum(-found.clearance.min(axis=0), 0.0)
    assert np.all(found.zone_violation <= deepest + 1e-6)
    assert np.all(deepest - found.zone_violation <= 0.5 * (deepest - sampled) + 1e-6)
    speed = np.abs(points.speed).max() / problem.limits.speed - 1.0
    assert found.limit_violation[Limit.SPEED] == pytest.approx(max(speed, 0.0), abs=1e-3)
    box = problem.box.offsets - trip.path.station_positions @ problem.box.normals.T
    assert found.limit_violation[Limit.WORKSPACE_BOUNDS] == pytest.approx(max(-box.min(), 0.0), abs=1e-12)
    assert found.worst_violation == max(found.zone_violation.max(), found.limit_violation.max())
    price = 7.0 * (found.zone_violation.sum() + found.limit_violation.sum())
    assert found.merit(Penalties.uniform(problem, 7.0)) == pytest.approx(trip.travel_time + price)
