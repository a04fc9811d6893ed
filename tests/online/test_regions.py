"""Regions that follow what came of predictions, against the same done with each prediction alone."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

import scp_planner as sp
from scp_planner.estimation.conformal import AdaptiveScales, region_score, sized
from scp_planner.mathematics.polynomials import PiecewisePolynomials
from scp_planner.online import sensor_frames
from scp_planner.online.foretold import Prediction
from scp_planner.online.many_zones import Future, Sizing, sized_pieces, times_linear
from scp_planner.online.obstacle_tracks import ObstacleTracks
from scp_planner.online.regions import MOST_COMPARED
from scp_planner.online.track import Seen
from scp_planner.scenario.models import Model
from scp_planner.scenario.shapes import Disc, Rectangle
from scp_planner.settings.online import Regions, Watch
from scp_planner.threat_zones.of_scenario import Embodied, estimated_zone

NOISE, STEP, COUNT, FRAMES, LEVEL = 0.1, 0.1, 4, 70, 0.5
LEADS = (0.0, 1.0, 2.0, 4.0)


def tracks_of(kind: Regions) -> ObstacleTracks:
    """Two that are taken for standing, and two for going straight on."""
    tracks = ObstacleTracks(sp.Confidence(probability=LEVEL, level="per_time"), watch=Watch(regions=kind))
    for number in range(COUNT):
        tracks.add_unseen(str(number), Disc(disc=0.3), Model(order=2 * number // COUNT), 0.0, NOISE**2 * np.eye(2))
    return tracks


def frame_of(rng: np.random.Generator, number: int) -> dict[str, Seen]:
    """All of them swing to and fro, which no polynomial foretells."""
    time = STEP * number
    places = np.stack([0.3 * np.sin(time + np.arange(COUNT)), 3.0 * np.arange(COUNT)], axis=1)
    return {
        str(k): Seen(time, (float(x), float(y))) for k, (x, y) in enumerate(places + rng.normal(0, NOISE, (COUNT, 2)))
    }


def score_of(told: Prediction, one: Seen) -> float:
    """By Horner's rule, one element at a time."""
    parts = [(told.origin, told.center), (told.origin, told.covariance)]
    if told.later is not None:
        pieces = told.later.centers, told.later.covariances
        number = [max(i for i, begin in enumerate(each.breakpoints[0, :-1]) if begin <= one.time) for each in pieces]
        parts = [(each.breakpoints[0, i], each.coefficients[0, i]) for each, i in zip(pieces, number, strict=True)]
    offset, center, covariance = np.array(one.position), np.zeros(2), np.zeros(3)
    for row in parts[0][1][::-1]:
        center = center * (one.time - parts[0][0]) + row
    for row in parts[1][1][::-1]:
        covariance = covariance * (one.time - parts[1][0]) + row
    border = -2.0 * math.log(1.0 - LEVEL)
    noise = NOISE**2 * np.array([[1.0, 0.0, 1.0]])
    return float(region_score([offset - center], [covariance], noise, border)[0])


def test_what_came_of_a_frame_is_learnt_as_of_each_prediction_alone() -> None:
    rng, tracks = np.random.default_rng(4), tracks_of(Regions.ADAPTIVE)
    expected = AdaptiveScales(1.0 - LEVEL, len(LEADS), kinds=3)
    told: dict[str, list[tuple[Prediction, int]]] = {str(k): [] for k in range(COUNT)}
    for number in range(FRAMES):
        seen = frame_of(rng, number)
        assert sensor_frames.take_in(tracks, list(seen), list(seen.values())) == COUNT * [None]
        for horizon, lead in enumerate(LEADS):
            found = {}
            for name, one in seen.items():
                before = [each for each in told[name] if each[0].origin <= one.time - lead]
                if before and one.time - before[-1][0].origin <= lead + 0.4:
                    found[name] = score_of(before[-1][0], one), before[-1][1]
            if found:
                scores, kinds = zip(*found.values(), strict=True)
                expected.take_in(horizon, list(found), scores, np.array(kinds))
        tracks.zones(STEP * number)
        for name, track in tracks.tracks.items():
            if track.settled and track.predicted is not None:
                told[name].append((track.predicted, int(track.alarmed or track.suspected)))
    assert tracks.sizes is not None
    scales = tracks.sizes.scales
    assert np.array_equal(scales.seen, expected.seen) and expected.seen.min() > 60
    each = []
    for kind in (0, 1):
        sizes = scales.scales(list(told), kind)
        assert sizes == pytest.approx(expected.scales(list(told), kind), rel=1e-9)
        each.append(sizes)
    assert np.ptp(each) > 0.1


def test_of_very_many_some_are_compared_at_a_time_and_all_in_turn() -> None:
    count, rng = MOST_COMPARED + 8, np.random.default_rng(2)
    tracks = ObstacleTracks(sp.Confidence(level="per_time"), watch=Watch(regions=Regions.ADAPTIVE))
    names = [str(number) for number in range(count)]
    for name in names:
        tracks.add_unseen(name, Disc(disc=0.3), Model(order=1), 0.0, NOISE**2 * np.eye(2))
    compared: set[str] = set()
    assert tracks.sizes is not None
    scales = tracks.sizes.scales
    for number in range(170):
        before = scales.seen.copy()
        seen = [Seen(STEP * number, (float(x), float(y))) for x, y in rng.normal(0.0, NOISE, (count, 2))]
        sensor_frames.take_in(tracks, names, seen)
        tracks.zones(STEP * number)
        assert (scales.seen - before).max() <= MOST_COMPARED
        compared |= set(scales.names)
    assert compared == set(names)
    assert scales.seen.min() >= 10 * MOST_COMPARED


def test_zones_are_sized_by_what_came() -> None:
    rng, tracks, plain = np.random.default_rng(5), tracks_of(Regions.ADAPTIVE), tracks_of(Regions.MODEL)
    for number in range(FRAMES):
        seen = frame_of(rng, number)
        for each in (tracks, plain):
            sensor_frames.take_in(each, list(seen), list(seen.values()))
        ours, zones = tracks.zones(STEP * number), plain.zones(STEP * number)
    assert tracks.sizes is not None
    scale = -2.0 * math.log(1.0 - LEVEL)
    now = STEP * (FRAMES - 1)
    for mine, zone in zip(ours, zones, strict=True):
        assert zone.covariances is not None
        kind = int(tracks.tracks[mine.id].alarmed or tracks.tracks[mine.id].suspected)
        (sizes,) = tracks.sizes.scales.scales([mine.id], kind)
        for lead, size in zip(LEADS[1:], sizes[1:], strict=True):
            (covariance,) = zone.covariance(np.array([now + lead]))
            flat = covariance[[0, 0, 1], [0, 1, 1]][None] / scale
            (found,) = mine.covariance(np.array([now + lead]))
            # zones of several pieces are sized linearly between their ends
            rel = 1e-6 if zone.covariances.coefficients.shape[1] == 1 else 0.05
            assert found[[0, 0, 1], [0, 1, 1]] == pytest.approx(scale * sized(flat, [size])[0], rel=rel, abs=1e-12)


def test_zones_with_a_bounded_heading_are_those_of_the_model() -> None:
    """A box that is driven in a way that no polynomial foretells, beside a disc that is: only the disc is sized."""
    made = {}
    for kind in Regions:
        rng = np.random.default_rng(6)
        watch = Watch(alarm_probability=0.0, gate_probability=0.0, regions=kind)
        tracks = ObstacleTracks(sp.Confidence(probability=LEVEL, level="per_time"), watch=watch)
        for name, shape in (("box", Rectangle(rectangle=(2.0, 0.5))), ("disc", Disc(disc=0.3))):
            tracks.add_unseen(name, shape, Model(order=1), 0.0, NOISE**2 * np.eye(2))
        for number in range(120):
            time = STEP * number
            for k, name in enumerate(("box", "disc")):
                x, y = rng.normal([3.0 * time, 4.0 * k + 0.5 * math.sin(time)], NOISE)
                tracks.observe(name, time, (float(x), float(y)))
            zones = tracks.zones(time)
        made[kind] = {zone.id: zone.covariance(np.array([time + 1.0]))[0] for zone in zones}
    adaptive, model = made[Regions.ADAPTIVE], made[Regions.MODEL]
    assert np.array_equal(adaptive["box"], model["box"])
    assert adaptive["disc"][0, 0] > 2.0 * model["disc"][0, 0]


def test_zones_of_what_was_seen_twice_at_one_time_are_sized_like_others() -> None:
    future = Future(np.array([2.0, 50.0]), np.zeros((2, 1, 3, 2)), np.tile([1.0, 0.0, 1.0], (2, 1, 3, 1)))
    leads = np.array([[0.0, 1.0, 2.0, 4.0], [1e-9, 1.0, 2.0, 4.0]])
    sizes = np.array([[1.5, 2.0, 2.0, 3.0]] * 2)
    edges, pieces = sized_pieces(future, np.arange(2), Sizing(leads, np.zeros(2, dtype=np.intp), sizes))
    assert np.all(np.isfinite(pieces))
    for lag in (0.5, 1.7, 3.0, 9.0):
        at = [
            sum(pieces[k, piece, n] * (2.0 + lag - edges[k, piece]) ** n for n in range(pieces.shape[2]))
            for k in (0, 1)
            for piece in [int(np.searchsorted(edges[k], 2.0 + lag, "right")) - 1]
        ]
        assert np.allclose(at[0], at[1], atol=1e-6)


@pytest.mark.parametrize(
    ("sizes", "count"),
    [
        ((1.5, 1.5, 1.5, 1.5), 1),
        ((1.0, 1.0, 1.0, 0.5), 3),
        ((0.5, 0.6, 1.0, 1.0), 4),
        ((2.0, 2.0, 1.0, 1.5), 4),
        ((0.5, 0.6, 1.0, 1.2), 5),
    ],
)
def test_sizes_are_linear_between_leads_in_as_many_pieces_as_that_takes(sizes: tuple[float, ...], count: int) -> None:
    growth = np.array([[1.0, 0.2, 2.0], [0.3, 0.1, 0.4], [0.05, 0.0, 0.1]])
    future = Future(np.array([2.0, 50.0]), np.zeros((2, 1, 3, 2)), np.tile(growth, (2, 1, 1, 1)))
    leads = np.array([[0.1, 1.0, 2.0, 4.0], [0.2, 1.0, 2.0, 4.0]])
    edges, pieces = sized_pieces(future, np.arange(2), Sizing(leads, np.zeros(2, dtype=np.intp), np.array([sizes] * 2)))
    assert pieces.shape[1] == count
    for k in (0, 1):
        for lag in np.linspace(0.0, 9.0, 46):
            size, model = np.interp(lag, leads[k], sizes), growth.T @ lag ** np.arange(3)
            expected = min(size, 1.0) * model + max(size - 1.0, 0.0) * np.array([1.0, 0.0, 1.0])
            piece = int(np.searchsorted(edges[k, 1:-1], 2.0 + lag, "right"))
            found = pieces[k, piece].T @ (2.0 + lag - edges[k, piece]) ** np.arange(pieces.shape[2])
            assert found == pytest.approx(expected, rel=1e-9, abs=1e-12)


def test_zones_made_alone_are_sized_together_as_each_by_itself(monkeypatch: pytest.MonkeyPatch) -> None:
    """People, half of whom are seen every other time: as much work for many as for two, and the same sizes."""
    sized_with: list[int] = []

    def counted(covariances: PiecewisePolynomials, *more: Any) -> PiecewisePolynomials:
        sized_with.append(len(covariances.coefficients))
        return times_linear(covariances, *more)

    monkeypatch.setattr("scp_planner.online.regions.times_linear", counted)
    rng, count = np.random.default_rng(8), 12
    tracks = ObstacleTracks(sp.Confidence(probability=LEVEL, level="per_time"), watch=Watch(regions=Regions.ADAPTIVE))
    for number in range(count):
        tracks.add_unseen(str(number), Disc(disc=0.3), Model(process="pedestrian"), 0.0, NOISE**2 * np.eye(2))
    for number in range(FRAMES):
        for k in range(0, count, 1 + number % 2):
            place = 2.0 * k + math.sin(STEP * number + k), 3.0 * k + rng.normal(0.0, NOISE)
            tracks.observe(str(k), STEP * number, place)
        sized_with.clear()
        zones = tracks.zones(STEP * number)
    assert sum(sized_with) == count and len(sized_with) <= 3
    sizes, every = tracks.sizes, list(tracks.tracks.values())
    assert sizes is not None
    plain = [
        estimated_zone(
            Embodied(track.id, track.shape, track.body, track.margin),
            track.estimate(tracks.newcomers),
            tracks.confidence,
            count,
            STEP * (FRAMES - 1),
        )
        for track in every
    ]
    at = STEP * (FRAMES - 1) + np.array([0.0, 0.3, 1.5, 3.0, 6.0])
    for track, zone, model in zip(every, zones, plain, strict=True):
        (alone,) = sizes.sized([track], [model])
        assert np.allclose(alone.covariance(at), zone.covariance(at), rtol=1e-12, atol=0.0)
        assert not np.allclose(alone.covariance(at), model.covariance(at))
