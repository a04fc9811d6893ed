from __future__ import annotations

import numpy as np
import pytest

from scp_planner.errors import EstimationError
from scp_planner.tracking.maximum_likelihood import MotionPrior, estimate_motion
from scp_planner.tracking.motion_estimate import PolynomialEstimate
from scp_planner.tracking.recursive import RecursiveEstimator

pytestmark = pytest.mark.numerics

SIGMA = np.array([[0.02, 0.005], [0.005, 0.01]])
CLOCK = 1e9
PRIOR = MotionPrior((1.0, 1.0), 0.5, (0.0, 0.0), 0.1)


def recording(count: int, obstacles: int = 3, order: int = 2) -> tuple[np.ndarray, np.ndarray]:
    """Times (n,) on a clock of 1e9 s, and positions (n, K, 2) on a map."""
    rng = np.random.default_rng([count, order])
    times = np.arange(count) / 8.0 + np.arange(count) % 3 / 64.0
    rows = times[:, None] ** np.arange(order + 1)
    truth = np.einsum("nj,kja->nka", rows, rng.normal(size=(obstacles, order + 1, 2)))
    return CLOCK + times, truth + 0.1 * rng.normal(size=truth.shape) + np.array([5e5, 4e6])


def covariances(count: int, obstacles: int = 3) -> np.ndarray:
    rng = np.random.default_rng(count)
    return SIGMA * rng.uniform(0.5, 2.0, (count, obstacles, 1, 1)) + np.diag([0.01, 0.0])


def assert_same(one: PolynomialEstimate, other: PolynomialEstimate) -> None:
    """Equal to 1e-10 of the distances and of the covariances, up to 4 s ahead."""
    times = other.reference_time + np.array([-0.5, 0.0, 1.0, 4.0])
    moved = np.abs(other.position(times) - other.position(times[0])).max() + 0.1
    assert one.position(times) - other.position(times) == pytest.approx(np.zeros((4, 2)), abs=1e-10 * moved + 1e-9)
    size = np.abs(other.covariance(times)).max(axis=(1, 2), keepdims=True)
    assert one.covariance(times) / size == pytest.approx(other.covariance(times) / size, abs=1e-10)
    assert one.noise_covariance == pytest.approx(other.noise_covariance, rel=1e-10)
    assert one.velocity == pytest.approx(other.velocity, rel=1e-9, abs=1e-9)
    assert one.observations == other.observations
    assert one.reference_time == other.reference_time
    assert type(one.errors) is type(other.errors)
    if other.degrees_of_freedom is not None:
        assert one.degrees_of_freedom == pytest.approx(other.degrees_of_freedom, rel=1e-9)
    assert one.regressors == other.regressors


@pytest.mark.parametrize("prior", [None, PRIOR])
@pytest.mark.parametrize("noise", ["known", "estimated", "varying"])
@pytest.mark.parametrize("order", [0, 1, 2])
def test_recursive_is_batch_in_any_order(order: int, noise: str, prior: MotionPrior | None) -> None:
    for count in (order + 4, 150):
        times, positions = recording(count, order=order)
        each = covariances(count)
        estimator = RecursiveEstimator(3, order, SIGMA if noise == "known" else None, varying=noise == "varying")
        for i in np.random.default_rng(1).permutation(count):
            estimator.update(times[i], positions[i], each[i] if noise == "varying" else None)
        assert estimator.observations.tolist() == [count] * 3
        for k in range(3):
            sigma = {"known": SIGMA, "estimated": None, "varying": each[:, k]}[noise]
            batch = estimate_motion(times, positions[:, k], sigma, order, prior)
            assert_same(estimator.estimate(k, prior), batch)


def test_obstacles_are_seen_when_they_are_seen() -> None:
    """Each has its own times, and dropouts of its own."""
    times, positions = recording(40)
    seen = np.random.default_rng(2).random((40, 3)) < 0.6
    late = times[:, None] + np.array([0.0, 1 / 32, 1 / 16])
    estimator = RecursiveEstimator(3, 2, np.array([SIGMA, 2 * SIGMA, 3 * SIGMA]))
    for i in range(40):
        garbage = np.where(seen[i][:, None], positions[i], np.nan)
        estimator.update(late[i], garbage, seen=seen[i])
    for k in range(3):
        own = seen[:, k]
        batch = estimate_motion(late[own, k], positions[own, k], (k + 1) * SIGMA)
        assert_same(estimator.estimate(k), batch)


def test_refused_observations_change_nothing() -> None:
    times, positions = recording(8, 2)
    estimator = RecursiveEstimator(2, 1, SIGMA)
    for i in range(7):
        estimator.update(times[i], positions[i])
    before = estimator.estimate(0)
    spoiled = positions[7].copy()
    spoiled[1, 0] = np.inf
    for arguments, message in (
        ((times[7], spoiled), r"obstacle 1: time .* or position \[inf, .*\] is not finite"),
        ((np.nan, positions[7]), "obstacle 0: time nan"),
        ((times[6], positions[6]), "obstacle 0: the observation at time .* comes twice"),
        ((times[7], positions[7, :1]), r"positions: their shape is \(1, 2\); must be \(2, 2\)"),
        ((times[7], positions[7], SIGMA), "covariance: it must not come"),
    ):
        with pytest.raises(EstimationError, match=message):
            estimator.update(*arguments)
    assert_same(estimator.estimate(0), before)
    estimator.update(times[7], positions[7])
    assert_same(estimator.estimate(1), estimate_motion(times, positions[:, 1], SIGMA, 1))


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"order": 3}, "order: 3"),
        ({"covariance": SIGMA, "varying": True}, "comes with each observation"),
        ({"covariance": -SIGMA}, "not positive definite"),
    ],
)
def test_misuse_is_named(arguments: dict[str, object], message: str) -> None:
    with pytest.raises(EstimationError, match=message):
        RecursiveEstimator(2, **arguments)  # type: ignore[arg-type]


def test_too_few_observations_are_named() -> None:
    estimator = RecursiveEstimator(2, 2)
    estimator.update(0.0, np.zeros((2, 2)))
    with pytest.raises(EstimationError, match="obstacle 1: 1 observations are too few for order 2; need 5"):
        estimator.estimate(1)
    known = RecursiveEstimator(1, 2, SIGMA)
    for x in (0.0, 1.0, 2.0):
        known.update(1.0, [[x, 0.0]])
    with pytest.raises(EstimationError, match="too few times"):
        known.estimate()
    with pytest.raises(EstimationError, match="does not determine"):
        known.estimate(prior=MotionPrior(velocity_deviation=1.0))
    with pytest.raises(EstimationError, match="it must come"):
        RecursiveEstimator(1, 2, varying=True).update(0.0, [[0.0, 0.0]])
