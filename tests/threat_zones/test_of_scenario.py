"""Zones against dense searches, finite differences and Monte Carlo."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scenes import disc, observed, scene
from zone_kinds import batch_of

import scp_planner as sp
from scp_planner.mathematics.ellipse import ellipse_contact
from scp_planner.mathematics.frames import PlanningFrame
from scp_planner.threat_zones.batch import ZoneBatch
from scp_planner.threat_zones.of_scenario import ZonesOf, zones
from scp_planner.tracking.estimate import estimate_obstacle

pytestmark = pytest.mark.numerics


def test_points_on_the_axes_of_an_ellipse_have_a_distance() -> None:
    points = np.array([[0.0, 0.0], [0.5, 0.0], [0.0, 0.5], [3.0, 0.0], [0.0, -3.0]])
    contact = ellipse_contact(points, np.tile([4.0, 0.0, 1.0], (5, 1)))
    expected = [-1.0, -np.sqrt(1 - 0.25 / 3), -0.5, 1.0, 2.0]
    np.testing.assert_allclose(contact.distance, expected, atol=1e-8)


def test_the_extra_margin_of_an_obstacle_counts() -> None:
    near, wide = disc("a", (5.0, 5.0)), {**disc("b", (5.0, 5.0)), "margin": 0.25}
    first, second = sp.zones(scene(near, wide))
    point = np.array([0.0, 0.0])
    assert first.signed_distance(0.0, point) - second.signed_distance(0.0, point) == pytest.approx(0.25)


def test_an_estimated_zone_is_its_estimate_scaled_by_the_level() -> None:
    for level in ("per_time", "per_obstacle", "joint"):
        scenario = scene(observed("seen", 1), confidence={"probability": 0.9, "level": level})
        obstacle = scenario.obstacles[0]
        assert obstacle.observations is not None
        estimate = sp.estimate_motion(
            obstacle.observations.time, obstacle.observations.position, obstacle.observations.covariance
        )
        zone = sp.zones(scenario)[0]
        t = np.array([0.0, 2.0, 5.0])
        np.testing.assert_allclose(zone.center(t), estimate.position(t), atol=1e-9)
        ratio = zone.covariance(t) / estimate.covariance(t)
        np.testing.assert_allclose(ratio, ratio[0, 0, 0], rtol=1e-6)
        if level == "per_time":
            assert ratio[0, 0, 0] == pytest.approx(-2.0 * np.log(0.1), rel=1e-6)  # chi-square, 2 degrees
        else:
            assert ratio[0, 0, 0] > -2.0 * np.log(0.1)


def test_an_estimated_zone_grows_and_the_growth_is_in_the_rate() -> None:
    _, batch = batch_of(scene(observed("seen", 1)))
    times, first = np.array([1.0]), np.zeros(1, dtype=int)
    contact = batch.contacts(first, times, batch.centers.at(first, times) + np.array([[10.0, 0.0]]))
    assert contact.rate[0] < -float(contact.normal[0] @ batch.velocities.at(first, times)[0]) - 0.05


def test_a_zone_covers_what_its_polynomials_miss_of_the_estimate() -> None:
    process = {"kind": "singer", "deviation": 0.5, "time_constant": 1.0}
    model = {"process": {"process": process, "velocity_deviation": 1.0, "noise_deviation": 0.1}}
    (zone,) = sp.zones(scene({**observed("seen", 1), "model": model}))
    estimate = estimate_obstacle(scene({**observed("seen", 1), "model": model}).obstacles[0])
    error = estimate.polynomials(0.0, 120.0).center_error
    assert error > 0.0
    assert zone.radius == pytest.approx(0.4 + error, rel=1e-12)


def test_zones_that_are_made_when_asked_for_are_those_of_the_list() -> None:
    """Discs go into a batch as numbers, whatever stands between them, and a batch has the zones in their order."""
    wall = {"id": "wall", "shape": {"polygon": [[0, 0], [3, 0], [3, 1], [1, 1], [1, 3], [0, 3]]}}
    scenario = scene(
        disc("first", (5.0, 3.0), (0.1, -0.4), (0.0, 0.1)),
        observed("seen", 1),
        wall | {"motion": {"position": [12.0, 3.0]}},
        disc("second", (15.0, -3.0), (0.0, 0.5)),
        {"id": "car", "shape": {"rectangle": [3.0, 1.5]}, "motion": {"position": [9.0, -4.0], "velocity": [0.2, 0.6]}},
        disc("third", (25.0, 9.0)),
        start={"time": 1.5},
    )
    made, listed = ZonesOf(scenario), zones(scenario)
    assert [zone.id for zone in made] == [zone.id for zone in listed] == [o.id for o in scenario.obstacles]
    assert made[-1].id == "third" and [zone.id for zone in made[1:3]] == ["seen", "wall"]
    with pytest.raises(IndexError, match="6 zones"):
        _ = made[6]
    frame = PlanningFrame.between((1.0, 2.0), (19.0, -3.0), 1.5)
    quick, slow = ZoneBatch.of(ZonesOf(scenario), frame, 0.3), ZoneBatch.of(listed, frame, 0.3)
    assert quick.ids == slow.ids and quick.size > len(listed)
    rng = np.random.default_rng(0)
    times, points = rng.uniform(0.0, 6.0, 200), rng.uniform(-5.0, 20.0, (200, 2))
    np.testing.assert_allclose(quick.distances(times, points), slow.distances(times, points), atol=1e-12)
    index = rng.integers(quick.size, size=200)
    for name in ("distance", "normal", "rate"):
        expected = getattr(slow.contacts(index, times, points), name)
        np.testing.assert_allclose(getattr(quick.contacts(index, times, points), name), expected, atol=1e-12)


def test_zones_of_many_obstacles_are_those_of_each_alone() -> None:
    """All models, short and long histories, all kinds of noise, and estimates of trackers."""
    rng, obstacles = np.random.default_rng(0), list[dict[str, Any]]()
    models: list[Any] = [{"order": 1}, {"order": 2}, "pedestrian", "car", "ship"]
    for number in range(20):
        count = int(rng.choice([6, 20, 90]))
        times = np.cumsum(rng.uniform(0.05, 0.4, count))
        places = rng.normal(size=2) + times[:, None] * rng.normal(size=2) + rng.normal(0.0, 0.1, (count, 2))
        each = [[[size, 0.0], [0.0, 0.5 * size]] for size in rng.uniform(0.005, 0.05, count).tolist()]
        noise = ([[0.02, 0.006], [0.006, 0.008]], each, None)[number % 3]
        seen = {"time": (times - times[-1]).tolist(), "position": places.tolist(), "covariance": noise}
        obstacles.append(
            {"id": f"o{number}", "shape": {"disc": 0.3}, "observations": seen, "model": models[number % 5]}
        )
        root = rng.normal(size=(4, 4)) * 10.0 ** rng.uniform(-2.0, 0.0, 4)
        told = {"time": 0.0, "position": [3.0, 4.0], "velocity": [0.5, 0.1], "covariance": (root @ root.T).tolist()}
        obstacles.append({"id": f"t{number}", "shape": {"disc": 0.3}, "estimate": told, "model": models[number % 4]})
    for level in ("per_time", "per_obstacle"):
        far = {"start": {"position": [0.0, 500.0]}, "confidence": {"probability": 0.9, "level": level}}
        at = np.array([0.0, 0.7, 3.0, 12.0])
        for zone, obstacle in zip(sp.zones(scene(*obstacles, **far)), obstacles, strict=True):
            (alone,) = sp.zones(scene(obstacle, **far))
            assert zone.id == alone.id and zone.radius == pytest.approx(alone.radius, rel=1e-9)
            np.testing.assert_allclose(zone.center(at), alone.center(at), rtol=1e-9, atol=1e-9)
            np.testing.assert_allclose(zone.covariance(at), alone.covariance(at), rtol=1e-6, atol=1e-12)
