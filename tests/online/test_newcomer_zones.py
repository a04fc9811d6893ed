"""Zones of newcomers that are made all at once: the same as those of each alone."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from scp_planner.estimation.least_squares import MotionPrior
from scp_planner.estimation.recursive import RecursiveEstimator
from scp_planner.online import newcomer_zones, obstacle_tracks
from scp_planner.online.obstacle_tracks import ObstacleTracks
from scp_planner.scenario.models import Confidence, Model
from scp_planner.scenario.shapes import Disc
from scp_planner.threat_zones.zone import ThreatZone

pytestmark = pytest.mark.numerics

NOW = 0.7
TIMES = np.linspace(NOW, 12.0, 30)


def crowd(order: int, level: str, count: int = 12) -> ObstacleTracks:
    """Some who have been seen once, or for some tenths of a second, each with a noise of its own."""
    rng = np.random.default_rng(order)
    tracks = ObstacleTracks(Confidence(level=level, probability=0.95))
    for number in range(count):
        root = 0.05 * rng.standard_normal((2, 2))
        noise = root @ root.T + 4e-4 * np.eye(2)
        tracks.add_unseen(f"n{number}", Disc(disc=0.4), Model(order=order), 0.1, noise)
        place, velocity = rng.uniform(-9.0, 9.0, 2), rng.standard_normal(2)
        for time in np.sort(rng.uniform(0.0, 0.6, 1 + number % 5)):
            x, y = rng.multivariate_normal(place + time * velocity, noise).tolist()
            tracks.observe(f"n{number}", float(time), (x, y))
    return tracks


def compared(zones: tuple[ThreatZone, ...]) -> list[np.ndarray[Any, Any]]:
    return [np.concatenate([zone.center(TIMES).ravel(), zone.covariance(TIMES).ravel()]) for zone in zones]


@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize("level", ["joint", "per_obstacle", "per_time"])
def test_newcomers_have_the_same_zones_together_as_each_alone(
    order: int, level: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    tracks = crowd(order, level)
    together = tracks.zones(NOW)
    expected = [track.predicted for track in tracks.tracks.values()]
    with monkeypatch.context() as alone:
        alone.setattr(obstacle_tracks, "newcomers_together", lambda *_: {})
        one_by_one = tracks.zones(NOW)
    assert [zone.id for zone in together] == [zone.id for zone in one_by_one]
    assert [zone.radius for zone in together] == [zone.radius for zone in one_by_one]
    for found, wanted in zip(compared(together), compared(one_by_one), strict=True):
        assert found == pytest.approx(wanted, rel=1e-8, abs=1e-9)
    for before, track in zip(expected, tracks.tracks.values(), strict=True):
        assert before is not None and track.predicted is not None
        noise = np.zeros((2, 2))
        for time in (NOW, 1.5):
            square = before.square(time, (1.0, 2.0), noise)
            assert square == pytest.approx(track.predicted.square(time, (1.0, 2.0), noise), rel=1e-8)


def test_a_crowd_of_newcomers_is_not_estimated_one_by_one(monkeypatch: pytest.MonkeyPatch) -> None:
    estimates: list[int] = []
    estimate = RecursiveEstimator.estimate

    def counted(self: RecursiveEstimator, obstacle: int = 0, *arguments: Any) -> Any:
        estimates.append(obstacle)
        return estimate(self, obstacle, *arguments)

    tracks = crowd(2, "joint", 40)
    monkeypatch.setattr(RecursiveEstimator, "estimate", counted)
    assert len(tracks.zones(NOW)) == 40
    assert not estimates


def test_motions_that_are_not_determined_are_left_to_others() -> None:
    """A prior of the velocity alone says nothing of how the velocity of order 2 changes."""
    tracks = crowd(2, "joint", 6)
    some = list(tracks.tracks.values())
    noise = np.array([track.known_noise for track in some])
    vague = MotionPrior(velocity_deviation=1.0)
    enough = [len(track.times) >= 2 for track in some]
    primed = newcomer_zones.Primed.of(tracks._roots(some), noise, vague)
    assert primed.some.tolist() == np.flatnonzero(enough).tolist()
