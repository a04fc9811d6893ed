"""Zones of tracked obstacles: how often they hold what comes, how large they are, and which observations count."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

import scp_planner as sp
from scp_planner.arrays import Array
from scp_planner.prediction.obstacle_tracks import ObstacleTracks
from scp_planner.settings.online import Regions, SceneOnlineSettings
from scp_planner.threat_zones.of_scenario import zones
from scp_planner.threat_zones.zone import ThreatZone
from scp_planner.tracking.estimate import estimate_obstacle
from scp_planner.tracking.estimators import MOST_LATE
from scp_planner.tracking.maximum_likelihood import estimate_motion

pytestmark = pytest.mark.numerics

NOISE, STEP = 0.1, 0.1
SIGMA = NOISE**2 * np.eye(2)
SCALE = -2.0 * math.log(0.05)
"""Of the region of two normal errors at 95 %."""


def tracked(
    places: Array,
    model: dict[str, Any] | None = None,
    watch: SceneOnlineSettings | None = None,
    probability: float = 0.95,
) -> ObstacleTracks:
    """Obstacles at places (F, K, 2) that are observed one frame after the other, and asked for their zones each time.

    A frame that is not a number is one in which the obstacle is not seen.
    """
    tracks = ObstacleTracks(sp.Confidence(level="per_time", probability=probability), settings=watch)
    for k in range(places.shape[1]):
        tracks.add_unseen(str(k), sp.Disc(disc=0.3), sp.Model(**model or {"order": 2}), 0.0, SIGMA)
    for number, frame in enumerate(places.tolist()):
        for k, (x, y) in enumerate(frame):
            tracks.observe(str(k), STEP * number, (x, y))
        tracks.zones(STEP * number)
    return tracks


def noisy(places: Array, seed: int) -> Array:
    return places + NOISE * np.random.default_rng(seed).standard_normal(places.shape)


def held(made: tuple[ThreatZone, ...], time: float, places: Array) -> float:
    """Share of the zones that hold the centres at a time."""
    offset = np.array([zone.center(time) for zone in made]) - places
    spread = np.array([zone.covariance(time) for zone in made])
    return float(np.mean(np.einsum("ka,kab,kb->k", offset, np.linalg.inv(spread), offset) <= 1.0))


def sizes(made: tuple[ThreatZone, ...], time: float) -> Array:
    """Geometric means of the axes of zones, m."""
    return np.array([np.linalg.det(zone.covariance(time)) ** 0.25 for zone in made])


def test_zones_of_steady_motions_hold_as_often_as_they_say_and_stay_small() -> None:
    """Against least squares with the same observations."""
    rng = np.random.default_rng(7)
    times = STEP * np.arange(80)[:, None, None]
    course = times * rng.normal(0, 1, (16, 2)) + 0.5 * times**2 * rng.normal(0, 0.3, (16, 2))
    seen = noisy(course, 1)
    tracks, now = tracked(seen[:70]), STEP * 69
    made = tracks.zones(now)
    assert not any(track.alarmed for track in tracks.tracks.values())
    assert held(made, now + 1.0, course[79]) > 0.9
    least = [estimate_motion(times[:70, 0, 0], seen[:70, k], SIGMA).covariance(now + 1.0) for k in range(16)]
    bare = SCALE**0.5 * np.linalg.det(np.array(least)) ** 0.25
    assert np.median(sizes(made, now + 1.0) / bare) < 1.5


@pytest.mark.parametrize(("change", "within"), [(0.5, 1.6), (1.0, 1.2), (2.0, 1.4)])
def test_zones_soon_hold_what_has_changed_its_acceleration(change: float, within: float) -> None:
    """A second ahead, at 99 %, for nine of ten."""
    rng, begin = np.random.default_rng(8), 50
    since = np.maximum(STEP * (np.arange(begin + 30) - begin), 0.0)
    angle = rng.uniform(0.0, 2.0 * math.pi, 20)
    course = 0.5 * change * since[:, None, None] ** 2 * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    last = begin + round(within / STEP)
    made = tracked(noisy(course, 2)[: last + 1], probability=0.99).zones(STEP * last)
    assert held(made, STEP * (last + 10), course[last + 10]) >= 0.9


def test_zones_of_those_that_weave_hold_and_are_small() -> None:
    """Two units of time ahead: those of free motions alone were 2.5 m large."""
    phases = np.random.default_rng(3).uniform(0.0, 2.0 * math.pi, 8)

    def where(time: Any) -> Array:
        swing = 0.5 * np.sin(0.5 * math.pi * np.asarray(time)[..., None] + phases)
        return np.stack([np.broadcast_to(1.2 * np.asarray(time)[..., None], swing.shape), swing], axis=-1)

    now = STEP * 99
    made = tracked(noisy(where(STEP * np.arange(100)), 3)).zones(now)
    for lead, largest in ((0.5, 0.6), (2.0, 1.5), (4.0, 4.0)):
        assert held(made, now + lead, where(now + lead)) > 0.9
        assert sizes(made, now + lead).mean() < largest


def test_noise_that_is_underestimated_makes_zones_larger_and_outliers_do_not() -> None:
    places = np.random.default_rng(15).standard_normal((100, 1, 2))
    calm, loud = NOISE * places, 3.0 * NOISE * places
    wild = calm.copy()
    wild[[20, 60]] += 5.0
    now = STEP * 99
    plain, larger, same = (sizes(tracked(each).zones(now), now)[0] for each in (calm, loud, wild))
    assert larger / plain == pytest.approx(3.0, rel=0.2)
    assert same / plain == pytest.approx(1.0, rel=0.1)


def observed(places: Array, order: int = 2) -> sp.Obstacle:
    seen = {"time": (STEP * np.arange(len(places))).tolist(), "position": places.tolist(), "covariance": SIGMA.tolist()}
    return sp.Obstacle.model_validate(
        {"id": "a", "shape": {"disc": 0.4}, "observations": seen, "model": {"order": order}}
    )


def test_outliers_of_the_past_are_left_out() -> None:
    places = noisy(np.zeros((100, 2)), 18)
    places[[3, 70]] += 3.0
    tracks = ObstacleTracks(sp.Confidence())
    tracks.add(observed(places))
    (zone,) = tracks.zones(10.0)
    kept = np.delete(np.arange(100), [3, 70])
    clean = estimate_motion(STEP * kept, places[kept], SIGMA)
    assert zone.center(10.0) == pytest.approx(clean.position(10.0), abs=1e-9)


@pytest.mark.parametrize("order", [0, 1, 2])
def test_zones_with_a_manoeuvre_are_those_of_the_scenario(order: int) -> None:
    tracks = ObstacleTracks(sp.Confidence(), settings=SceneOnlineSettings(manoeuvre=0.4, changes=0.0))
    tracks.add(observed(noisy(np.zeros((30, 2)), 12), order))
    (zone,), (given,) = tracks.zones(3.0), tracks.as_obstacles()
    assert given.model.manoeuvre == pytest.approx(0.4 * tracks.newcomers.acceleration_deviation)
    estimate, at = estimate_obstacle(given), 3.0 + np.array([0.0, 1.0, 5.0])
    ratio = zone.covariance(at)[:, 0, 0] / estimate.covariance(at)[:, 0, 0]
    assert zone.center(at) == pytest.approx(estimate.position(at), abs=1e-9)
    assert ratio == pytest.approx(ratio[0], rel=1e-9)


def test_zone_of_what_has_changed_is_in_the_scenario_too() -> None:
    """As a course whose zone is no larger, and hardly smaller."""
    since = np.maximum(STEP * np.arange(60) - 3.0, 0.0)[:, None]
    tracks = ObstacleTracks(sp.Confidence())
    tracks.add(observed(noisy(0.5 * since**2 * np.array([1.0, 0.0]), 13)))
    (zone,), obstacles = tracks.zones(6.0), tracks.as_obstacles()
    scenario = sp.Scenario(
        vehicle={"radius": 0.3, "max_speed": 2.0, "max_acceleration": 1.0, "max_deceleration": 1.0},
        start={"time": 6.0, "position": [0.0, 30.0], "speed": 0.0},
        goal={"position": [10.0, 30.0]},
    ).model_copy(update={"obstacles": obstacles})
    (same,) = zones(scenario)
    at = 6.0 + np.linspace(0.0, 8.0, 41)
    assert same.center(at) == pytest.approx(zone.center(at), abs=2e-3)
    ratio = np.linalg.eigvals(np.linalg.solve(zone.covariance(at), same.covariance(at))).real
    assert ratio.max() <= 1.0 and ratio.min() > 0.97


# late observations

WANDERER = {"kind": "random_walk", "diffusion": 0.3}
PROCESS = sp.Model(process={"process": WANDERER, "velocity_deviation": 1.0, "noise_deviation": 0.1})


def seen_in(order: list[int], model: sp.Model) -> tuple[ObstacleTracks, list[str | None]]:
    """Something that wanders, seen in some order, and what was said of each observation."""
    draw = np.random.default_rng(7)
    places = np.cumsum(np.cumsum(0.02 * draw.normal(size=(1 + max(order), 2)), axis=0), axis=0)
    tracks = ObstacleTracks(sp.Confidence(), settings=SceneOnlineSettings(gate_probability=0.0))
    tracks.add_unseen("one", sp.Disc(disc=0.5), model, 0.0, SIGMA)
    return tracks, [tracks.observe("one", STEP * k, (float(places[k, 0]), float(places[k, 1]))) for k in order]


def assert_same_zones(one: ObstacleTracks, other: ObstacleTracks, now: float) -> None:
    (mine,), (theirs,) = one.zones(now), other.zones(now)
    at = now + np.linspace(0.0, 5.0, 6)
    assert np.array_equal(mine.center(at), theirs.center(at))
    assert np.array_equal(mine.covariance(at), theirs.covariance(at))


@pytest.mark.parametrize("late", [1, 17, MOST_LATE])
def test_a_late_observation_is_learnt_as_if_it_had_come_in_time(late: int) -> None:
    count = 2 * MOST_LATE
    missed = count - 1 - late
    tracks, said = seen_in([k for k in range(count) if k != missed] + [missed], PROCESS)
    assert not any(said)
    assert_same_zones(tracks, seen_in(list(range(count)), PROCESS)[0], STEP * count)


def test_observations_in_any_order_are_learnt_as_if_in_order() -> None:
    count = 2 * MOST_LATE
    shuffled = [k for begin in range(0, count, 8) for k in reversed(range(begin, begin + 8))]
    assert_same_zones(seen_in(shuffled, PROCESS)[0], seen_in(list(range(count)), PROCESS)[0], STEP * count)


def test_what_comes_too_late_is_told_and_left_out_of_a_process_only() -> None:
    count = 2 * MOST_LATE
    in_time = list(range(1, count))
    tracks, said = seen_in([*in_time, 0], PROCESS)
    assert not any(said[:-1]) and "too late" in str(said[-1])
    assert_same_zones(tracks, seen_in(in_time, PROCESS)[0], STEP * count)
    assert not any(seen_in([*in_time, 0], sp.Model())[1])


# regions that follow what came

STEADY = {"process": {**WANDERER, "diffusion": 1e-4}, "velocity_deviation": 1.0, "noise_deviation": 0.1}


@pytest.mark.parametrize("model", [{"order": 1}, {"process": STEADY}], ids=["polynomial", "process"])
def test_adaptive_regions_hold_as_often_as_they_say_where_the_model_is_wrong(model: dict[str, Any]) -> None:
    """Obstacles swing about and are taken for going straight on: regions of the model hold far less often."""
    rng, count, frames = np.random.default_rng(5), 8, 110
    times = STEP * np.arange(frames + 20)
    course = np.stack([0.3 * np.sin(times[:, None] + rng.uniform(0, 6, count)), np.zeros((len(times), count))], axis=-1)
    seen, shares = noisy(course, 6), {}
    for kind in Regions:
        watch = SceneOnlineSettings(regions=kind, alarm_probability=0.0, gate_probability=0.0, changes=0.0)
        tracks, found = tracked(seen[:60], model, watch, 0.8), []
        for number in range(60, frames):
            for k, (x, y) in enumerate(seen[number].tolist()):
                tracks.observe(str(k), STEP * number, (x, y))
            made = tracks.zones(STEP * number)
            found.append(held(made, STEP * (number + 10), course[number + 10]))
        shares[kind] = float(np.mean(found))
    assert shares[Regions.ADAPTIVE] > 0.7
    assert shares[Regions.MODEL] < 0.5


def test_zones_with_a_bounded_heading_are_those_of_the_model() -> None:
    """A box that is driven in a way that no polynomial foretells, beside a disc that is: only the disc is sized."""
    made = {}
    for kind in Regions:
        rng = np.random.default_rng(6)
        watch = SceneOnlineSettings(alarm_probability=0.0, gate_probability=0.0, regions=kind)
        tracks = ObstacleTracks(sp.Confidence(probability=0.5, level="per_time"), settings=watch)
        for name, shape in (("box", sp.Rectangle(rectangle=(2.0, 0.5))), ("disc", sp.Disc(disc=0.3))):
            tracks.add_unseen(name, shape, sp.Model(order=1), 0.0, SIGMA)
        for number in range(120):
            time = STEP * number
            for k, name in enumerate(("box", "disc")):
                x, y = rng.normal([3.0 * time, 4.0 * k + 0.5 * math.sin(time)], NOISE)
                tracks.observe(name, time, (float(x), float(y)))
            found = tracks.zones(time)
        made[kind] = {zone.id: zone.covariance(np.array([time + 1.0]))[0] for zone in found}
    adaptive, model = made[Regions.ADAPTIVE], made[Regions.MODEL]
    assert np.array_equal(adaptive["box"], model["box"])
    assert adaptive["disc"][0, 0] > 2.0 * model["disc"][0, 0]
