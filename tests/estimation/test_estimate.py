from __future__ import annotations

import math
from fractions import Fraction
from types import SimpleNamespace
from typing import Any, ClassVar

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from scp_planner.errors import EstimationError
from scp_planner.estimation.error_laws import HotellingErrors, NormalErrors, StudentErrors
from scp_planner.estimation.estimate import estimate_motion, estimate_obstacle
from scp_planner.estimation.least_squares import MotionPrior
from scp_planner.estimation.motion_estimate import PolynomialEstimate, standardised_speed
from scp_planner.estimation.observations import Faulty, Outliers, Screening
from scp_planner.scenario.models import Obstacle

pytestmark = pytest.mark.numerics

SIGMA = np.array([[0.04, 0.015], [0.015, 0.01]])
TRUTH = np.array([[3.0, -1.0], [1.2, 0.4], [-0.3, 0.25]])  # position, velocity, half the acceleration


def observe(rng: np.random.Generator, times: np.ndarray, order: int = 2, sigma: np.ndarray = SIGMA) -> np.ndarray:
    truth = (np.asarray(times)[:, None] ** np.arange(order + 1)) @ TRUTH[: order + 1]
    return truth + rng.multivariate_normal(np.zeros(2), sigma, len(times))


def irregular(rng: np.random.Generator, count: int = 15, end: float = 2.0) -> np.ndarray:
    return np.sort(rng.uniform(0.0, end, count))


def closed_form(times: list[Fraction], t: Fraction) -> float:
    """Variance of the estimate at t in units of sigma^2, written out in c_j = sum t_i^j as in the publication."""
    n, c1, c2, c3, c4 = (sum(s**j for s in times) for j in range(5))
    determinant = n * (c2 * c4 - c3**2) - c1 * (c1 * c4 - c2 * c3) + c2 * (c1 * c3 - c2**2)
    numerator = (
        (c2 * c4 - c3**2)
        + 2 * t * (c2 * c3 - c1 * c4)
        + t**2 * (2 * (c1 * c3 - c2**2) + n * c4 - c2**2)
        + 2 * t**3 * (c1 * c2 - n * c3)
        + t**4 * (n * c2 - c1**2)
    )
    return float(numerator / determinant)


@pytest.mark.parametrize("count", [3, 5, 20])
def test_variance_agrees_with_the_closed_form(count: int) -> None:
    times = [Fraction(i, 8) + Fraction(i * i, 64) for i in range(count)]
    seen = estimate_motion([float(t) for t in times], np.zeros((count, 2)), SIGMA)
    for t in (Fraction(-1), Fraction(1, 3), times[-1], times[-1] + 7):
        assert seen.covariance(float(t)) == pytest.approx(closed_form(times, t) * SIGMA, rel=1e-9)


@pytest.mark.parametrize("order", [0, 1, 2])
def test_estimate_is_least_squares(order: int) -> None:
    rng = np.random.default_rng(order)
    times = irregular(rng)
    positions = observe(rng, times)
    fits = [np.polynomial.Polynomial.fit(times, positions[:, a], order).convert() for a in range(2)]
    for covariance in (None, SIGMA):
        seen = estimate_motion(times, positions, covariance, order)
        for t in (0.0, 1.3, 5.0):
            assert seen.position(t) == pytest.approx([fit(t) for fit in fits], rel=1e-9)
        last = times[-1]
        assert seen.reference_time == last
        assert seen.velocity == pytest.approx([fit.deriv()(last) for fit in fits], rel=1e-8)
        assert seen.acceleration == pytest.approx([fit.deriv(2)(last) for fit in fits], rel=1e-8)
        assert (seen.order, seen.observations) == (order, len(times))


@pytest.mark.parametrize("order", [0, 1, 2])
def test_estimated_covariance_is_unbiased(order: int) -> None:
    rng = np.random.default_rng(7)
    times = irregular(rng, order + 4)
    runs = 1500
    found = [estimate_motion(times, observe(rng, times, order), None, order) for _ in range(runs)]
    mean = np.mean([seen.noise_covariance for seen in found], axis=0)
    spread = np.std([seen.noise_covariance for seen in found], axis=0) / math.sqrt(runs)
    assert np.all(np.abs(mean - SIGMA) < 4 * spread)
    assert {seen.degrees_of_freedom for seen in found} == {3}


@pytest.mark.parametrize("each", [False, True])
def test_covariance_is_that_of_the_errors(each: bool) -> None:
    """The spread of estimates over simulated observations, with a common covariance and with one for each."""
    rng = np.random.default_rng(11)
    times = irregular(rng, 8)
    sigmas = np.array([SIGMA * (1 + 3 * (i % 3)) + np.diag([0.0, 0.02 * (i % 2)]) for i in range(8)]) if each else None
    where = np.array([0.5, 2.0, 4.0])
    errors = []
    for _ in range(1000):
        if sigmas is None:
            seen = estimate_motion(times, observe(rng, times), SIGMA)
        else:
            noise = np.array([rng.multivariate_normal(np.zeros(2), sigma) for sigma in sigmas])
            seen = estimate_motion(times, (times[:, None] ** np.arange(3)) @ TRUTH + noise, sigmas)
        errors.append(seen.position(where) - (where[:, None] ** np.arange(3)) @ TRUTH)
    for i, t in enumerate(where):
        at = np.array(errors)[:, i]
        assert at.mean(axis=0) == pytest.approx([0, 0], abs=4 * float(np.sqrt(np.trace(seen.covariance(t)) / 1000)))
        # the sample covariance of 1000, standardised, is the identity to 4 / sqrt(1000)
        standard = np.linalg.solve(np.linalg.cholesky(seen.covariance(t)), at.T)
        assert np.cov(standard) == pytest.approx(np.eye(2), abs=0.13)


def test_covariances_for_each_are_generalised_least_squares() -> None:
    rng = np.random.default_rng(2)
    times = irregular(rng, 9)
    sigmas = np.array([np.diag(rng.uniform(0.01, 0.2, 2)) + 0.005 for _ in times])
    positions = observe(rng, times)
    design = np.array([np.kron(t ** np.arange(3), np.eye(2)) for t in times])
    information = sum(x.T @ np.linalg.inv(s) @ x for x, s in zip(design, sigmas, strict=True))
    right = sum(x.T @ np.linalg.inv(s) @ z for x, s, z in zip(design, sigmas, positions, strict=True))
    expected = np.linalg.solve(information, right)
    seen = estimate_motion(times, positions, sigmas)
    at = np.kron(2.5 ** np.arange(3), np.eye(2))
    assert seen.position(2.5) == pytest.approx(at @ expected, rel=1e-9)
    assert seen.covariance(2.5) == pytest.approx(at @ np.linalg.inv(information) @ at.T, rel=1e-9)
    assert seen.noise_covariance == pytest.approx(sigmas.mean(axis=0))
    assert seen.regressors is None


def test_one_covariance_given_for_each_is_the_common_one() -> None:
    rng = np.random.default_rng(4)
    times = irregular(rng)
    positions = observe(rng, times)
    common, each = (estimate_motion(times, positions, s) for s in (SIGMA, np.broadcast_to(SIGMA, (15, 2, 2))))
    assert each.position(3.0) == pytest.approx(common.position(3.0), rel=1e-10)
    assert each.covariance(3.0) == pytest.approx(common.covariance(3.0), rel=1e-9)
    assert each.standardised_length(2.0) == pytest.approx(common.standardised_length(2.0), rel=1e-6)


@pytest.mark.parametrize("covariance", [None, SIGMA])
def test_a_clock_of_a_billion_seconds_loses_nothing(covariance: np.ndarray | None) -> None:
    rng = np.random.default_rng(6)
    times = np.arange(12) / 8.0  # exact on either clock
    positions = observe(rng, times)
    near, far = (estimate_motion(times + shift, positions, covariance) for shift in (0.0, 1e9))
    for t in (1.0, 2.0, 9.0):
        assert far.position(1e9 + t) == pytest.approx(near.position(t), rel=1e-13)
        assert far.covariance(1e9 + t) == pytest.approx(near.covariance(t), rel=1e-13)
    assert far.velocity == pytest.approx(near.velocity, rel=1e-13)
    assert far.standardised_length(1e9 + 2, 1e9 + 5) == pytest.approx(near.standardised_length(2, 5), rel=1e-12)
    assert far.polynomials(1e9 + 2, 1e9 + 5).center == pytest.approx(near.polynomials(2, 5).center, rel=1e-12)


def test_map_coordinates_lose_nothing() -> None:
    rng = np.random.default_rng(8)
    times = irregular(rng)
    positions = np.round(observe(rng, times) * 1024) / 1024  # exact in either frame
    origin = np.array([500_000.0, 5_800_000.0])
    near, far = estimate_motion(times, positions), estimate_motion(times, positions + origin)
    assert far.noise_covariance == pytest.approx(near.noise_covariance, rel=1e-12)
    assert far.position(4.0) - origin == pytest.approx(near.position(4.0), abs=2e-9)


@given(st.integers(0, 2), st.booleans(), st.integers(0, 2**32), st.floats(-3.1, 3.1), st.permutations(range(9)))
@settings(max_examples=25)
def test_estimate_does_not_depend_on_the_frame_or_the_order(
    order: int, known: bool, seed: int, angle: float, shuffled: list[int]
) -> None:
    rng = np.random.default_rng(seed)
    times = irregular(rng, 9)
    positions = observe(rng, times)
    turn = np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])
    move = rng.normal(size=2)
    seen = estimate_motion(times, positions, SIGMA if known else None, order)
    turned = estimate_motion(
        times[shuffled], positions[shuffled] @ turn.T + move, turn @ SIGMA @ turn.T if known else None, order
    )
    assert turned.position(3.0) == pytest.approx(turn @ seen.position(3.0) + move, rel=1e-7, abs=1e-7)
    assert turned.covariance(3.0) == pytest.approx(turn @ seen.covariance(3.0) @ turn.T, rel=1e-7, abs=1e-9)
    assert turned.reference_time == seen.reference_time


@pytest.mark.parametrize("each", [False, True])
@pytest.mark.parametrize("order", [0, 1, 2])
def test_polynomials_are_the_estimate(order: int, each: bool) -> None:
    rng = np.random.default_rng(9)
    times = irregular(rng)
    sigma = np.array([SIGMA * (1 + i) for i in range(15)]) if each else SIGMA
    seen = estimate_motion(times, observe(rng, times), sigma, order)
    pieces = seen.polynomials(1.5, 8.0)
    assert pieces.breakpoints.tolist() == [1.5, 8.0]
    assert (pieces.center_error, pieces.covariance_error) == (0.0, 0.0)
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


class TestIsotropicNoise:
    def test_pools_all_residuals(self) -> None:
        rng = np.random.default_rng(14)
        times = irregular(rng)
        positions = observe(rng, times)
        seen = estimate_motion(times, positions, noise="isotropic")
        fits = [np.polyfit(times, positions[:, a], 2, full=True)[1][0] for a in range(2)]
        assert seen.noise_covariance == pytest.approx(sum(fits) / 24 * np.eye(2))
        assert seen.errors == StudentErrors(24)
        assert seen.degrees_of_freedom is None

    def test_needs_much_less_room_with_few_observations(self) -> None:
        rng = np.random.default_rng(15)
        times = np.arange(5) * 0.1
        positions = observe(rng, times, sigma=0.01 * np.eye(2))
        general, isotropic = (estimate_motion(times, positions, noise=n) for n in ("general", "isotropic"))
        assert isotropic.errors.pointwise_scale(0.05) < general.errors.pointwise_scale(0.05) / 40

    def test_covers_as_promised(self) -> None:
        rng = np.random.default_rng(16)
        times, runs, inside = np.arange(5) * 0.1, 1000, 0
        for _ in range(runs):
            seen = estimate_motion(times, rng.normal(size=(5, 2)), noise="isotropic")
            z = seen.position(1.0)
            inside += bool(z @ np.linalg.solve(seen.covariance(1.0), z) <= seen.errors.pointwise_scale(0.05))
        assert inside / runs == pytest.approx(0.95, abs=4 * math.sqrt(0.95 * 0.05 / runs))


class TestPrior:
    times = np.arange(6) * 0.2

    def positions(self) -> np.ndarray:
        return observe(np.random.default_rng(17), self.times)

    def test_that_says_nothing_changes_nothing(self) -> None:
        plain, vague = (estimate_motion(self.times, self.positions(), SIGMA, prior=p) for p in (None, MotionPrior()))
        assert vague.position(4.0) == pytest.approx(plain.position(4.0), rel=1e-9)
        assert vague.covariance(4.0) == pytest.approx(plain.covariance(4.0), rel=1e-9)

    def test_is_bayes_rule(self) -> None:
        prior = MotionPrior((0.5, 0.1), 0.7, (0.0, -0.2), 0.3)
        design = np.kron(self.times[:, None] ** np.arange(3), np.eye(2))
        last = self.times[-1]
        about = np.vstack([np.kron([0, 1, 2 * last], np.eye(2)), np.kron([0, 0, 2], np.eye(2))])
        known = np.diag([0.7**-2] * 2 + [0.3**-2] * 2)
        weights = np.kron(np.eye(6), np.linalg.inv(SIGMA))
        information = design.T @ weights @ design + about.T @ known @ about
        right = design.T @ weights @ self.positions().ravel() + about.T @ known @ np.array([0.5, 0.1, 0.0, -0.2])
        at = np.kron(4.0 ** np.arange(3), np.eye(2))
        seen = estimate_motion(self.times, self.positions(), SIGMA, prior=prior)
        assert seen.position(4.0) == pytest.approx(at @ np.linalg.solve(information, right), rel=1e-9)
        assert seen.covariance(4.0) == pytest.approx(at @ np.linalg.inv(information) @ at.T, rel=1e-8)

    def test_stands_in_for_observations(self) -> None:
        prior = MotionPrior((1.0, 0.0), 0.5, (0.0, 0.0), 0.2)
        seen = estimate_motion([3.0], [[2.0, 1.0]], SIGMA, prior=prior)
        assert seen.position(5.0) == pytest.approx([4.0, 1.0])
        expected = SIGMA + (2.0**2 * 0.5**2 + 2.0**2 * 2.0**2 / 4 * 0.2**2) * np.eye(2)
        assert seen.covariance(5.0) == pytest.approx(expected)

    def test_keeps_far_zones_finite(self) -> None:
        prior = MotionPrior(acceleration_deviation=0.1)
        free, held = (estimate_motion(self.times, self.positions(), SIGMA, prior=p) for p in (None, prior))
        assert np.trace(held.covariance(6.0)) < np.trace(free.covariance(6.0)) / 10

    def test_covers_obstacles_that_are_as_it_says(self) -> None:
        rng = np.random.default_rng(18)
        prior = MotionPrior((1.0, 0.0), 0.5, (0.0, 0.0), 0.4)
        runs, inside = 1000, 0
        for _ in range(runs):
            velocity, acceleration = rng.normal([1.0, 0.0], 0.5), rng.normal(0.0, 0.4, 2)
            lags = self.times[:, None] - 1.0
            truth = lags * velocity + 0.5 * lags**2 * acceleration
            noise = rng.multivariate_normal(np.zeros(2), SIGMA, 6)
            seen = estimate_motion(self.times, truth + noise, SIGMA, prior=prior)
            error = seen.position(4.0) - (3.0 * velocity + 4.5 * acceleration)
            inside += bool(error @ np.linalg.solve(seen.covariance(4.0), error) <= seen.errors.pointwise_scale(0.05))
        assert inside / runs == pytest.approx(0.95, abs=4 * math.sqrt(0.95 * 0.05 / runs))

    @pytest.mark.parametrize(
        ("given", "message"),
        [
            ({"velocity_deviation": 0.0}, "prior.velocity_deviation: 0.0 is not a positive number"),
            ({"acceleration_deviation": -1.0}, "prior.acceleration_deviation"),
            ({"velocity": (math.nan, 0.0)}, "prior.velocity: .* is not two finite numbers"),
            ({"acceleration": (1.0,)}, "prior.acceleration"),
        ],
    )
    def test_must_make_sense(self, given: dict[str, object], message: str) -> None:
        with pytest.raises(EstimationError, match=message):
            MotionPrior(**given)  # type: ignore[arg-type]

    def test_that_leaves_the_motion_open_is_refused(self) -> None:
        with pytest.raises(EstimationError, match="do not determine a motion of order 2"):
            estimate_motion([3.0], [[2.0, 1.0]], SIGMA, prior=MotionPrior(velocity_deviation=1.0))


class TestForgetting:
    def test_weighs_by_age(self) -> None:
        rng = np.random.default_rng(19)
        times = irregular(rng)
        positions = observe(rng, times)
        weights = 0.8 ** np.arange(14, -1, -1)
        fits = [np.polyfit(times, positions[:, a], 2, w=np.sqrt(weights)) for a in range(2)]
        seen = estimate_motion(times, positions, SIGMA, forgetting=0.8)
        assert seen.position(3.0) == pytest.approx([np.polyval(fit, 3.0) for fit in fits], rel=1e-9)

    @pytest.mark.parametrize("known", [True, False])
    def test_covers_a_motion_that_does_not_change(self, known: bool) -> None:
        rng = np.random.default_rng(20)
        times, runs, inside = np.arange(20) * 0.1, 1000, 0
        for _ in range(runs):
            seen = estimate_motion(
                times, rng.multivariate_normal(np.zeros(2), SIGMA, 20), SIGMA if known else None, forgetting=0.85
            )
            z = seen.position(2.5)
            inside += bool(z @ np.linalg.solve(seen.covariance(2.5), z) <= seen.errors.pointwise_scale(0.05))
        assert inside / runs == pytest.approx(0.95, abs=4 * math.sqrt(0.95 * 0.05 / runs))

    def test_follows_a_manoeuvre(self) -> None:
        times = np.arange(60) * 0.1
        positions = np.stack([times, np.where(times < 4.0, 0.0, times - 4.0)], axis=1)
        keep, forget = (estimate_motion(times, positions, SIGMA, 1, forgetting=f) for f in (1.0, 0.7))
        assert abs(forget.velocity[1] - 1.0) < 0.01 < abs(keep.velocity[1] - 1.0)


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
        (
            {"times": range(6), "positions": np.outer([1, 5, 2, 8, 1, 1], [1, 2]), "covariance": None},
            "residuals on a line",
        ),
    ],
)
def test_bad_observations_are_named(change: dict[str, object], message: str) -> None:
    arguments = {"times": [0.0, 1.0, 2.0], "positions": np.zeros((3, 2)), "covariance": SIGMA, **change}
    with pytest.raises(EstimationError, match=message):
        estimate_motion(**arguments)  # type: ignore[arg-type]


class TestObstacles:
    seen: ClassVar[dict[str, list[Any]]] = {
        "time": [0.0, 0.4, 0.8, 1.2, 1.6, 2.0],
        "position": np.random.default_rng(24).normal(size=(6, 2)).tolist(),
    }

    def obstacle(self, model: dict[str, object], **observations: object) -> Obstacle:
        return Obstacle(id="a", shape={"disc": 0.3}, observations={**self.seen, **observations}, model=model)

    def test_order_and_covariance_are_taken_from_the_scenario(self) -> None:
        seen = estimate_obstacle(self.obstacle({"order": 1}, covariance=SIGMA))
        same = estimate_motion(self.seen["time"], self.seen["position"], SIGMA, 1)
        assert seen.position(3.0) == pytest.approx(same.position(3.0))
        assert isinstance(seen.errors, NormalErrors)
        assert isinstance(estimate_obstacle(self.obstacle({"order": 1})).errors, HotellingErrors)

    def test_prior_is_taken_from_the_scenario(self) -> None:
        prior = {"velocity": [1.0, 0.0], "velocity_deviation": 0.5}
        seen = estimate_obstacle(self.obstacle({"order": 2, "prior": prior}, covariance=SIGMA))
        same = estimate_motion(
            self.seen["time"], self.seen["position"], SIGMA, 2, MotionPrior((1.0, 0.0), velocity_deviation=0.5)
        )
        assert seen.covariance(3.0) == pytest.approx(same.covariance(3.0))

    def test_process_noise_is_taken_from_the_scenario(self) -> None:
        process = {
            "process": {"kind": "random_walk", "diffusion": 0.1},
            "velocity_deviation": 1.0,
            "noise_deviation": 0.1,
        }
        seen = estimate_obstacle(self.obstacle({"process": process}))
        assert type(seen).__name__ == "ProcessEstimate"

    def test_errors_name_the_obstacle(self) -> None:
        moving = Obstacle(id="b", shape={"disc": 0.3}, motion={"position": [0, 0]})
        with pytest.raises(EstimationError, match=r"obstacle 'b': it has no observations"):
            estimate_obstacle(moving)
        still = SimpleNamespace(id="c", observations=SimpleNamespace(time=[0], position=[[0, 0]], covariance=None))
        still.estimate = None
        still.model = SimpleNamespace(order=2, prior=None, process=None)
        with pytest.raises(EstimationError, match="obstacle 'c': observations: 1 are too few"):
            estimate_obstacle(still)  # type: ignore[arg-type]


def test_hotelling_regions_cover_each_axis_as_student_intervals_do() -> None:
    """Estimated covariance, one axis at a time: the textbook interval of simple regression."""
    rng = np.random.default_rng(25)
    times = np.arange(8) * 0.5
    positions = observe(rng, times, 1)
    seen = estimate_motion(times, positions, None, 1)
    fit = stats.linregress(times, positions[:, 0])
    assert math.sqrt(seen.covariance(0.0)[0, 0]) == pytest.approx(fit.intercept_stderr)


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
