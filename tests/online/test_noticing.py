"""Tests of motions and noise against what was predicted, and what follows from them."""

from __future__ import annotations

import math

import numpy as np
import pytest

import scp_planner as sp
from scp_planner.estimation.confidence import uniform_scale
from scp_planner.estimation.error_laws import NormalErrors
from scp_planner.estimation.estimate import estimate_motion, estimate_obstacle
from scp_planner.estimation.motion_filter import estimate_process
from scp_planner.mathematics.polynomials import PiecewisePolynomials
from scp_planner.online.many_zones import Level, times_linear, zones_of_mixtures
from scp_planner.online.mixtures import FilterModels, FilterStates, Mixture
from scp_planner.online.noticing import EVIDENCE, Bank
from scp_planner.online.obstacle_tracks import ObstacleTracks
from scp_planner.online.track import ObstacleTrack
from scp_planner.scenario.models import Model
from scp_planner.scenario.process_model import ProcessModel
from scp_planner.scenario.shapes import Disc
from scp_planner.settings.online import RARE, Watch
from scp_planner.threat_zones.of_scenario import HORIZON, Body, zones

NOISE = 0.1
WIDENING = FilterModels(1.5, 0.5)
STEP = 0.1


def bank_of(count: int, order: int = 2) -> tuple[Bank, np.ndarray]:
    bank = Bank(order, WIDENING)
    return bank, np.array([bank.take(NOISE**2 * np.eye(2)) for _ in range(count)])


def drive(bank: Bank, slots: np.ndarray, places: np.ndarray, first: float = 0.0) -> list[np.ndarray]:
    """Feed places (n, K, 2) one after the other; give who was alarmed after each."""
    alarmed = []
    for number, place in enumerate(places):
        bank.update(slots, np.full(len(slots), first + STEP * number), place)
        alarmed.append(bank.alarmed[slots].copy())
    return alarmed


def test_filters_are_those_of_their_motions() -> None:
    """Every filter of the bank against the Kalman filter of the motion that it is named for."""
    rng = np.random.default_rng(0)
    times, places = np.sort(rng.uniform(0.0, 3.0, 12)), rng.normal(0.0, 1.0, (12, 2))
    sigma = 0.04 * np.eye(2)
    bank = Bank(1, WIDENING)
    slot = np.array([bank.take(sigma)])
    for time, place in zip(times, places, strict=True):
        bank.update(slot, np.array([time]), place[None])
    at = times[-1] + 1.7
    for number, motion in enumerate(WIDENING.filters):
        model = ProcessModel(process=motion, velocity_deviation=1.5, noise_deviation=1.0)
        expected = estimate_process(times, places, model, sigma)
        bank.weights[slot] = np.eye(WIDENING.size)[number]
        mixed = bank.mixed(slot, np.array([at]))
        assert mixed.mean[0, 0] == pytest.approx(expected.position(at), abs=1e-9)
        assert mixed.covariance[0, 0, :, 0] == pytest.approx(expected.covariance(at), rel=1e-9)


def test_mixture_has_the_moments_of_its_parts() -> None:
    rng = np.random.default_rng(1)
    bank, slots = bank_of(1)
    drive(bank, slots, rng.normal(0.0, 0.3, (20, 1, 2)))
    weights = rng.dirichlet(np.ones(WIDENING.size))
    parts = []
    for one in np.eye(len(weights)):
        bank.weights[slots] = one
        parts.append(bank.mixed(slots, np.array([3.0])))
    bank.weights[slots] = weights
    mixed = bank.mixed(slots, np.array([3.0]))
    means = np.array([part.mean.reshape(6) for part in parts])
    second = sum(
        w * (part.covariance.reshape(6, 6) + np.outer(m, m)) for w, part, m in zip(weights, parts, means, strict=True)
    )
    mean = weights @ means
    assert mixed.mean.reshape(6) == pytest.approx(mean, abs=1e-12)
    assert mixed.covariance.reshape(6, 6) == pytest.approx(second - np.outer(mean, mean), abs=1e-10)


def test_zone_of_one_filter_is_that_of_its_motion() -> None:
    """Its polynomials, and its scale from the standardised length, against the batch estimate."""
    rng = np.random.default_rng(2)
    times, places = STEP * np.arange(25), rng.normal(0.0, 0.3, (25, 1, 2))
    bank, slots = bank_of(1)
    drive(bank, slots, places)
    level = Level(sp.Confidence(probability=0.95, level="per_obstacle"), 1)
    track = ObstacleTrack("a", Disc(disc=0.3), Model(), 0.0, Body(0.3), covariance=NOISE**2 * np.eye(2))
    for number, motion in enumerate(WIDENING.filters):
        model = ProcessModel(process=motion, velocity_deviation=1.5, noise_deviation=1.0)
        estimate = estimate_process(times, places[:, 0], model, NOISE**2 * np.eye(2))
        bank.weights[slots] = np.eye(WIDENING.size)[number]
        start = times[-1] + 0.05
        (zone,) = zones_of_mixtures([track], bank.mixed(slots, np.array([start])), start, level)
        length = estimate.standardised_length(start, start + HORIZON)
        scale = uniform_scale(1.0 - 0.95, length, NormalErrors())
        at = start + np.array([0.0, 0.5, 2.0, 7.0])
        assert zone.center(at) == pytest.approx(estimate.position(at), abs=1e-8)
        assert zone.covariance(at) == pytest.approx(scale * estimate.covariance(at), rel=1e-4)


def test_what_moves_as_foretold_is_believed() -> None:
    rng = np.random.default_rng(7)
    bank, slots = bank_of(40)
    times = STEP * np.arange(200)[:, None, None]
    places = times * rng.normal(0, 1, (40, 2)) + 0.5 * times**2 * rng.normal(0, 0.3, (40, 2))
    alarmed = drive(bank, slots, places + NOISE * rng.standard_normal(places.shape))
    assert not np.any(alarmed)


@pytest.mark.parametrize(("change", "within"), [(0.5, 1.5), (1.0, 1.2), (2.0, 1.0)])
def test_a_change_of_acceleration_is_noticed(change: float, within: float) -> None:
    """Nearly all of 40; soon after, nine of ten are in the region of 99 % that is foretold a second ahead."""
    rng = np.random.default_rng(8)
    bank, slots = bank_of(40)
    begin = 100
    since = np.maximum(STEP * (np.arange(170) - begin), 0.0)
    angle = rng.uniform(0.0, 2.0 * math.pi, 40)
    course = 0.5 * change * since[:, None, None] ** 2 * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    places = course + NOISE * rng.standard_normal(course.shape)
    last = begin + round(within / STEP)
    alarmed = drive(bank, slots, places[: last + 1])
    assert not np.any(alarmed[begin]) and np.mean(alarmed[last]) >= 0.95
    some = slots[alarmed[last]]
    ahead = bank.mixed(some, np.full(len(some), STEP * (last + 10)))
    offset = course[last + 10][alarmed[last]] - ahead.mean[:, 0]
    squares = np.einsum("ka,kab,kb->k", offset, np.linalg.inv(ahead.covariance[:, 0, :, 0]), offset)
    assert np.mean(squares < -2.0 * math.log(0.01)) >= 0.9


def test_false_alarm_is_called_off() -> None:
    rng = np.random.default_rng(9)
    bank, slots = bank_of(10)
    places = NOISE * rng.standard_normal((200, 10, 2))
    drive(bank, slots, places[:100])
    bank.alarm(slots, np.zeros(len(slots), dtype=np.intp))
    alarmed = drive(bank, slots, places[100:], 10.0)
    assert not np.any(alarmed[-1]) and np.all(alarmed[EVIDENCE - 2])


def test_an_outlier_alone_is_no_alarm() -> None:
    rng = np.random.default_rng(10)
    bank, slots = bank_of(1)
    places = NOISE * rng.standard_normal((150, 1, 2))
    places[80] += 5.0 * NOISE
    assert not np.any(drive(bank, slots, places))


def test_manoeuvre_adds_to_the_variance() -> None:
    times, rng = STEP * np.arange(20), np.random.default_rng(11)
    sigma = np.array([[0.02, 0.005], [0.005, 0.01]])
    for order in (0, 1, 2):
        estimate = estimate_motion(times, rng.normal(size=(20, 2)), sigma, order)
        wider = estimate.with_manoeuvre(0.3)
        at = times[-1] + np.array([0.0, 1.0, 3.0])
        change = 0.3**2 / np.linalg.eigvalsh(sigma)[0] * sigma
        added = (np.array([0.0, 1.0, 3.0]) ** 4 / 4.0)[:, None, None] * change
        assert wider.position(at) == pytest.approx(estimate.position(at), abs=1e-10)
        assert wider.covariance(at) == pytest.approx(estimate.covariance(at) + added, rel=1e-9)


def observed(places: np.ndarray, order: int = 2) -> sp.Obstacle:
    return sp.Obstacle.model_validate(
        {
            "id": "a",
            "shape": {"disc": 0.4},
            "observations": {
                "time": (STEP * np.arange(len(places))).tolist(),
                "position": places.tolist(),
                "covariance": (NOISE**2 * np.eye(2)).tolist(),
            },
            "model": {"order": order},
        }
    )


@pytest.mark.parametrize("order", [0, 1, 2])
def test_zones_with_a_manoeuvre_are_those_of_the_scenario(order: int) -> None:
    rng = np.random.default_rng(12)
    tracks = ObstacleTracks(sp.Confidence(), watch=Watch(manoeuvre=0.4, changes=0.0))
    tracks.add(observed(NOISE * rng.standard_normal((30, 2)), order))
    (zone,), (given,) = tracks.zones(3.0), tracks.as_obstacles()
    assert given.model.manoeuvre == pytest.approx(0.4 * tracks.newcomers.acceleration_deviation)
    estimate, at = estimate_obstacle(given), 3.0 + np.array([0.0, 1.0, 5.0])
    ratio = zone.covariance(at)[:, 0, 0] / estimate.covariance(at)[:, 0, 0]
    assert zone.center(at) == pytest.approx(estimate.position(at), abs=1e-9)
    assert ratio == pytest.approx(ratio[0], rel=1e-9)


def test_zone_of_what_has_changed_is_in_the_scenario_too() -> None:
    """As a course whose zone is no larger, and hardly smaller."""
    rng = np.random.default_rng(13)
    since = np.maximum(STEP * np.arange(60) - 3.0, 0.0)[:, None]
    tracks = ObstacleTracks(sp.Confidence())
    tracks.add(observed(0.5 * since**2 * np.array([1.0, 0.0]) + NOISE * rng.standard_normal((60, 2))))
    assert tracks.tracks["a"].alarmed
    (zone,), obstacles = tracks.zones(6.0), tracks.as_obstacles()
    scenario = sp.Scenario(
        vehicle={"radius": 0.3, "max_speed": 2.0, "max_acceleration": 1.0, "max_deceleration": 1.0},
        start={"time": 6.0, "position": [0.0, 30.0], "speed": 0.0},
        goal={"position": [10.0, 30.0]},
    ).model_copy(update={"obstacles": obstacles})
    (same,) = zones(scenario)
    at = 6.0 + np.linspace(0.0, 8.0, 41)
    assert same.center(at) == pytest.approx(zone.center(at), abs=2e-3)
    ratio = np.linalg.eigvals(np.linalg.solve(zone.covariance(at), same.covariance(at))).real
    assert ratio.max() <= 1.0 and ratio.min() > 0.97


def test_many_are_learnt_as_each_alone() -> None:
    rng = np.random.default_rng(14)
    together, alone = ObstacleTracks(sp.Confidence()), ObstacleTracks(sp.Confidence())
    some = [observed(NOISE * rng.standard_normal((n, 2))).model_copy(update={"id": f"o{n}"}) for n in (12, 30, 45)]
    together.add(*some)
    for one in some:
        alone.add(one)
    for zone, other in zip(together.zones(4.5), alone.zones(4.5), strict=True):
        assert zone.covariance(6.0) == pytest.approx(other.covariance(6.0), rel=1e-12)
        assert zone.center(6.0) == pytest.approx(other.center(6.0), abs=1e-12)


def test_noise_that_is_underestimated_makes_zones_larger() -> None:
    rng = np.random.default_rng(15)
    places = rng.standard_normal((100, 2))
    sizes = []
    for factor in (1.0, 3.0):
        tracks = ObstacleTracks(sp.Confidence())
        tracks.add(observed(factor * NOISE * places))
        (zone,) = tracks.zones(10.0)
        sizes.append(math.sqrt(zone.covariance(10.0)[0, 0]))
    assert sizes[1] / sizes[0] == pytest.approx(3.0, rel=0.2)


def test_without_alarms_all_is_believed() -> None:
    rng = np.random.default_rng(16)
    tracks = ObstacleTracks(sp.Confidence(), watch=Watch(alarm_probability=0.0))
    tracks.add(observed(3.0 * NOISE * rng.standard_normal((100, 2))))
    assert tracks.noise.factor == 1.0 and not tracks.tracks["a"].alarmed
    assert RARE > 0.0


def test_covariances_times_a_linear_factor() -> None:
    rng = np.random.default_rng(17)
    whole = PiecewisePolynomials(np.array(2 * [[2.0, 5.0, 9.0]]), rng.normal(size=(2, 2, 4, 3)))
    leads, factors = np.array([0.0, 1.0, 4.0]), np.array([[1.0, 3.0, 2.0], [0.5, 0.2, 4.0]])
    added = np.array([[0.0, 2.0, 5.0], [1.0, 0.0, 3.0]])
    scaled, wider = times_linear(whole, leads, factors), times_linear(whole, leads, factors, added)
    at = np.linspace(2.0, 9.0, 71)
    for k in range(2):
        expected = np.interp(at - 2.0, leads, factors[k])[:, None] * whole.grid(at)[:, k]
        assert scaled.grid(at)[:, k] == pytest.approx(expected, rel=1e-9, abs=1e-9)
        more = wider.grid(at)[:, k] - scaled.grid(at)[:, k]
        assert more == pytest.approx(np.interp(at - 2.0, leads, added[k])[:, None] * [1.0, 0.0, 1.0], abs=1e-9)


def test_shapes_of_a_mixture_are_those_of_the_noise() -> None:
    """Noise that is no circle: process noise is in proportion, its smallest axis as intense as asked for."""
    bank = Bank(2, WIDENING)
    sigma = np.array([[0.04, 0.0], [0.0, 0.01]])
    slot = np.array([bank.take(sigma)])
    drive(bank, slot, np.zeros((5, 1, 2)))
    mixed: Mixture = bank.mixed(slot, np.array([1.0]))
    assert mixed.shape[0] == pytest.approx(sigma / 0.01)


def test_outliers_of_the_past_are_left_out() -> None:
    rng = np.random.default_rng(18)
    places = NOISE * rng.standard_normal((100, 2))
    places[[3, 70]] += 3.0
    tracks = ObstacleTracks(sp.Confidence())
    tracks.add(observed(places))
    track = tracks.tracks["a"]
    assert len(track.times) == 98 and not track.alarmed
    (zone,) = tracks.zones(10.0)
    clean = estimate_motion(track.times, track.positions, NOISE**2 * np.eye(2))
    assert zone.center(10.0) == pytest.approx(clean.position(10.0), abs=1e-9)


def test_nothing_is_lost_where_all_changes_at_once() -> None:
    """A leap: two observations in a row may be outliers, the third is none."""
    rng = np.random.default_rng(19)
    places = NOISE * rng.standard_normal((60, 2))
    places[40:] += 4.0
    tracks = ObstacleTracks(sp.Confidence())
    tracks.add(observed(places))
    assert 54 <= len(tracks.tracks["a"].times) <= 58 and tracks.tracks["a"].alarmed  # two in three, until believed
    (zone,) = tracks.zones(6.0)
    assert zone.center(6.0) == pytest.approx((4.0, 4.0), abs=0.5)


@pytest.mark.parametrize("lags", [np.full(3, 0.3), np.array([0.3, 0.1, 0.6])])
@pytest.mark.parametrize("unit", [np.full(3, 0.02), np.array([0.01, 0.02, 0.04])])
def test_filters_of_a_frame_are_moved_on_as_each_alone(lags: np.ndarray, unit: np.ndarray) -> None:
    """Whether all lags and noises are the same or not: F P F' + Q, written out."""
    rng, diffusions = np.random.default_rng(4), np.array([[0.3, 0.0], [0.0, 0.7]])
    roots = rng.normal(size=(2, 3, 3, 3))
    whole = roots @ roots.transpose(0, 1, 3, 2)  # (M, K, 3, 3)
    rows, columns = np.triu_indices(3)
    mean = rng.normal(size=(3, 2, 2, 3))
    states = FilterStates(mean.copy(), whole[..., rows, columns].transpose(2, 0, 1).copy(), diffusions)
    states.predict(lags, unit)
    for k, t in enumerate(lags.tolist()):
        moved = np.array([[1.0, t, 0.5 * t * t], [0.0, 1.0, t], [0.0, 0.0, 1.0]])
        for number, (swerve, jerk) in enumerate(diffusions.tolist()):
            # white acceleration, and white jerk, integrated
            noise = swerve * np.array([[t**3 / 3.0, t**2 / 2.0, 0.0], [t**2 / 2.0, t, 0.0], [0.0, 0.0, 0.0]])
            noise += jerk * np.array(
                [
                    [t**5 / 20.0, t**4 / 8.0, t**3 / 6.0],
                    [t**4 / 8.0, t**3 / 3.0, t**2 / 2.0],
                    [t**3 / 6.0, t**2 / 2.0, t],
                ]
            )
            spread = moved @ whole[number, k] @ moved.T + noise / unit[k]
            assert states.spread[:, number, k] == pytest.approx(spread[rows, columns], rel=1e-12)
            assert states.mean[:, :, number, k] == pytest.approx(moved @ mean[:, :, number, k], rel=1e-12, abs=1e-12)
