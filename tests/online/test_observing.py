"""Observations while driving: their effect on zones and on the next plans."""

from __future__ import annotations

import math
from threading import Thread

import numpy as np
import pytest
from replanning import PERIOD, TalkingSolver, begin, follow, observed, seen
from scenes import disc, scene

import scp_planner as sp
from scp_planner.online.planner import Planner
from scp_planner.scenario.units import NaturalUnits
from scp_planner.settings.online import OnlineSettings
from scp_planner.threat_zones.of_scenario import ZonesOf
from scp_planner.threat_zones.zone import ThreatZone

pytestmark = pytest.mark.numerics


def zones_of(planner: Planner, whole: sp.Scenario) -> list[ThreatZone]:
    """The zones of a planner's scenario, made in the units of the whole trip: they decide how long zones hold for."""
    units = NaturalUnits.of(whole)
    return [zone.outside(units) for zone in ZonesOf(units.scenario(planner.scenario))]


def test_zones_are_those_of_all_that_was_observed() -> None:
    """With the same level as a scenario that holds the same observations."""
    scenario = scene(
        observed(seen("a", (12.0, -6.0), (0.0, 0.8), 0.1)),
        observed(seen("b", (15.0, 5.0), (-0.5, -0.5), 0.1, 1, order=2)),
        disc("known", (10.0, 6.0), (0.0, -0.5)),
        confidence={"probability": 0.9, "level": "joint"},
    )
    planner = Planner(scenario)
    begin(planner, scenario)
    rng = np.random.default_rng(5)
    for k in range(1, 8):
        time = k * PERIOD
        planner.observe("a", time, np.array([12.0, -6.0 + 0.8 * time]) + 0.1 * rng.standard_normal(2))
        planner.observe("b", time, np.array([15.0, 5.0]) - 0.5 * time + 0.1 * rng.standard_normal(2))
        follow(planner, time)
    made = zones_of(planner, scenario)
    assert [zone.id for zone in planner.zones] == [zone.id for zone in made] == ["a", "b", "known"]
    times = np.linspace(0.7, 8.0, 20)
    points = rng.normal(0.0, 8.0, (20, 2))
    for zone, other in zip(planner.zones, made, strict=True):
        assert zone.center(times) == pytest.approx(other.center(times), abs=1e-8)
        assert zone.signed_distance(times, points) == pytest.approx(other.signed_distance(times, points), abs=1e-5)


def test_observation_during_a_replan_is_in_its_certificate() -> None:
    scenario = scene(observed(seen("a", (12.0, -6.0), (0.0, 0.8), 0.1)))
    planner = Planner(scenario, online=OnlineSettings(improve_every=1))
    begin(planner, scenario)

    def look() -> None:
        planner.observe("a", 0.1, (12.3, -5.8))
        assert len(planner.obstacles.tracks["a"].times) == 30  # not in the middle of a step

    planner.solver = TalkingSolver(planner, look)
    plan = follow(planner, 0.1)
    assert planner.solver.calls >= 1
    assert len(planner.obstacles.tracks["a"].times) == 31
    (zone,) = sp.zones(planner.scenario)
    assert planner.zones[0].center(2.0) == pytest.approx(zone.center(2.0), abs=1e-9)
    assert plan.safe


def test_observations_may_come_from_another_thread() -> None:
    scenario = scene(observed(seen("a", (12.0, -6.0), (0.0, 0.8), 0.1)))
    planner = Planner(scenario)
    begin(planner, scenario)
    places = {0.001 * k: (12.0, -6.0 + 0.0008 * k) for k in range(1, 201)}

    def look() -> None:
        for time, place in places.items():
            planner.observe("a", time, place)

    looking = Thread(target=look)
    looking.start()
    for k in range(1, 11):
        assert follow(planner, 0.2 + 0.02 * k).safe
    looking.join()
    follow(planner, 0.5)
    track = planner.obstacles.tracks["a"]
    assert len(track.times) == 230 and track.times == sorted(track.times)
    (zone,) = sp.zones(planner.scenario)
    assert planner.zones[0].center(2.0) == pytest.approx(zone.center(2.0), abs=1e-8)


def test_wild_observation_is_left_out_and_a_lasting_change_is_learnt() -> None:
    scenario = scene(observed(seen("a", (12.0, -6.0), (0.0, 0.0), 0.1)))
    planner = Planner(scenario)
    begin(planner, scenario)
    rng = np.random.default_rng(1)
    planner.observe("a", 0.1, (17.0, -6.0))
    assert planner.notes[-1] == "a at t = 0.100 s: it is improbable given the earlier observations"
    planner.observe("a", 0.2, (12.05, -5.95))
    follow(planner, 0.2)
    assert planner.zones[0].center(0.2) == pytest.approx((12.0, -6.0), abs=0.15)
    for k in range(3, 9):
        planner.observe("a", 0.1 * k, np.array([17.0, -6.0]) + 0.1 * rng.standard_normal(2))
        follow(planner, 0.1 * k)
    assert planner.zones[0].center(0.8) == pytest.approx((17.0, -6.0), abs=0.3)
    assert planner.obstacles.tracks["a"].newcomer


@pytest.mark.parametrize("late", [False, True])
def test_observation_that_comes_twice_counts_once(late: bool) -> None:
    scenario = scene(observed(seen("a", (12.0, -6.0), (0.0, 0.0), 0.1)))
    planner = Planner(scenario)
    for k in range(1, 20):
        planner.observe("a", 0.1 * k, (12.0 + 0.01 * (-1) ** k, -6.0))
    again = 3 if late else 19
    planner.observe("a", 0.1 * again, (11.99, -6.0))
    planner.replan(1.9, (1.9, 0.0), 0.0, 1.0)
    assert planner.notes[-1].endswith("it came twice")
    assert len(planner.obstacles.tracks["a"].times) == 49


def test_order_in_which_observations_come_does_not_matter() -> None:
    scenario = scene(observed(seen("a", (12.0, -6.0), (0.0, 0.8), 0.1)))
    rng = np.random.default_rng(2)
    news = [(0.1 * k, np.array([12.0, -6.0 + 0.08 * k]) + 0.1 * rng.standard_normal(2)) for k in range(1, 11)]
    zones = []
    for order in (range(10), rng.permutation(10)):
        planner = Planner(scenario)
        for k in order:
            planner.observe("a", *news[k])
        planner.replan(1.0, (1.0, 0.0), 0.0, 1.0)
        zones.append(planner.zones[0])
    times = np.linspace(1.0, 6.0, 10)
    assert zones[0].center(times) == pytest.approx(zones[1].center(times), abs=1e-9)
    assert zones[0].covariance(times) == pytest.approx(zones[1].covariance(times), rel=1e-9)


def test_newcomer_is_kept_clear_of_from_its_first_observation() -> None:
    scenario = scene()
    planner = Planner(scenario)
    begin(planner, scenario)
    planner.add_obstacle("new", {"disc": 0.4}, covariance=0.01 * np.eye(2))
    follow(planner, 0.1)
    assert [zone.id for zone in planner.zones] == []  # nobody has seen it yet
    sizes = []
    for k in range(2, 15):
        time = 0.1 * k
        planner.observe("new", time, (9.0 + 0.02 * (-1) ** k, 0.1))
        plan = follow(planner, time)
        assert plan.safe
        (zone,) = planner.zones
        (same,) = zones_of(planner, scenario)
        assert zone.covariance(time + 2.0) == pytest.approx(same.covariance(time + 2.0), rel=1e-6)
        sizes.append(math.sqrt(float(zone.covariance(time + 1.0)[0, 0])))
    # Within a second nothing is known but that it moves like others; the more is seen, the less it may do.
    assert sizes[0] > 2.0 and sizes[-1] < 0.5 * sizes[0]


class Straight:
    """A predictor that counts how often it is asked, and for how long."""

    def __init__(self) -> None:
        self.asked: list[tuple[float, float]] = []

    def predict(self, now: float, horizon: float) -> dict[str, sp.Course]:
        self.asked.append((now, horizon))
        times = np.array([now, now + 1.0])
        return {"walker": sp.Course(time=times, position=np.stack([times + 8.0, 0.0 * times + 3.0], axis=-1))}


def test_a_predictor_is_asked_at_each_replan() -> None:
    planner, predictor = sp.Planner(scene()), Straight()
    planner.add_obstacle("walker", {"disc": 0.3})
    planner.predictor = predictor
    for time in (0.0, 0.1):
        plan = planner.replan(time, (time, 0.0), 0.0, 1.0)
        (zone,) = planner.zones
        assert zone.center(time + 0.5) == pytest.approx((time + 8.5, 3.0), abs=1e-6)
    assert [now for now, _ in predictor.asked] == [0.0, 0.1]
    assert predictor.asked[0][1] == pytest.approx(20.0 / 3.0)
    assert 20.0 / 3.0 < predictor.asked[1][1] < plan.arrival_time
