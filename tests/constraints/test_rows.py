"""The constraints of every trip: their rows and gradients against central differences of what they are about."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from scenes import scene
from slopes import assert_rows, curved_problem_and_trip, differences, moved, problem_and_trip, trip_near_the_guide

from scp_planner.arrays import rows_of
from scp_planner.constraints.clearance import SAMPLE_STRIDE, Clearance
from scp_planner.constraints.constraint import Constraint
from scp_planner.constraints.drive import STANDS, DriveRows, kept_by_every_step
from scp_planner.constraints.lateral import LateralAcceleration, station_sites
from scp_planner.problem.build import build_problem
from scp_planner.problem.problem import Problem
from scp_planner.settings.planning import Settings
from scp_planner.threat_zones.of_scenario import zones
from scp_planner.trips.trajectory import Trajectory

pytestmark = pytest.mark.numerics

Array = np.ndarray


Made = Callable[[int], tuple[Problem, Trajectory]]
GUIDES = pytest.mark.parametrize("made", [problem_and_trip, curved_problem_and_trip], ids=["straight", "curved"])


def constraint_of(problem: Problem, name: str) -> Constraint:
    return next(one for one in problem.constraints if one.name == name)


@GUIDES
@pytest.mark.parametrize("degree", [0, 1, 2])
def test_entries_at_given_times(degree: int, made: Made) -> None:
    problem, trip = made(degree)
    times = problem.space.time_table(np.random.default_rng(1).uniform(0.02, 0.98, 20))
    sampled = problem.constraints[0].smooth(times)
    index = np.arange(20 * problem.zones.size)
    assert_rows(sampled.gradient(trip, index), differences(problem, trip, sampled.excess, 1e-5))
    prices = np.random.default_rng(2).uniform(0.1, 1.0, len(index))
    assert sampled.slope(trip, index, prices) == pytest.approx(prices @ sampled.gradient(trip, index), abs=1e-9)
    points = trip.at(times)
    expected = problem.zones.distances(points.time, points.path.position)
    np.testing.assert_allclose(sampled.excess(trip), -expected.ravel())


@pytest.mark.parametrize("degree", [0, 1, 2])
def test_entries_at_minima_and_samples(degree: int) -> None:
    """By the envelope theorem the entry into what has corners changes as its row says, though the minimum moves."""
    boxes = [
        {"id": f"box{k}", "shape": {"rectangle": [2.0, 1.0]}, "motion": {"position": place, "velocity": (-0.3, 0.1)}}
        for k, place in enumerate([(8.0, 1.3), (14.0, -2.2)])
    ]
    scenario = scene(*boxes)
    problem = build_problem(scenario, zones(scenario), Settings(acceleration_degree=degree))
    trip, clearance = trip_near_the_guide(problem, 0), problem.constraints[0]
    assert isinstance(clearance, Clearance)
    excess = clearance.excess(trip)
    rows = clearance.rows(trip, excess)

    def entry(other: Trajectory) -> Array:
        return clearance.worst(other, clearance.excess(other))

    assert np.all(entry(trip) > -0.9)
    nearest = [np.flatnonzero(rows.group == zone)[rows.gap[rows.group == zone].argmin()] for zone in (0, 1)]
    np.testing.assert_allclose(-rows.gap[nearest], entry(trip))
    assert_rows(rows.matrix[nearest], differences(problem, trip, entry, 1e-5), 1e-3)
    points = trip.at(rows_of(problem.samples, np.arange(0, problem.grid, SAMPLE_STRIDE)))
    apart = problem.zones.distances(points.time, points.path.position)
    assert len(rows.gap) >= np.count_nonzero(apart < clearance.near)


@GUIDES
@pytest.mark.parametrize("degree", [0, 1, 2])
def test_arrival_speed_and_acceleration_rows(degree: int, made: Made) -> None:
    problem, trip = made(degree)
    drive = DriveRows(problem)
    matrix, bound, limits = drive.matrix(trip), drive.bounds(trip), problem.limits

    def arrival(other: Trajectory) -> Array:
        final, v0 = problem.space.drive.final_distance, problem.space.start_speed
        tau = other.travel_time
        driven = v0 * tau + tau**2 * float(final @ other.beta)
        return np.array([driven - other.path.arc_length])

    assert_rows(matrix[:1], differences(problem, trip, arrival, 1e-5))
    # The other rows are linear in (b, tau): exact for steps of any size.
    rng = np.random.default_rng(2)
    for _ in range(20):
        z = 0.2 * rng.normal(size=(matrix.shape[1],))
        other = moved(problem, trip, z)
        left = bound[1:] - matrix[1:] @ z
        ratio = 1.0 + z[-1]
        speeds = other.speed_control_points()[1:]
        # The trip moves on by a little at least.
        expected = np.concatenate([(limits.speed - speeds) * ratio, speeds * ratio - STANDS])
        np.testing.assert_allclose(left[: len(expected)], expected, atol=1e-10)
        # Conservative: tau^2 is replaced by its tangent.
        up, down = np.split(left[len(expected) :], 2)
        assert np.all(up <= (limits.acceleration - other.beta) * ratio**2 + 1e-10)
        assert np.all(down <= (limits.deceleration + other.beta) * ratio**2 + 1e-10)


def assert_two_sided(limit: Constraint, trip: Trajectory, value: Array, difference: Array, smooth: Array) -> None:
    """Rows are the upper sides of some values, then lower sides of some: those that are not far away."""
    rows = limit.rows(trip, limit.excess(trip))
    upper, lower = np.flatnonzero(value > -0.5), np.flatnonzero(value < 0.5)
    assert len(rows.gap) == len(upper) + len(lower)
    assert 0 < len(upper) < len(value) or 0 < len(lower) < len(value), "one of the far sides is to be left out"
    for sign, side, of in ((1.0, upper, slice(len(upper))), (-1.0, lower, slice(len(upper), None))):
        np.testing.assert_allclose(rows.gap[of], 1.0 - sign * value[side], atol=1e-12)
        assert_rows(rows.matrix[of][smooth[side]], sign * difference[side[smooth[side]]], 1e-4)
    assert len(np.unique(rows.key)) == len(rows.key)


@GUIDES
@pytest.mark.parametrize("degree", [0, 1, 2])
def test_curvature_and_lateral_acceleration(degree: int, made: Made) -> None:
    problem, trip = made(degree)

    def curvature(other: Trajectory) -> Array:
        return other.path.station_bend.curvature / problem.limits.curvature

    value, difference = curvature(trip), differences(problem, trip, curvature, 1e-5)
    assert_two_sided(constraint_of(problem, "curvature"), trip, value, difference, np.ones(len(value), dtype=bool))
    limit = constraint_of(problem, "lateral_acceleration")
    assert isinstance(limit, LateralAcceleration)
    look, count = limit.look(trip), len(problem.samples.sigma) - problem.grid
    assert len(look.peaks.speed) > 0, "this trip is to come near the limit"
    assert look.jumps is not None and len(look.jumps.time) == count

    def lateral(other: Trajectory) -> Array:
        places = np.concatenate([look.stations.parameters, look.peaks.parameters])
        there = other.at(rows_of(problem.samples, slice(problem.grid, None)))
        jumps = there.speed**2 * other.path.bend(there.path).curvature
        return np.concatenate([station_sites(other, places).lateral, jumps]) / problem.limits.lateral_acceleration

    # Not where the one-sided derivatives differ: at knots of the path or of a piecewise constant acceleration.
    # Jumps are followed in time: only at knots of the path does their curvature bend.
    sigma = np.concatenate([look.stations.sigma, look.peaks.sigma])
    smooth = np.abs(sigma[:, None] - problem.space.acceleration.breakpoints).min(axis=1) > 1e-4
    assert smooth.sum() > 0.6 * len(smooth)
    smooth = np.concatenate([smooth, np.ones(count, dtype=bool)])
    assert_two_sided(limit, trip, lateral(trip), differences(problem, trip, lateral, 1e-6), smooth)


@pytest.mark.parametrize("degree", [0, 1])
def test_what_every_step_keeps_as_descent_prices_it(degree: int) -> None:
    problem, trip = problem_and_trip(degree)
    for constraint in (constraint_of(problem, "speed"), *kept_by_every_step(problem)):
        index = np.arange(len(constraint.excess(trip)))
        found = differences(problem, trip, constraint.excess, 1e-5)
        assert_rows(constraint.gradient(trip, index), found)
        assert len(constraint.rows(trip, constraint.excess(trip)).gap) == 0, "they have rows of their own"


@GUIDES
def test_the_rows_of_the_box_are_exact(made: Made) -> None:
    problem, trip = made(0)
    box = constraint_of(problem, "workspace bounds")
    index = np.arange(len(box.excess(trip)))
    z = np.random.default_rng(3).normal(size=problem.step_size)
    step = box.gradient(trip, index) @ z
    np.testing.assert_allclose(box.excess(trip) + step, box.excess(moved(problem, trip, z)), atol=1e-12)
    world = problem.frame.to_world(trip.path.station_positions)
    keep = problem.scenario.vehicle.radius + problem.settings.box_margin
    expected = np.stack([21.0 - world[:, 0], world[:, 0] + 1.0, 2.0 - world[:, 1], world[:, 1] + 1.3], axis=1)
    np.testing.assert_allclose(-box.excess(trip), (expected - keep).ravel(), atol=1e-12)


# When trips are nearest to corners, against dense samples of them


@pytest.mark.parametrize("turn", [0.02, 0.3, 1.5])
@pytest.mark.parametrize("speed", [0.0, 0.7])
def test_corners_that_stand_or_come_are_passed_as_near_as_they_are(turn: float, speed: float) -> None:
    rng = np.random.default_rng(5)
    # Roofs over the way, each with its ridge somewhere between two samples
    roofs = [
        {
            "id": f"roof{k}",
            "shape": {"polygon": [(0.0, 0.0), (-2.0, -2.0 * np.tan(turn / 2)), (2.0, -2.0 * np.tan(turn / 2))]},
            "motion": {"position": (float(x), -0.36), "velocity": (-speed, 0.0)},
        }
        for k, x in enumerate(rng.uniform(5.0, 15.0, 8))
    ]
    scenario = scene(*roofs, vehicle={"radius": 0.3}, start={"speed": 2.0})
    problem = build_problem(scenario, zones(scenario), Settings())
    space = problem.space
    theta = 0.05 * np.sin(np.linspace(0.0, np.pi, space.path_size)) ** 2
    trip = Trajectory.of(space, theta, np.linspace(0.2, -0.2, space.acceleration_size))
    clearance = problem.constraints[0]
    dense = trip.at(space.time_table(np.linspace(0.0, 1.0, 40_001)))
    expected = problem.zones.distances(dense.time, dense.path.position).min(axis=0)
    np.testing.assert_allclose(-clearance.worst(trip, clearance.excess(trip)), expected, atol=2e-6)
