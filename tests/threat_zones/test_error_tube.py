"""Tubes round plans hold whole new drives as often as they promise."""

from __future__ import annotations

import numpy as np
import pytest
from scenes import VEHICLE, scene

import scp_planner as sp
from scp_planner.errors import EstimationError
from scp_planner.scenario.models import Vehicle
from scp_planner.threat_zones.error_tube import TrackingRecord, TrackingTube, fit_tracking_tube

REPETITIONS = 25


def drives(count: int, rng: np.random.Generator) -> list[TrackingRecord]:
    """Drives of 60 moments, each off by a share of its own of what grows with speed and turns, and by noise."""
    found = []
    for _ in range(count):
        speed, curvature = rng.uniform(0.0, 3.0, 60), rng.uniform(-0.4, 0.4, 60)
        speed[0], curvature[0] = 3.0, 0.4
        size = rng.gamma(4.0, 0.25) * (0.01 + 0.02 * speed + 0.03 * speed**2 * np.abs(curvature))
        angle = rng.uniform(0.0, 2.0 * np.pi, 60)
        driven = size[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1) + 0.002 * rng.normal(size=(60, 2))
        found.append(TrackingRecord.of(speed, curvature, np.zeros((60, 2)), driven))
    return found


@pytest.mark.parametrize("probability", [0.8, 0.95])
def test_whole_new_drives_stay_inside_as_often_as_promised(probability: float) -> None:
    rng = np.random.default_rng(2)
    inside = []
    for _ in range(REPETITIONS):
        tube = fit_tracking_tube(drives(80, rng), probability)
        new = drives(30, rng)
        inside.append(np.mean([np.all(one.error <= tube.radius(one.speed, one.lateral)) for one in new]))
    mean, deviation = float(np.mean(inside)), float(np.std(inside)) / np.sqrt(REPETITIONS)
    # Of 40 drives that size it, split conformal holds between the level and 1 / 41 more.
    assert probability - 3.0 * deviation <= mean <= probability + 1.0 / 41 + 3.0 * deviation


def test_the_form_of_the_error_is_found() -> None:
    tube = fit_tracking_tube(drives(400, np.random.default_rng(3)), 0.9)
    assert tube.per_lateral / tube.per_speed == pytest.approx(1.5, rel=0.2)
    assert tube.records == 200
    speed, lateral = np.array([0.5, 1.0, 2.9]), np.array([0.0, 0.3, 3.0])
    expected = tube.standing + tube.per_speed * speed + tube.per_lateral * lateral
    assert tube.radius(speed, lateral) == pytest.approx(expected)


def test_the_bound_covers_every_moment_of_a_trip_and_is_a_setting() -> None:
    vehicle = Vehicle(**{**VEHICLE, "max_curvature": 0.15})  # 1.35 m/s2 at top speed, less than the 2 m/s2 allowed
    tube = TrackingTube(0.01, 0.01, 0.02, 3.0, 3.6, 0.95, 40)
    assert tube.bound(vehicle) == pytest.approx(0.01 + 0.03 + 0.02 * 1.35)
    post = {"id": "post", "shape": {"disc": 0.5}, "motion": {"position": [10.0, 0.1]}}
    scenario = scene(post)
    bound = tube.bound(scenario.vehicle)
    plan = sp.plan(scenario)
    time = np.linspace(plan.start_time, plan.arrival_time, 300)
    lateral = plan.speed(time) ** 2 * np.abs(plan.curvature(time))
    assert np.all(tube.radius(np.minimum(plan.speed(time), 3.0), lateral) <= bound + 1e-9)
    planner = sp.Planner(scenario, online=sp.OnlineSettings(tracking_error=bound))
    planner.replan(time=0.0, position=(0.0, 0.0), heading=0.0, speed=1.0)
    assert planner.zones[0].radius == pytest.approx(0.5 + bound)


def test_what_was_not_recorded_is_refused() -> None:
    tube = TrackingTube(0.01, 0.01, 0.02, 2.5, 2.0, 0.95, 40)
    with pytest.raises(EstimationError, match=r"speed: must be from 0 to 2\.5"):
        tube.bound(Vehicle(**VEHICLE))
    unbounded = Vehicle(**{**VEHICLE, "max_speed": 2.0, "max_lateral_acceleration": None, "max_curvature": None})
    with pytest.raises(EstimationError, match="lateral: must be from 0 to 2"):
        tube.bound(unbounded)


def test_too_few_drives_and_faulty_ones_are_refused() -> None:
    some = drives(37, np.random.default_rng(1))
    with pytest.raises(EstimationError, match=r"37 drives are too few for 0\.95; it takes 38"):
        fit_tracking_tube(some, 0.95)
    assert np.isfinite(fit_tracking_tube(drives(38, np.random.default_rng(1)), 0.95).standing)
    with pytest.raises(EstimationError, match="too few"):
        fit_tracking_tube(some[:1], 0.5)
    with pytest.raises(EstimationError, match="probability"):
        fit_tracking_tube(some, 1.0)
    with pytest.raises(EstimationError, match="error: must hold finite"):
        TrackingRecord(np.ones(2), np.ones(2), np.array([0.1, np.nan]))
    with pytest.raises(EstimationError, match="lateral: shape"):
        TrackingRecord(np.ones(2), np.ones(3), np.ones(2))
    with pytest.raises(EstimationError, match="no error at all"):
        fit_tracking_tube([TrackingRecord(np.ones(2), np.ones(2), np.zeros(2))] * 4, 0.5)
