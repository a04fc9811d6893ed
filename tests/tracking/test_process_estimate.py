from __future__ import annotations

import math
from collections.abc import Callable
from functools import cache
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.stats import multivariate_normal

from scp_planner.errors import EstimationError
from scp_planner.scenario.models import Obstacle
from scp_planner.scenario.process_model import ProcessModel, Tails
from scp_planner.tracking.confidence import NormalErrors, StudentErrors
from scp_planner.tracking.dynamics import Dynamics, MeanReverting, RandomWalk, Singer, WhiteJerk, dynamics_of
from scp_planner.tracking.estimate import estimate_obstacle, estimate_obstacles
from scp_planner.tracking.kalman import estimate_process, estimate_processes
from scp_planner.tracking.maximum_likelihood import check_observations
from scp_planner.tracking.motion_estimate import region_scale
from scp_planner.tracking.motion_fitting import log_likelihood
from scp_planner.tracking.process_estimate import PIECES, ProcessEstimate
from scp_planner.tracking.tracks import Track, Tracks

pytestmark = pytest.mark.numerics

TAILS = Tails(degrees_of_freedom=4.0, lead_time=(0.4, 1.2, 2.4, 4.8), inflation=(0.8, 0.6, 0.5, 0.4))
KINDS = {
    "random_walk": {"diffusion": 0.2},
    "mean_reverting": {"diffusion": 0.2, "time_constant": 1.5},
    "singer": {"deviation": 0.6, "time_constant": 0.8},
    "random_walk_acceleration": {"diffusion": 0.2, "acceleration_deviation": 0.4},
}
KIND = pytest.mark.parametrize("kind", list(KINDS))
NODES, WEIGHTS = np.polynomial.legendre.leggauss(24)


def model(kind: str = "random_walk", tails: Tails | None = None) -> ProcessModel:
    process = {"kind": kind, **KINDS[kind]}
    return ProcessModel(process=process, velocity_deviation=1.3, noise_deviation=0.1, tails=tails)


@cache
def kernel(kind: str) -> Callable[[float, float], float]:
    """Covariance of one position component at two times after the first observation, from its start.

    Integrals of the covariance of the velocity or of the acceleration, by quadrature: nothing from the package.
    """
    q, tau = KINDS[kind].get("diffusion", 0.0), KINDS[kind].get("time_constant", 1.0)
    weight: Callable[[float, Any], Any]
    between: Callable[[Any], Any] | None
    if kind == "random_walk":
        weight, between = (lambda t, a: t - a), None
    elif kind == "mean_reverting":
        weight, between = (lambda t, a: np.ones_like(a)), (lambda d: 0.5 * q * tau * np.exp(-d / tau))
    elif kind == "random_walk_acceleration":
        weight, between = (lambda t, a: 0.5 * (t - a) ** 2), None
    else:
        weight, between = (lambda t, a: t - a), (lambda d: KINDS[kind]["deviation"] ** 2 * np.exp(-d / tau))

    def interval(low: float, high: float) -> tuple[np.ndarray, np.ndarray]:
        half = 0.5 * (high - low)
        return low + half * (1 + NODES), half * WEIGHTS

    @cache
    def covariance(t: float, s: float) -> float:
        total = 1.3**2 * t * s + (0.5 * KINDS[kind].get("acceleration_deviation", 0.0) * t * s) ** 2
        a, wa = interval(0.0, t)
        if between is None:  # white noise: only equal times
            a, wa = interval(0.0, min(t, s))
            return total + q * float(np.sum(wa * weight(t, a) * weight(s, a)))
        for ai, wi in zip(a, wa, strict=True):
            for low, high in ((0.0, min(ai, s)), (min(ai, s), s)):  # smooth on either side of equal times
                b, wb = interval(low, high)
                total += wi * float(weight(t, ai) * np.sum(wb * weight(s, b) * between(np.abs(ai - b))))
        return total

    # for s < t the kink lies beyond s for some a: integrate the shorter time outside
    return lambda t, s: covariance(min(t, s), max(t, s))


def regression(kind: str, times: np.ndarray, z: np.ndarray, at: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Predict by Gaussian-process regression with an unknown first position: means (m, 2), variances (m,)."""
    k, lags, ahead = kernel(kind), times - times[0], at - times[0]
    known = np.array([[k(t, s) for s in lags] for t in lags]) + 0.1**2 * np.eye(len(lags))
    cross = np.array([[k(t, s) for s in lags] for t in ahead])
    inverse = np.linalg.inv(known)
    ones = np.ones(len(lags))
    constant = 1.0 / (ones @ inverse @ ones)
    first = constant * ones @ inverse @ z
    mean = first + cross @ inverse @ (z - first)
    left = 1.0 - cross @ inverse @ ones
    own = np.array([k(t, t) for t in ahead])
    return mean, own - np.einsum("mi,ij,mj->m", cross, inverse, cross) + constant * left**2


def walk(rng: np.random.Generator, dynamics: Dynamics, times: np.ndarray, runs: int) -> np.ndarray:
    """Simulate true positions of one component: (runs, n), beginning at 0."""
    state = rng.multivariate_normal(np.zeros(dynamics.states), dynamics.prior(1.3**2), runs)
    positions = [state[:, 0]]
    for lag in np.diff(times):
        noise = rng.multivariate_normal(np.zeros(dynamics.states), dynamics.noise(lag), runs)
        state = state @ dynamics.transition(lag).T + noise
        positions.append(state[:, 0])
    return np.array(positions).T


@pytest.mark.parametrize("lag", [1e-3, 0.1, 0.7, 0.9, 1.1, 4.0])
@pytest.mark.parametrize("tau", [0.8, 1.0, 30.0])
def test_dynamics_are_those_of_their_differential_equations(lag: float, tau: float) -> None:
    """Transition and noise from one matrix exponential (Van Loan), which loses digits only for short lags."""
    cases: list[tuple[Dynamics, list[list[float]], list[float]]] = [
        (RandomWalk(0.3), [[0, 1], [0, 0]], [0, 0.3]),
        (MeanReverting(0.3, tau), [[0, 1, 0], [0, -1 / tau, 1 / tau], [0, 0, 0]], [0, 0.3, 0]),
        (WhiteJerk(0.3, 0.5), [[0, 1, 0], [0, 0, 1], [0, 0, 0]], [0, 0, 0.3]),
        (Singer(0.7, tau), [[0, 1, 0], [0, 0, 1], [0, 0, -1 / tau]], [0, 0, 2 * 0.7**2 / tau]),
    ]
    for dynamics, drift, noise in cases:
        d = dynamics.states
        block = np.zeros((2 * d, 2 * d))
        block[:d, :d], block[:d, d:], block[d:, d:] = -np.array(drift), np.diag(noise), np.array(drift).T
        exponential = expm(block * lag)
        transition = exponential[d:, d:].T
        assert dynamics.transition(np.array(lag)) == pytest.approx(transition, rel=1e-11, abs=1e-14)
        expected = transition @ exponential[:d, d:]
        assert dynamics.noise(np.array(lag)) == pytest.approx(expected, rel=1e-7, abs=5e-15 * np.abs(expected).max())


@KIND
def test_estimate_is_gaussian_process_regression(kind: str) -> None:
    rng = np.random.default_rng(1)
    times = 100.0 + np.sort(rng.uniform(0, 3, 6))
    z = rng.normal(size=(6, 2))
    seen = estimate_process(times, z, model(kind))
    at = times[-1] + np.array([0.0, 0.3, 2.0, 6.0])
    mean, variance = regression(kind, times, z, at)
    assert seen.position(at) == pytest.approx(mean, rel=1e-7, abs=1e-8)
    assert seen.covariance(at) == pytest.approx(variance[:, None, None] * np.eye(2), rel=1e-6)
    # velocity and acceleration are what the prediction does at first
    step = 1e-4
    assert seen.velocity == pytest.approx((seen.position(times[-1] + step) - seen.position(times[-1])) / step, abs=1e-3)
    bend = seen.position(times[-1] + np.array([0.0, 0.01, 0.02]))
    assert seen.acceleration == pytest.approx((bend[2] - 2 * bend[1] + bend[0]) / 1e-4, abs=0.05)


@KIND
def test_likelihood_is_that_of_the_differences(kind: str) -> None:
    """Given the first position: the joint normal density of all others, of tracks of any length."""
    rng, k, tracks, expected = np.random.default_rng(2), kernel(kind), [], 0.0
    for number, count in enumerate((6, 1, 3)):
        times, z = np.sort(rng.uniform(0, 3, count)), rng.normal(size=(count, 2))
        tracks.append(Track(str(number), times, z))
        lags = times[1:] - times[0]
        if count > 1:
            joint = np.array([[k(t, s) for s in lags] for t in lags]) + 0.1**2 * (np.eye(count - 1) + 1.0)
            normal = multivariate_normal(np.zeros(count - 1), joint)
            expected += sum(float(normal.logpdf(z[1:, a] - z[0, a])) for a in range(2))
    assert log_likelihood(Tracks(tracks), model(kind)) == pytest.approx(expected, rel=1e-7)


@KIND
def test_obstacles_are_estimated_together_as_each_alone(kind: str) -> None:
    """Seen equally often or not, at equal times or not, by sensors of their own."""
    rng, obstacles = np.random.default_rng(3), []
    for name, times in (("a", [0.0, 0.4, 1.2]), ("b", [1.2]), ("c", [0.1, 0.2, 0.3, 0.9, 1.0]), ("d", [0.0, 0.7, 1.2])):
        noise = [(0.02 * (1 + k) * np.eye(2)).tolist() for k in range(len(times))] if name in "cd" else None
        seen = {"time": times, "position": rng.normal(size=(len(times), 2)).tolist(), "covariance": noise}
        obstacles.append(
            Obstacle(id=name, shape={"disc": 0.3}, observations=seen, model={"process": model(kind, TAILS)})
        )
    for one, together in zip(obstacles, estimate_obstacles(obstacles), strict=True):
        alone, at = estimate_obstacle(one), together.reference_time + np.array([0.0, 0.5, 4.0])
        np.testing.assert_allclose(together.position(at), alone.position(at), rtol=1e-12)
        np.testing.assert_allclose(together.covariance(at), alone.covariance(at), rtol=1e-12)
        assert together.standardised_length(1.3, 9.0) == pytest.approx(alone.standardised_length(1.3, 9.0), rel=1e-12)
        ours, own = together.polynomials(1.3, 9.0), alone.polynomials(1.3, 9.0)
        np.testing.assert_allclose(ours.breakpoints, own.breakpoints)
        np.testing.assert_allclose(ours.center, own.center, rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(ours.covariance, own.covariance, rtol=1e-9, atol=1e-9)
        assert (together.observations, together.reference_time) == (alone.observations, max(one.observations.time))  # type: ignore[union-attr]


def test_noise_of_each_observation_is_used_with_its_shape() -> None:
    """A sensor that sees x well and y badly: each component by itself is a one-dimensional problem."""
    rng = np.random.default_rng(3)
    times, z = np.arange(5) * 0.4, rng.normal(size=(5, 2))
    both = estimate_process(times, z, model(), np.diag([0.05**2, 0.5**2]))
    for axis, deviation in ((0, 0.05), (1, 0.5)):
        single = estimate_process(times, z, model(), deviation**2 * np.eye(2))
        assert both.position(4.0)[axis] == pytest.approx(single.position(4.0)[axis], rel=1e-9)
        assert both.covariance(4.0)[axis, axis] == pytest.approx(single.covariance(4.0)[axis, axis], rel=1e-9)
    turn = np.array([[0.8, -0.6], [0.6, 0.8]])
    each = np.broadcast_to(turn @ np.diag([0.05**2, 0.5**2]) @ turn.T, (5, 2, 2))
    turned = estimate_process(times, z @ turn.T, model(), each)
    assert turned.covariance(4.0) == pytest.approx(turn @ both.covariance(4.0) @ turn.T, rel=1e-9)
    assert turned.noise_covariance == pytest.approx(each[0])


@KIND
@pytest.mark.parametrize("tails", [None, TAILS])
def test_polynomials_are_near_and_on_the_safe_side(kind: str, tails: Tails | None) -> None:
    rng = np.random.default_rng(4)
    times = 1e9 + np.arange(8) * 0.5
    seen = estimate_process(times, rng.normal(size=(8, 2)), model(kind, tails), [[0.02, 0.01], [0.01, 0.05]])
    start, stop = times[-1] + 0.25, times[-1] + 9.25
    pieces = seen.polynomials(start, stop)
    assert (pieces.breakpoints[0], pieces.breakpoints[-1]) == (start, stop)
    assert np.all(np.diff(pieces.breakpoints) > 0)
    assert pieces.center_error <= PIECES.center_tolerance
    exact = kind.startswith("random_walk")
    if exact:
        assert pieces.center_error == 0.0
        assert len(pieces.center) == (1 if tails is None else 5)  # kinks of the inflation
    rounding = 1e-7  # of a clock of 1e9 s
    ends = []
    for i, center in enumerate(pieces.center):
        t = np.linspace(pieces.breakpoints[i], pieces.breakpoints[i + 1], 37)
        powers = (t - pieces.breakpoints[i])[:, None] ** np.arange(7)
        rows, columns = powers[:, : len(pieces.covariance[i])], powers[:, : len(center)]
        true = seen.covariance(t)
        assert np.abs(columns @ center - seen.position(t)).max() <= pieces.center_error + 10 * rounding
        xx, xy, yy = (rows @ pieces.covariance[i]).T
        given = np.stack([xx, xy, xy, yy], axis=-1).reshape(-1, 2, 2)
        relative = np.linalg.eigvals(np.linalg.solve(true, given)).real
        assert relative.min() >= 1 - 100 * rounding
        assert relative.max() <= 1 + (0.0 if exact else 2 * PIECES.covariance_tolerance) + 100 * rounding
        ends.append((columns @ center)[[0, -1]])
    for before, after in pairwise(ends):
        assert before[1] == pytest.approx(after[0], abs=1e-6)  # no jumps


@KIND
def test_tails_inflate_the_covariance(kind: str) -> None:
    times, z = np.arange(5) * 0.4, np.random.default_rng(5).normal(size=(5, 2))
    normal, heavy = (estimate_process(times, z, model(kind, tails)) for tails in (None, TAILS))
    assert isinstance(normal.errors, NormalErrors)
    assert heavy.errors == StudentErrors(4.0)
    for lead, inflation in ((0.0, 0.8), (0.4, 0.8), (0.8, 0.7), (2.4, 0.5), (3.6, 0.45), (20.0, 0.4)):
        t = 1.6 + lead
        assert heavy.covariance(t) == pytest.approx(inflation * normal.covariance(t), rel=1e-12)
        assert heavy.position(t) == pytest.approx(normal.position(t))
    # a factor that depends on time alone does not move the standardised error
    assert heavy.standardised_length(1.6, 9.0) == pytest.approx(normal.standardised_length(1.6, 9.0))


@KIND
def test_length_is_that_of_the_standardised_error(kind: str) -> None:
    """The error of an isotropic prediction: sqrt(1 - correlation^2) of errors a little time apart is its speed."""
    times = np.arange(6) * 0.4
    seen = estimate_process(times, np.zeros((6, 2)), model(kind))
    k, last = kernel(kind), times[-1]
    known = np.array([[k(t, s) for s in times] for t in times]) + 0.1**2 * np.eye(6)
    inverse, ones = np.linalg.inv(known), np.ones(6)
    constant = 1.0 / (ones @ inverse @ ones)

    def chords(count: int) -> float:
        grid = last + np.linspace(0.0, 4.0, count + 1)
        cross = np.array([[k(t, s) for s in times] for t in grid])
        left = 1.0 - cross @ inverse @ ones
        total = 0.0
        for i in range(count):
            pair = [i, i + 1]
            own = np.array([[k(grid[a], grid[b]) for b in pair] for a in pair])
            c = own - cross[pair] @ inverse @ cross[pair].T + constant * np.outer(left[pair], left[pair])
            total += math.acos(min(1.0, c[0, 1] / math.sqrt(c[0, 0] * c[1, 1])))
        return total

    # white noise on the velocity roughens the curve, in the first order of the step
    assert seen.standardised_length(last, last + 4.0) == pytest.approx(2 * chords(80) - chords(40), rel=2e-3)


@KIND
@pytest.mark.parametrize("tails", [None, TAILS])
def test_regions_cover_motions_that_follow_the_model(kind: str, tails: Tails | None) -> None:
    """2,000 simulated obstacles: at one time exactly, at all times at least, and hardly more."""
    rng = np.random.default_rng(6)
    runs, seen = 2000, np.arange(6) * 0.4
    ahead = seen[-1] + np.linspace(0.0, 6.0, 61)[1:]
    used, times = model(kind, tails), np.concatenate([seen, ahead])
    dynamics = dynamics_of(used)
    truth = np.stack([walk(rng, dynamics, times, runs) for _ in range(2)], axis=-1)
    noise = 0.1 * rng.normal(size=(runs, 6, 2))
    if tails is not None:  # one heavy-tailed factor on all that is random, and the inflation on the errors below
        factor = np.sqrt(4.0 / rng.chisquare(4.0, runs))[:, None, None]
        truth, noise = truth * factor, noise * factor
    records = [check_observations(seen, each) for each in truth[:, :6] + noise]
    estimates = estimate_processes(used, records)
    errors = truth[:, 6:] - np.array([each.position(ahead) for each in estimates])
    estimate = estimates[0]
    variance = estimate.covariance(ahead)[:, 0, 0]  # the same for all, as they were seen at the same times
    if tails is not None:
        errors *= np.sqrt(np.interp(ahead - seen[-1], tails.lead_time, tails.inflation))[:, None]
    squares = (errors**2).sum(axis=-1) / variance
    deviation = math.sqrt(0.95 * 0.05 / runs)
    at_once = region_scale("per_time", 0.95, estimate)
    for i in (4, 20, 59):
        assert np.mean(squares[:, i] <= at_once) == pytest.approx(0.95, abs=4 * deviation)
    always = region_scale("per_obstacle", 0.95, estimate, start=ahead[0], stop=ahead[-1])
    assert 0.95 - 4 * deviation < np.mean(squares.max(axis=1) <= always) < 0.975


def single() -> ProcessEstimate:
    return estimate_process([0.0, 0.4], [[0.0, 0.0], [0.5, 0.0]], model())


def test_one_observation_is_enough() -> None:
    seen = estimate_process([1.0], [[2.0, 3.0]], model())
    assert seen.position(4.0) == pytest.approx([2.0, 3.0])
    assert seen.covariance(1.0) == pytest.approx(0.01 * np.eye(2))
    # noise, a velocity of 1.3 m/s that nobody has seen, and what it does until then
    assert seen.covariance(4.0) == pytest.approx((0.01 + (1.3 * 3) ** 2 + 0.2 * 27 / 3) * np.eye(2))


@pytest.mark.parametrize("lag", [1e3, 1e6, 1e9])
@pytest.mark.parametrize("kind", list(KINDS))
def test_after_a_long_time_nothing_but_the_noise_of_the_last_observation_is_left(kind: str, lag: float) -> None:
    seen = estimate_process([0.0, lag], [[0.0, 0.0], [2.0, 3.0]], model(kind))
    # the variance predicted is so large that 1 / R + 1 / P = 1 / R up to a hundredth
    assert seen.covariance(lag) == pytest.approx(0.01 * np.eye(2), rel=0.01)
    assert seen.position(lag) == pytest.approx([2.0, 3.0], abs=1e-2)
    assert np.isfinite(seen.standardised_length(lag, lag + 10.0))
    assert np.isfinite(seen.covariance(lag + 10.0)).all()


def test_the_past_and_the_far_future_are_not_for_it() -> None:
    with pytest.raises(EstimationError, match=r"time: 0.1 s before the last observation"):
        single().position(0.3)
    with pytest.raises(EstimationError, match="stop inf must be finite"):
        single().standardised_length(0.4, math.inf)
    with pytest.raises(EstimationError, match="start 2 is after its stop 1"):
        single().standardised_length(2, 1)
    with pytest.raises(EstimationError, match="span of time"):
        single().polynomials(2, 1)
    with pytest.raises(EstimationError, match="there are none"):
        estimate_process([], np.zeros((0, 2)), model())
