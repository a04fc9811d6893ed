"""Planning while driving: outcomes and their reasons, what is observed, deadlines, misuse."""

from __future__ import annotations

import copy
import math
import pickle
from collections.abc import Callable

import numpy as np
import pytest
from replanning import PERIOD, WALL, NoSolver, begin, follow, observed, seen
from scenes import CROSSERS, disc, scene
from scipy.stats import chi2
from shapely import Point, Polygon

import scp_planner as sp
from scp_planner.online import decision
from scp_planner.online.plan import Outcome
from scp_planner.online.planner import Planner
from scp_planner.online.reasons import CandidateKind, ReasonCode
from scp_planner.planning.plan import PlanStatus
from scp_planner.settings.online import OnlineSettings, Safety
from verification.dense_check import check_trip

pytestmark = pytest.mark.numerics


def test_first_plan_is_certified_and_says_so() -> None:
    scenario = scene(*CROSSERS)
    plan = begin(Planner(scenario), scenario)
    assert plan.outcome is Outcome.IMPROVED and plan.code is ReasonCode.DRIVING
    assert plan.lasts == pytest.approx(plan.travel_time)
    assert [(each.kind, each.chosen) for each in plan.candidates] == [(CandidateKind.ROUTE, True)]
    assert plan.certified and plan.safe and plan.stop is None
    # The loop of a replan is coarser than that of a plan, but not by much.
    assert plan.travel_time == pytest.approx(sp.plan(scenario).travel_time, rel=0.02)


def test_plans_are_improved_on_the_way_and_never_get_slower_among_known_motions() -> None:
    scenario = scene(*CROSSERS)
    planner = Planner(scenario)
    arrivals = [begin(planner, scenario).arrival_time]
    for k in range(1, 60):
        plan = follow(planner, k * PERIOD)
        assert plan.outcome in (Outcome.IMPROVED, Outcome.KEPT) and plan.certified
        arrivals.append(plan.arrival_time)
    assert np.diff(arrivals).max() <= decision.DECISION.slower
    assert arrivals[-1] <= arrivals[0] + 0.02


@pytest.mark.parametrize("near_goal", [True, False])
def test_last_plan_is_kept_while_its_certificate_holds(near_goal: bool) -> None:
    """Near the goal; or where the solver fails and what is left, fitted anew, is worse."""
    scenario = scene(*CROSSERS)
    planner = Planner(scenario)
    first = begin(planner, scenario)
    planner.solver = NoSolver()
    kept = follow(planner, first.arrival_time - 0.2) if near_goal else None
    time = 0.0
    while kept is None or kept.outcome is not Outcome.KEPT:
        time += PERIOD
        assert time < first.arrival_time
        kept = follow(planner, time)
        assert kept.certified
    assert kept.trip.frame.time < time or near_goal
    (chosen,) = (each for each in kept.candidates if each.chosen)
    assert chosen.kind is CandidateKind.LAST and chosen.safe and not chosen.verdict and str(chosen) in kept.explanation


def test_vehicle_brakes_before_what_blocks_its_way_and_goes_on_when_it_is_gone() -> None:
    scenario = scene(bounds={"min": (-2.0, -1.0), "max": (21.0, 1.0)})
    planner = Planner(scenario)
    begin(planner, scenario)
    time = 2.0
    plan = follow(planner, time)
    post = float(plan.position(time)[0]) + 5.0
    planner.add_obstacle(disc("post", (post, 0.0), radius=0.9))
    outcomes = []
    for k in range(1, 31):
        plan = follow(planner, time + k * PERIOD)
        outcomes.append(plan.outcome)
        assert plan.safe and plan.reason
    assert outcomes[-1] is Outcome.BRAKING and not plan.certified
    assert plan.code is ReasonCode.BLOCKED and plan.obstacle == "post" and plan.lasts is None
    assert plan.reason == "post blocks the way to the goal; the vehicle stands."
    assert np.linalg.norm(plan.position(time + 3.0) - (post, 0.0)) >= 0.9 + scenario.vehicle.radius
    planner.remove_obstacle("post")
    plans = [follow(planner, time + k * PERIOD) for k in range(31, 42)]
    assert any(plan.outcome is Outcome.IMPROVED for plan in plans[:5])
    plan = plans[-1]
    assert plan.certified
    assert plan.position(plan.arrival_time) == pytest.approx(scenario.goal.position, abs=1e-6)


def test_least_bad_stop_is_driven_where_none_is_certified() -> None:
    scenario = scene(start={"speed": 3.0})
    planner = Planner(scenario)
    begin(planner, scenario)
    position = planner.plan.position(1.0)  # type: ignore[union-attr]
    planner.add_obstacle({"id": "wall", "shape": WALL, "motion": {"position": [position[0] + 1.5, 0.0]}})
    plan = follow(planner, 1.0)
    assert plan.outcome is Outcome.BRAKING and not plan.safe and not plan.certified
    assert plan.code is ReasonCode.NOTHING_SAFE and plan.obstacle == "wall"
    assert sum(each.chosen for each in plan.candidates) == 1 and not any(each.safe for each in plan.candidates)
    assert any("clearance to wall" in each.verdict for each in plan.candidates)
    # It brakes as hard as it may.
    assert float(plan.speed(1.0 + 0.5)) == pytest.approx(3.0 - 0.5 * scenario.vehicle.max_deceleration, abs=0.05)


def test_whole_trips_are_certified_where_that_is_asked_for() -> None:
    scenario = scene(observed(seen("walker", (12.0, -6.0), (0.0, 0.8), 0.02)))
    planner = Planner(scenario, online=OnlineSettings(safety=Safety.TRIP))
    plan = begin(planner, scenario)
    assert plan.certified and plan.stop is None
    assert sp.certify(planner.scenario, plan).holds


def test_planner_says_so_after_arrival() -> None:
    scenario = scene()
    planner = Planner(scenario)
    plan = begin(planner, scenario)
    plan = planner.replan(plan.arrival_time, scenario.goal.position, 0.0, 2.0)
    assert plan.code is ReasonCode.ARRIVED and plan.outcome is Outcome.BRAKING
    assert plan.arrived and not begin(Planner(scenario), scenario).arrived


def test_vehicle_that_is_blown_off_its_plan_finds_back() -> None:
    scenario = scene(*CROSSERS)
    planner = Planner(scenario)
    begin(planner, scenario)
    plan = planner.replan(0.5, (0.6, 0.5), 0.4, 1.5)
    assert plan.outcome is Outcome.IMPROVED and plan.safe
    assert plan.position(0.5) == pytest.approx((0.6, 0.5), abs=1e-9)
    assert float(plan.heading(0.5)) == pytest.approx(0.4, abs=1e-6) and float(plan.speed(0.5)) == pytest.approx(1.5)
    assert all(follow(planner, 0.5 + k * PERIOD).safe for k in range(1, 6))
    assert planner.plan is not None and planner.plan.certified


def test_vehicle_faster_than_allowed_slows_down() -> None:
    scenario = scene()
    planner = Planner(scenario)
    begin(planner, scenario)
    plan = planner.replan(0.5, (1.0, 0.0), 0.0, 3.4)
    assert plan.safe and float(plan.speed(plan.arrival_time)) <= scenario.vehicle.max_speed + 1e-6


def test_one_side_is_chosen_and_kept() -> None:
    """An obstacle in the middle of the way, seen with noise: both sides are as good."""
    scenario = scene(observed(seen("post", (10.0, 0.0), (0.0, 0.0), 0.2, order=0)))
    planner = Planner(scenario)
    plan = begin(planner, scenario)
    rng = np.random.default_rng(3)
    sides = []
    for k in range(1, 36):
        time = k * PERIOD
        planner.observe("post", time, np.array([10.0, 0.0]) + 0.2 * rng.standard_normal(2))
        plan = follow(planner, time)
        track = plan.position(np.linspace(time, plan.arrival_time, 400))
        sides.append(np.sign(track[np.argmin(np.abs(track[:, 0] - 10.0)), 1]))
    assert np.count_nonzero(np.diff(sides)) <= 1


def test_a_faster_way_is_found_when_it_opens() -> None:
    """A wall of three discs leaves only a long way round, until one of them has gone."""
    posts = [disc(f"p{k}", (10.0, y), radius=1.3) for k, y in enumerate((-2.4, 0.0, 2.4))]
    scenario = scene(*posts)
    planner = Planner(scenario)
    before = begin(planner, scenario).arrival_time
    planner.remove_obstacle("p1")
    plans = [follow(planner, k * PERIOD) for k in range(1, 2 * planner.online.look_every)]
    assert any(each.chosen and each.kind is CandidateKind.ROUTE for plan in plans for each in plan.candidates)
    assert planner.plan is not None and planner.plan.arrival_time < before - 0.1


def test_margin_holds_tracking_error_and_reaction_time() -> None:
    scenario = scene(disc("d", (12.0, 0.0)))
    planner = Planner(scenario, online=OnlineSettings(tracking_error=0.05, reaction_time=0.02))
    plan = begin(planner, scenario)
    assert OnlineSettings(tracking_error=0.05, reaction_time=0.02).margin(3.0) == pytest.approx(0.11)
    assert planner.zones[0].radius == pytest.approx(0.5 + 0.11)
    track = plan.position(np.linspace(0.0, plan.arrival_time, 2000))
    assert np.linalg.norm(track - (12.0, 0.0), axis=1).min() >= 0.5 + 0.3 + 0.11
    report = check_trip(planner.scenario.to_dict(), plan.position, 0.0, plan.arrival_time)
    assert report.ok, str(report)


def test_without_a_deadline_the_same_calls_give_the_same_plans() -> None:
    scenario = scene(observed(seen("walker", (10.0, -6.0), (0.0, 1.0), 0.1)), *CROSSERS[:2])
    runs = []
    for _ in range(2):
        planner = Planner(scenario)
        plans = [begin(planner, scenario)]
        plans += [follow(planner, k * PERIOD) for k in range(1, 25)]
        runs.append([(plan.reason, plan.iterations, plan.position(9.0).tolist(), plan.arrival_time) for plan in plans])
    assert runs[0] == runs[1]


def test_what_is_driven_where_nothing_is_safe_is_less_likely_touched_than_braking() -> None:
    """Somebody is seen to have turned towards the vehicle; what it does is compared with braking by drawn errors."""
    scenario = scene(observed(seen("a", (12.0, -6.0), (0.0, 0.8), 0.1, order=2)), start={"speed": 2.5})
    planner, vehicle = Planner(scenario), scenario.vehicle
    begin(planner, scenario)
    rng, gains = np.random.default_rng(3), []
    errors = rng.standard_normal((4000, 2)) / math.sqrt(chi2.ppf(0.95, 2))
    ahead = np.linspace(0.0, 1.5, 16)
    for k in range(1, 50):
        time = 0.1 * k
        last = planner.plan
        assert last is not None
        here, heading, speed = last.position(time), float(last.heading(time)), float(last.speed(time))
        since = max(time - 1.0, 0.0)
        place = np.array([12.0 - 0.9 * since**2, -6.0 + 0.8 * time + 0.6 * since**2])
        planner.observe("a", time, place + 0.1 * rng.standard_normal(2))
        plan = follow(planner, time)
        if plan.safe:
            continue
        assert not plan.certified and plan.status is PlanStatus.INFEASIBLE
        (zone,) = planner.zones
        drawn = zone.center(time + ahead)[:, None] + errors @ np.linalg.cholesky(
            zone.covariance(time + ahead)
        ).transpose(0, 2, 1)
        until = np.minimum(ahead, speed / vehicle.max_deceleration)
        way = speed * until - 0.5 * vehicle.max_deceleration * until**2
        braking = here + way[:, None] * [math.cos(heading), math.sin(heading)]
        reach = zone.radius + vehicle.radius
        driven, braked = (
            float((np.linalg.norm(drawn - course[:, None], axis=2) < reach).mean(axis=1).max())
            for course in (plan.position(time + ahead), braking)
        )
        gains.append(braked - driven)
    assert len(gains) > 2 and min(gains) > -0.05 and max(gains) > 0.05


@pytest.mark.parametrize(("low", "high", "holds"), [(-4.0, -3.0, True), (-6.0, -5.0, False)])
@pytest.mark.parametrize("told", ["front", "driving"])
def test_the_middle_of_a_vehicle_that_backs_up_is_towards_its_front(
    low: float, high: float, holds: bool, told: str
) -> None:
    """At a stand on its way it may be told to head as its front does, or as it last drove."""
    region = [[low, -0.4], [high, -0.4], [high, 0.4], [low, 0.4]]
    scenario = sp.Scenario(
        vehicle={"radius": 0.3, "max_speed": 3.0, "max_acceleration": 1.5, "max_deceleration": 2.0}
        | {"steering": "both_ways", "centre": 1.0},
        start={"time": 0.0, "position": [0.0, 0.0], "heading": 0.0, "speed": 0.0},
        goal={"region": region, "position": [-4.5, 0.0]},
    )
    planner = sp.Planner(scenario)
    plan = planner.replan(0.0, (0.0, 0.0), 0.0, 0.0)
    assert plan.certified is holds
    assert sp.certify(planner.scenario, plan).holds is holds
    if not holds:
        return
    plan = planner.replan(1.0, plan.position(1.0), float(plan.heading(1.0)), float(plan.speed(1.0)))
    assert plan.certified and planner.scenario.vehicle.centre == -1.0
    at = plan.position(2.0)
    plan = planner.replan(2.0, at, 0.0 if told == "front" else np.pi, 0.0)
    assert plan.certified
    assert abs(abs(float(plan.heading(2.0))) - np.pi) < 1e-6
    assert low <= plan.position(plan.arrival_time)[0] + 1.0 <= high


def test_path_is_driven_slower_where_that_is_all_that_helps() -> None:
    scenario = scene()
    planner = Planner(scenario, online=OnlineSettings(safety=Safety.TRIP))
    first = begin(planner, scenario)
    meeting = first.position(5.0)
    planner.solver = NoSolver()
    planner.add_obstacle(disc("crosser", tuple(meeting - 5.0 * np.array([0.0, 1.0])), (0.0, 1.0), radius=0.4))
    plan = follow(planner, 1.0)
    assert plan.outcome is Outcome.REPAIRED and plan.certified
    assert plan.code is ReasonCode.GIVING_WAY and plan.obstacle == "crosser"
    path, driven = first.position(np.linspace(1.0, 7.0, 500)), plan.position(np.linspace(1.0, plan.arrival_time, 50))
    apart = np.linalg.norm(driven[:, None] - path, axis=2).min(axis=1)
    assert apart[driven[:, 0] < path[-1, 0]].max() < 0.02
    assert plan.arrival_time > first.arrival_time + 0.1
    report = check_trip(planner.scenario.to_dict(), plan.position, 1.0, plan.arrival_time)
    assert report.ok, str(report)


def test_who_is_late_answers_honestly_and_finds_back_to_a_plan() -> None:
    """A crowd comes into view, and for some replans there is no time at all."""
    planner = Planner(scene(goal={"position": [60.0, 0.0]}))
    planner.replan(0.0, (0.0, 0.0), 0.0, 1.0)
    for number, place in enumerate(np.random.default_rng(0).uniform((4.0, -8.0), (30.0, 8.0), (120, 2))):
        planner.add_obstacle(f"n{number}", {"disc": 0.4}, covariance=0.0025 * np.eye(2))
        planner.observe(f"n{number}", 0.1, place)
    for k in range(1, 4):
        plan = follow(planner, 0.1 * k, deadline=1e-9)
        assert plan.iterations == 0 and (plan.certified or plan.reason)
    for name in list(planner.obstacles.tracks):
        planner.remove_obstacle(name)
    plans = [follow(planner, 0.1 * k) for k in range(4, 12)]
    assert plans[-1].certified and any(one.outcome is Outcome.IMPROVED for one in plans)


@pytest.mark.parametrize("copied", [copy.copy, copy.deepcopy, lambda planner: pickle.loads(pickle.dumps(planner))])
def test_a_copy_goes_on_by_itself(copied: Callable[[Planner], Planner]) -> None:
    """It plans as the planner itself, which does not learn of what the copy is told."""
    planner = Planner(scene(disc("slow", (8.0, -1.0), (0.0, 0.3))))
    position, heading, speed = np.zeros(2), 0.0, 1.0
    for time in (0.0, 0.1, 0.2):
        other = copied(planner)
        plan = planner.replan(time, position, heading, speed)
        assert other.replan(time, position, heading, speed) == plan
        other.add_obstacle("only there", {"disc": 0.3})
        assert "only there" not in planner.obstacles.tracks
        ahead = time + 0.1
        position, heading, speed = plan.position(ahead), float(plan.heading(ahead)), float(plan.speed(ahead))


def test_what_is_safe_stays_so_at_the_rate_of_the_replans_where_no_period_is_given() -> None:
    """The default period of this vehicle is 0.04 s; a target lies beyond a wall that it drives towards."""
    wall = [(4.0, -5.0), (4.3, -5.0), (4.3, 3.0), (4.0, 3.0)]
    vehicle = {"radius": 0.3, "max_speed": 3.0, "max_acceleration": 2.0, "max_deceleration": 2.0}
    scenario = sp.Scenario(
        vehicle={**vehicle, "max_curvature": 1.0},
        start={"time": 0.0, "position": (0.0, 0.0), "heading": 0.0, "speed": 0.0},
        goal={"target": {"motion": {"position": (8.0, 0.0), "velocity": (0.0, 0.1)}}, "radius": 0.3},
        walls=[wall],
    )
    planner = sp.Planner(scenario)
    plan = begin(planner, scenario)
    for time in np.arange(1, 41) / 10.0:
        assert plan.safe
        assert Polygon(wall).distance(Point(plan.position(time))) > 0.3 - 1e-6
        plan = follow(planner, float(time))
    assert planner.online.period is not None
    assert planner.online.period < 0.05
    assert sum("longer than the period" in doubt for doubt in planner.doubts) == 1
