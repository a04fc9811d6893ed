"""Trips against quadrature, root finding and finite differences."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import quad, solve_ivp

from scp_planner.mathematics.frames import PlanningFrame
from scp_planner.trips.guide import CurvedGuide, Guide, StraightGuide
from scp_planner.trips.path import Path
from scp_planner.trips.space import TripSpace
from scp_planner.trips.trajectory import Trajectory
from scp_planner.trips.trip import Trip

pytestmark = pytest.mark.numerics

BREAKS = (0.0, 0.1, 0.19, 0.4, 0.55, 0.8, 1.0)


def space(acceleration_degree: int = 0, path_degree: int = 3, start_speed: float = 1.0, spans: int = 10) -> TripSpace:
    return TripSpace(StraightGuide(20.0), start_speed, path_degree, spans, acceleration_degree, BREAKS)


def random_trip(trips: TripSpace, seed: int = 0) -> Trajectory:
    rng = np.random.default_rng(seed)
    theta = 0.5 * rng.normal(size=trips.path_size)
    theta[0] = theta[-1] = 0.0
    return Trajectory.of(trips, theta, rng.uniform(-0.1, 0.5, trips.acceleration_size))


def slope(trip: Trajectory, parameter: float) -> float:
    return float(trip.space.path.derivative.rows(np.array([parameter]))[0] @ trip.theta) / trip.space.length


@pytest.mark.parametrize("path_degree", [3, 5])
def test_the_weighted_squares_of_slopes_are_their_sum_over_the_nodes(path_degree: int) -> None:
    trips = space(path_degree=path_degree)
    rng = np.random.default_rng(path_degree)
    weights, theta = rng.uniform(0.5, 2.0, len(trips.tables.node_parameters)), rng.normal(size=trips.path_size)
    nodes, step = trips.tables.node_parameters, 1e-6
    slopes = (trips.path.rows(nodes + step) - trips.path.rows(nodes - step)) @ theta / (2.0 * step)
    form = trips.tables.slopes_squared(weights)
    assert theta @ form @ theta == pytest.approx(weights @ slopes**2, rel=1e-7)
    np.testing.assert_array_equal(form, form.T)


@pytest.mark.parametrize("path_degree", [3, 4, 5])
def test_the_arc_length_is_the_integral_of_the_speed(path_degree: int) -> None:
    trip = random_trip(space(path_degree=path_degree))
    inner = np.linspace(0.0, 1.0, 11)[1:-1]
    for end in (0.13, 0.5, 1.0):
        exact = quad(
            lambda u: 20.0 * np.hypot(1.0, slope(trip, u)),
            0.0,
            end,
            points=inner[inner < end] if end > 0.2 else None,
            limit=300,
            epsabs=1e-12,
        )[0]
        assert trip.path.arc_length_at(np.array([end]))[0] == pytest.approx(exact, abs=2e-5)


def test_stations_are_found_back_from_their_arc_length() -> None:
    trip = random_trip(space())
    parameters = np.linspace(0.0, 1.0, 257)
    found = trip.path.parameter_at(trip.path.arc_length_at(parameters))
    np.testing.assert_allclose(found, parameters, atol=1e-12)


@pytest.mark.parametrize("degree", [0, 1, 2])
@pytest.mark.parametrize("start_speed", [0.0, 1.0])
def test_the_travel_time_is_that_of_integrating_the_acceleration(degree: int, start_speed: float) -> None:
    trip = random_trip(space(degree, start_speed=start_speed))
    tau = trip.travel_time

    def rate(t: float, state: np.ndarray) -> list[float]:
        row = trip.space.acceleration.rows(np.array([t / tau]))[0]
        return [state[1], float(row @ trip.beta)]

    state = np.array([0.0, start_speed])
    for low, high in pairwise(BREAKS):
        # one-sided at breakpoints, where the acceleration may jump
        inside = (low * tau + 1e-12, high * tau - 1e-12)
        state = solve_ivp(rate, inside, state, rtol=1e-11, atol=1e-12).y[:, -1]
    assert state[0] == pytest.approx(trip.path.arc_length, abs=1e-7)
    end = trip.at(trip.space.time_table(np.array([1.0])))
    assert state[1] == pytest.approx(end.speed[0], abs=1e-8)
    assert end.parameter[0] == pytest.approx(1.0, abs=1e-12)


def test_the_travel_time_is_infinite_when_the_vehicle_never_arrives() -> None:
    trips = space()
    assert trips.travel_time(20.0, np.full(trips.acceleration_size, -0.5)) == np.inf


@pytest.mark.parametrize("path_degree", [3, 5])
def test_the_curvature_turns_the_heading(path_degree: int) -> None:
    trip = random_trip(space(path_degree=path_degree))
    u = np.random.default_rng(6).uniform(0.01, 0.99, 80)
    step = 1e-6
    ahead, behind = trip.path.points(u + step), trip.path.points(u - step)
    turn = np.arctan2(*ahead.direction.T[::-1]) - np.arctan2(*behind.direction.T[::-1])
    length = 0.5 * (ahead.speed + behind.speed) * 2 * step * trip.space.length
    points = trip.path.points(u)
    np.testing.assert_allclose(trip.path.bend(points).curvature, turn / length, atol=1e-6)
    rate = (trip.path.bend(ahead).curvature - trip.path.bend(behind).curvature) / (2 * step * 20.0)
    inside = np.abs(u * 10 - np.round(u * 10)) > 1e-4
    np.testing.assert_allclose(trip.path.curvature_rate(points)[inside], rate[inside], rtol=1e-5, atol=1e-5)


def test_station_quantities_are_those_of_points() -> None:
    trip = random_trip(space())
    parameters = trip.space.tables.station_parameters
    points = trip.path.points(parameters)
    at_points, at_stations = trip.path.bend(points), trip.path.station_bend
    np.testing.assert_allclose(at_stations.curvature, at_points.curvature, atol=1e-12)
    np.testing.assert_allclose(trip.path.station_positions, points.position, atol=1e-12)
    np.testing.assert_allclose(trip.path.station_arc_lengths, trip.path.arc_length_at(parameters), atol=1e-12)
    np.testing.assert_allclose(trip.path.station_gradients, trip.path.arc_length_gradient(parameters), atol=1e-12)


@pytest.mark.parametrize("degree", [0, 1, 2])
def test_times_are_found_back_from_distances(degree: int) -> None:
    trip = random_trip(space(degree))
    sigma = np.sort(np.random.default_rng(7).uniform(0.0, 1.0, 200))
    points = trip.at(trip.space.time_table(sigma))
    arrivals = trip.arrivals(points.distance)
    np.testing.assert_allclose(arrivals.sigma, sigma, atol=1e-10)
    np.testing.assert_allclose(arrivals.speed, points.speed, atol=1e-8)
    np.testing.assert_allclose(trip.speed_at(sigma), points.speed, atol=1e-12)


@pytest.mark.parametrize("spans", [10, 30], ids=["few-cells", "many-cells"])
def test_gradients_of_the_arc_length_agree_with_differences(spans: int) -> None:
    trips = space(spans=spans)
    trip = random_trip(trips)
    parameters = np.array([0.0, 0.1, 0.333, 0.77, 1.0])
    gradient = trip.path.arc_length_gradient(parameters)
    step = 1e-4
    for k in range(trips.path_size):
        moved = [trip.theta.copy() for _ in range(2)]
        moved[0][k] += step
        moved[1][k] -= step
        lengths = [Trajectory.of(trips, theta, trip.beta).path.arc_length_at(parameters) for theta in moved]
        np.testing.assert_allclose(gradient[:, k], (lengths[0] - lengths[1]) / (2 * step), atol=1e-8)
    np.testing.assert_allclose(gradient[-1], trip.path.final_gradient, atol=1e-12)


# The arc length by which trips are driven, against quadrature, where speeds over the station change fast

BEND = CurvedGuide(20.0, 0.4 * np.sin(np.linspace(0.0, 3.0, 16)))
"""Its 15 pieces are not the cells of paths with 10 spans."""
GUIDES: list[Guide] = [StraightGuide(20.0), BEND]


def steep(guide: Guide, degree: int = 5, size: float = 2.0, seed: int = 3) -> Path:
    space = TripSpace(guide, 1.0, degree, 10, 0, (0.0, 0.3, 0.6, 1.0))
    theta = size * np.random.default_rng(seed).normal(size=space.path_size)
    return Path(space, theta)


def integral(path: Path, end: float) -> float:
    """The arc length up to a normalised station, piece by piece."""
    inner = np.union1d(np.linspace(0.0, 1.0, 11), np.linspace(0.0, 1.0, 16))
    edges = [*inner[inner < end - 1e-9], end]

    def speed(u: float) -> float:
        return path.space.length * float(path.points(np.array([u])).speed[0])

    return sum(quad(speed, low, high, epsabs=1e-13, epsrel=1e-13, limit=400)[0] for low, high in pairwise(edges))


@pytest.mark.parametrize("guide", GUIDES, ids=["straight", "curved"])
@pytest.mark.parametrize("degree", [3, 5])
def test_arc_lengths_are_as_near_to_the_integral_as_they_say(guide: Guide, degree: int) -> None:
    path = steep(guide, degree)
    exact = path.exact
    assert 0.0 < exact.error < 1e-11 * exact.total
    for end in (0.033, 0.1, 0.47, 0.815, 1.0):
        found = float(exact.at(np.array([end]))[0])
        assert abs(found - integral(path, end)) <= exact.error + 1e-13 * exact.total


@pytest.mark.parametrize("guide", GUIDES, ids=["straight", "curved"])
def test_stations_are_found_back(guide: Guide) -> None:
    path = steep(guide)
    parameters = np.linspace(0.0, 1.0, 1001)
    found = path.exact.parameter_at(path.exact.at(parameters))
    np.testing.assert_allclose(found, parameters, rtol=0.0, atol=1e-13)
    np.testing.assert_allclose(path.exact.parameter_at(np.array([-1.0, 1e9])), [0.0, 1.0], rtol=0.0, atol=1e-13)


@pytest.mark.parametrize("guide", GUIDES, ids=["straight", "curved"])
def test_a_trip_is_driven_at_the_speed_that_it_has(guide: Guide) -> None:
    path = steep(guide)
    drawn = Trajectory.of(path.space, path.theta, np.array([0.3, 0.0, -0.2]))
    trip = Trip(PlanningFrame((0.0, 0.0), 0.0, 0.0), drawn.settled())
    step = 1e-6 * trip.trajectory.travel_time
    times = np.linspace(0.01, 0.99, 4001) * trip.trajectory.travel_time
    there = trip.at(times)[0].speed

    def seen(at: np.ndarray) -> np.ndarray:
        return np.hypot(*at.T) / (2.0 * step)

    ahead, behind = trip.at(times + step)[0], trip.at(times - step)[0]
    np.testing.assert_allclose(seen(ahead.path.position - behind.path.position), there, rtol=0.0, atol=2e-7)
    # Between equal cells the speed over the station is interpolated, and what is driven by that is another speed.
    ends = [drawn.at(drawn.space.time_table((times + by) / drawn.travel_time)).path.position for by in (step, -step)]
    rough = seen(ends[0] - ends[1])
    assert np.abs(rough - there).max() > 1e-4


def test_a_trip_is_settled_to_the_end_of_its_path() -> None:
    path = steep(StraightGuide(20.0), size=6.0)
    drawn = Trajectory.of(path.space, path.theta, np.array([0.3, 0.0, -0.2]))
    assert abs(path.arc_length - path.exact.total) > 1e-9
    settled = drawn.settled()
    driven = settled.drive_at(np.ones(1)).distance[0]
    assert driven == pytest.approx(path.exact.total, rel=1e-14)
    assert settled.arrives
    assert settled.settled() is settled


def test_a_path_with_a_cusp_has_no_error_that_is_known() -> None:
    bend = CurvedGuide(10.0, np.linspace(0.0, 2.0, 11))  # a radius of 5 m
    space = TripSpace(bend, 1.0, 3, 2, 0, (0.0, 1.0))
    path = Path(space, np.full(space.path_size, 5.0))
    assert path.exact.error == float("inf")
