"""Maximum likelihood of motions, against generalised least squares, the article's closed form and simulation."""

from __future__ import annotations

import math
from fractions import Fraction
from typing import Any, ClassVar

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from observed_motions import SIGMA, irregular, observe

from scp_planner.errors import EstimationError
from scp_planner.scenario.models import Obstacle
from scp_planner.tracking.confidence import HotellingErrors, NormalErrors, StudentErrors
from scp_planner.tracking.estimate import estimate_obstacle
from scp_planner.tracking.maximum_likelihood import MotionPrior, estimate_motion

pytestmark = pytest.mark.numerics

PRIOR = MotionPrior((0.5, 0.1), 0.7, (0.0, -0.2), 0.3)


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


def normal_equations(
    times: np.ndarray, positions: np.ndarray, sigmas: np.ndarray, order: int, prior: MotionPrior | None
) -> tuple[np.ndarray, np.ndarray]:
    """Coefficients (2 p,) of powers of time, and their covariance: Bayes' rule, written out."""
    powers = np.arange(order + 1)
    information, right = np.zeros((2 * order + 2, 2 * order + 2)), np.zeros(2 * order + 2)
    for time, z, sigma in zip(times, positions, np.broadcast_to(sigmas, (len(times), 2, 2)), strict=True):
        design = np.kron(time**powers, np.eye(2))
        information += design.T @ np.linalg.inv(sigma) @ design
        right += design.T @ np.linalg.inv(sigma) @ z
    if prior is not None:
        last = times.max()
        for row, mean, deviation in (
            (np.array([0.0, 1.0, 2.0 * last]), prior.velocity, prior.velocity_deviation),
            (np.array([0.0, 0.0, 2.0]), prior.acceleration, prior.acceleration_deviation),
        ):
            design = np.kron(row[: order + 1], np.eye(2)) / deviation
            information += design.T @ design
            right += design.T @ (np.array(mean) / deviation)
    return np.linalg.solve(information, right), np.linalg.inv(information)


@pytest.mark.parametrize("prior", [None, MotionPrior(), PRIOR])
@pytest.mark.parametrize("each", [False, True])
@pytest.mark.parametrize("order", [0, 1, 2])
def test_estimate_is_bayes_rule(order: int, each: bool, prior: MotionPrior | None) -> None:
    """With a known covariance, common or for each; a prior that says nothing changes nothing."""
    rng = np.random.default_rng(order)
    times = irregular(rng)
    sigmas = np.array([np.diag(rng.uniform(0.01, 0.2, 2)) + 0.005 for _ in times]) if each else SIGMA
    positions = observe(rng, times)
    expected, spread = normal_equations(times, positions, sigmas, order, None if prior == MotionPrior() else prior)
    seen = estimate_motion(times, positions, sigmas, order, prior)
    for t in (0.0, 1.3, 5.0):
        at = np.kron(t ** np.arange(order + 1), np.eye(2))
        assert seen.position(t) == pytest.approx(at @ expected, rel=1e-8)
        assert seen.covariance(t) == pytest.approx(at @ spread @ at.T, rel=1e-8)
    fit, last = np.vstack([expected.reshape(-1, 2), np.zeros((3, 2))]), times[-1]
    assert seen.velocity == pytest.approx(fit[1] + 2.0 * last * fit[2], rel=1e-8, abs=1e-12)
    assert seen.acceleration == pytest.approx(2.0 * fit[2], rel=1e-8)
    assert seen.noise_covariance == pytest.approx(np.mean(np.broadcast_to(sigmas, (15, 2, 2)), axis=0))
    assert (seen.order, seen.observations, seen.reference_time) == (order, 15, last)
    assert seen.errors == NormalErrors() and seen.degrees_of_freedom is None


@pytest.mark.parametrize("order", [0, 1, 2])
def test_noise_is_estimated_from_the_residuals(order: int) -> None:
    """Without bias, E'E / (n - p); of isotropic noise from both coordinates."""
    rng = np.random.default_rng(order)
    times = irregular(rng)
    positions, design = observe(rng, times) * [1.0, 0.05], times[:, None] ** np.arange(order + 1)
    residuals = positions - design @ np.linalg.lstsq(design, positions, rcond=None)[0]
    sigma, degrees = residuals.T @ residuals / (14 - order), 14 - order
    general, isotropic = (estimate_motion(times, positions, None, order, noise=n) for n in ("general", "isotropic"))
    assert general.noise_covariance == pytest.approx(sigma, rel=1e-9)
    assert (general.errors, general.degrees_of_freedom) == (HotellingErrors(degrees), degrees)
    assert isotropic.noise_covariance == pytest.approx(0.5 * np.trace(sigma) * np.eye(2), rel=1e-9)
    assert (isotropic.errors, isotropic.degrees_of_freedom) == (StudentErrors(2 * degrees), None)
    for seen, noise in ((general, sigma), (isotropic, 0.5 * np.trace(sigma) * np.eye(2))):
        known = estimate_motion(times, positions, noise, order)
        assert seen.position(5.0) == pytest.approx(known.position(5.0), rel=1e-9)
        assert seen.covariance(5.0) == pytest.approx(known.covariance(5.0), rel=1e-9)


@pytest.mark.parametrize("case", ["known", "general", "isotropic", "prior"])
def test_regions_cover_as_promised(case: str) -> None:
    """1,000 obstacles, that are as the prior says where there is one."""
    rng, runs, inside = np.random.default_rng(16), 1000, 0
    times, prior = 0.2 * np.arange(7), MotionPrior((1.0, 0.0), 0.5, (0.0, 0.0), 0.4)
    for _ in range(runs):
        velocity, acceleration = rng.normal([1.0, 0.0], 0.5), rng.normal(0.0, 0.4, 2)
        lags = (times - times[-1])[:, None]
        sigma = 0.01 * np.eye(2) if case == "isotropic" else SIGMA
        positions = lags * velocity + 0.5 * lags**2 * acceleration + rng.multivariate_normal(np.zeros(2), sigma, 7)
        known = sigma if case in ("known", "prior") else None
        noise = "isotropic" if case == "isotropic" else "general"
        seen = estimate_motion(times, positions, known, 2, prior if case == "prior" else None, noise=noise)
        error = seen.position(times[-1] + 3.0) - (3.0 * velocity + 4.5 * acceleration)
        spread = seen.covariance(times[-1] + 3.0)
        inside += bool(error @ np.linalg.solve(spread, error) <= seen.errors.pointwise_scale(0.05))
    assert inside / runs == pytest.approx(0.95, abs=4 * math.sqrt(0.95 * 0.05 / runs))


@pytest.mark.parametrize("covariance", [None, SIGMA])
def test_a_clock_of_a_billion_seconds_and_map_coordinates_lose_nothing(covariance: np.ndarray | None) -> None:
    rng = np.random.default_rng(6)
    times = np.arange(12) / 8.0  # exact on either clock
    positions = np.round(observe(rng, times) * 1024) / 1024  # exact in either frame
    origin = np.array([500_000.0, 5_800_000.0])
    near, far = (
        estimate_motion(times, positions, covariance),
        estimate_motion(1e9 + times, positions + origin, covariance),
    )
    for t in (1.0, 2.0, 9.0):
        assert far.position(1e9 + t) - origin == pytest.approx(near.position(t), abs=4e-9)
        assert far.covariance(1e9 + t) == pytest.approx(near.covariance(t), rel=1e-12)
    assert far.velocity == pytest.approx(near.velocity, rel=1e-12)
    assert far.standardised_length(1e9 + 2, 1e9 + 5) == pytest.approx(near.standardised_length(2, 5), rel=1e-12)
    moved = far.polynomials(1e9 + 2, 1e9 + 5).center - near.polynomials(2, 5).center
    assert moved[0] == pytest.approx(np.vstack([origin, np.zeros((4, 2))]), abs=4e-9)


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


def test_a_prior_stands_in_for_observations() -> None:
    prior = MotionPrior((1.0, 0.0), 0.5, (0.0, 0.0), 0.2)
    seen = estimate_motion([3.0], [[2.0, 1.0]], SIGMA, prior=prior)
    assert seen.position(5.0) == pytest.approx([4.0, 1.0])
    expected = SIGMA + (2.0**2 * 0.5**2 + 2.0**2 * 2.0**2 / 4 * 0.2**2) * np.eye(2)
    assert seen.covariance(5.0) == pytest.approx(expected)
    with pytest.raises(EstimationError, match="do not determine a motion of order 2"):
        estimate_motion([3.0], [[2.0, 1.0]], SIGMA, prior=MotionPrior(velocity_deviation=1.0))


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"velocity_deviation": 0.0}, "prior.velocity_deviation: 0.0 is not a positive number"),
        ({"acceleration_deviation": -1.0}, "prior.acceleration_deviation"),
        ({"velocity": (math.nan, 0.0)}, "prior.velocity: .* is not two finite numbers"),
        ({"acceleration": (1.0,)}, "prior.acceleration"),
    ],
)
def test_a_prior_must_make_sense(given: dict[str, object], message: str) -> None:
    with pytest.raises(EstimationError, match=message):
        MotionPrior(**given)  # type: ignore[arg-type]


def test_two_sensors_at_one_time_are_two_observations() -> None:
    seen = estimate_motion([0, 0, 1, 1], [[0.0, 0.0], [0.2, 0.0], [1.0, 0.0], [1.2, 0.0]], SIGMA, 1)
    assert seen.position(1.0) == pytest.approx([1.1, 0.0])
    assert seen.covariance(1.0) == pytest.approx(SIGMA / 2)


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
        ({"times": [0.0, np.inf, 2.0]}, r"observations.time\[1\]: inf is not finite"),
        ({"positions": [[0, 0], [1, 0], [0, np.nan]]}, r"observations.position\[2\]: \[0.0, nan\] is not finite"),
        (
            {"times": [1.0, 0.0, 1.0, 1.0], "positions": [[2, 3], [2, 3], [0, 0], [2, 3]]},
            r"observations\[3\]: time 1.0 with position \[2.0, 3.0\] is there twice, first as observations\[0\]",
        ),
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


class TestObstacles:
    seen: ClassVar[dict[str, list[Any]]] = {
        "time": [0.0, 0.4, 0.8, 1.2, 1.6, 2.0],
        "position": np.random.default_rng(24).normal(size=(6, 2)).tolist(),
    }

    def obstacle(self, model: dict[str, object], **observations: object) -> Obstacle:
        return Obstacle(id="a", shape={"disc": 0.3}, observations={**self.seen, **observations}, model=model)

    def test_model_and_covariance_are_taken_from_the_scenario(self) -> None:
        prior = {"velocity": [1.0, 0.0], "velocity_deviation": 0.5}
        same = MotionPrior((1.0, 0.0), velocity_deviation=0.5)
        cases: tuple[tuple[dict[str, object], Any, int, MotionPrior | None], ...] = (
            ({"order": 1}, SIGMA, 1, None),
            ({"order": 1}, None, 1, None),
            ({"order": 2, "prior": prior}, SIGMA, 2, same),
        )
        for model, covariance, order, known in cases:
            seen = estimate_obstacle(self.obstacle(model, covariance=covariance))
            alone = estimate_motion(self.seen["time"], self.seen["position"], covariance, order, known)
            assert seen.position(3.0) == pytest.approx(alone.position(3.0))
            assert seen.covariance(3.0) == pytest.approx(alone.covariance(3.0))
            assert type(seen.errors) is type(alone.errors)

    def test_errors_name_the_obstacle(self) -> None:
        moving = Obstacle(id="b", shape={"disc": 0.3}, motion={"position": [0, 0]})
        with pytest.raises(EstimationError, match=r"obstacle 'b': it has no observations"):
            estimate_obstacle(moving)
        still = self.obstacle({"order": 1}, position=[[1.0, 1.0]] * 6)
        with pytest.raises(EstimationError, match=r"obstacle 'a': observations\.position: they lie exactly"):
            estimate_obstacle(still)
