"""Trips along ways: what they fit best by least squares, and drives of the textbook."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from scenes import CROSSERS, scene

from scp_planner.problem.build import build_problem
from scp_planner.problem.problem import Problem
from scp_planner.search.first_trips import _fastest_drive, _highest, bows, trip_along
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


@pytest.mark.parametrize("length", [0.5, 20.0, 300.0])
def test_the_fastest_drive_speeds_up_and_cruises(length: float) -> None:
    """Piecewise constant accelerations: at full where a span begins before the top speed is reached."""
    problem = problem_of(goal={"position": [length, 0.0]}) if length != 20.0 else problem_of()
    beta = _fastest_drive(problem, length)
    rise, ramp = 2.0 / 1.5, 0.5 * (1.0 + 3.0) * 2.0 / 1.5  # from 1 to 3 m/s at 1.5 m/s^2
    time = rise + (length - ramp) / 3.0 if length > ramp else (math.sqrt(1.0 + 3.0 * length) - 1.0) / 1.5
    begins = problem.space.acceleration.breakpoints[:-1] * time
    clear = np.abs(begins - rise) > 1e-2  # limits have a margin
    assert beta[clear] == pytest.approx(np.where(begins < rise, 1.5, 0.0)[clear], rel=1e-3)


def test_the_motor_bounds_accelerations_by_its_power_over_the_speed() -> None:
    problem = problem_of(vehicle={"max_power": 1.2})
    times = np.linspace(0.0, 10.0, 201)
    highest = _highest(problem, times, 2.0 * times)
    assert highest == pytest.approx(np.minimum(1.2 / 2.0, problem.highest_accelerations), rel=1e-6)
    unbounded = replace(problem, scenario=scene(*CROSSERS))
    assert np.array_equal(_highest(unbounded, times, 2.0 * times), problem.highest_accelerations)


def test_bows_go_to_both_sides_and_arrive() -> None:
    problem = problem_of()
    found = list(bows(problem))
    middle = [float(trip.path.points(np.array([0.5])).position[0, 1]) for trip in found]
    assert [int(np.sign(round(y, 6))) for y in middle] == [0, 1, -1, 1, -1] * 2
    assert all(math.isfinite(trip.travel_time) for trip in found)
    assert min(trip.travel_time for trip in found[5:]) > max(trip.travel_time for trip in found[:1])
