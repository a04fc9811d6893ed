"""Trips in the world: what is told of them at a time, in two ways."""

from __future__ import annotations

import numpy as np
import pytest
from slopes import problem_and_trip

from scp_planner.mathematics.frames import PlanningFrame
from scp_planner.trips import trip as trip_module
from scp_planner.trips.space import TimeTable, TripSpace
from scp_planner.trips.trip import Trip

pytestmark = pytest.mark.numerics


def test_what_is_told_of_many_points_is_told_part_by_part(monkeypatch: pytest.MonkeyPatch) -> None:
    """A third of a million positions took 1.2 GB together; parts of every size tell the same, in its shape."""
    _, trajectory = problem_and_trip(1, seed=2)
    at_once = Trip(PlanningFrame((3.0, -2.0), 0.7, 5.0), trajectory)
    times = np.linspace(4.0, 5.5 + trajectory.travel_time, 84).reshape(2, 6, 7)
    expected = at_once.frame.to_world(at_once.at(times)[0].path.position).reshape(2, 6, 7, 2)
    looked: list[int] = []
    table = type(trajectory.space).time_table

    def told(space: TripSpace, sigma: np.ndarray) -> TimeTable:
        looked.append(len(sigma))
        return table(space, sigma)

    monkeypatch.setattr(TripSpace, "time_table", told)
    monkeypatch.setattr(trip_module, "AT_ONCE", 20)
    found = at_once.told(times, lambda points: at_once.frame.to_world(points.path.position))
    assert looked == [20, 20, 20, 20, 4]
    np.testing.assert_allclose(found, expected, atol=1e-12)
    assert at_once.told(5.5, lambda points: points.speed).shape == ()
    assert at_once.told([], lambda points: points.path.position).shape == (0, 2)
