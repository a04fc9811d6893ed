"""Every kind of row against central differences of what it linearises."""

from __future__ import annotations

import numpy as np
import pytest
from slopes import assert_rows, differences, moved, problem_and_trip

from scp_planner.scp.bend_sites import bend_sites, station_sites
from scp_planner.scp.evaluation import box_gaps, evaluate_trip
from scp_planner.scp.linearisation import TrustRegion, linearise, rows_within
from scp_planner.scp.rows.base import Rows
from scp_planner.scp.rows.bends import STILL, curvature_rows, lateral_rows
from scp_planner.scp.rows.box import box_rows
from scp_planner.scp.rows.clearance import ClearanceSites, clearance_rows
from scp_planner.scp.rows.drive import KinematicRows
from scp_planner.trips.trajectory import Trajectory

pytestmark = pytest.mark.numerics

Array = np.ndarray


@pytest.mark.parametrize("degree", [0, 1, 2])
def test_clearance_rows(degree: int) -> None:
    problem, trip = problem_and_trip(degree)
    table = problem.space.time_table(np.random.default_rng(1).uniform(0.02, 0.98, 40))
    zone = np.arange(40) % problem.zones.size
    points = trip.at(table)
    contacts = problem.zones.contacts(zone, points.time, points.path.position)
    rows = clearance_rows(problem, trip, ClearanceSites.of(zone, np.arange(40), points, contacts))

    def distance(other: Trajectory) -> Array:
        there = other.at(table)
        return problem.zones.contacts(zone, there.time, there.path.position).distance

    assert_rows(-rows.matrix, differences(problem, trip, distance, 1e-5))
    np.testing.assert_allclose(rows.gap, contacts.distance)


@pytest.mark.parametrize("degree", [0, 1, 2])
def test_arrival_speed_and_acceleration_rows(degree: int) -> None:
    problem, trip = problem_and_trip(degree)
    kinematics = KinematicRows(problem)
    matrix, bound = np.full((kinematics.count, kinematics.width), np.nan), kinematics.bounds(trip)
    kinematics.write(trip, matrix)
    limits = problem.limits

    def arrival(other: Trajectory) -> Array:
        tables, v0 = problem.space.tables, problem.space.start_speed
        tau = other.travel_time
        driven = v0 * tau + tau**2 * float(tables.final_distance @ other.beta)
        return np.array([driven - other.path.arc_length])

    assert_rows(matrix[:1], differences(problem, trip, arrival, 1e-5))
    # The other rows are linear in (b, tau): exact for steps of any size.
    rng = np.random.default_rng(2)
    for _ in range(20):
        z = rng.normal(size=matrix.shape[1]) * 0.2
        other = moved(problem, trip, z)
        left = bound[1:] - matrix[1:] @ z
        ratio = 1.0 + z[-1]
        speeds = other.speed_control_points()[1:]
        # The trip moves on by a little at least.
        expected = np.concatenate([(limits.speed - speeds) * ratio, speeds * ratio - STILL])
        np.testing.assert_allclose(left[: len(expected)], expected, atol=1e-10)
        # Conservative: tau^2 is replaced by its tangent.
        up, down = np.split(left[len(expected) :], 2)
        assert np.all(up <= (limits.acceleration - other.beta) * ratio**2 + 1e-10)
        assert np.all(down <= (limits.deceleration + other.beta) * ratio**2 + 1e-10)


def assert_both_sides(
    rows: Rows, value: Array, difference: Array, tolerance: float = 2e-5, smooth: Array | None = None
) -> None:
    """Rows are the upper sides of some values, then lower sides of some: those that are not far away."""
    smooth = np.ones(len(value), dtype=bool) if smooth is None else smooth
    upper, lower = np.flatnonzero(value > -0.5), np.flatnonzero(value < 0.5)
    assert len(rows.gap) == len(upper) + len(lower)
    assert 0 < len(upper) < len(value) or 0 < len(lower) < len(value), "one of the far sides is to be left out"
    for sign, side, of in ((1.0, upper, slice(len(upper))), (-1.0, lower, slice(len(upper), None))):
        np.testing.assert_allclose(rows.gap[of], 1.0 - sign * value[side], atol=1e-12)
        assert_rows(rows.matrix[of][smooth[side]], sign * difference[side[smooth[side]]], tolerance)


@pytest.mark.parametrize("degree", [0, 1, 2])
def test_curvature_and_lateral_rows(degree: int) -> None:
    problem, trip = problem_and_trip(degree)
    sites = bend_sites(problem, trip, trip.at(problem.samples))
    assert len(sites.peaks.speed) > 0, "this trip is to come near the limit"
    rows = curvature_rows(problem, sites, 0)

    def curvature(other: Trajectory) -> Array:
        return other.path.station_bend.curvature / problem.limits.curvature

    assert_both_sides(rows, curvature(trip), differences(problem, trip, curvature, 1e-5))

    lateral = lateral_rows(problem, trip, trip.at(problem.samples), sites, 0)

    def value(other: Trajectory) -> Array:
        fixed = station_sites(other, problem.space.tables.station_parameters).lateral
        peaks = station_sites(other, sites.peaks.parameters).lateral
        there = other.at(problem.samples).take(slice(problem.grid, None))
        jumps = there.speed**2 * other.path.bend(there.path).curvature
        return np.concatenate([fixed, peaks, jumps]) / problem.limits.lateral_acceleration

    difference = differences(problem, trip, value, 1e-6)
    # Not where the one-sided derivatives differ: at knots of the path or of a piecewise constant acceleration.
    breaks = problem.space.acceleration.breakpoints
    sigma = np.concatenate([sites.stations.sigma, sites.peaks.sigma])
    smooth = np.abs(sigma[:, None] - breaks).min(axis=1) > 1e-4
    assert smooth.sum() > 0.6 * len(smooth)
    # Jumps are followed in time: only at knots of the path does their curvature bend.
    assert sites.jumps is not None and len(sites.jumps.lateral) == len(breaks) - 2
    smooth = np.concatenate([smooth, np.ones(len(breaks) - 2, dtype=bool)])
    assert_both_sides(lateral, value(trip), difference, 1e-4, smooth)


def test_box_rows_are_exact() -> None:
    problem, trip = problem_and_trip(0)
    gaps = box_gaps(problem, trip.path)
    rows = box_rows(problem, gaps, 0, np.inf)
    z = np.random.default_rng(3).normal(size=(rows.matrix.shape[1],))
    there = box_gaps(problem, moved(problem, trip, z).path)
    np.testing.assert_allclose(rows.gap - rows.matrix @ z, there.ravel(), atol=1e-12)
    world = problem.frame.to_world(trip.path.station_positions)
    keep = problem.scenario.vehicle.radius + problem.settings.box_margin
    expected = np.stack([21.0 - world[:, 0], world[:, 0] + 1.0, 2.0 - world[:, 1], world[:, 1] + 1.3], axis=1)
    np.testing.assert_allclose(gaps, expected - keep, atol=1e-12)


def test_rows_out_of_reach_are_left_out_and_cannot_be_violated() -> None:
    problem, trip = problem_and_trip(0)
    base = evaluate_trip(problem, trip, 1.5)
    trust = TrustRegion(0.05, 0.1, 0.01)
    some, every = linearise(problem, base, trust, 1.5), linearise(problem, base, trust.scaled(1e6), 1.5)
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
    base, trust = evaluate_trip(problem, straight, 1.5), TrustRegion(1.0, 1.0, 0.1)
    assert base.sites.worst_lateral < 0.1 * problem.limits.lateral_acceleration
    rows = linearise(problem, base, trust, 1.5)

    def lateral(other: Trajectory) -> Array:
        stations = problem.space.tables.station_parameters
        there = station_sites(other, stations)
        return there.lateral / problem.limits.lateral_acceleration

    use, rng = differences(problem, straight, lateral, 1e-5), np.random.default_rng(5)
    free = problem.ends.free
    for _ in range(20):
        z = np.zeros(problem.step_size)
        count = free.stop - free.start
        z[:count] = trust.theta * problem.space.tables.leverage[free] * rng.choice([-1.0, 1.0], count)
        worst = float(np.abs(use @ z).max()) - 1.0
        assert worst > 0.0, "the step is to bend too much"
        assert float((rows.matrix @ z - rows.gap).max()) >= worst - 1e-3
