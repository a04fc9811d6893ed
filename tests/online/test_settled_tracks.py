"""What zones are made from is worked out beforehand, and anew with all that is learnt of any obstacle."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from scp_planner.online import sensor_frames
from scp_planner.online.obstacle_tracks import ObstacleTracks
from scp_planner.online.settled_tracks import SettledTracks
from scp_planner.online.track import Seen
from scp_planner.scenario.estimates import Estimate
from scp_planner.scenario.models import Confidence, Model, Obstacle
from scp_planner.scenario.motions import Motion
from scp_planner.scenario.shapes import Disc
from scp_planner.threat_zones.zone import ThreatZone

NOISE, STEP, COUNT, LAST = 0.1, 0.1, 6, 40


def tracks_of() -> ObstacleTracks:
    """Obstacles of two orders."""
    tracks = ObstacleTracks(Confidence())
    for number in range(COUNT):
        tracks.add_unseen(str(number), Disc(disc=0.3), Model(order=1 + number % 2), 0.0, NOISE**2 * np.eye(2))
    return tracks


def take_in_frame(tracks: ObstacleTracks, number: int) -> None:
    """Take in one look at each; the second turns at last."""
    rng, time, seen = np.random.default_rng([7, number]), STEP * number, {}
    for k in range(COUNT):
        turn = 2.0 * max(time - 3.5, 0.0) ** 2 if k == 1 else 0.0
        x, y = np.array([0.2 * k * time + turn, 3.0 * k]) + NOISE * rng.standard_normal(2)
        seen[str(k)] = Seen(time, (float(x), float(y)))
    sensor_frames.take_in(tracks, list(seen), list(seen.values()))


def bits_of(zones: tuple[ThreatZone, ...]) -> list[tuple[object, ...]]:
    """All numbers of zones."""
    every: list[tuple[object, ...]] = []
    for zone in zones:
        parts = [zone.centers, *([] if zone.covariances is None else [zone.covariances])]
        numbers = [part.tobytes() for one in parts for part in (one.breakpoints, one.coefficients)]
        every.append((zone.id, zone.radius, zone.until, *numbers))
    return every


def noise_is_more(tracks: ObstacleTracks) -> None:
    tracks.judge_noise(np.full(100_000, 6.0))


def a_tracker_tells(tracks: ObstacleTracks) -> None:
    tracks.update("0", Estimate(time=9.0, position=(1.0, 2.0), velocity=(0.1, 0.0), covariance=np.eye(4).tolist()))


def one_comes(tracks: ObstacleTracks) -> None:
    motion = Motion(time=0.0, position=(3.0, 3.0), velocity=(0.0, 1.0))
    tracks.add(Obstacle(id="new", shape=Disc(disc=0.3), motion=motion))


def one_comes_unseen(tracks: ObstacleTracks) -> None:
    tracks.add_unseen("new", Disc(disc=0.3), Model(order=1), 0.0, NOISE**2 * np.eye(2))
    tracks.observe("new", STEP * LAST, (1.0, 1.0))


NEWS: list[Callable[[ObstacleTracks], object]] = [
    noise_is_more,
    a_tracker_tells,
    one_comes,
    one_comes_unseen,
    lambda tracks: tracks.remove("2"),
    lambda tracks: tracks.foretell("2", Motion(time=0.0, position=(0.0, 6.0), velocity=(1.0, 0.0))),
    lambda tracks: tracks.observe("2", STEP * (LAST + 1), (1.7, 6.1)),
    lambda tracks: [tracks.observe("2", STEP * (LAST + k), (9.0, 1.0 + k)) for k in (1, 2, 3)],  # learnt anew
    lambda tracks: take_in_frame(tracks, LAST + 1),
]


@pytest.mark.parametrize("news", NEWS)
def test_zones_are_those_of_all_that_is_known_whatever_was_worked_out_before(
    news: Callable[[ObstacleTracks], object],
) -> None:
    before, after = tracks_of(), tracks_of()
    for number in range(LAST + 1):
        take_in_frame(before, number)
        take_in_frame(after, number)
    before.prepare()
    known = bits_of(before.zones(STEP * (LAST + 2)))
    assert known == bits_of(after.zones(STEP * (LAST + 2)))
    before.prepare()
    news(before)
    before.prepare()
    news(after)
    found = bits_of(before.zones(STEP * (LAST + 2)))
    assert found == bits_of(after.zones(STEP * (LAST + 2)))
    assert found != known, "that was no news"


def test_it_is_worked_out_beforehand_once_for_each_time_that_zones_are_asked_for(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    made: list[int] = []

    begin = SettledTracks.__init__

    def counted(*arguments: Any) -> None:
        made.append(len(arguments))
        begin(*arguments)

    monkeypatch.setattr(SettledTracks, "__init__", counted)
    tracks = tracks_of()
    for number in range(LAST):
        take_in_frame(tracks, number)
        tracks.prepare()
    assert len(made) <= 2, "nobody has asked for zones"
    made.clear()
    tracks.zones(STEP * LAST)
    assert made, "what was worked out is of what was known then"
    made.clear()
    for number in range(LAST, LAST + 3):
        take_in_frame(tracks, number)
        tracks.prepare()
        count = len(made)
        tracks.zones(STEP * (number + 1))
        assert count > 0 and len(made) == count, "it was at hand"
        made.clear()
