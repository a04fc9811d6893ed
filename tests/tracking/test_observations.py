"""Observations that are no good: refused, left out, or given less weight."""

from __future__ import annotations

import numpy as np
import pytest
from observed_motions import SIGMA, observe

from scp_planner.errors import EstimationError
from scp_planner.tracking.maximum_likelihood import estimate_motion
from scp_planner.tracking.observations import Faulty, Screening

pytestmark = pytest.mark.numerics


class TestScreening:
    times = np.arange(20) * 0.1
    positions = observe(np.random.default_rng(21), times)

    def test_missing_rows_are_refused_or_left_out(self) -> None:
        positions = self.positions.copy()
        positions[5, 1] = np.nan
        with pytest.raises(EstimationError, match=r"observations.position\[5\]: \[.*nan\] is not finite"):
            estimate_motion(self.times, positions, SIGMA)
        seen = estimate_motion(self.times, positions, SIGMA, screening=Screening(missing=Faulty.DROP))
        rest = np.delete(np.arange(20), 5)
        assert seen.rejected == (5,)
        assert seen.position(3.0) == pytest.approx(
            estimate_motion(self.times[rest], positions[rest], SIGMA).position(3.0)
        )
        times = self.times.copy()
        times[2] = np.inf
        with pytest.raises(EstimationError, match=r"observations.time\[2\]: inf is not finite"):
            estimate_motion(times, self.positions, SIGMA)

    def test_repeated_rows_are_refused_or_left_out(self) -> None:
        times, positions = np.append(self.times, self.times[7]), self.positions
        positions = np.vstack([positions, positions[7]])
        with pytest.raises(EstimationError, match=r"observations\[20\]: time 0.7.* first as observations\[7\]"):
            estimate_motion(times, positions, SIGMA)
        seen = estimate_motion(times, positions, SIGMA, screening=Screening(repeated=Faulty.DROP))
        assert seen.rejected == (20,)
        assert seen.observations == 20

    def test_two_sensors_at_one_time_are_two_observations(self) -> None:
        seen = estimate_motion([0, 0, 1, 1], [[0.0, 0.0], [0.2, 0.0], [1.0, 0.0], [1.2, 0.0]], SIGMA, 1)
        assert seen.position(1.0) == pytest.approx([1.1, 0.0])
        assert seen.covariance(1.0) == pytest.approx(SIGMA / 2)

    def test_settings_must_make_sense(self) -> None:
        with pytest.raises(ValueError, match=r"'sometimes'"):
            Screening(missing="sometimes")  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"order": 3}, "order: 3 is not 0, 1 or 2"),
        ({"order": 1.5}, "order: 1.5 is not"),
        ({"times": [], "positions": np.zeros((0, 2))}, "observations: 0 are too few for order 2"),
        (
            {"times": [0, 1], "positions": np.zeros((2, 2))},
            "2 are too few for order 2 and a known covariance; at least 3",
        ),
        ({"times": range(4), "positions": np.eye(4)[:, :2], "covariance": None}, "4 are too few .* at least 5"),
        ({"times": [0, 0, 1, 1], "positions": np.arange(8).reshape(4, 2)}, "2 different times are too few"),
        ({"times": [[0, 1, 2]]}, r"time has shape \(1, 3\)"),
        ({"positions": np.zeros((3, 3))}, r"position \(3, 3\)"),
        ({"positions": [["a", "b"]] * 3}, "observations.position: it is not an array of numbers"),
        ({"covariance": np.eye(3)}, r"covariance: its shape is \(3, 3\)"),
        ({"covariance": [[1.0, 2.0], [2.0, 1.0]]}, "is not positive definite"),
        ({"covariance": [[1.0, 0.5], [0.0, 1.0]]}, "is not symmetric"),
        ({"covariance": [[np.nan, 0.0], [0.0, 1.0]]}, "is not finite"),
        ({"covariance": [np.eye(2), np.eye(2), -np.eye(2)]}, r"covariance\[2\]: .* is not positive definite"),
        ({"times": range(6), "positions": np.ones((6, 2)), "covariance": None}, "lie exactly on a motion"),
    ],
)
def test_bad_observations_are_named(change: dict[str, object], message: str) -> None:
    arguments = {"times": [0.0, 1.0, 2.0], "positions": np.zeros((3, 2)), "covariance": SIGMA, **change}
    with pytest.raises(EstimationError, match=message):
        estimate_motion(**arguments)  # type: ignore[arg-type]
