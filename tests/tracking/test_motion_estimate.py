"""Polynomials and lengths of estimated motions."""

from __future__ import annotations

import math

import numpy as np
import pytest
from observed_motions import SIGMA, irregular, observe

from scp_planner.errors import EstimationError
from scp_planner.tracking.maximum_likelihood import estimate_motion
from scp_planner.tracking.motion_estimate import standardised_speed

pytestmark = pytest.mark.numerics


@pytest.mark.parametrize("each", [False, True])
@pytest.mark.parametrize("order", [0, 1, 2])
def test_polynomials_are_the_estimate(order: int, each: bool) -> None:
    rng = np.random.default_rng(9)
    times = irregular(rng)
    sigma = np.array([SIGMA * (1 + i) for i in range(15)]) if each else SIGMA
    seen = estimate_motion(times, observe(rng, times), sigma, order)
    pieces = seen.polynomials(1.5, 8.0)
    assert pieces.breakpoints.tolist() == [1.5, 8.0]
    assert pieces.center_error == 0.0
    t = np.linspace(1.5, 8.0, 11)
    powers = (t - 1.5)[:, None] ** np.arange(5)
    assert powers @ pieces.center[0] == pytest.approx(seen.position(t), rel=1e-12)
    xx, xy, yy = (powers @ pieces.covariance[0]).T
    assert np.stack([xx, xy, xy, yy], axis=-1).reshape(-1, 2, 2) == pytest.approx(seen.covariance(t), rel=1e-9)


@pytest.mark.parametrize("span", [(2, 1), (1, 1), (0, math.inf), (math.nan, 1)])
def test_polynomials_need_a_finite_span(span: tuple[float, float]) -> None:
    seen = estimate_motion([0, 1, 2], np.zeros((3, 2)), SIGMA)
    with pytest.raises(EstimationError, match="span of time"):
        seen.polynomials(*span)


def test_length_of_a_straight_motion_is_an_angle() -> None:
    rng = np.random.default_rng(10)
    times = irregular(rng)
    seen = estimate_motion(times, observe(rng, times), SIGMA, 1)
    root = np.linalg.cholesky(np.linalg.inv(np.array([[15, times.sum()], [times.sum(), (times**2).sum()]])))

    def direction(t: float) -> np.ndarray:
        return root.T @ (np.array([0.0, 1.0]) if math.isinf(t) else np.array([1.0, t]))

    for start, stop in ((2.0, 5.0), (0.0, 2.0), (2.0, math.inf)):
        a, b = direction(start), direction(stop)
        angle = math.acos(a @ b / np.linalg.norm(a) / np.linalg.norm(b))
        assert seen.standardised_length(start, stop) == pytest.approx(angle, rel=1e-9)
    assert seen.standardised_length() == pytest.approx(math.pi, rel=1e-9)
    assert estimate_motion(times, observe(rng, times), SIGMA, 0).standardised_length() == 0.0


def test_length_of_a_quadratic_motion_is_that_of_a_fine_polyline() -> None:
    rng = np.random.default_rng(12)
    times = irregular(rng)
    seen = estimate_motion(times, observe(rng, times), None, 2)
    rows = np.linspace(2.0, 7.0, 20_001)[:, None] ** np.arange(3)
    design = times[:, None] ** np.arange(3)
    on_sphere = rows @ np.linalg.cholesky(np.linalg.inv(design.T @ design))
    on_sphere /= np.linalg.norm(on_sphere, axis=1, keepdims=True)
    length = np.linalg.norm(np.diff(on_sphere, axis=0), axis=1).sum()
    assert seen.standardised_length(2.0, 7.0) == pytest.approx(length, rel=1e-6)


def test_length_with_a_covariance_for_each_is_the_mean_speed_of_the_standardised_error() -> None:
    """Against its definition, with the standardised error's rate of change by finite differences of its covariance."""
    rng = np.random.default_rng(13)
    times = irregular(rng, 8)
    sigmas = np.array([np.diag([0.01 + 0.3 * (i % 2), 0.2 - 0.02 * i]) + 0.001 for i in range(8)])
    seen = estimate_motion(times, observe(rng, times), sigmas)
    angles = np.linspace(0, 2 * math.pi, 721)[:-1]
    directions = np.stack([np.cos(angles), np.sin(angles)])

    def rows(t: float) -> np.ndarray:
        return np.kron(((t - seen.center_time) / seen.time_scale) ** np.arange(3), np.eye(2))

    spread = seen.coefficient_covariance.reshape(6, 6)

    def standardised(t: float) -> np.ndarray:
        return np.linalg.solve(np.linalg.cholesky(rows(t) @ spread @ rows(t).T), rows(t))

    total, step = 0.0, 4e-3
    for t in np.arange(2.0, 5.0, step) + 0.5 * step:
        change = (standardised(t + 0.5 * step) - standardised(t - 0.5 * step)) / step
        here = standardised(t)
        cross = here @ spread @ change.T
        given = change @ spread @ change.T - cross.T @ cross  # the standardised error itself has unit covariance
        total += step * np.mean(np.sqrt(np.einsum("an,ab,bn->n", directions, given, directions)))
    assert seen.standardised_length(2.0, 5.0) == pytest.approx(total, rel=1e-5)


def test_the_standardised_speed_is_the_mean_over_directions() -> None:
    rng = np.random.default_rng(5)
    mixed = rng.normal(size=(20, 6, 4))
    whole = np.einsum("nki,nkj->nij", mixed, mixed)
    error, cross, rate = whole[:, :2, :2], whole[:, :2, 2:], whole[:, 2:, 2:]
    found = standardised_speed(error, cross, rate)
    angles = np.linspace(0.0, 2.0 * np.pi, 4000, endpoint=False)
    directions = np.stack([np.cos(angles), np.sin(angles)])
    for k in range(20):
        half = np.linalg.inv(np.linalg.cholesky(error[k]))
        given = half @ (rate[k] - cross[k].T @ np.linalg.inv(error[k]) @ cross[k]) @ half.T
        mean = np.sqrt(np.einsum("in,ij,jn->n", directions, given, directions)).mean()
        assert found[k] == pytest.approx(mean, rel=1e-8)


@pytest.mark.parametrize("order", [0, 1, 2])
def test_a_manoeuvre_adds_to_the_variance(order: int) -> None:
    """A change of acceleration, known to 0.3 m/s2, begins at the last observation."""
    rng = np.random.default_rng(11)
    times = irregular(rng)
    estimate = estimate_motion(times, observe(rng, times, order), SIGMA, order)
    wider, lead = estimate.with_manoeuvre(0.3), np.array([0.0, 1.0, 3.0])
    change = 0.3**2 / np.linalg.eigvalsh(SIGMA)[0] * SIGMA
    at = times[-1] + lead
    assert wider.position(at) == pytest.approx(estimate.position(at), abs=1e-10)
    added = (lead**4 / 4.0)[:, None, None] * change
    assert wider.covariance(at) == pytest.approx(estimate.covariance(at) + added, rel=1e-9)
