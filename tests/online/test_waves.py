"""Tests of the filters of those that weave, and of their zones."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest
from scipy.linalg import expm

import scp_planner as sp
from scp_planner.online import sensor_frames
from scp_planner.online.obstacle_tracks import ObstacleTracks
from scp_planner.online.track import Seen
from scp_planner.online.waves import DAMPING, Swings, SwingStates

NOISE = 0.1
STEP = 0.1
SWINGS = Swings.of(1.5, 0.5)


def states_of(count: int) -> SwingStates:
    states = SwingStates.none(SWINGS)
    states.mean, states.spread = (np.zeros((*part.shape[:-1], count)) for part in (states.mean, states.spread))
    return states


def moments(number: int, times: np.ndarray, places: np.ndarray, lead: float) -> list[np.ndarray]:
    """Position, velocity and acceleration after the last look, and their covariance: an ordinary Kalman filter.

    Of the course, its rate and its acceleration, the swing and its rate; moved by C. F. Van Loan's exponential.
    """
    rate = float(SWINGS.rates[number])
    drift = np.diag([1.0, 1.0, 0.0, 1.0], 1)
    drift[4, 3:] = -(rate**2), -2.0 * DAMPING * rate
    noise = np.diag([0.0, 0.0, SWINGS.jerk, 0.0, 4.0 * DAMPING * rate**3 * SWINGS.deviation**2])
    look = np.array([1.0, 0.0, 0.0, 1.0, 0.0])
    swing = SWINGS.deviation
    mean, spread = np.zeros((5, 2)), np.diag([1e9, 1.5**2, 0.5**2, swing**2, (swing * rate) ** 2])
    lags = [0.0, *np.diff(times), lead]
    for lag, place in zip(lags, [*places, None], strict=True):
        both = expm(lag * np.block([[-drift, noise], [np.zeros((5, 5)), drift.T]]))
        moved = both[5:, 5:].T
        mean, spread = moved @ mean, moved @ spread @ moved.T + moved @ both[:5, 5:]
        if place is not None:
            gain = spread @ look / (look @ spread @ look + NOISE**2)
            mean = mean + np.outer(gain, place - look @ mean)
            keep = np.eye(5) - np.outer(gain, look)
            spread = keep @ spread @ keep.T + NOISE**2 * np.outer(gain, gain)
    seen = np.stack([look, look @ drift, look @ drift @ drift])
    return [seen @ mean, seen @ spread @ seen.T]


def test_filters_are_those_of_a_course_and_a_swing() -> None:
    rng = np.random.default_rng(0)
    times = np.cumsum(rng.uniform(0.05, 0.3, (12, 3)), axis=0)  # each has its own clock
    places, unit = rng.normal(0.0, 0.5, (12, 3, 2)), np.full(3, NOISE**2)
    states = states_of(3)
    states.begin(np.arange(3), places[0], 1.0, unit)
    for lag, place in zip(np.diff(times, axis=0), places[1:], strict=True):
        states.predict(lag, unit)
        states.update(place.T, 1.0)
    states.predict(np.array([1.7, 1.7, 0.4]), unit)
    mean, spread = states.kinematic
    for number in range(len(SWINGS.rates)):
        for k, lead in ((0, 1.7), (2, 0.4)):
            expected, covariance = moments(number, times[:, k], places[:, k], lead)
            assert mean[:, :, number, k] == pytest.approx(expected, abs=1e-5)
            assert NOISE**2 * spread[:, number, k] == pytest.approx(covariance[np.triu_indices(3)], rel=1e-5, abs=1e-7)


def test_a_frame_is_predicted_as_each_alone() -> None:
    rng, unit = np.random.default_rng(1), np.array([0.01, 0.02, 0.04])
    states = states_of(3)
    states.begin(np.arange(3), rng.normal(0.0, 1.0, (3, 2)), 1.0, unit)
    states.predict(np.full(3, 0.7), unit)
    states.update(rng.normal(0.0, 1.0, (2, 3)), 1.0)
    for lags in (np.full(3, 0.3), np.array([0.3, 0.1, 0.6])):
        together = states.of(slice(None))
        together.predict(lags, unit)
        for k in range(3):
            alone = states.of(np.array([k]))
            alone.predict(lags[k : k + 1], unit[k : k + 1])
            assert together.mean[..., k] == pytest.approx(alone.mean[..., 0], abs=1e-12)
            assert together.spread[..., k] == pytest.approx(alone.spread[..., 0], rel=1e-12, abs=1e-12)


def test_settled_is_the_course_and_as_far_as_a_swing_leads() -> None:
    """Long after the last look the swing is anywhere: there the moments of both are the same."""
    rng, unit = np.random.default_rng(2), np.array([0.01])
    states = states_of(1)
    states.begin(np.array([0]), rng.normal(0.0, 1.0, (1, 2)), 1.0, unit)
    states.predict(np.array([500.0]), unit)
    (mean, spread), (calm, wide) = states.kinematic, states.settled(unit)
    assert calm[:2] == pytest.approx(mean[:2], rel=1e-6, abs=1e-6)
    assert wide[0] == pytest.approx(spread[0], rel=1e-6)


def weaving(
    frames_seen: int, size: float = 0.5, period: float = 4.0, count: int = 12
) -> tuple[ObstacleTracks, Callable[[float], np.ndarray]]:
    """Obstacles that weave about straight courses and are seen so often; and where they are."""
    rng = np.random.default_rng(3)
    phases = rng.uniform(0.0, 2.0 * math.pi, count)

    def where(time: float) -> np.ndarray:
        return np.stack([1.2 * time + 0.0 * phases, size * np.sin(2.0 * math.pi * time / period + phases)], axis=1)

    tracks = ObstacleTracks(sp.Confidence(probability=0.95, level="per_time"))
    names = [str(k) for k in range(count)]
    for name in names:
        tracks.add_unseen(name, sp.Disc(disc=0.3), sp.Model(order=2), 0.0, NOISE**2 * np.eye(2))
    for number in range(frames_seen):
        time = STEP * number
        places = where(time) + NOISE * rng.standard_normal((count, 2))
        sensor_frames.take_in(tracks, names, [Seen(time, (float(x), float(y))) for x, y in places])
    return tracks, where


def test_zones_of_those_that_weave_hold_and_are_small() -> None:
    """Two units of time ahead: those of free motions alone were 2.5 m large."""
    tracks, where = weaving(110)
    now = STEP * 109
    zones = tracks.zones(now)
    assert all(track.alarmed for track in tracks.tracks.values())
    for lead, largest in ((0.5, 0.6), (2.0, 1.5), (4.0, 4.0)):
        offset = np.array([zone.center(now + lead) for zone in zones]) - where(now + lead)
        spread = np.array([zone.covariance(now + lead) for zone in zones])
        assert np.mean(np.einsum("ka,kab,kb->k", offset, np.linalg.inv(spread), offset) <= 1.0) > 0.9
        assert np.sqrt(np.linalg.det(spread)).mean() < largest**2


def test_pieces_of_a_zone_are_what_the_filters_predict() -> None:
    tracks, _ = weaving(100, count=2)
    tracks.watch = sp.OnlineSettings(changes=0.0).watch
    now = STEP * 99
    for k, zone in enumerate(tracks.zones(now)):
        estimator = tracks.tracks[str(k)].estimator
        assert estimator is not None and estimator.bank is not None and zone.covariances is not None
        bank, slot = estimator.bank, np.array([estimator.slot])
        first = bank.mixed(slot, np.array([now])).covariance[0, 0, :, 0]
        scale = zone.covariance(now)[0, 0] / first[0, 0]
        assert scale == pytest.approx(-2.0 * math.log(0.05), rel=1e-9)
        for lead in (0.0, 0.33, 1.0, 2.7, 5.1):
            mixed = bank.mixed(slot, np.array([now + lead]))
            assert zone.center(now + lead) == pytest.approx(mixed.mean[0, 0], abs=5e-3)
            assert zone.covariance(now + lead) == pytest.approx(
                scale * mixed.covariance[0, 0, :, 0], rel=0.02, abs=1e-3
            )
        far = now + 60.0
        settled = bank.settled(slot, np.array([far]))
        assert zone.center(far) == pytest.approx(settled.mean[0, 0], abs=1e-6)
        assert zone.covariance(far) == pytest.approx(scale * settled.covariance[0, 0, :, 0], rel=1e-6)
        for one in (zone.centers, zone.covariances):
            edges = one.breakpoints[0, 1:-1]
            assert one.grid(edges - 1e-9) == pytest.approx(one.grid(edges), rel=1e-6, abs=1e-6)


def test_those_that_swing_not_have_zones_of_one_piece() -> None:
    """A free walk."""
    rng, tracks = np.random.default_rng(4), ObstacleTracks(sp.Confidence())
    tracks.add_unseen("a", sp.Disc(disc=0.3), sp.Model(order=2), 0.0, NOISE**2 * np.eye(2))
    places = np.cumsum(STEP * np.cumsum(0.4 * rng.standard_normal((120, 2)), axis=0), axis=0)
    for number, place in enumerate(places + NOISE * rng.standard_normal((120, 2))):
        tracks.observe("a", STEP * number, (float(place[0]), float(place[1])))
    (zone,) = tracks.zones(12.0)
    assert tracks.tracks["a"].alarmed and zone.centers.coefficients.shape[1] == 1
