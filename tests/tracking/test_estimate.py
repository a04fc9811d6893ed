"""Estimates of motions: least squares, priors and forgetting, against closed forms and simulation."""

from __future__ import annotations

import math
from fractions import Fraction
from types import SimpleNamespace
from typing import Any, ClassVar

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from observed_motions import SIGMA, TRUTH, irregular, observe

from scp_planner.errors import EstimationError
from scp_planner.scenario.models import Obstacle
from scp_planner.tracking.confidence import HotellingErrors, NormalErrors, StudentErrors
from scp_planner.tracking.estimate import estimate_obstacle
from scp_planner.tracking.maximum_likelihood import MotionPrior, estimate_motion
from scp_planner.tracking.recursive import RecursiveEstimator

pytestmark = pytest.mark.numerics


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
    roots = None if sigmas is None else np.linalg.cholesky(sigmas)
    errors = []
    for _ in range(1000):
        if roots is None:
            seen = estimate_motion(times, observe(rng, times), SIGMA)
        else:
            noise = np.einsum("nij,nj->ni", roots, rng.normal(size=(8, 2)))
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


@pytest.mark.parametrize("scale", [1.0, 1e-3, 1e4])
@pytest.mark.parametrize("place", [0.0, 1e5])
@pytest.mark.parametrize("bend", ["straight", "on a line", "rounding"])
def test_exact_positions_give_a_covariance_that_nothing_divides_by_zero_with(
    scale: float, place: float, bend: str
) -> None:
    times = 0.25 * np.arange(20)
    along = times + (0.0 if bend == "straight" else 0.1) * np.exp(-times)
    if bend == "rounding":
        along = np.round(along, 6)
    positions = scale * (place + np.outer(along, [0.6, 0.8]))
    found = estimate_motion(times, positions, order=1)
    values = np.linalg.eigvalsh(found.noise_covariance)
    residuals = positions - found.position(times)
    assert values[1] >= (residuals**2).sum() / (len(times) - 2) * (1.0 - 1e-6)
    assert values[0] >= 0.99e-4 * values[1] > 0.0
    assert np.sqrt(values[1]) < scale * (0.05 if bend != "straight" else 1e-5 + 1e-12 * place)
    freer = found.with_manoeuvre(0.1 * scale)
    assert np.isfinite(freer.covariance(times[-1] + 1.0)).all()
    recursive = RecursiveEstimator(1, 1)
    for time, position in zip(times, positions, strict=True):
        recursive.update(time, position[None])
    same = recursive.estimate()
    assert same.noise_covariance == pytest.approx(found.noise_covariance, rel=1e-3, abs=1e-3 * float(values[0]))


def test_a_noise_that_shows_is_estimated_as_it_is() -> None:
    rng, times = np.random.default_rng(0), 0.1 * np.arange(40)
    positions = np.outer(times, [1.0, 0.5]) + rng.normal(size=(40, 2)) * [0.05, 0.002]
    found = estimate_motion(times, positions, order=1)
    design = np.stack([np.ones(40), times], axis=1)
    residuals = positions - design @ np.linalg.lstsq(design, positions, rcond=None)[0]
    assert found.noise_covariance == pytest.approx(residuals.T @ residuals / 38, rel=1e-9)
