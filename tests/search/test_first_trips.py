"""Trips along ways: what they fit best by least squares, and drives of the textbook."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scenes import CROSSERS, scene

from scp_planner.problem.build import build_problem
from scp_planner.problem.problem import Problem
from scp_planner.search.first_trips import bows, trip_along
from scp_planner.search.ways import WaySearch
from scp_planner.settings.planning import Settings
from scp_planner.threat_zones.of_scenario import zones


def problem_of(**changes: object) -> Problem:
    scenario = scene(*CROSSERS, **changes)
    return build_problem(scenario, zones(scenario), Settings())


@pytest.mark.parametrize("smoothing", [1.0, 0.1])
def test_a_trip_along_a_way_fits_its_offsets_and_bends_as_little(smoothing: float) -> None:
    problem = problem_of()
    way = WaySearch(problem).best()
    assert way is not None and np.abs(way.offsets).max() > 0.3
    trip = trip_along(problem, way, smoothing)
    space, free = problem.space, problem.ends.free
    rows = space.path.rows(way.stations / space.length)
    weighted = space.tables.station_bends * (smoothing / space.length**2)
    matrix, theta = np.concatenate([rows, weighted]), problem.ends.theta.copy()
    wanted = np.concatenate([way.offsets, np.zeros(len(weighted))]) - matrix @ theta
    theta[free] += np.linalg.lstsq(matrix[:, free], wanted, rcond=None)[0]
    assert trip.theta == pytest.approx(np.clip(theta, problem.ends.lower, problem.ends.upper), abs=1e-6)
    assert trip.travel_time == pytest.approx(way.times[-1], rel=0.05)
    assert np.all(trip.beta <= problem.highest_accelerations + 1e-9)
    assert np.all(trip.beta >= problem.lowest_accelerations - 1e-9)


def test_bows_go_to_both_sides_and_arrive() -> None:
    problem = problem_of()
    found = list(bows(problem))
    middle = [float(trip.path.points(np.array([0.5])).position[0, 1]) for trip in found]
    assert [int(np.sign(round(y, 6))) for y in middle] == [0, 1, -1, 1, -1] * 2
    assert all(math.isfinite(trip.travel_time) for trip in found)
    assert min(trip.travel_time for trip in found[5:]) > max(trip.travel_time for trip in found[:1])
