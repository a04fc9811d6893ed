"""Zones of those that weave, between the moments at which they are put down."""

from __future__ import annotations

import numpy as np
import pytest

import scp_planner as sp
from scp_planner.online.obstacle_tracks import ObstacleTracks
from scp_planner.online.track import NoticingTrack

pytestmark = pytest.mark.numerics


@pytest.mark.parametrize("deviation", [0.003, 0.01, 0.03])
@pytest.mark.parametrize("order", [0, 1])
def test_regions_between_moments_are_those_that_the_filters_predict(deviation: float, order: int) -> None:
    """By a hundred times and more does what is known of a place grow in the first of the spans; each is one factor."""
    rng = np.random.default_rng(0)
    tracks = ObstacleTracks(sp.Confidence())
    tracks.add_unseen("o", sp.Disc(disc=0.1), sp.Model(order=order), 0.0, deviation**2 * np.eye(2))
    times = 0.06 * np.arange(30)
    places = np.stack([0.8 * times + 0.25 * np.sin(2.5 * times), 0.2 * np.cos(2.1 * times) - 1.2 * times], axis=1)
    places += deviation * rng.normal(size=places.shape)
    for time, (x, y) in zip(times.tolist(), places.tolist(), strict=True):
        assert tracks.observe("o", time, (x, y), None) is None
    start = 1.8
    (zone,) = tracks.zones(start)
    estimator = tracks.tracks["o"].estimator
    assert isinstance(estimator, NoticingTrack)
    slots = np.array([estimator.slot])
    assert estimator.bank.weave(slots).all()
    ahead = np.linspace(0.0, 1.2, 121)
    assert zone.covariances is not None
    found = zone.covariances.grid(start + ahead)[:, 0]
    mixtures = [estimator.bank.mixed(slots, np.array([start + time])).covariance[0, 0, :, 0] for time in ahead.tolist()]
    expected = np.stack([[one[0, 0], one[1, 1]] for one in mixtures])
    factor = found[:, [0, 2]] / expected
    assert expected[-1, 0] > 50.0 * expected[0, 0]
    assert factor.max() < 1.002 * factor.min()
