"""Conformal regions: their guarantees, by counting."""

from __future__ import annotations

import math
from itertools import permutations

import numpy as np
import pytest

from scp_planner.arrays import Array
from scp_planner.errors import EstimationError
from scp_planner.tracking.conformal import (
    CONFORMAL,
    AdaptiveScales,
    conformal_quantile,
    region_score,
    square_within,
)
from scp_planner.tracking.motion_fitting import fit_motion_model, prediction_errors
from scp_planner.tracking.tracks import Track, Tracks


@pytest.mark.parametrize("alpha", [0.1, 0.25, 0.5])
def test_next_score_is_inside_as_often_as_promised(alpha: float) -> None:
    """Whichever of 6 exchangeable scores comes last: counted over all their orders."""
    held = [order[-1] <= conformal_quantile(order[:-1], alpha) for order in permutations(range(6))]
    assert 1.0 - alpha <= np.mean(held) <= 1.0 - alpha + 1.0 / 6.0


def test_too_few_scores_make_a_region_of_everything() -> None:
    assert conformal_quantile(np.arange(18), 0.05) == math.inf
    assert conformal_quantile(np.arange(19), 0.05) == 18.0
    assert conformal_quantile([], 0.5) == math.inf
    # of two tracks only, whatever the number of their errors
    assert conformal_quantile(np.arange(1000), 0.05, groups=2) == math.inf


@pytest.mark.parametrize(("scores", "alpha", "what"), [([1.0], 0.0, "alpha"), ([math.nan], 0.1, "scores")])
def test_misuse_is_refused(scores: list[float], alpha: float, what: str) -> None:
    with pytest.raises(EstimationError, match=what):
        conformal_quantile(scores, alpha)
    for level, rate in ((1.5, 0.1), (0.1, 0.0)):
        with pytest.raises(EstimationError):
            AdaptiveScales(level, 1, rate=rate)


@pytest.mark.parametrize("kind", ["calm", "growing", "bursts"])
def test_level_is_kept_in_the_long_run_whatever_comes(kind: str) -> None:
    rng = np.random.default_rng(0)
    steps, alpha = 4000, 0.1
    size = {
        "calm": np.ones(steps),
        "growing": np.exp(np.linspace(0.0, 5.0, steps)),
        "bursts": np.where(np.arange(steps) // 200 % 2, 30.0, 1.0),
    }[kind]
    scales = AdaptiveScales(alpha, 1)
    for square in size * rng.chisquare(2, steps):
        scales.take_in(0, ["a"], [square])
    # the bound of the head of the module; and regions are not much larger than it takes
    bound = (1.0 + scales.rate) / (scales.rate * steps)
    assert 0.5 * alpha < scales.missed[0] / scales.seen[0] <= alpha + bound


def test_calm_track_has_no_smaller_regions_than_others() -> None:
    rng = np.random.default_rng(7)
    scales = AdaptiveScales(0.1, 1)
    for square in rng.chisquare(2, 1000):
        scales.take_in(0, ["calm", "restless"], [0.1 * square, 4.0 * square])
    calm, restless, new = scales.scales(["calm", "restless", "new"])[:, 0].tolist()
    assert calm == pytest.approx(new, rel=0.05) and restless > 1.2 * calm


def test_a_region_of_the_size_of_a_score_has_what_is_seen_on_its_border() -> None:
    """The region and noise together; noise alone, where that is enough."""
    rng = np.random.default_rng(6)
    z, shape = 3.0 * rng.standard_normal((500, 2)), np.tile([1.0, 0.3, 0.8], (500, 1))
    scores = region_score(z, shape, 0.5 * shape, 6.0)
    assert 50 < (scores > 1.0).sum() < 450 and 10 < (scores == 0.0).sum()
    larger = np.maximum(scores - 1.0, 0.0)[:, None] * [1.0, 0.0, 1.0]
    covariance = np.minimum(scores, 1.0)[:, None] * shape + larger + 0.5 * shape
    square = np.einsum("na,nab,nb->n", z, np.linalg.inv(covariance[:, [0, 1, 1, 2]].reshape(-1, 2, 2)), z)
    assert square[scores > 0.0] == pytest.approx(6.0)
    assert (square[scores == 0.0] <= 6.0).all()
    assert square_within(z, covariance) == pytest.approx(square)


def test_new_track_begins_with_what_others_have_taught() -> None:
    scales = AdaptiveScales(0.1, 2)
    assert scales.scales(["new"]).tolist() == [[1.0, 1.0]]
    scales.take_in(1, [f"t{number}" for number in range(100)], np.full(100, 9.0))
    assert scales.scales(["new"]).tolist() == [[1.0, 9.0]]
    scales.forget("t1")
    assert scales.scales(["t1"]).tolist() == [[1.0, 9.0]]


def test_kinds_of_predictions_are_told_apart_once_there_are_enough_errors_of_each() -> None:
    rng = np.random.default_rng(3)
    scales, names = AdaptiveScales(0.1, 1, kinds=2), [f"t{number}" for number in range(50)]
    for _ in range(3):
        scales.take_in(0, names, 4.0 * rng.chisquare(2, 50), np.ones(50, dtype=int))
    calm, restless = (float(scales.scales(["new"], kind)[0, 0]) for kind in (0, 1))
    assert calm == pytest.approx(restless, rel=0.1) and calm > 10.0  # that of the only kind there is
    for _ in range(10):
        scales.take_in(0, names, rng.uniform(0.0, 1.0, 50), np.zeros(50, dtype=int))
        scales.take_in(0, names, 4.0 * rng.chisquare(2, 50), np.ones(50, dtype=int))
    calm, restless = (float(scales.scales(["new"], kind)[0, 0]) for kind in (0, 1))
    assert calm < 1.0 and restless > 10.0


def test_regions_that_are_right_are_left_as_they_are() -> None:
    """Regions of 95 % that are left by 5 % of the errors, but for chance, keep their size."""
    rng, names = np.random.default_rng(8), [f"t{number}" for number in range(40)]
    shape, noise = np.tile([1.0, 0.0, 1.0], (40, 1)), np.tile([4.0, 0.0, 4.0], (40, 1))
    border, found = -2.0 * math.log(0.05), []
    scales = AdaptiveScales(0.05, 1)
    for _ in range(200):
        scores = region_score(math.sqrt(5.0) * rng.standard_normal((40, 2)), shape, noise, border)
        scales.take_in(0, names, scores)
        found.append(scales.scales(["new"])[0, 0])
    assert np.mean(np.array(found[50:]) == 1.0) > 0.8


def test_regions_that_are_too_large_shrink_to_what_they_should_be() -> None:
    """Also where most of what is seen is noise: the least size that holds it has the right quantile."""
    rng, names = np.random.default_rng(9), [f"t{number}" for number in range(40)]
    shape, noise = np.tile([4.0, 0.0, 4.0], (40, 1)), np.tile([4.0, 0.0, 4.0], (40, 1))
    scales = AdaptiveScales(0.05, 1)
    for _ in range(400):
        seen = math.sqrt(5.0) * rng.standard_normal((40, 2))  # 1 of it is the error of the prediction
        scales.take_in(0, names, region_score(seen, shape, noise, -2.0 * math.log(0.05)))
    assert 0.2 < scales.scales(["new"])[0, 0] < 0.4


def walkers(count: int, seed: int) -> Tracks:
    rng = np.random.default_rng(seed)
    times = 0.4 * np.arange(25.0)
    velocity = np.cumsum(0.2 * rng.standard_t(3, (count, 25, 2)), axis=1) + rng.normal(0.0, 1.0, (count, 1, 2))
    places: Array = np.cumsum(0.4 * velocity, axis=1) + 0.03 * rng.standard_normal(velocity.shape)
    return Tracks(tuple(Track(f"w{k}", times, place) for k, place in enumerate(places)), source="made")


def test_fitted_model_is_split_conformal_at_its_level() -> None:
    """Its regions hold as many errors of the half that nothing was fitted to as the quantile says, and of others."""
    tracks, leads = walkers(60, 1), (0.4, 1.2, 2.4)
    model = fit_motion_model(tracks, lead_times=leads, conformal=0.9)
    assert model.tails is not None and model.tails.lead_time == leads
    degrees = model.tails.degrees_of_freedom
    scale = degrees * math.expm1(-2.0 * math.log(0.1) / degrees)
    for which, least, most in ((tracks.halves()[1], 0.9, 0.96), (walkers(60, 2), 0.86, 0.97)):
        for errors, inflation in zip(
            prediction_errors(which, model, lead_times=leads), model.tails.inflation, strict=True
        ):
            assert least <= np.mean(errors.squares <= scale * inflation) <= most


def test_regions_do_not_vanish_where_noise_explains_all_that_is_seen() -> None:
    scales = AdaptiveScales(0.05, 1)
    for _ in range(300):
        scales.take_in(0, ["one", "two"], [0.0, 0.0])
    assert np.array_equal(scales.scales(["one", "two", "new"]), np.full((3, 1), CONFORMAL.least))


@pytest.mark.parametrize(("largest", "most"), [(1 + 1e-6, 1.0), (3.0, 5.0), (1.0, 1.0), (0.8, 1.0), (0.3, 0.6)])
def test_a_region_beyond_all_errors_is_larger_by_what_they_were(largest: float, most: float) -> None:
    """Above 1 a size is what is added to variances: for errors of a micrometre that is not a metre."""
    scales, base = AdaptiveScales(0.05, 1), 1.0 if largest > 1.0 else 0.0
    for _ in range(300):
        scales.take_in(0, ["other"], [0.1])
    for share in np.linspace(0.5, 1.0, 20):  # a row of misses, until its level is below nothing
        scales.take_in(0, ["wall"], [base + (largest - base) * share])
    size = scales.scales(["wall"])[0, 0]  # beyond the largest but for a few of the newest
    assert base + 1.2 * (largest - base) < size <= most + 1e-12 or size == most
