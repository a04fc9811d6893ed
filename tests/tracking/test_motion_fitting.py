from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from scp_planner.arrays import Array
from scp_planner.errors import EstimationError
from scp_planner.scenario.process_model import MeanRevertingVelocity, ProcessModel
from scp_planner.tracking.confidence import StudentErrors
from scp_planner.tracking.dynamics import dynamics_of
from scp_planner.tracking.kalman import estimate_process
from scp_planner.tracking.motion_fitting import (
    PredictionErrors,
    bounds_met,
    fit_motion_model,
    fit_tails,
    log_likelihood,
    prediction_errors,
    stretches_of,
)
from scp_planner.tracking.tracks import Track, Tracks

KINDS = {
    "random_walk": {"diffusion": 0.05},
    "mean_reverting": {"diffusion": 0.2, "time_constant": 1.5},
    "singer": {"deviation": 0.8, "time_constant": 0.8},
}


def model(kind: str = "random_walk") -> ProcessModel:
    return ProcessModel(process={"kind": kind, **KINDS[kind]}, velocity_deviation=1.2, noise_deviation=0.05)


def simulated(kind: str, tracks: int, count: int, seed: int = 0) -> Tracks:
    """Tracks that follow a model, observed with its noise."""
    rng, dynamics = np.random.default_rng(seed), dynamics_of(model(kind))
    times = 0.4 * np.arange(float(count))
    state = rng.multivariate_normal(np.zeros(dynamics.states), dynamics.prior(1.2**2), (tracks, 2))
    positions = [state[..., 0]]
    for lag in np.diff(times):
        noise = rng.multivariate_normal(np.zeros(dynamics.states), dynamics.noise(lag), (tracks, 2))
        state = state @ dynamics.transition(lag).T + noise
        positions.append(state[..., 0])
    seen: Array = np.array(positions).transpose(1, 0, 2) + 0.05 * rng.normal(size=(tracks, count, 2))
    return Tracks([Track(str(i), times, z) for i, z in enumerate(seen)])


@pytest.mark.parametrize(
    "kind", [pytest.param(kind, marks=pytest.mark.slow) if kind == "singer" else kind for kind in KINDS]
)
def test_parameters_come_back(kind: str) -> None:
    fitted = fit_motion_model(simulated(kind, 200, 20), kind, tails=False)
    assert fitted.process.kind == kind
    assert fitted.noise_deviation == pytest.approx(0.05, rel=0.1)
    assert fitted.velocity_deviation == pytest.approx(1.2, rel=0.15)
    for name, value in KINDS[kind].items():
        assert getattr(fitted.process, name) == pytest.approx(value, rel=0.15), name
    assert fitted.fitted_to is not None
    assert (fitted.fitted_to.tracks, fitted.fitted_to.observations) == (200, 4000)


@pytest.mark.parametrize(("length", "time"), [(1e-4, 1e-3), (1e4, 3e3)])
@pytest.mark.parametrize("count", [12, 19])
def test_tracks_of_all_sizes_are_fitted_like_those_of_people(count: int, length: float, time: float) -> None:
    """Among the maxima of the likelihood, too: there is one of velocities that never revert."""
    people = simulated("mean_reverting", 20, count)
    others = Tracks([Track(track.id, time * track.times, length * track.positions) for track in people])
    one, other = (fit_motion_model(tracks, "mean_reverting", tails=False) for tracks in (people, others))
    assert bounds_met(others, other) == []
    assert isinstance(one.process, MeanRevertingVelocity) and isinstance(other.process, MeanRevertingVelocity)
    assert other.process.time_constant == pytest.approx(time * one.process.time_constant, rel=0.02)
    assert other.process.diffusion == pytest.approx(length**2 / time**3 * one.process.diffusion, rel=0.02)
    assert other.velocity_deviation == pytest.approx(length / time * one.velocity_deviation, rel=0.02)
    assert other.noise_deviation == pytest.approx(length * one.noise_deviation, rel=0.02)


def test_no_parameters_near_are_more_likely() -> None:
    tracks = simulated("mean_reverting", 40, 15)
    fitted = fit_motion_model(tracks, "mean_reverting", tails=False)
    best = log_likelihood(tracks, fitted)
    for factor in (0.97, 1.03):
        for name in KINDS["mean_reverting"]:
            process = fitted.process.model_copy(update={name: factor * getattr(fitted.process, name)})
            assert log_likelihood(tracks, fitted.model_copy(update={"process": process})) < best
        for name in ("velocity_deviation", "noise_deviation"):
            assert log_likelihood(tracks, fitted.model_copy(update={name: factor * getattr(fitted, name)})) < best


def test_long_tracks_are_cut_without_loss_of_rows() -> None:
    """One of 100 positions counts as three pieces, each given its first."""
    track = simulated("random_walk", 1, 100)[0]
    pieces = [
        Track(str(i), track.times[p], track.positions[p]) for i, p in enumerate(np.array_split(np.arange(100), 3))
    ]
    assert log_likelihood(Tracks([track]), model()) == pytest.approx(log_likelihood(Tracks(pieces), model()))


def test_prediction_errors_are_those_of_the_estimates() -> None:
    tracks = simulated("singer", 3, 12)
    used = model("singer")
    for errors in prediction_errors(tracks, used, window=5, lead_times=(0.4, 2.0)):
        steps = round(errors.lead_time / 0.4)
        place = 0
        for number, track in enumerate(tracks):
            for last in range(4, 12 - steps):
                seen = estimate_process(track.times[last - 4 : last + 1], track.positions[last - 4 : last + 1], used)
                offset = track.positions[last + steps] - seen.position(track.times[last + steps])
                covariance = seen.covariance(track.times[last + steps])
                assert errors.squares[place] == pytest.approx(offset @ np.linalg.solve(covariance, offset), rel=1e-9)
                assert errors.deviations[place] == pytest.approx(math.sqrt(covariance[0, 0]), rel=1e-9)
                assert errors.tracks[place] == number
                place += 1
        assert place == len(errors.squares)


def test_targets_are_the_positions_nearest_to_the_lead_times() -> None:
    """With a gap in the track: what is not there is not predicted."""
    times = np.array([0.0, 0.4, 0.8, 1.2, 2.0, 2.45])
    tracks = Tracks([Track("a", times, np.stack([times, times], axis=1))])
    stretches, (short, long) = stretches_of(tracks, 2, (0.4, 1.2))
    assert stretches.times.tolist() == [[0.0, 0.4], [0.4, 0.8], [0.8, 1.2], [1.2, 2.0]]
    assert short.stretches.tolist() == [0, 1, 3]  # 2.45 s is near enough to 2.4 s; nothing is near 1.6 s
    assert short.times.tolist() == [0.8, 1.2, 2.45]
    assert long.stretches.tolist() == [1, 2]
    assert long.times.tolist() == [2.0, 2.45]


def student_errors(
    degrees: float, inflations: list[float], tracks: int, each: int, seed: int = 3
) -> list[PredictionErrors]:
    rng = np.random.default_rng(seed)
    owners = np.repeat(np.arange(tracks), each)
    found = []
    for i, inflation in enumerate(inflations):
        squares = inflation * rng.chisquare(2, len(owners)) * degrees / rng.chisquare(degrees, len(owners))
        ones = np.ones(len(owners))
        found.append(PredictionErrors(0.4 * (i + 1), squares, ones, owners, np.arange(len(owners))))
    return found


def test_tails_come_back() -> None:
    tails = fit_tails(student_errors(5.0, [1.5, 0.7, 0.3], tracks=300, each=40))
    assert tails.lead_time == pytest.approx((0.4, 0.8, 1.2))
    assert tails.inflation == pytest.approx((1.5, 0.7, 0.3), rel=0.08)
    assert tails.degrees_of_freedom == pytest.approx(5.0, rel=0.15)


def test_fitted_tails_cover_the_next_errors() -> None:
    """Averaged over 20 small samples."""
    levels = (0.9, 0.95, 0.99)
    inside = []
    for seed in range(20):
        tails = fit_tails(student_errors(4.0, [1.0], tracks=40, each=4, seed=seed))
        law = StudentErrors(tails.degrees_of_freedom)
        limits = [tails.inflation[0] * law.pointwise_scale(1 - level) for level in levels]
        inside.append([1 - StudentErrors(4.0).exceedance(limit) for limit in limits])
    assert np.mean(inside, axis=0) == pytest.approx(levels, abs=0.015)


def test_few_tracks_widen_the_tails() -> None:
    """600 errors: ten each from 60 tracks that differ as wholes, or each on its own."""
    for seed in range(2):
        (single,) = student_errors(6.0, [1.0], tracks=60, each=1, seed=seed)
        alike = replace(single, squares=np.repeat(single.squares, 10), tracks=np.repeat(np.arange(60), 10))
        apart = replace(alike, tracks=np.random.default_rng(seed).permutation(600))
        wide, narrow = (fit_tails([e]) for e in (alike, apart))
        limits = [t.inflation[0] * StudentErrors(t.degrees_of_freedom).pointwise_scale(0.01) for t in (wide, narrow)]
        assert limits[0] > 1.03 * limits[1]


def test_the_same_tracks_give_the_same_model() -> None:
    tracks = simulated("random_walk", 30, 25)
    assert fit_motion_model(tracks) == fit_motion_model(tracks)


def test_lead_times_that_few_tracks_reach_are_left_out(caplog: pytest.LogCaptureFixture) -> None:
    tracks = Tracks([*simulated("random_walk", 30, 14)])
    fitted = fit_motion_model(tracks, window=8, lead_times=(0.4, 1.2, 9.9))
    assert fitted.tails is not None
    assert fitted.tails.lead_time == (0.4, 1.2)
    assert "lead time 9.9 s: fewer than 10 tracks reach it" in caplog.text


@pytest.mark.parametrize(
    ("tracks", "arguments", "message"),
    [
        (simulated("random_walk", 3, 20), {"kind": "brownian"}, "kind: 'brownian' is not one of random_walk"),
        (simulated("random_walk", 3, 20), {"window": 0}, "window: 0"),
        (simulated("random_walk", 3, 20), {}, "fewer than 10 reach any of the lead times"),
        (simulated("random_walk", 20, 8), {}, "none has more than 8 positions"),
        (simulated("random_walk", 20, 1), {}, "none has more than one position"),
        (Tracks([]), {}, "none has more than one position"),
    ],
)
def test_too_little_to_go_by_is_named(tracks: Tracks, arguments: dict[str, object], message: str) -> None:
    with pytest.raises(EstimationError, match=message):
        fit_motion_model(tracks, **arguments)  # type: ignore[arg-type]


def test_a_parameter_that_ends_at_its_bound_is_told() -> None:
    """Manoeuvres of a random walk are shorter than any: their time constant goes as low as it may."""
    tracks = simulated("random_walk", 30, 20)
    fitted = fit_motion_model(tracks, "singer", tails=False)
    (told,) = bounds_met(tracks, fitted)
    assert told.startswith("time_constant ended at its lower bound, 0.01:")
    assert bounds_met(tracks, fit_motion_model(tracks, tails=False)) == []


def test_the_noise_can_be_given() -> None:
    tracks = simulated("random_walk", 100, 20)
    fitted = fit_motion_model(tracks, tails=False, noise=0.05)
    assert fitted.noise_deviation == 0.05
    assert fitted.process.diffusion == pytest.approx(0.05, rel=0.15)  # type: ignore[union-attr]
    smooth = Tracks([Track(t.id, t.times, t.positions[0] + np.outer(t.times, [1.0, 0.2])) for t in tracks])
    told = bounds_met(smooth, fit_motion_model(smooth, tails=False))
    assert any("noise_deviation ended at its lower bound" in text for text in told)
    with pytest.raises(EstimationError, match=r"noise: 0\.0 is not a positive number"):
        fit_motion_model(tracks, noise=0.0)
