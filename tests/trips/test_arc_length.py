"""The arc length by which trips are driven, against quadrature, where speeds over the station change fast."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import quad

from scp_planner.mathematics.frames import PlanningFrame
from scp_planner.trips.arc_length import ArcLength
from scp_planner.trips.guide import CurvedGuide, Guide, StraightGuide
from scp_planner.trips.path import Path
from scp_planner.trips.space import TripSpace
from scp_planner.trips.trajectory import Trajectory
from scp_planner.trips.trip import Trip

pytestmark = pytest.mark.numerics

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


def test_the_error_is_no_less_than_what_few_nodes_leave() -> None:
    path = steep(StraightGuide(20.0))
    one = ArcLength(path._speeds, 20.0, np.linspace(0.0, 1.0, 11))
    left, width = np.array([0.3]), np.array([0.1])
    fitted = one._fitted(left, width)
    bound = float(one._strays(left, width, fitted)[0])
    x = np.linspace(-1.0, 1.0, 4001)
    value, speed = np.polynomial.polynomial.polyval(x, fitted[0]), path._speeds(0.3 + 0.05 * (1.0 + x))
    share = float(np.abs(value - speed).max() / speed.min())
    assert 1e-6 < share <= bound  # one cell over a whole span is far from good enough, and that is seen


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


@pytest.mark.parametrize("guide", GUIDES, ids=["straight", "curved"])
def test_a_single_distance_is_found_as_among_others(guide: Guide) -> None:
    exact = steep(guide).exact
    distances = np.linspace(-0.1, 1.1, 37) * exact.total
    together = exact.parameter_at(distances)
    alone = np.array([float(exact.parameter_at(one)[0]) for one in distances[:, None]])
    np.testing.assert_allclose(alone, together, rtol=0.0, atol=1e-14)
    np.testing.assert_allclose(
        exact.at(alone), np.clip(distances, 0.0, exact.total), rtol=0.0, atol=1e-13 * exact.total
    )
