"""What is driven where nothing is safe: who stands in the way leaves, by zones that grow alike for all dodges."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scenes import disc, scene

from scp_planner.online.dodge_odds import STEADY, odds, odds_of_stop
from scp_planner.online.dodge_outlooks import DodgeOutlooks
from scp_planner.online.dodge_worth import FADING, GAIN, a_moment
from scp_planner.online.evasion import Evasion
from scp_planner.online.planner import Planner
from scp_planner.online.vetting import Stop
from scp_planner.settings.online import OnlineSettings

PERIOD, SPEED, SIZE = 0.1, 1.2, 0.6
LEADS = np.array([0.0, 0.25, 0.5, 1.0, 1.5, 2.0, 3.0, 4.0, 6.0, 10.0])


def walker_at(times: Any, beside: float) -> np.ndarray:
    """Somebody who walks towards the vehicle, or past it."""
    clock = np.asarray(times, dtype=float)
    return np.stack([4.0 - SPEED * clock, np.full_like(clock, beside)], axis=-1)


def course(now: float, beside: float, growth: float) -> dict[str, Any]:
    """What is foretold of that, ever less surely."""
    spread = (0.03 + growth * LEADS**2) ** 2
    return {
        "time": (now + LEADS).tolist(),
        "position": walker_at(now + LEADS, beside).tolist(),
        "covariance": [[[each, 0.0], [0.0, each]] for each in spread.tolist()],
    }


def planner_of(beside: float, growth: float) -> Planner:
    walker = {"id": "walker", "shape": {"disc": SIZE}, "motion": course(0.0, beside, growth)}
    return Planner(scene(walker, start={"speed": 0.0}), online=OnlineSettings(period=PERIOD))


@pytest.mark.parametrize(("beside", "growth"), [(0.3, 0.6), (0.6, 1.0)])
def test_vehicle_that_is_walked_at_leaves_though_nothing_is_safe(beside: float, growth: float) -> None:
    """The zone soon fills all that it can reach; standing, it would be in the middle of where the walker goes."""
    planner, unsafe = planner_of(beside, growth), 0
    place, heading, speed = np.zeros(2), 0.0, 0.0
    for number in range(50):
        now = number * PERIOD
        if number:
            planner.update_motion("walker", course(now, beside, growth))
        plan = planner.replan(now, place, heading, speed)
        unsafe += not plan.safe
        times = np.linspace(now, now + PERIOD, 6)
        away = np.linalg.norm(plan.position(times) - walker_at(times, beside), axis=1)
        assert away.min() >= SIZE + 0.3
        place, heading = plan.position(now + PERIOD), float(plan.heading(now + PERIOD))
        speed = max(float(plan.speed(now + PERIOD)), 0.0)
    assert unsafe > 5


def test_odds_are_the_share_of_zones_that_dodges_keep_clear_of() -> None:
    planner = planner_of(0.3, 0.6)
    plan = planner.replan(0.0, np.zeros(2), 0.0, 0.0)
    assert planner._state is not None
    moment = planner._means.moment(planner._state)
    vehicle, box = moment.scenario.vehicle, DodgeOutlooks.box(moment)
    dodges = Evasion(planner._means)._dodges(moment)
    found = odds(moment, dodges, box)
    until, width = GAIN * a_moment(vehicle), 2.0 * vehicle.radius
    (zone,) = moment.zones
    for number in range(0, len(found), 7):
        least, way = 1.0, 0.0
        for k, time in enumerate(dodges.times):
            place = moment.frame.to_world(dodges.position[number, k])
            if k and dodges.times[k - 1] <= until:
                way += float(np.linalg.norm(dodges.position[number, k] - dodges.position[number, k - 1]))
            offset = place - zone.center(np.array([time]))[0]
            away = float(np.linalg.norm(offset))
            spread = np.squeeze(zone.covariance(np.array([min(time, until)])))
            extent = float(np.sqrt(offset @ spread @ offset)) / away
            gap = away - SIZE - vehicle.radius
            late = width * (1.0 + FADING * time / a_moment(vehicle))
            least = min(least, gap / extent if gap > 0.0 else gap / late)
        assert found[number] == pytest.approx(least - STEADY * min(way / width, 1.0), abs=1e-6)
    assert found.max() > found[0] + STEADY, "the first one stands"
    driven = Stop(dodges.trip(int(found.argmax()), moment.frame), 0.0)
    assert odds_of_stop(moment, driven, dodges.times) == pytest.approx(found.max(), abs=1e-3)
    assert plan.trip is not driven.trip


def test_what_is_known_exactly_is_kept_clear_of_or_not() -> None:
    planner = Planner(scene(disc("post", (3.0, 0.0)), start={"speed": 0.0}), online=OnlineSettings(period=PERIOD))
    planner.replan(0.0, np.zeros(2), 0.0, 0.0)
    assert planner._state is not None
    moment = planner._means.moment(planner._state)
    dodges = Evasion(planner._means)._dodges(moment)
    found = odds(moment, dodges, DodgeOutlooks.box(moment))
    away = np.linalg.norm(dodges.position - moment.frame.to_frame(np.array([3.0, 0.0])), axis=2).min(axis=1)
    hits = away < 0.8
    assert hits.any() and (~hits).any()
    assert found[~hits].min() >= 1.0 - STEADY and found[hits].max() < 0.0
