"""The bank of filters against dense Kalman filters, and its levels against motions that follow no member."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from scp_planner.arrays import Array, Index
from scp_planner.tracking.bank import BANK, WALKS, FilterBank, TrackPrior
from scp_planner.tracking.levels import TrackLevels

PRIOR = TrackPrior(diffusion=0.1, degrees=5.0, velocity_deviation=1.0, acceleration=1.0)


def dense_walk(
    diffusion: float, velocity_variance: float, times: Array, positions: Array, noise: float
) -> tuple[Array, Array, Array]:
    """Filter one coordinate with matrices; return state, covariance and the density of each innovation."""
    mean, covariance, densities = np.array([positions[0], 0.0]), np.diag([noise, velocity_variance]), []
    for lag, position in zip(np.diff(times), positions[1:], strict=True):
        f = np.array([[1.0, lag], [0.0, 1.0]])
        q = diffusion * np.array([[lag**3 / 3.0, lag**2 / 2.0], [lag**2 / 2.0, lag]])
        mean, covariance = f @ mean, f @ covariance @ f.T + q
        variance = covariance[0, 0] + noise
        densities.append(multivariate_normal.pdf(position, mean[0], variance))
        gain = covariance[:, 0] / variance
        mean, covariance = mean + gain * (position - mean[0]), covariance - np.outer(gain, covariance[0])
    return mean, covariance, np.array(densities)


def test_members_and_weights_are_those_of_dense_filters_without_changes() -> None:
    rng = np.random.default_rng(1)
    times = np.array([0.0, 0.3, 0.35, 1.0])
    positions, noise = rng.normal(0.0, 0.3, (2, 4)), np.array([0.01, 0.04])
    bank, slots = FilterBank(1.5, 0.5, hazard=0.0), np.array([0])
    bank.grow(1)
    bank.begin(slots, times[:1], positions[:, :1], noise[:, None], [PRIOR])
    for k in range(1, 4):
        bank.update(slots, times[k : k + 1], positions[:, k : k + 1], noise[:, None])
        if k == 1:  # later, who stood may have set out
            weights = bank.weights(slots)[:WALKS, 0]
    likelihood = np.ones(WALKS)
    for k, ratio in enumerate(BANK.diffusions):
        for axis in range(2):
            mean, covariance, densities = dense_walk(PRIOR.diffusion * ratio, 1.0, times, positions[axis], noise[axis])
            likelihood[k] *= densities[0]
            assert bank.walks.mean[:, axis, k, 0] == pytest.approx(mean, rel=1e-9)
            assert bank.walks.spread[:, :, axis, k, 0] == pytest.approx(covariance, rel=1e-8)
    expected = likelihood * PRIOR.weights[:WALKS]
    assert weights / weights.sum() == pytest.approx(expected / expected.sum(), rel=1e-8)


def test_tail_is_the_share_of_samples_that_are_farther_off() -> None:
    rng = np.random.default_rng(2)
    bank, slots = watched(np.zeros((2, 12)) + 0.5 * np.arange(12) + rng.normal(0.0, 0.05, (2, 12)), 0.05)
    mixture = bank.predicted(slots, np.array([1.0]))
    which = rng.choice(len(mixture.weight), 200_000, p=mixture.weight[:, 0] / mixture.weight.sum())
    samples = rng.normal(size=(2, len(which))) * np.sqrt(mixture.variance[:, which, 0])
    (radius, _) = mixture.radii(np.array([0.1]))[:, 0]
    assert np.mean(np.hypot(*samples) > radius) == pytest.approx(0.1, abs=0.003)
    assert mixture.tail(np.array([[radius], [0.0]]))[0] == pytest.approx(0.1, rel=1e-4)


def watched(positions: Array, noise: float, step: float = 0.1) -> tuple[FilterBank, Index]:
    """Let a bank watch one track, positions (2, T) m."""
    bank, slots, variance = FilterBank(1.5, 0.5), np.array([0]), np.full((2, 1), noise**2)
    bank.grow(1)
    bank.begin(slots, np.zeros(1), positions[:, :1], variance, [PRIOR])
    for k in range(1, positions.shape[1]):
        bank.update(slots, np.array([k * step]), positions[:, k : k + 1], variance)
    return bank, slots


@pytest.mark.parametrize("noise", [1e-6, 0.01, 0.04])
def test_standing_is_learnt_within_half_a_second_and_left_at_once(noise: float) -> None:
    rng = np.random.default_rng(3)
    still = rng.normal(0.0, noise, (2, 6))
    bank, slots = watched(still, noise)
    assert bank.stands(slots).all()
    away = np.concatenate([still, np.cumsum(np.full((2, 5), 0.1), axis=1)], axis=1)
    assert not watched(away, noise)[0].stands(slots).any()


def test_who_has_stood_for_longer_sets_out_later() -> None:
    radii = [
        watched(np.zeros((2, count)), 0.02)[0].predicted(np.array([0]), np.ones(1)).radii(np.array([0.01]))[0, 0]
        for count in (10, 100, 2000)
    ]
    assert radii[0] > radii[1] > radii[2]
    assert radii[2] < 0.1


@pytest.mark.parametrize("diffusion", [1e-3, 0.3])
def test_levels_hold_whole_tubes_of_walks_of_any_diffusion(diffusion: float) -> None:
    rng = np.random.default_rng(4)
    tracks, count, step, noise = 12, 400, 0.1, 0.04
    kicks = rng.normal(0.0, np.sqrt(diffusion * step), (count, 2, tracks))
    velocity = rng.normal(0.0, 1.0, (2, tracks)) + np.cumsum(kicks, axis=0)
    truth = np.cumsum(velocity * step, axis=0)
    seen = truth + rng.normal(0.0, noise, truth.shape)
    bank, slots = FilterBank(1.5, 0.5), np.arange(tracks)
    levels, variance = TrackLevels(bank, 0.75), np.full((2, tracks), noise**2)
    bank.grow(tracks)
    levels.grow(tracks)
    bank.begin(slots, np.zeros(tracks), seen[0], variance, [PRIOR] * tracks)
    held = []
    for k in range(1, count - 20):
        time = np.full(tracks, k * step)
        levels.compare(slots, time, seen[k], variance)
        bank.update(slots, time, seen[k], variance)
        levels.keep(slots, time)
        if k > 100 and k % 4 == 0:
            inside = np.ones(tracks, dtype=bool)
            for ahead in (5, 10, 15, 20):
                mixture = bank.predicted(slots, np.full(tracks, ahead * step))
                alpha = levels.alphas(slots, np.full(tracks, 0.1))
                inside &= mixture.tail(truth[k + ahead] - mixture.center) >= alpha
            held.append(inside)
    assert 0.85 <= np.mean(held) <= 0.97
