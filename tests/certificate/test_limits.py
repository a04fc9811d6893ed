"""The certificate's bounds of what limits are used, against fine searches."""

from __future__ import annotations

import numpy as np
import pytest
from reference_trips import (
    FRAME,
    SEEDS,
    Reference,
    broken,
    least,
    random_trip,
    the_scene,
    vehicle_limits,
    verdict,
)

from scp_planner.trips.guide import StraightGuide
from scp_planner.trips.space import TripSpace
from scp_planner.trips.trajectory import Trajectory
from scp_planner.trips.trip import Trip

pytestmark = pytest.mark.numerics


@pytest.mark.parametrize(
    ("limit", "name"),
    [
        ("max_speed", "speed"),
        ("max_acceleration", "acceleration"),
        ("max_deceleration", "acceleration"),
        ("max_curvature", "curvature"),
        ("max_lateral_acceleration", "lateral_acceleration"),
    ],
)
@pytest.mark.parametrize("seed", SEEDS)
def test_a_limit_broken_by_a_thousandth_is_refused(seed: int, limit: str, name: str) -> None:
    trip = random_trip(seed, path_degree=3 + seed % 3)
    worst = vehicle_limits(Reference(trip))[limit]
    assert worst > 0.0

    refused = verdict(the_scene(vehicle={limit: worst / 1.001}), trip)
    assert broken(refused) == {name}
    (violation,) = refused.violations
    assert abs(violation.value) == pytest.approx(worst, rel=1e-3)
    assert abs(violation.allowed) == pytest.approx(worst / 1.001)

    kept = verdict(the_scene(vehicle={limit: worst * (1.0 + 1e-6)}), trip)
    assert broken(kept) == set()
    assert abs(kept.limits[name].worst) == pytest.approx(worst, rel=2e-3)


@pytest.mark.parametrize("seed", [0, 1, 3])
def test_a_peak_of_curvature_between_knots_is_found(seed: int) -> None:
    trip = random_trip(seed, path_degree=5, bow=1.2)
    reference = Reference(trip)
    where, value = least(lambda s: -np.abs(reference.curvature_at(s)), 0.0, 20.0, 200001)
    assert np.abs(reference.station_knots - where).min() > 0.05
    assert broken(verdict(the_scene(vehicle={"max_curvature": -value * (1.0 - 1e-6)}), trip)) == {"curvature"}
    assert broken(verdict(the_scene(vehicle={"max_curvature": -value * (1.0 + 1e-6)}), trip)) == set()


@pytest.mark.parametrize("degree", [1, 2])
def test_speed_and_acceleration_of_smooth_profiles_are_bounded(degree: int) -> None:
    """By control points, which a smooth profile stays below: what is refused may hold, what is accepted does."""
    trip = random_trip(2, acceleration_degree=degree)
    worst = vehicle_limits(Reference(trip))
    for limit, name in (
        ("max_speed", "speed"),
        ("max_acceleration", "acceleration"),
        ("max_deceleration", "acceleration"),
    ):
        assert broken(verdict(the_scene(vehicle={limit: worst[limit] / 1.001}), trip)) == {name}
        assert broken(verdict(the_scene(vehicle={limit: worst[limit] * 1.5 + 0.2}), trip)) == set()


@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize("seed", SEEDS)
def test_limits_are_told_apart_to_a_millionth(seed: int, degree: int) -> None:
    """Control points of smooth profiles lie farther beyond them than that."""
    trip = random_trip(seed, acceleration_degree=degree)
    reference = Reference(trip)
    times = np.linspace(0.0, reference.tau, 200_001)
    speed, acceleration = float(reference.speed(times).max()), reference.acceleration(times)
    room = 1.0 + 1e-6
    limits = {
        "max_speed": speed * room,
        "max_acceleration": float(acceleration.max()) * room,
        "max_deceleration": max(-float(acceleration.min()) * room, 1e-3),
    }
    assert broken(verdict(the_scene(vehicle=limits), trip)) == set()
    for name, what in (("max_speed", "speed"), ("max_acceleration", "acceleration")):
        less = {**limits, name: limits[name] / room**2}
        assert broken(verdict(the_scene(vehicle=less), trip)) == {what}


def test_driving_backwards_is_refused() -> None:
    space = TripSpace(StraightGuide(20.0), 1.0, 3, 9, 0, (0.0, 0.3, 0.6, 1.0))
    beta = np.array([-0.5, 0.5, 0.6])
    trip = Trip(FRAME, Trajectory.of(space, np.zeros(space.path_size), beta))
    assert Reference(trip).speed(np.array([0.3 * trip.trajectory.travel_time]))[0] < 0.0
    assert broken(verdict(the_scene(), trip)) == {"speed"}
