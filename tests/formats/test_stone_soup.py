"""Tracks of Stone Soup, filtered by it, and what a planner is told of them."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta

import numpy as np
import pytest
from scenes import scene

import scp_planner as sp
from scp_planner.formats.stone_soup import stone_soup_state

START = datetime(2026, 1, 1, 12, 0, 0)


def test_a_track_of_stone_soup_is_an_obstacle() -> None:
    pytest.importorskip("stonesoup")
    from stonesoup.models.measurement.linear import LinearGaussian
    from stonesoup.models.transition.linear import CombinedLinearGaussianTransitionModel, ConstantVelocity
    from stonesoup.predictor.kalman import KalmanPredictor
    from stonesoup.types.detection import Detection
    from stonesoup.types.hypothesis import SingleHypothesis
    from stonesoup.types.state import GaussianState
    from stonesoup.types.track import Track
    from stonesoup.updater.kalman import KalmanUpdater

    predictor = KalmanPredictor(CombinedLinearGaussianTransitionModel([ConstantVelocity(0.01), ConstantVelocity(0.01)]))
    updater = KalmanUpdater(LinearGaussian(4, (0, 2), 0.01 * np.eye(2)))
    track = Track([GaussianState([[8.0], [0.0], [-2.0], [0.0]], np.diag([0.1, 1.0, 0.1, 1.0]), START)])
    for k in range(1, 21):
        stamp = START + timedelta(seconds=0.1 * k)
        seen = Detection([[8.0 - 0.05 * k], [-2.0 + 0.08 * k]], timestamp=stamp)
        track.append(updater.update(SingleHypothesis(predictor.predict(track, timestamp=stamp), seen)))

    now = START.replace(tzinfo=UTC).timestamp() + 2.0
    given = stone_soup_state(track)
    assert given["time"] == pytest.approx(now)
    assert given["velocity"] == pytest.approx((-0.5, 0.8), abs=0.1)
    start = {"time": now, "position": [0.0, 0.0], "heading": 0.0, "speed": 1.0}
    planner = sp.Planner(scene().model_copy(update={"start": start}))
    planner.add_obstacle(track.id, {"disc": 0.3}, model={"order": 1})
    planner.update_obstacle(track.id, **given)
    planner.replan(now, (0.0, 0.0), 0.0, 1.0)
    (zone,) = planner.zones
    assert zone.center(now + 1.0) == pytest.approx((6.5, 0.4), abs=0.3)
