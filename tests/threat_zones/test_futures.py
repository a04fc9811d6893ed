"""Zones of obstacles of several futures hold what they promise, and everybody knows whose they are."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scenes import disc, scene

import scp_planner as sp
from scp_planner.scenario.motions import Futures
from scp_planner.threat_zones.zone import by_obstacle
from scp_planner.tracking.confidence import alpha_of_mixture, course_scale, marginal_scale, shared_risk, sizes_of

TIMES = np.linspace(0.0, 8.0, 9)


def course(
    rate: tuple[float, float], growth: float | None = 0.1, begin: tuple[float, float] = (9, -4)
) -> dict[str, Any]:
    """A straight course, its standard deviation growing by so much a second; None: known exactly."""
    position = np.array(begin) + TIMES[:, None] * np.array(rate)
    motion: dict[str, Any] = {"time": TIMES.tolist(), "position": position.tolist()}
    if growth is not None:
        motion["covariance"] = [[[v, 0.3 * v], [0.3 * v, 0.8 * v]] for v in (0.05 + growth * TIMES) ** 2]
    return motion


def several(name: str, *futures: tuple[float, dict[str, Any]], radius: float = 0.4) -> dict[str, Any]:
    """An obstacle of several futures."""
    listed = [{"weight": weight, "motion": motion} for weight, motion in futures]
    return {"id": name, "shape": {"disc": radius}, "motion": {"futures": listed}}


AHEAD, TURNING, STOPPING = course((0.0, 1.0)), course((0.6, 0.8), 0.15), course((0.0, 0.0), 0.02)


def test_each_future_has_a_zone_at_the_scale_of_its_share() -> None:
    fork = several("fork", (0.3, TURNING), (0.7, AHEAD))
    scenario = scene(fork, confidence={"probability": 0.9, "level": "per_time"})
    zones = sp.zones(scenario)
    assert [zone.id for zone in zones] == ["fork", "fork"]
    weights = np.array([0.7, 0.3])  # the most probable one first
    covariances = [np.array(motion["covariance"]) for motion in (AHEAD, TURNING)]
    spreads = np.array([np.sqrt(np.mean(np.sqrt(np.linalg.det(each)))) for each in covariances])
    sizes = sizes_of(spreads, np.full(2, -2.0 * np.log(0.1)), 0.4)
    risk = shared_risk(weights, sizes, 0.1)
    assert float(weights @ risk) == pytest.approx(0.1)
    for zone, each, one in zip(zones, covariances, risk, strict=True):
        assert zone.covariance(TIMES[3]) == pytest.approx(-2.0 * np.log(one) * each[3], rel=1e-9)
        assert zone.radius == pytest.approx(0.4)
    assert zones[0].center(2.0) == pytest.approx([9.0, -2.0])


def test_a_single_future_is_its_course() -> None:
    one = sp.zones(scene(several("one", (1.0, AHEAD)), disc("known", (3.0, 5.0))))
    same = sp.zones(scene({"id": "one", "shape": {"disc": 0.4}, "motion": AHEAD}, disc("known", (3.0, 5.0))))
    assert len(one) == len(same) == 2
    assert np.array_equal(one[0].covariance(TIMES), same[0].covariance(TIMES))


def test_a_covariance_that_is_nearly_singular_has_a_share() -> None:
    flat = course((0.6, 0.8))
    flat["covariance"] = [[1.0, 1.0 - 2e-9], [1.0 - 2e-9, 1.0]]
    zones = sp.zones(scene(several("fork", (0.5, flat), (0.5, AHEAD))))
    assert len(zones) == 2
    assert all(np.all(np.isfinite(zone.covariance(TIMES))) for zone in zones)


def test_futures_known_exactly_all_have_their_zones_and_cost_nothing() -> None:
    exact = several("exact", (0.99, course((0.0, 1.0), None)), (0.01, course((0.6, 0.8), None)), (0.0, STOPPING))
    exact["motion"]["futures"][2]["motion"] = course((0.0, 0.0), None)
    seen = {"id": "seen", "shape": {"disc": 0.4}, "motion": AHEAD}
    zones = sp.zones(scene(exact, seen))
    assert [zone.id for zone in zones] == ["exact", "exact", "seen"]  # what cannot be is left out
    assert all(zone.covariances is None for zone in zones[:2])
    scale = marginal_scale("joint", 0.95, len(TIMES), 1)
    assert zones[2].covariance(4.0) == pytest.approx(scale * np.array(AHEAD["covariance"][4]), rel=1e-9)


def test_an_improbable_future_is_left_out_only_where_the_level_allows_it() -> None:
    def count(probability: float) -> int:
        confidence = {"probability": probability, "level": "joint"}
        return len(sp.zones(scene(several("fork", (0.99, AHEAD), (0.01, TURNING)), confidence=confidence)))

    assert (count(0.95), count(0.999)) == (1, 2)


def test_at_the_joint_level_others_have_their_part() -> None:
    forks = [several(name, (0.5, AHEAD), (0.5, AHEAD)) for name in "abc"]
    zones = sp.zones(scene(*forks))
    alone = 1.0 - 0.95 ** (1.0 / 3.0)
    scale = course_scale("joint", alpha_of_mixture("joint", alone, 3), len(TIMES))
    for zone in zones:
        assert zone.covariance(4.0) == pytest.approx(scale * np.array(AHEAD["covariance"][4]), rel=1e-9)


@pytest.mark.parametrize("probability", [0.8, 0.95])
@pytest.mark.parametrize("level", ["per_time", "per_obstacle", "joint"])
def test_what_is_drawn_from_the_mixture_is_outside_of_all_zones_at_most_as_often_as_asked(
    level: str, probability: float
) -> None:
    fork = several("fork", (0.62, AHEAD), (0.25, TURNING), (0.1, STOPPING), (0.03, course((-0.8, 0.5))), radius=0.3)
    left = several("left", (0.5, course((1.0, 0.0), 0.05)), (0.5, course((0.0, 1.5), 0.2)), radius=0.3)
    scenario = scene(fork, left, confidence={"probability": probability, "level": level})
    zones = by_obstacle(sp.zones(scenario))
    rng, trials = np.random.default_rng(4), 4000
    outside = {}
    for obstacle in scenario.obstacles:
        motion = obstacle.motion
        assert isinstance(motion, Futures)
        chosen = rng.choice(len(motion.futures), size=trials, p=[one.weight for one in motion.futures])
        far = np.zeros((trials, len(TIMES)), dtype=bool)
        for number, future in enumerate(motion.futures):
            rows = np.flatnonzero(chosen == number)
            assert isinstance(future.motion, sp.Course)
            roots = np.linalg.cholesky(np.array(future.motion.covariance))
            # Half of each error is the same at all times.
            own, common = rng.standard_normal((2, len(rows), len(TIMES), 2))
            errors = np.sqrt(0.5) * (own + common[:, :1])
            places = np.array(future.motion.position) + np.einsum("tij,rtj->rti", roots, errors)
            every = [zone.signed_distance(TIMES, places) for zone in zones[obstacle.id]]
            far[rows] = np.min(every, axis=0) > -zones[obstacle.id][0].radius  # the centre, not the shape
        outside[obstacle.id] = far
    allowed = 1.0 - probability
    noise = 3.0 * np.sqrt(allowed * probability / trials)
    rates = {
        "per_time": max(each.mean(axis=0).max() for each in outside.values()),
        "per_obstacle": max(each.any(axis=1).mean() for each in outside.values()),
        "joint": np.any([each.any(axis=1) for each in outside.values()], axis=0).mean(),
    }
    assert rates[level] <= allowed + noise
    assert rates[level] >= 0.3 * allowed  # and the zones are not far too large


def test_the_certificate_names_the_obstacle_whichever_future_is_cut() -> None:
    along = [(7.0, 0.0), (13.0, 0.0)]
    standing = [{"position": list(place)} for place in along]
    free = sp.plan(scene())
    for cut, name in zip(standing, ("first", "second"), strict=True):
        futures = (0.5, cut), (0.5, {"position": [0.0, 50.0]})
        certificate = sp.certify(scene(several(name, *futures)), free)
        assert not certificate.holds
        assert {each.obstacle for each in certificate.violations} == {name}
    both = sp.plan(scene(several("both", (0.7, standing[0]), (0.3, standing[1]))))
    assert both.certified
    assert both.travel_time > free.travel_time
    places = both.position(np.linspace(both.start_time, both.arrival_time, 400))
    for place in along:
        assert np.hypot(*(places - np.array(place)).T).min() >= 0.3 + 0.4 - 1e-9
