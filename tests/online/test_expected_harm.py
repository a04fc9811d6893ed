"""What is driven where nothing is safe: what is least likely to be touched, and least of all while it drives fast."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from scenes import disc, scene
from scipy.stats import chi2, norm

from scp_planner.online import evasion
from scp_planner.online.dodge_outlooks import DodgeOutlooks
from scp_planner.online.dodge_worth import FADING, a_moment
from scp_planner.online.dodges import Dodges
from scp_planner.online.evasion import Evasion
from scp_planner.online.expected_harm import (
    CREEPING_HARM,
    GROWS,
    SETTING_OFF,
    STANDING_HARM,
    harms_of_dodges,
    harms_of_trips,
)
from scp_planner.online.fallback import Fallback
from scp_planner.online.means import Replan
from scp_planner.online.plan import AWAY
from scp_planner.online.planner import Planner
from scp_planner.online.renewal import Renewal
from scp_planner.online.vetting import Moment
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


def seen_by(planner: Planner) -> tuple[Moment, Dodges]:
    """What a planner that has replanned sees, and its dodges."""
    assert planner._state is not None
    moment = planner._means.moment(planner._state)
    return moment, Evasion(planner._means)._dodges(moment)


@pytest.mark.parametrize("standing", [STANDING_HARM, CREEPING_HARM])
@pytest.mark.parametrize("touched", [False, True])
def test_harm_is_how_likely_a_normal_error_closes_the_gap(touched: bool, standing: float) -> None:
    """Sample by sample, with the true speeds of the trips; of who is touched already the mean over the times."""
    planner = planner_of(0.3, 0.6)
    now = 2.7 if touched else 0.0
    if touched:
        planner.update_motion("walker", course(now, 0.3, 0.6))
    planner.replan(now, np.zeros(2), 0.0, 0.0)
    moment, dodges = seen_by(planner)
    vehicle, confidence = moment.scenario.vehicle, planner._means.given.confidence
    by = confidence, standing
    found = harms_of_dodges(moment, dodges, DodgeOutlooks.box(moment), *by)
    scale = np.sqrt(chi2.ppf(confidence.probability, 2))
    (zone,) = moment.zones
    step = dodges.times[1]
    for number in range(0, len(found), 7):
        trip, each, fading = dodges.trip(number, moment.frame), [], []
        for time in dodges.times:
            points, _ = trip.at(now + time)
            (place,) = trip.frame.to_world(points.path.position)
            offset = place - zone.center(np.array([now + time]))[0]
            away = float(np.linalg.norm(offset))
            spread = np.squeeze(zone.covariance(np.array([now + min(time, GROWS * a_moment(vehicle))])))
            deviation = float(np.sqrt(offset @ spread @ offset)) / away / scale
            driven = trip.at(now + time + step)[0].distance[0] - points.distance[0]
            counts = CREEPING_HARM + (1.0 - CREEPING_HARM) * driven / step / vehicle.max_speed
            fading.append(1.0 / (1.0 + FADING * time / a_moment(vehicle)))
            probability = norm.cdf((SIZE + vehicle.radius - away) / deviation)
            each.append((counts if driven > 1e-3 * step else standing) * probability * fading[-1])
        sets_off = trip.at(now + step)[0].distance[0] > 1e-3 * step
        more = SETTING_OFF * (CREEPING_HARM - standing) if sets_off else 0.0
        expected = sum(each) / sum(fading) + more if touched else max(each)
        assert found[number] == pytest.approx(expected, abs=2e-3)
        assert harms_of_trips(moment, [trip], dodges.times, *by) == pytest.approx([expected], abs=2e-3)
    assert touched or found.min() < 0.7 * found[0], "the first one stands"


@pytest.mark.parametrize(("standing", "driving", "stays"), [(0.2, 0.16, True), (0.05, 0.035, True), (0.2, 0.1, False)])
def test_who_stands_sets_off_only_for_clearly_less_harm(
    standing: float, driving: float, stays: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    planner = planner_of(0.3, 0.6)
    planner.replan(0.0, np.zeros(2), 0.0, 0.0)
    moment, dodges = seen_by(planner)
    still = dodges.until <= dodges.wait
    assert still.any() and (~still).any()
    monkeypatch.setattr(evasion, "harms_of_dodges", lambda *_: np.where(still, standing, driving))
    now = Replan(moment, 0.0, math.inf, None, 1)
    found = Evasion(planner._means).least_harmful(now, ())
    assert isinstance(found, evasion.Dodge) and found.moves is not stays


def test_what_does_least_harm_is_safe_if_it_is_certified(monkeypatch: pytest.MonkeyPatch) -> None:
    """It may be none of those that were tried before: then it has its stop, and is not said to lead to the goal."""
    monkeypatch.setattr(evasion, "TRIED", 0)
    planner = Planner(scene(disc("parked", (20.0, 0.0), radius=2.0)), online=OnlineSettings(period=PERIOD))
    planner.replan(0.0, np.zeros(2), 0.0, 0.0)
    moment, _ = seen_by(planner)
    now = Replan(moment, 0.0, math.inf, None, 1)
    plan = Fallback(planner._means)._give_way(now, Renewal(planner._means, now), "nothing was found")
    assert plan.outcome in AWAY and plan.safe and plan.stop is not None and not plan.certified
    assert "nothing is safe" not in str(plan.reason)


def test_several_who_may_come_are_independent() -> None:
    both, planners = {"a": 1.2, "b": -1.4}, {}
    for names in ("a", "b", "ab"):
        walkers = [{"id": name, "shape": {"disc": SIZE}, "motion": course(0.0, both[name], 0.3)} for name in names]
        planners[names] = Planner(
            scene(*walkers, start={"speed": 0.0}, confidence={"probability": 0.9, "level": "per_time"}),
            online=OnlineSettings(period=PERIOD),
        )
    harms = {}
    for names, planner in planners.items():
        planner.replan(0.0, np.zeros(2), 0.0, 0.0)
        moment, dodges = seen_by(planner)
        harms[names] = harms_of_dodges(
            moment, dodges, DodgeOutlooks.box(moment), planner._means.given.confidence, STANDING_HARM
        )
    assert harms["a"].max() > 0.2 and harms["b"].max() > 0.2
    np.testing.assert_allclose(1.0 - harms["ab"], (1.0 - harms["a"]) * (1.0 - harms["b"]), atol=1e-9)


def test_what_is_known_exactly_is_kept_clear_of_or_not() -> None:
    planner = Planner(scene(disc("post", (3.0, 0.0)), start={"speed": 0.0}), online=OnlineSettings(period=PERIOD))
    planner.replan(0.0, np.zeros(2), 0.0, 0.0)
    moment, dodges = seen_by(planner)
    found = harms_of_dodges(moment, dodges, DodgeOutlooks.box(moment), planner._means.given.confidence, STANDING_HARM)
    away = np.linalg.norm(dodges.position - moment.frame.to_frame(np.array([3.0, 0.0])), axis=2)
    hits = away.min(axis=1) < 0.8
    assert hits.any() and (~hits).any()
    late = dodges.times[(away < 0.8).argmax(axis=1)] / a_moment(moment.scenario.vehicle)
    assert found[~hits].max() == 0.0
    assert np.all(found[hits] >= STANDING_HARM / (1.0 + FADING * late[hits]) - 1e-12)
