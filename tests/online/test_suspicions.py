"""Changes of acceleration that are likely by now, against least squares and normal densities written out."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest
from scipy.stats import chi2

import scp_planner as sp
from scp_planner.estimation.recursive import RecursiveEstimator
from scp_planner.online import sensor_frames
from scp_planner.online.mixtures import Mixture
from scp_planner.online.obstacle_tracks import ObstacleTracks
from scp_planner.online.suspicions import (
    LOOKED_AT,
    ONSETS,
    SPEAKS,
    WARY,
    WARY_LASTS,
    Allowance,
    Changes,
    Sightings,
    changed_motions,
    changes_of,
)
from scp_planner.online.track import Seen
from scp_planner.settings.online import MANOEUVRE, Regions, Watch
from scp_planner.threat_zones.zone import ThreatZone

STEP, NOISE = 0.1, 0.1
SIGMA = np.array([[0.02, 0.008], [0.008, 0.01]])
DEVIATION = 0.5


@dataclass(frozen=True)
class Sight:
    """What was seen of one obstacle: times, places, the estimate of them, the newest looks."""

    times: np.ndarray
    places: np.ndarray
    estimator: RecursiveEstimator
    looks: Sightings


def sight(order: int, count: int, sigma: np.ndarray) -> Sight:
    """Of an obstacle that changes its acceleration by 0.5 m/s^2 a second before the end."""
    rng = np.random.default_rng(order)
    times = STEP * np.sort(rng.uniform(0.0, count, count))
    places = np.outer(times, [1.0, -0.5]) * (order > 0)
    places += 0.25 * np.maximum(times - times[-1] + 1.0, 0.0)[:, None] ** 2
    places += rng.multivariate_normal(np.zeros(2), sigma, count)
    estimator = RecursiveEstimator(1, order, sigma)
    for time, place in zip(times, places, strict=True):
        estimator.update(time, place[None])
    newest = min(count, 32)
    clock, rows = np.full((32, 1), -np.inf), np.zeros((2, 32, 1))
    clock[-newest:, 0], rows[:, -newest:, 0] = times[-newest:], places[-newest:].T
    return Sight(times, places, estimator, Sightings(clock, rows))


@pytest.mark.parametrize("order", [1, 2])
def test_evidence_is_the_ratio_of_normal_densities(order: int) -> None:
    seen = sight(order, 30, NOISE**2 * np.eye(2))
    times, places = seen.times, seen.places
    found = changes_of(seen.estimator.roots, seen.looks, NOISE**2 * np.eye(2)[None], DEVIATION)
    powers = (times - times.mean())[:, None] ** np.arange(order + 1)
    anywhere = NOISE**2 * np.eye(30) + 1e6 * powers @ powers.T
    for column, number in enumerate(ONSETS[:-1]):
        path = 0.5 * np.maximum(times - times[-1 - number], 0.0) ** 2
        densities = []
        for matrix in (anywhere, anywhere + DEVIATION**2 * np.outer(path, path)):
            fit = (places * np.linalg.solve(matrix, places)).sum()
            densities.append(-0.5 * fit - np.linalg.slogdet(matrix)[1])
        assert found.evidence[0, column] == pytest.approx(densities[1] - densities[0], abs=2e-3)


@pytest.mark.parametrize("order", [0, 1, 2])
def test_a_motion_that_has_changed_is_that_of_least_squares(order: int) -> None:
    """Polynomial and change fitted together, the change with what is known of it beforehand as one more look."""
    seen = sight(order, 40, SIGMA)
    times, places, roots = seen.times, seen.places, seen.estimator.roots
    found = changes_of(roots, seen.looks, SIGMA[None], DEVIATION)
    at, column = times[-1] + 0.7, 5
    onset = times[-1 - ONSETS[column]]
    columns = [*(times[:, None] ** np.arange(order + 1)).T, 0.5 * np.maximum(times - onset, 0.0) ** 2]
    design = np.stack(columns, axis=1)
    least = np.linalg.eigvalsh(SIGMA)[0]
    design = np.vstack([design, np.sqrt(least) / DEVIATION * np.eye(order + 2)[-1:]])
    fit = np.linalg.lstsq(design, np.vstack([places, np.zeros((1, 2))]), rcond=None)[0]
    row = np.array([*(at ** np.arange(order + 1)), 0.5 * (at - onset) ** 2])
    only = replace(found, evidence=np.where(np.arange(len(ONSETS)) == column, 0.0, -400.0)[None])
    motion = changed_motions(roots, only.sure(), SIGMA[None], at)
    assert motion.mean[0, 0] == pytest.approx(row @ fit, abs=1e-9)
    expected = (row @ np.linalg.inv(design.T @ design) @ row) * SIGMA
    assert motion.covariance[0, 0, :, 0] == pytest.approx(expected, rel=1e-6)


def test_suspicions_have_the_moments_of_their_mixture() -> None:
    rng = np.random.default_rng(4)
    count, onsets = 3, len(ONSETS)
    evidence = SPEAKS + rng.uniform(-2.0, 4.0, (count, onsets))
    changes = Changes(
        gap=rng.uniform(0.05, 0.2, (count, onsets)),
        evidence=evidence,
        change=rng.normal(0.0, 3.0, (count, onsets, 2)),
        variance=rng.uniform(0.5, 2.0, (count, onsets)),
        course=rng.normal(0.0, 1.0, (count, onsets, 3)),
        root=np.broadcast_to(np.eye(2), (count, 2, 2)),
    )
    often = 0.02
    found = changes.suspicions(often)
    for k in range(count):
        odds = often * changes.gap[k] * np.exp(evidence[k])
        weight = np.where(evidence[k] > SPEAKS, odds / (1.0 + odds.sum()), 0.0)
        parts = [np.outer(changes.course[k, h], changes.change[k, h]) for h in range(onsets)]
        mean = sum(w * part for w, part in zip(weight, parts, strict=True))
        second = sum(
            w * (part @ part.T + v * np.outer(c, c))
            for w, part, v, c in zip(weight, parts, changes.variance[k], changes.course[k], strict=True)
        )
        assert found.probability[k] == pytest.approx(weight.sum())
        assert found.shift[k] == pytest.approx(mean)
        assert found.spread[k] == pytest.approx(second - mean @ mean.T)


def watched(change: float, watch: Watch) -> tuple[np.ndarray, np.ndarray]:
    """Of 30 obstacles, 1 m/s fast, from 1 s before a change on: whether zones hold what comes 1.5 s later; sizes."""
    rng = np.random.default_rng(8)
    tracks, names = ObstacleTracks(sp.Confidence(level="per_obstacle"), watch=watch), [f"o{k}" for k in range(30)]
    for name in names:
        tracks.add_unseen(name, sp.Disc(disc=0.3), sp.Model(order=2), 0.0, NOISE**2 * np.eye(2))
    held, sizes = [], []
    for time in STEP * np.arange(-60, 15):
        place = np.array([time, 0.5 * change * max(time, 0.0) ** 2])
        ones = place + NOISE * rng.standard_normal((len(names), 2))
        sensor_frames.take_in(tracks, names, [Seen(float(time), (x, y)) for x, y in ones.tolist()])
        if time < -1.0:
            continue
        ahead = time + 1.5
        later = np.array([ahead, 0.5 * change * max(ahead, 0.0) ** 2])
        zones = tracks.zones(float(time))
        offset = np.array([zone.center(np.array([ahead]))[0] for zone in zones]) - later
        spread = np.array([zone.covariance(np.array([ahead]))[0] for zone in zones])
        held.append(np.einsum("ka,kab,kb->k", offset, np.linalg.inv(spread), offset) <= 1.0)
        sizes.append(np.sqrt(np.linalg.det(spread)))
    return np.array(held), np.array(sizes)


def test_zones_allow_for_a_change_before_the_alarm() -> None:
    """A change of 0.5 m/s^2 that nobody can be sure of after 1 s."""
    with_them, _ = watched(0.5, Watch())
    without, _ = watched(0.5, Watch(changes=0.0))
    after = slice(20, 23)  # 1.0 s to 1.2 s
    assert with_them[after].mean() > without[after].mean() + 0.25
    assert with_them[-1].mean() > 0.9


def test_zones_of_those_that_move_as_foretold_stay_as_they_are() -> None:
    _, sizes = watched(0.0, Watch())
    _, without = watched(0.0, Watch(changes=0.0))
    # But for rounding, which depends on the kernel that is multiplied with
    assert np.mean(~np.isclose(sizes, without, rtol=1e-9, atol=0.0)) < 0.01
    assert np.all(sizes >= without * (1.0 - 1e-9))


def test_two_mixtures_together_have_the_moments_of_both() -> None:
    rng = np.random.default_rng(6)

    def made(count: int) -> Mixture:
        roots = rng.normal(size=(count, 6, 6))
        covariance = (roots @ roots.transpose(0, 2, 1)).reshape(count, 3, 2, 3, 2)
        return Mixture(rng.normal(size=(count, 3, 2)), covariance, np.ones((count, 2)), np.ones((count, 2, 2)))

    filters, change = made(3), made(2)
    share = np.array([0.3, 0.8])
    both = filters.blended(np.array([0, 2]), change, share)
    for number, (k, s) in enumerate(zip((0, 2), share, strict=True)):
        means = [one.reshape(6) for one in (filters.mean[k], change.mean[number])]
        spreads = [one.reshape(6, 6) for one in (filters.covariance[k], change.covariance[number])]
        mean = (1.0 - s) * means[0] + s * means[1]
        second = (1.0 - s) * (spreads[0] + np.outer(means[0], means[0])) + s * (
            spreads[1] + np.outer(means[1], means[1])
        )
        assert both.mean[k].reshape(6) == pytest.approx(mean)
        assert both.covariance[k].reshape(6, 6) == pytest.approx(second - np.outer(mean, mean))
        assert both.diffusion[k] == pytest.approx(1.0 - s)
    assert np.array_equal(both.mean[1], filters.mean[1]) and np.array_equal(both.covariance[1], filters.covariance[1])


@pytest.mark.parametrize("count", [1, 2, 3])
def test_an_alarm_among_the_first_looks_leaves_zones(count: int) -> None:
    """Too few looks for a polynomial, let alone for a change of one."""
    tracks = ObstacleTracks(sp.Confidence())
    tracks.add_unseen("a", sp.Disc(disc=0.3), sp.Model(order=2), 0.0, NOISE**2 * np.eye(2))
    for number in range(count):
        tracks.observe("a", STEP * number, (0.1 * number, 0.0))
    estimator = tracks.tracks["a"].estimator
    assert estimator is not None and estimator.bank is not None
    estimator.bank.alarm(np.array([estimator.slot]), np.array([2]))
    tracks.observe("a", STEP * count, (0.1 * count, 0.0))
    (zone,) = tracks.zones(STEP * count)
    assert tracks.tracks["a"].alarmed
    assert zone.center(STEP * count) == pytest.approx((0.1 * count, 0.0), abs=3.0 * NOISE)


def test_what_is_not_looked_at_could_not_speak_for_a_change() -> None:
    told = np.geomspace(1e-3, 1e6, 2000)  # what looks tell of a change, beside what was known of it
    least = 2.0 * (SPEAKS + np.log1p(told)) * (1.0 + told) / told
    assert LOOKED_AT < 0.8 * least.min()


def seen_for(seconds: float, turns: float) -> tuple[ObstacleTracks, tuple[ThreatZone, ...]]:
    """One who goes on as before, beside one who accelerates from the tenth second on, and then not any more."""
    watch = Watch(regions=Regions.MODEL)
    tracks, names = ObstacleTracks(sp.Confidence(level="per_time"), watch=watch), ["calm", "other"]
    for name in names:
        tracks.add_unseen(name, sp.Disc(disc=0.3), sp.Model(order=2), 0.0, NOISE**2 * np.eye(2))
    rng, made = np.random.default_rng(2), tuple[ThreatZone, ...]()
    for time in STEP * np.arange(round(seconds / STEP)):
        during = float(np.clip(time - 10.0, 0.0, 2.0))
        places = np.array([[time, 0.0], [time, 5.0 + turns * during * (time - 10.0 - 0.5 * during)]])
        places += NOISE * rng.standard_normal((2, 2))
        sensor_frames.take_in(tracks, names, [Seen(float(time), (x, y)) for x, y in places.tolist()])
        made = tracks.zones(float(time))
    return tracks, made


@pytest.mark.parametrize("seconds", [13.0, 60.0])
def test_more_is_allowed_for_while_others_change_their_motion(seconds: float) -> None:
    """By a change of acceleration of the calm one as of now, whose deviation is ten times as large; for a while."""
    (calm, usual), (wary, more) = seen_for(seconds, 0.0), seen_for(seconds, 1.0)
    assert not calm.tracks["other"].alarmed and not wary.tracks["calm"].alarmed
    now = round(seconds / STEP - 1) * STEP
    allowed = (WARY**2 - MANOEUVRE**2) * calm.newcomers.acceleration_deviation**2
    assert wary.tracks["other"].alarmed
    for ahead in (0.5, 1.0, 2.0):
        grown = more[0].covariance(now + ahead) - usual[0].covariance(now + ahead)
        expected = allowed * 0.25 * ahead**4 * chi2.ppf(0.95, 2) if seconds < 20.0 else 0.0
        assert np.squeeze(grown) == pytest.approx(expected * np.eye(2), rel=1e-6, abs=1e-9)


@pytest.mark.parametrize(("usual", "wary"), [(0.1, WARY), (2.0, 2.0), (0.0, 0.0)])
def test_wariness_ends(usual: float, wary: float) -> None:
    allowance, after = Allowance(usual, 0.5), 1.0 + WARY_LASTS
    seen = []
    for time, noticed in (
        (0.0, ""),
        (1.0, "a"),
        (2.0, ""),
        (after, "a"),
        (after + WARY_LASTS + 0.1, "a"),
        (40.0, "ab"),
    ):
        allowance.note(time, frozenset(noticed))
        seen.append(allowance.now)
    assert seen == pytest.approx([0.5 * each for each in (usual, wary, wary, wary, usual, wary)])
