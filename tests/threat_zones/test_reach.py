"""Zones cut to what an obstacle can reach: how often they hold motions within the bounds, and how far they go."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

import scp_planner as sp
from scp_planner.arrays import Array
from scp_planner.errors import ScenarioError
from scp_planner.mathematics.frames import PlanningFrame
from scp_planner.prediction.foresight import foreseen
from scp_planner.prediction.obstacle_tracks import ObstacleTracks
from scp_planner.threat_zones.batch import ZoneBatch
from scp_planner.threat_zones.zone import ThreatZone

pytestmark = pytest.mark.numerics

TOP, HARDEST, NOISE, LEVEL = 3.0, 0.8, 0.1, 0.9
BOUNDS = {"max_speed": TOP, "max_acceleration": HARDEST}
SINGER = {
    "process": {"kind": "singer", "deviation": HARDEST / math.sqrt(3.0), "time_constant": 6.0},
    "velocity_deviation": 2.0,
    "noise_deviation": NOISE,
}
SEEN, LEADS, STEP = np.arange(-3.0, 0.01, 0.2), np.array([0.5, 1.0, 2.0, 4.0, 8.0, 16.0]), 0.02


def driven(rng: np.random.Generator, count: int, hold: float | None) -> tuple[Array, Array]:
    """Places at `SEEN` and `LEADS` of motions that keep to the bounds, about the place at time 0.

    They accelerate as Singer has it, or from time 0 on as hard as they may, anew after so many seconds.
    """
    deviation, keeps = HARDEST / math.sqrt(3.0), math.exp(-STEP / 6.0)
    velocity = rng.uniform(0.3, 0.95, count)[:, None] * TOP * _units(rng, count)
    push, place = deviation * rng.standard_normal((count, 2)), np.zeros((count, 2))
    found = []
    for number in range(round((LEADS[-1] - SEEN[0]) / STEP) + 1):
        now = round(number + SEEN[0] / STEP)
        found.append(place.copy())
        if hold is None:
            push = keeps * push + deviation * math.sqrt(1.0 - keeps**2) * rng.standard_normal((count, 2))
        elif now < 0:
            push = np.zeros((count, 2))
        elif now % round(hold / STEP) == 0:
            push = HARDEST * _units(rng, count)
        push /= np.maximum(np.hypot(*push.T) / HARDEST, 1.0)[:, None]
        place += STEP * velocity
        velocity += STEP * push
        velocity /= np.maximum(np.hypot(*velocity.T) / TOP, 1.0)[:, None]
    every = np.array(found)
    places = [every[np.round((some - SEEN[0]) / STEP).astype(int)] for some in (SEEN, LEADS, np.zeros(1))]
    return places[0] - places[2], places[1] - places[2]


def _units(rng: np.random.Generator, count: int) -> Array:
    angle = rng.uniform(0.0, 2.0 * math.pi, count)
    return np.stack([np.cos(angle), np.sin(angle)], axis=1)


def scene(obstacles: list[dict[str, Any]], level: str = "per_time", probability: float = LEVEL) -> sp.Scenario:
    return sp.Scenario(
        vehicle={"radius": 0.3, "max_speed": 3.0, "max_acceleration": 1.5, "max_deceleration": 2.0},
        start={"time": 0.0, "position": (-30.0, 0.0), "speed": 1.0},
        goal={"position": (-10.0, 0.0)},
        obstacles=obstacles,
        confidence={"level": level, "probability": probability},
    )


def seen(rng: np.random.Generator, number: int, path: Array, model: Any) -> dict[str, Any]:
    """An obstacle that was at places (n, 2), or has moved with a velocity (2,)."""
    path = path if path.ndim == 2 else SEEN[:, None] * path
    places = path + NOISE * rng.standard_normal((len(SEEN), 2))
    observations = {"time": SEEN.tolist(), "position": places.tolist(), "covariance": (NOISE**2 * np.eye(2)).tolist()}
    return {"id": str(number), "shape": {"disc": 0.3}, "observations": observations, "model": model}


def held(zone: ThreatZone, times: Array, places: Array) -> Array:
    """True if the centre is in its region at each of some times."""
    offset = places - zone.center(times)
    return np.asarray(np.einsum("na,nab,nb->n", offset, np.linalg.inv(zone.covariance(times)), offset) <= 1.0)


@pytest.mark.parametrize("hold", [None, 1.0, 5.0, 20.0])
def test_motions_within_the_bounds_are_held_at_the_level(hold: float | None) -> None:
    """Those of the model at all times, and any others from when the zone is all that can be reached."""
    rng, count = np.random.default_rng(2), 300
    before, after = driven(rng, count, hold)
    some = [seen(rng, k, before[:, k], {"process": {**SINGER, **BOUNDS}}) for k in range(count)]
    made = sp.zones(scene(some))
    share = np.mean([held(zone, LEADS, after[:, k]) for k, zone in enumerate(made)], axis=0)
    assert (share[slice(None if hold is None else 4, None)] >= LEVEL - 0.02).all(), share


@pytest.mark.parametrize("process", [{"process": SINGER}, {"order": 2}], ids=["singer", "polynomial"])
@pytest.mark.parametrize("level", ["per_time", "joint"])
def test_zones_are_never_larger_than_the_model_nor_than_the_bounds_allow(process: Any, level: str) -> None:
    velocity = np.array([2.0, 0.0])
    bounded, free = (
        sp.zones(scene([seen(np.random.default_rng(3), 0, velocity, {**process, **more})], level))[0]
        for more in (BOUNDS, {})
    )
    late, unit = np.linspace(0.0, 100.0, 301), np.stack([np.cos(np.arange(8.0)), np.sin(np.arange(8.0))], axis=1)
    for direction in unit:
        room, own = bounded.support(late, direction), free.support(late, direction)
        # by at most what the ball about the estimated velocity is beyond the top speed when it is left
        assert (room <= room[0] + NOISE + TOP**2 / (2.0 * HARDEST) + TOP * late).all()
        assert (room <= 1.05 * own).all()  # a share of the level is the velocity's
    areas = [np.linalg.det(zone.covariance(late)) for zone in (bounded, free)]
    assert areas[0][-1] < 0.1 * areas[1][-1]


def test_a_ship_reaches_no_farther_than_twenty_knots_take_it() -> None:
    times, speed = np.arange(-60.0, 1.0, 6.0), 9.26
    places = np.outer(times, [speed, 0.0]) + np.random.default_rng(0).normal(0.0, 5.0, (len(times), 2))
    sights = {"time": times.tolist(), "position": places.tolist(), "covariance": [[25.0, 0.0], [0.0, 25.0]]}
    ship = {"id": "ship", "shape": {"disc": 10.0}, "observations": sights, "model": "ship"}
    vehicle = {"radius": 8.0, "max_speed": 7.0, "max_acceleration": 0.1, "max_deceleration": 0.1}
    start = {"time": 0.0, "position": (3000, -3000), "speed": 4.0}
    (zone,) = sp.zones(sp.Scenario(vehicle=vehicle, start=start, goal={"position": (8000, -3000)}, obstacles=[ship]))
    assert float(zone.support(300.0, (0.0, 1.0))) < 10.3 * 300.0 + 50.0
    assert held(zone, np.array([60.0, 300.0]), np.array([[speed * 60.0, 0.0], [speed * 300.0, 0.0]])).all()


@pytest.mark.parametrize("bounds", [BOUNDS, {"max_speed": TOP}])
def test_what_is_seen_to_be_faster_than_its_top_speed_is_held_too(bounds: Any) -> None:
    rng, velocity = np.random.default_rng(5), np.array([2.0 * TOP, 0.0])
    (zone,) = sp.zones(scene([seen(rng, 0, velocity, {"process": SINGER, **bounds})]))
    assert held(zone, LEADS, LEADS[:, None] * velocity).all()


@pytest.mark.parametrize("level", ["per_time", "joint"])
def test_zones_of_tracks_are_cut_too(level: str) -> None:
    """New ones, learnt ones, and one whose motion has changed."""
    rng, velocities = np.random.default_rng(4), np.array([[2.0, 0.0], [0.0, 1.5], [1.0, 1.0]])
    tracks = ObstacleTracks(sp.Confidence(level=level, probability=0.95))
    for k in range(3):
        tracks.add_unseen(str(k), sp.Disc(disc=0.3), sp.Model(order=2, **BOUNDS), 0.0, NOISE**2 * np.eye(2))
    for time in np.arange(0.0, 6.01, 0.1):
        for k, velocity in enumerate(velocities):
            if k or time > 5.5:
                swerve = 0.35 * max(time - 4.0, 0.0) ** 2 * np.array([1.0, -1.0]) * (k == 2)
                x, y = time * velocity + swerve + NOISE * rng.standard_normal(2)
                tracks.observe(str(k), float(time), (float(x), float(y)))
        made = tracks.zones(float(time))
    for zone in made:
        size = np.sqrt(np.linalg.eigvalsh(zone.covariance(np.array([6.0, 36.0])))[:, -1])
        assert size[1] <= size[0] + 30.0 * TOP + 1e-9
    again = sp.zones(scene([]).model_copy(update={"obstacles": tracks.as_obstacles()}))
    assert len(again) == 3


def test_zones_with_later_measurements_follow_the_expected_motion() -> None:
    """Beyond the foresight they keep their size, and their offset from where the obstacle is expected."""
    velocity = np.array([2.0, 0.0])
    (zone,) = sp.zones(scene([seen(np.random.default_rng(1), 0, velocity, {"process": SINGER, **BOUNDS})]))
    batch = ZoneBatch.of((zone,), PlanningFrame((0.0, 0.0), 0.0, 0.0), 0.0)
    assert zone.expected is not None
    (expected,) = np.diff(zone.expected.grid(np.array([8.0, 20.0]))[:, 0], axis=0)
    (moved,) = np.diff(foreseen(batch, 8.0, {}).centers.grid(np.array([8.0, 20.0]))[:, 0], axis=0)
    np.testing.assert_allclose(moved, expected, atol=1e-6)
    np.testing.assert_allclose(foreseen(batch, 8.0, {}).centers.grid(np.array([5.0]))[0, 0], zone.center(5.0))


@pytest.mark.parametrize("name", ["max_speed", "max_acceleration"])
def test_bounds_that_are_not_positive_are_refused(name: str) -> None:
    with pytest.raises(ScenarioError, match=name):
        scene([seen(np.random.default_rng(0), 0, np.ones(2), {"process": SINGER, name: 0.0})])
