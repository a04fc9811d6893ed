"""Filters of several obstacles, used while driving."""

from __future__ import annotations

import numpy as np
import pytest

from scp_planner.errors import EstimationError
from scp_planner.scenario.process_model import ProcessModel
from scp_planner.tracking.kalman import estimate_process
from scp_planner.tracking.motion_filter import MotionFilter

pytestmark = pytest.mark.numerics

SINGER = {"kind": "singer", "deviation": 0.6, "time_constant": 0.8}


def model() -> ProcessModel:
    return ProcessModel(process=SINGER, velocity_deviation=1.3, noise_deviation=0.1)


class TestFilter:
    times = np.arange(8) * 0.4
    positions = np.random.default_rng(7).normal(size=(8, 3, 2)).cumsum(axis=0)

    def test_follows_each_obstacle_as_the_single_estimate_does(self) -> None:
        seen = np.random.default_rng(8).random((8, 3)) < 0.7
        seen[2] = True
        tracker = MotionFilter(model(), 3)
        for i in range(8):
            assert tracker.update(self.times[i], self.positions[i], seen=seen[i]).tolist() == seen[i].tolist()
        assert tracker.observations.tolist() == seen.sum(axis=0).tolist()
        for k in range(3):
            own = seen[:, k]
            single = estimate_process(self.times[own], self.positions[own, k], model())
            assert tracker.estimate(k).position(9.0) == pytest.approx(single.position(9.0), rel=1e-12)
            assert tracker.estimate(k).covariance(9.0) == pytest.approx(single.covariance(9.0), rel=1e-12)
            assert tracker.estimate(k).reference_time == single.reference_time == self.times[own][-1]

    def test_refused_observations_change_nothing(self) -> None:
        tracker = MotionFilter(model(), 3)
        for i in range(7):
            tracker.update(self.times[i], self.positions[i])
        spoiled = self.positions[7].copy()
        spoiled[2, 1] = np.nan
        for arguments, message in (
            ((self.times[7], spoiled), r"obstacle 2: time .* or position \[.*, nan\] is not finite"),
            ((self.times[6], self.positions[6]), "obstacle 0: the observation at time .* comes twice"),
            ((self.times[3], self.positions[3]), "obstacle 0: time .* is before .* must come in order"),
            ((self.times[7], self.positions[7, :2]), r"their shape is \(2, 2\)"),
            ((self.times[7], self.positions[7], np.zeros((2, 2))), "is not positive definite"),
        ):
            with pytest.raises(EstimationError, match=message):
                tracker.update(*arguments)
        tracker.update(self.times[7], self.positions[7])
        single = estimate_process(self.times, self.positions[:, 0], model())
        assert tracker.estimate(0).position(5.0) == pytest.approx(single.position(5.0))
        with pytest.raises(EstimationError, match="obstacle 2: it has not been seen"):
            MotionFilter(model(), 3).estimate(2)
        with pytest.raises(EstimationError, match="gate_probability: 2"):
            MotionFilter(model(), gate_probability=2)
