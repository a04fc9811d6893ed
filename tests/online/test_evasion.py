"""Out of the way: what is promised of a stop, and people who walk at a vehicle that stands."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scenes import disc, scene

import scp_planner as sp
from scp_planner.online.plan import OnlinePlan, Outcome
from scp_planner.online.planner import Planner
from scp_planner.online.reasons import ReasonCode
from scp_planner.online.stops import standing_from
from scp_planner.scenario.models import Steering
from scp_planner.settings.online import GiveWay, OnlineSettings
from scp_planner.simulation.crowds import WALKER, among_people

SCALE = math.sqrt(-2.0 * math.log(0.05))
"""Of the region of two normal errors at 95 %."""
PERIOD = 0.2


def follow(planner: Planner, time: float) -> OnlinePlan:
    plan = planner.plan
    assert plan is not None
    return planner.replan(time, plan.position(time), float(plan.heading(time)), max(float(plan.speed(time)), 0.0))


@pytest.mark.parametrize("steering", Steering)
def test_vehicle_that_stands_gets_out_of_the_way(steering: Steering) -> None:
    """There is no way to its goal, so it waits, where somebody would walk over it."""
    scenario = scene(
        disc("walker", (0.1, -2.5), (0.0, 1.0), radius=0.3),
        {"id": "wall", "shape": {"rectangle": [0.4, 20.0], "heading": 0.0}, "motion": {"position": [2.0, 0.0]}},
        bounds={"min": (-5.0, -5.0), "max": (10.0, 5.0)},
        start={"speed": 0.0},
        goal={"position": (8.0, 0.0)},
        vehicle={"max_speed": 1.0, "max_curvature": 2.0, "steering": steering},
    )

    planner = Planner(scenario, online=OnlineSettings(period=PERIOD))
    planner.replan(0.0, (0.0, 0.0), 0.0, 0.0)
    outcomes = set()
    for k in range(1, 18):  # until it has passed
        plan = planner.plan
        assert plan is not None and plan.reason
        times = np.linspace((k - 1) * PERIOD, k * PERIOD, 5)
        walker = np.stack([np.full(5, 0.1), times - 2.5], axis=1)
        assert np.linalg.norm(plan.position(times) - walker, axis=1).min() >= 0.6 - 1e-9
        outcomes.add(plan.outcome)
        follow(planner, k * PERIOD)
    assert Outcome.EVADING in outcomes


def test_goal_that_is_blocked_is_approached_as_near_as_is_safe() -> None:
    scenario = scene(disc("post", (8.0, 0.0), radius=0.6), goal={"position": (8.0, 0.0)}, vehicle={"max_speed": 1.0})
    planner = Planner(scenario, online=OnlineSettings(period=PERIOD))
    planner.replan(0.0, (0.0, 0.0), 0.0, 1.0)
    for k in range(1, 60):
        plan = follow(planner, PERIOD * k)
        assert plan.safe and plan.reason
    assert plan.outcome is Outcome.BRAKING and plan.code is ReasonCode.BLOCKED and plan.obstacle == "post"
    away = float(np.linalg.norm(plan.position(12.0) - (8.0, 0.0)))
    assert 0.9 <= away <= 1.3


POST = disc("post", (4.0, 0.62), radius=0.3)
SLOW = {"max_speed": 1.0, "steering": Steering.ANY}


def test_giving_way_early_keeps_farther_away() -> None:
    """Somebody stands beside the way, nearly in it: a trip passes as near as it may."""
    least = {}
    for way in GiveWay:
        scenario = scene(POST, goal={"position": (8.0, 0.0), "radius": 0.3}, start={"speed": 0.0}, vehicle=SLOW)
        planner = Planner(scenario, online=OnlineSettings(give_way=way))
        plan, k = planner.replan(0.0, (0.0, 0.0), 0.0, 0.0), 0
        places = [plan.position(0.0)]
        while not plan.arrived and k < 60:
            places.extend(plan.position(0.25 * k + np.linspace(0.0, 0.25, 6)))
            k += 1
            plan = follow(planner, 0.25 * k)
            assert plan.safe
        assert plan.arrived
        least[way] = np.linalg.norm(np.array(places) - (4.0, 0.62), axis=1).min() - 0.6
    assert least[GiveWay.LATE] < 0.05
    assert least[GiveWay.EARLY] > 0.12


@pytest.mark.parametrize(
    ("posts", "half_width"),
    [([(7.6, 0.75)], 9.0), ([(3.0 + x, side * 0.63) for x in (0.0, 0.5, 1.0) for side in (1.0, -1.0)], 0.95)],
    ids=["somebody stands beside the goal", "there is hardly room, and no other way"],
)
def test_giving_way_early_arrives(posts: list[tuple[float, float]], half_width: float) -> None:
    """More room is worth waiting for, but not for ever; and who has arrived needs no more of it."""
    scenario = scene(
        *(disc(f"post {k}", place, radius=0.3) for k, place in enumerate(posts)),
        goal={"position": (8.0, 0.0)},
        start={"speed": 0.0, "position": (2.0, 0.0)},
        vehicle=SLOW,
        bounds={"min": (-1.0, -half_width), "max": (9.0, half_width)},
    )
    planner = Planner(scenario, online=OnlineSettings(give_way=GiveWay.EARLY))
    plan, k = planner.replan(0.0, (2.0, 0.0), 0.0, 0.0), 0
    while not plan.arrived and k < 100:
        k += 1
        plan = follow(planner, 0.25 * k)
        assert plan.safe
    assert plan.arrived and 0.25 * k < 14.0


def test_a_turn_that_was_begun_is_gone_on_with() -> None:
    """The crosser speeds up. If each replan began a turn of its own, straight on at first, it would never turn.

    A limited rate of the curvature gives such turns.
    """

    def speeds_up(time: float | np.ndarray) -> np.ndarray:
        t = np.asarray(time, dtype=float)
        rising = np.clip(t - 2.0, 0.0, 2.0)
        y = t - 5.0 + 0.25 * rising**2 + 0.5 * rising * (np.maximum(t - 2.0, 0.0) - rising)
        return np.stack([np.full_like(t, 11.0), y], axis=-1)

    crosser = {"id": "a", "shape": {"disc": 0.5}, "motion": {"position": [11.0, -5.0], "velocity": [0.0, 1.0]}}
    vehicle = {"max_lateral_acceleration": None, "max_curvature": 1.0, "max_curvature_rate": 8.0}
    scenario = scene(crosser, vehicle=vehicle, start={"speed": 1.0})
    late = OnlineSettings(changes=0.0)  # else what comes is expected to, and little is left to evade
    run = sp.simulate(scenario, noise=0.1, rate=10.0, seed=0, world={"a": speeds_up}, online=late)
    assert run.arrived and not run.contact
    assert math.dist(run.position[-1], (20.0, 0.0)) < 0.1
    assert any(cycle.code == ReasonCode.NOTHING_SAFE and cycle.outcome == Outcome.EVADING for cycle in run.records)


@pytest.mark.parametrize(("begins", "velocity"), [((-2.0, 0.05), (3.0, 0.0)), ((0.3, 0.1), (0.0, 0.0))])
def test_where_nothing_is_safe_it_says_for_whom_and_how_long(
    begins: tuple[float, float], velocity: tuple[float, float]
) -> None:
    """Somebody who is too fast to be evaded, and somebody who stands and touches it already."""
    scenario = scene(
        disc("walker", (5.0, 5.0), radius=0.3),
        start={"speed": 0.0},
        vehicle={"max_speed": 1.0, "max_acceleration": 0.5, "max_deceleration": 0.5, "steering": "any"},
    )
    planner = Planner(scenario, online=OnlineSettings(period=PERIOD))
    planner.update_motion("walker", {"position": begins, "velocity": velocity})
    plan = planner.replan(0.0, (0.0, 0.0), None, 0.0)
    assert not plan.safe and plan.code is ReasonCode.NOTHING_SAFE and plan.obstacle == "walker"
    if velocity[0] == 0.0:
        assert plan.lasts is None
    else:  # until the discs, which touch at 0.6 m, are apart again
        assert plan.lasts == pytest.approx((2.0 + math.sqrt(0.6**2 - 0.05**2)) / 3.0, abs=0.05)
    severities = [each.severity for each in plan.candidates if each.severity is not None]
    assert severities and all(0.0 <= each <= 1.0 for each in severities)


def test_vehicle_brakes_before_posts_where_going_on_does_hardly_less_harm() -> None:
    """Two posts at the way turn out to be known badly when the vehicle can neither stop nor turn before them."""

    def predicted(side: float, deviation: float) -> dict[str, Any]:
        spread = [[deviation**2, 0.0], [0.0, deviation**2]]
        return {"time": [0.0, 30.0], "position": 2 * [[19.0, side]], "covariance": 2 * [spread]}

    posts = {"left": 1.6, "right": -1.6}
    planner = Planner(scene(*(disc(name, (19.0, side)) for name, side in posts.items()), start={"speed": 3.0}))
    first = planner.replan(0.0, (0.0, 0.0), 0.0, 3.0)
    assert first.certified
    for name, side in posts.items():
        planner.update_motion(name, predicted(side, 0.35))
    for time in (17.0 / 3.0, 17.4 / 3.0):
        plan = follow(planner, time)
        assert plan.outcome is Outcome.BRAKING and not plan.safe and not plan.certified
        assert plan.code is ReasonCode.NOTHING_SAFE
        x, y = plan.position(np.linspace(time, plan.arrival_time, 50)).T
        assert np.abs(y).max() < 0.1 and x[-1] < 19.5
    for zone in planner.zones:
        region = math.sqrt(zone.covariance(np.array([6.0]))[0, 0, 0])
        assert region > 1.6 - 0.5 - 0.3


def reachable(name: str, time: float, place: np.ndarray, velocity: np.ndarray, most: float) -> dict[str, Any]:
    """Somebody whose acceleration is at most so much: in a disc that grows with the square of time."""
    later = np.concatenate([np.linspace(0.0, 8.0, 65)])
    deviation = (0.5 * most * later**2 + 1e-3) / SCALE
    return {
        "id": name,
        "shape": {"disc": 0.3},
        "motion": {
            "time": (time + later).tolist(),
            "position": (place + later[:, None] * velocity).tolist(),
            "covariance": [(one**2 * np.eye(2)).tolist() for one in deviation],
        },
    }


class Hunters:
    """People who walk at the vehicle as hard as they may."""

    def __init__(self, seed: int, most: float) -> None:
        rng = np.random.default_rng(seed)
        self.most = most
        angle = rng.uniform(0.0, 2.0 * math.pi, 3)
        self.place = np.array([3.5, 0.0]) + rng.uniform(2.5, 4.5, (3, 1)) * np.stack([np.cos(angle), np.sin(angle)], 1)
        self.velocity = rng.uniform(-0.6, 0.6, (3, 2))

    def copy(self) -> Hunters:
        other = object.__new__(Hunters)
        other.most, other.place, other.velocity = self.most, self.place.copy(), self.velocity.copy()
        return other

    def hunt(self, position: np.ndarray, dt: float) -> float:
        """Move on; return the least distance to the vehicle then."""
        towards = position - self.place
        unit = towards / np.maximum(np.linalg.norm(towards, axis=1), 1e-9)[:, None]
        self.place = self.place + dt * self.velocity + 0.5 * dt * dt * self.most * unit
        self.velocity = self.velocity + dt * self.most * unit
        return float(np.linalg.norm(position - self.place, axis=1).min()) - 0.6

    def shown(self, planner: Planner, time: float) -> None:
        for k, (place, velocity) in enumerate(zip(self.place, self.velocity, strict=True)):
            if f"h{k}" in planner.obstacles.tracks:
                planner.remove_obstacle(f"h{k}")
            planner.add_obstacle(reachable(f"h{k}", time, place, velocity, self.most))


def promised(plan: OnlinePlan, times: np.ndarray) -> np.ndarray:
    """Positions along a plan up to its branch, and then along its stop."""
    if plan.stop is None:
        return plan.position(times)
    stop = plan.stop.frame.to_world(plan.stop.at(times)[0].path.position)
    return np.where((times <= plan.branch_time)[:, None], plan.position(times), stop)


@pytest.mark.parametrize(
    ("seed", "way", "jerk"),
    [
        *((seed, GiveWay.LATE, None) for seed in (0, 2, 5)),
        *(pytest.param(seed, GiveWay.LATE, None, marks=pytest.mark.slow) for seed in (1, 3)),
        (0, GiveWay.EARLY, None),
        (1, GiveWay.EARLY, None),
        (5, GiveWay.LATE, 2.0),
    ],
)
def test_what_is_safe_is_not_hit_by_whoever_keeps_to_the_assumptions(
    seed: int, way: GiveWay, jerk: float | None
) -> None:
    """Whatever they do within their zones, with no replan ever after, up to when the vehicle stands."""
    scenario = scene(
        start={"speed": 0.5},
        goal={"position": (8.0, 0.0)},
        vehicle={"max_speed": 1.5, "max_jerk": jerk},
        confidence={"probability": 0.95, "level": "per_time"},
    )
    planner, hunters = Planner(scenario, online=OnlineSettings(period=PERIOD, give_way=way)), Hunters(seed, 0.15)
    time, promises = 0.0, 0
    hunters.shown(planner, time)
    plan = planner.replan(time, (0.0, 0.0), 0.0, 0.5)
    for k in range(1, 9):
        if plan.safe:
            promises += 1
            ends = (
                plan.arrival_time if plan.stop is None else plan.stop.frame.time + standing_from(plan.stop.trajectory)
            )
            times = np.arange(time, ends, 0.02)
            fork = hunters.copy()
            for place in promised(plan, times)[1:]:
                assert fork.hunt(place, 0.02) >= -1e-3
        for place in plan.position(np.arange(1, 11) * 0.02 + time):
            hunters.hunt(place, 0.02)
        time = k * PERIOD
        hunters.shown(planner, time)
        plan = follow(planner, time)
        assert not planner.doubts, "they keep to what is assumed of them"
    assert promises >= 1


@pytest.mark.parametrize("among", [False, True], ids=["default", "among people"])
def test_assumptions_on_what_is_observed_are_told_in_every_profile(among: bool) -> None:
    """Somebody who is seen walks straight on, and within one period jumps aside by a metre; then the rest fails too."""
    scenario = scene(goal={"position": (8.0, 0.0)}, start={"speed": 0.0}, vehicle=SLOW)
    settings = OnlineSettings(tracking_error=0.05)
    if among:
        settings = replace(among_people(scenario.vehicle, PERIOD), tracking_error=0.05)
    planner = Planner(scenario, online=replace(settings, period=PERIOD))
    planner.add_obstacle("a", {"disc": 0.3}, covariance=1e-6 * np.eye(2), model=WALKER)
    for k in range(-10, 1):
        planner.observe("a", k * PERIOD, (6.0 - 0.5 * k * PERIOD, 3.0))
    planner.replan(0.0, (0.0, 0.0), None, 0.0)
    planner.observe("a", PERIOD, (6.0 - 0.5 * PERIOD, 3.0))
    follow(planner, PERIOD)
    assert not planner.doubts
    # An observation may be left out as a fault of the sensor: who does that is seen there again and again.
    for k in range(2, 6):
        planner.observe("a", k * PERIOD, (6.0 - 0.5 * k * PERIOD, 4.0))
        follow(planner, k * PERIOD)
    assert sum("a has left its zone" in doubt for doubt in planner.doubts) >= 1
    planner.doubts.clear()
    plan = follow(planner, 7.0 * PERIOD)
    assert any("longer than the period" in doubt for doubt in planner.doubts)
    planner.doubts.clear()
    after = 8.0 * PERIOD
    planner.replan(after, plan.position(after) + np.array([0.0, 0.2]), None, max(float(plan.speed(after)), 0.0))
    assert any("0.2 m off its plan" in doubt for doubt in planner.doubts)


def test_a_stop_must_stay_clear_for_as_long_as_is_stated() -> None:
    """Somebody comes over where it would stand, three seconds after it would: that counts only if one looks so far."""
    walker = disc("walker", (4.0, -8.0), (0.0, 1.0), radius=0.4)
    safe = {}
    for wait in (0.0, 4.0):
        scenario = scene(
            walker, start={"speed": 0.0, "position": (4.0, -3.0)}, bounds={"min": (3.6, -9.0), "max": (30.0, 9.0)}
        )
        planner = Planner(scenario, online=OnlineSettings(stay_clear=wait))
        plan = planner.replan(0.0, (4.0, -3.0), 0.0, 0.0)
        safe[wait] = plan
        assert plan.safe
        if plan.stop is not None:
            stands = plan.stop.frame.time + standing_from(plan.stop.trajectory)
            place = plan.stop.frame.to_world(plan.stop.at(stands)[0].path.position)[0]
            times = np.linspace(stands, stands + wait, 50)
            away = np.linalg.norm(place - np.stack([np.full(50, 4.0), -8.0 + times], axis=1), axis=1)
            assert away.min() >= 0.7 - 1e-6
    assert sp.certify(planner.scenario, safe[4.0]).clearance.minimum >= 0.0


def test_in_a_narrow_room_no_manoeuvre_ends_where_no_trip_leads_on() -> None:
    """Something blocks the room for a while. The vehicle cannot turn round there: turned to a wall it would stay."""
    planner = Planner(scene(bounds={"min": (-2.0, -1.1), "max": (26.0, 1.1)}), online=OnlineSettings(iterations=6))
    plan = planner.replan(0.0, (0.0, 0.0), 0.0, 1.0)
    for k in range(20, 75):
        time = 0.1 * k
        place = plan.position(time)
        if k == 21:
            planner.add_obstacle(disc("post", (float(plan.position(2.0)[0]) + 5.0, 0.0), radius=1.2))
        if k == 62:
            planner.remove_obstacle("post")
            stood = place
        plan = planner.replan(time, place, float(plan.heading(time)), max(float(plan.speed(time)), 0.0))
    assert float(plan.position(7.4)[0]) > stood[0] + 0.2
    assert plan.arrival_time < 20.0


SPEED, SIZE = 1.2, 0.6
LEADS = np.array([0.0, 0.25, 0.5, 1.0, 1.5, 2.0, 3.0, 4.0, 6.0, 10.0])


def walker_at(times: Any, beside: float) -> np.ndarray:
    """Somebody who walks towards the vehicle, or past it."""
    clock = np.asarray(times, dtype=float)
    return np.stack([4.0 - SPEED * clock, np.full_like(clock, beside)], axis=-1)


def course(now: float, beside: float, growth: float) -> dict[str, Any]:
    """Prediction of that motion, ever less certain."""
    spread = (0.03 + growth * LEADS**2) ** 2
    return {
        "time": (now + LEADS).tolist(),
        "position": walker_at(now + LEADS, beside).tolist(),
        "covariance": [[[each, 0.0], [0.0, each]] for each in spread.tolist()],
    }


@pytest.mark.parametrize(("beside", "growth"), [(0.3, 0.6), (0.6, 1.0)])
def test_vehicle_that_is_walked_at_leaves_though_nothing_is_safe(beside: float, growth: float) -> None:
    """The zone soon fills all that it can reach; standing, it would be in the middle of where the walker goes."""
    walker = {"id": "walker", "shape": {"disc": SIZE}, "motion": course(0.0, beside, growth)}
    planner, unsafe = Planner(scene(walker, start={"speed": 0.0}), online=OnlineSettings(period=0.1)), 0
    place, heading, speed = np.zeros(2), 0.0, 0.0
    for number in range(50):
        now = number * 0.1
        if number:
            planner.update_motion("walker", course(now, beside, growth))
        plan = planner.replan(now, place, heading, speed)
        unsafe += not plan.safe
        times = np.linspace(now, now + 0.1, 6)
        away = np.linalg.norm(plan.position(times) - walker_at(times, beside), axis=1)
        assert away.min() >= SIZE + 0.3
        place, heading = plan.position(now + 0.1), float(plan.heading(now + 0.1))
        speed = max(float(plan.speed(now + 0.1)), 0.0)
    assert unsafe > 5
