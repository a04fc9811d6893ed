"""Trips in the world: what is told of them at a time, in two ways."""

from __future__ import annotations

import numpy as np
import pytest
from slopes import problem_and_trip

from scp_planner.mathematics.frames import PlanningFrame
from scp_planner.trips.trip import Trip

pytestmark = pytest.mark.numerics


@pytest.mark.parametrize("degree", [0, 1, 2])
def test_the_place_at_a_time_is_that_of_its_points_and_the_ends_are_not_left(degree: int) -> None:
    _, trajectory = problem_and_trip(degree, seed=1)
    trip = Trip(PlanningFrame((3.0, -2.0), 0.7, 5.0), trajectory)
    ends = 5.0, 5.0 + trajectory.travel_time
    times = np.array([ends[0] - 1.0, *np.linspace(*ends, 7), ends[1] + 1.0])
    points, _ = trip.at(times)
    expected = trip.frame.to_world(points.path.position)
    found = np.array([trip.place_at(float(time)) for time in times])
    assert found == pytest.approx(expected, abs=1e-9)
    assert found[[0, -1]] == pytest.approx(found[[1, -2]], abs=1e-9)
