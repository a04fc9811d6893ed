"""Observations that are no good: refused, left out, or given less weight."""

from __future__ import annotations

import math

import numpy as np
import pytest
from observed_motions import SIGMA, TRUTH, observe

from scp_planner.errors import EstimationError
from scp_planner.tracking.maximum_likelihood import estimate_motion
from scp_planner.tracking.motion_estimate import PolynomialEstimate
from scp_planner.tracking.observations import Faulty, Outliers, Screening

pytestmark = pytest.mark.numerics


class TestScreening:
    times = np.arange(20) * 0.1

    def spoiled(self, rows: list[int], seed: int = 21) -> np.ndarray:
        positions = observe(np.random.default_rng(seed), self.times)
        positions[rows] += [2.0, -3.0]
        return positions

    def error(self, seen: PolynomialEstimate) -> float:
        return float(np.linalg.norm(seen.position(2.5) - 2.5 ** np.arange(3) @ TRUTH))

    @pytest.mark.parametrize("covariance", [None, SIGMA, np.broadcast_to(SIGMA, (20, 2, 2))])
    @pytest.mark.parametrize("noise", ["general", "isotropic"])
    def test_gate_leaves_out_what_does_not_fit(self, covariance: np.ndarray | None, noise: str) -> None:
        screening = Screening(outliers=Outliers.GATE)
        seen = estimate_motion(self.times, self.spoiled([4, 11]), covariance, noise=noise, screening=screening)
        assert seen.rejected == (4, 11)
        rest = np.setdiff1d(np.arange(20), [4, 11])
        sigma = covariance[rest] if covariance is not None and covariance.ndim == 3 else covariance
        clean = estimate_motion(self.times[rest], self.spoiled([])[rest], sigma, noise=noise)
        assert seen.position(3.0) == pytest.approx(clean.position(3.0))
        assert seen.covariance(3.0) == pytest.approx(clean.covariance(3.0))

    @pytest.mark.parametrize(
        ("known", "noise"),
        [
            (True, "general"),
            (False, "isotropic"),
            pytest.param(True, "isotropic", marks=pytest.mark.slow),
            pytest.param(False, "general", marks=pytest.mark.slow),
        ],
    )
    def test_gate_seldom_touches_good_observations(self, known: bool, noise: str) -> None:
        rng = np.random.default_rng(22)
        runs, touched = 600, 0
        sigma = SIGMA if noise == "general" else 0.01 * np.eye(2)
        screening = Screening(outliers=Outliers.GATE, gate_probability=0.05)
        for _ in range(runs):
            positions = rng.multivariate_normal(np.zeros(2), sigma, 8)
            seen = estimate_motion(
                self.times[:8], positions, sigma if known else None, noise=noise, screening=screening
            )
            touched += bool(seen.rejected)
        assert 0.01 < touched / runs < 0.05 + 4 * math.sqrt(0.05 * 0.95 / runs)  # Bonferroni: at most 0.05

    @pytest.mark.parametrize("covariance", [None, SIGMA])
    def test_huber_weights_limit_the_harm(self, covariance: np.ndarray | None) -> None:
        kept, weighed = (
            estimate_motion(self.times, self.spoiled([16, 18]), covariance, screening=Screening(outliers=o))
            for o in (Outliers.KEEP, Outliers.HUBER)
        )
        assert self.error(weighed) < self.error(kept) / 4
        assert weighed.rejected == ()

    @pytest.mark.parametrize("known", [True, pytest.param(False, marks=pytest.mark.slow)])
    def test_huber_weights_cover_with_clean_and_with_spoiled_observations(self, known: bool) -> None:
        rng = np.random.default_rng(23)
        times, runs = np.arange(30) * 0.1, 90
        for share in (0.0, 0.1):  # 3,000 runs give 0.95 to 0.97 and 0.94 to 0.97
            inside = 0
            for _ in range(runs):
                positions = rng.multivariate_normal(np.zeros(2), SIGMA, 30)
                positions[rng.random(30) < share] *= 8.0
                screening = Screening(outliers=Outliers.HUBER)
                seen = estimate_motion(times, positions, SIGMA if known else None, 1, screening=screening)
                z = seen.position(4.0)
                inside += bool(z @ np.linalg.solve(seen.covariance(4.0), z) <= seen.errors.pointwise_scale(0.05))
            assert 0.94 - 4 * math.sqrt(0.94 * 0.06 / runs) < inside / runs < 1.0

    def test_huber_weights_solve_their_equation(self) -> None:
        """At the solution the sum of psi(residual) x vanishes, psi(r) = r min(1, k / |r|)."""
        positions = self.spoiled([3, 7, 12])
        seen = estimate_motion(self.times, positions, SIGMA, screening=Screening(outliers=Outliers.HUBER))
        residuals = np.linalg.solve(np.linalg.cholesky(SIGMA), (positions - seen.position(self.times)).T).T
        psi = residuals * np.minimum(1.0, 2.0 / np.linalg.norm(residuals, axis=1, keepdims=True))
        score = (self.times[:, None] ** np.arange(3)).T @ psi
        assert np.abs(score).max() < 1e-7

    def test_missing_rows_are_refused_or_left_out(self) -> None:
        positions = self.spoiled([])
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
            estimate_motion(times, self.spoiled([]), SIGMA)

    def test_repeated_rows_are_refused_or_left_out(self) -> None:
        times, positions = np.append(self.times, self.times[7]), self.spoiled([])
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
        with pytest.raises(EstimationError, match=r"gate_probability: 1.5"):
            Screening(gate_probability=1.5)


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
        ({"forgetting": 0.0}, "forgetting: 0.0"),
        (
            {"forgetting": 0.9, "covariance": None, "screening": Screening(outliers=Outliers.GATE)},
            "the covariance must be given",
        ),
        ({"times": range(6), "positions": np.ones((6, 2)), "covariance": None}, "lie exactly on a motion"),
    ],
)
def test_bad_observations_are_named(change: dict[str, object], message: str) -> None:
    arguments = {"times": [0.0, 1.0, 2.0], "positions": np.zeros((3, 2)), "covariance": SIGMA, **change}
    with pytest.raises(EstimationError, match=message):
        estimate_motion(**arguments)  # type: ignore[arg-type]
