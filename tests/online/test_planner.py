"""Planning while driving: outcomes and their reasons, what is observed, deadlines, misuse."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise
from threading import Thread
from typing import Any

import numpy as np
import pytest
from clock import FakeClock
from scenes import CROSSERS, disc, scene

import scp_planner as sp
from scp_planner.estimation.error_laws import StudentErrors
from scp_planner.online import decision
from scp_planner.online import planner as online_planner
from scp_planner.online.foretold import Prediction
from scp_planner.online.means import Means
from scp_planner.online.plan import OnlinePlan, Outcome
from scp_planner.online.planner import Planner
from scp_planner.online.remaining import State, remaining_trip
from scp_planner.online.stops import standing_from, stop_after
from scp_planner.planning.plan import PlanStatus
from scp_planner.problem.build import build_problem
from scp_planner.scp.loop import ScpLoop
from scp_planner.settings.online import OnlineSettings, Safety
from scp_planner.solvers.interface import QuadraticProgram, Solution, SolverStatus
from scp_planner.threat_zones.of_scenario import ZonesOf
from scp_planner.threat_zones.zone import ThreatZone
from scp_planner.trips.trip import Trip
from verification.dense_check import check_trip

pytestmark = pytest.mark.numerics

PERIOD = 0.1
WALL = {"polygon": [[-0.2, -40.0], [0.2, -40.0], [0.2, 40.0], [-0.2, 40.0]]}


class NoSolver:
    """A solver that always fails."""

    name = "none"

    def solve(self, program: QuadraticProgram) -> Solution:
        return Solution(SolverStatus.FAILED, np.zeros_like(program.gradient), np.zeros(0))


class TalkingSolver:
    """A solver during whose first call something else happens."""

    name = "talking"

    def __init__(self, planner: Planner, happens: Callable[[], None]) -> None:
        self.solver, self.happens, self.calls = planner.solver, happens, 0

    def solve(self, program: QuadraticProgram) -> Solution:
        self.calls += 1
        if self.calls == 1:
            self.happens()
        return self.solver.solve(program)


def begin(planner: Planner, scenario: sp.Scenario) -> OnlinePlan:
    start = scenario.start
    return planner.replan(start.time, start.position, start.heading, start.speed)


def follow(planner: Planner, time: float, **options: Any) -> OnlinePlan:
    """Replan where the last plan has the vehicle at a time."""
    plan = planner.plan
    assert plan is not None
    heading, speed = float(plan.heading(time)), max(float(plan.speed(time)), 0.0)
    return planner.replan(time, plan.position(time), heading, speed, **options)


def seen(
    name: str, position: tuple[float, float], velocity: tuple[float, float], noise: float, seed: int = 0, order: int = 1
) -> dict[str, Any]:
    """A disc of 0.4 m that has been observed for 3 s, at 10 Hz, up to time 0."""
    times = np.linspace(-2.9, 0.0, 30)
    errors = noise * np.random.default_rng(seed).standard_normal((30, 2))
    places = np.array(position) + times[:, None] * velocity + errors
    return {
        "id": name,
        "shape": {"disc": 0.4},
        "observations": {"time": times, "position": places, "covariance": noise**2 * np.eye(2)},
        "model": {"order": order},
    }


def observed(obstacle: dict[str, Any]) -> dict[str, Any]:
    data = dict(obstacle)
    data["observations"] = {key: value.tolist() for key, value in data["observations"].items()}
    return data


# outcomes


def test_first_plan_is_certified_and_says_so() -> None:
    scenario = scene(*CROSSERS)
    plan = begin(Planner(scenario), scenario)
    assert plan.outcome is Outcome.IMPROVED and plan.reason == "first plan"
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
    assert np.diff(arrivals).max() <= decision.SLOWER
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
    assert kept.reason is not None
    assert kept.reason == "the goal is near" if near_goal else kept.reason.startswith("it holds, and is ")


def test_path_is_driven_slower_where_that_is_all_that_helps(monkeypatch: pytest.MonkeyPatch) -> None:
    scenario = scene()
    planner = Planner(scenario, online=OnlineSettings(safety=Safety.TRIP))
    first = begin(planner, scenario)
    monkeypatch.setattr(Means, "starts", lambda *_: iter(()))  # no other way
    meeting = first.position(5.0)
    planner.solver = NoSolver()
    planner.add_obstacle(disc("crosser", tuple(meeting - 5.0 * np.array([0.0, 1.0])), (0.0, 1.0), radius=0.4))
    plan = follow(planner, 1.0)
    assert plan.outcome is Outcome.REPAIRED and plan.certified
    assert plan.reason is not None and "clearance to crosser" in plan.reason
    path, driven = first.position(np.linspace(1.0, 7.0, 500)), plan.position(np.linspace(1.0, plan.arrival_time, 50))
    apart = np.linalg.norm(driven[:, None] - path, axis=2).min(axis=1)
    assert apart[driven[:, 0] < path[-1, 0]].max() < 0.02
    assert plan.arrival_time > first.arrival_time + 0.1
    report = check_trip(planner.scenario.to_dict(), plan.position, 1.0, plan.arrival_time)
    assert report.ok, str(report)


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
    assert plan.reason is not None and plan.reason.endswith("the vehicle stands")
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
    assert plan.reason is not None and "no stop is certified, this is the least bad: clearance to wall" in plan.reason
    # It brakes as hard as it may.
    assert float(plan.speed(1.0 + 0.5)) == pytest.approx(3.0 - 0.5 * scenario.vehicle.max_deceleration, abs=0.05)


def test_stop_of_a_plan_is_one() -> None:
    """It begins like the plan, brakes within the limit, stands, and keeps clear until then."""
    walker = seen("walker", (12.0, -6.0), (0.0, 0.8), 0.1, order=2)
    scenario = scene(observed(walker), observed(seen("other", (6, 3), (0, 0), 0.1)))
    planner = Planner(scenario)
    plan = begin(planner, scenario)
    assert plan.stop is not None and not plan.certified and plan.safe
    stands = plan.stop.frame.time + standing_from(plan.stop.trajectory)
    assert plan.branch_time is not None and planner.online.period is not None
    assert planner.online.period <= plan.branch_time < stands
    times = np.linspace(0.0, plan.branch_time, 50)
    stop = plan.stop.frame.to_world(plan.stop.at(times)[0].path.position)
    assert np.abs(stop - plan.position(times)).max() < 1e-9
    speeds = plan.stop.at(np.linspace(0.0, stands + 0.2, 400))[0].speed
    assert (
        speeds[-1] < 2e-3 and np.diff(speeds).min() >= -scenario.vehicle.max_deceleration * (stands + 0.2) / 399 * 1.001
    )
    certificate = sp.certify(planner.scenario, plan)
    assert not certificate.holds and all(v.time > stands for v in certificate.violations if v.what == "clearance")


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
    assert plan.reason == "arrived; the vehicle stands" and plan.outcome is Outcome.BRAKING
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
    reasons = [follow(planner, k * PERIOD).reason for k in range(1, 2 * planner.online.look_every)]
    assert "another way round" in reasons
    assert planner.plan is not None and planner.plan.arrival_time < before - 0.1


# what is observed


def zones_of(planner: Planner) -> list[ThreatZone]:
    """The zones of a planner's scenario, made in the units of the whole trip: they decide how long zones hold for."""
    units = planner._units
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
    made = zones_of(planner)
    assert [zone.id for zone in planner.zones] == [zone.id for zone in made] == ["a", "b", "known"]
    times = np.linspace(0.7, 8.0, 20)
    points = rng.normal(0.0, 8.0, (20, 2))
    for zone, other in zip(planner.zones, made, strict=True):
        assert zone.center(times) == pytest.approx(other.center(times), abs=1e-8)
        assert zone.signed_distance(times, points) == pytest.approx(other.signed_distance(times, points), abs=1e-5)


def test_plan_that_breaks_a_limit_yet_is_improved_sooner(monkeypatch: pytest.MonkeyPatch) -> None:
    """From a stand before something that goes away: the first trip drives too fast, until it has been improved."""
    scenario = scene(bounds={"min": (-2.0, -1.1), "max": (21.0, 1.1)})
    planner = Planner(scenario, online=OnlineSettings(iterations=6))
    begin(planner, scenario)
    post = float(follow(planner, 2.0).position(2.0)[0]) + 8.0
    planner.add_obstacle(disc("post", (post, 0.0), radius=1.2))
    for k in range(21, 51):
        follow(planner, k * PERIOD)
    planner.remove_obstacle("post")
    tried: list[int] = []
    improve = decision.Decision._improve

    def counting(self: decision.Decision, *given: Any) -> Any:
        tried.append(k)
        return improve(self, *given)

    monkeypatch.setattr(decision.Decision, "_improve", counting)
    plans = {}
    for k in range(51, 80):
        plans[k] = follow(planner, k * PERIOD)
    every = planner.online.improve_every
    gaps = [(later - one, plans[one]) for one, later in pairwise(tried) if plans[one].outcome is Outcome.IMPROVED]
    assert {gap for gap, plan in gaps if plan.status is PlanStatus.INFEASIBLE} == {every // decision.UNFINISHED_SOONER}
    assert {gap for gap, plan in gaps if plan.status is PlanStatus.CERTIFIED} == {every}


def test_stop_of_a_plan_that_is_kept_is_the_same_to_the_bit() -> None:
    """So that its limits need not be checked again."""
    scenario = scene(observed(seen("a", (12.0, -6.0), (0.0, 0.8), 0.1, order=2)))
    planner = Planner(scenario)
    plans = [begin(planner, scenario), *(follow(planner, k * PERIOD) for k in range(1, 12))]
    same = 0
    for last, plan in pairwise(plans):
        if plan.outcome is Outcome.KEPT and plan.stop is not None and plan.branch_time == last.branch_time:
            assert last.stop is not None
            ours, theirs = plan.stop.trajectory, last.stop.trajectory
            assert np.array_equal(ours.beta, theirs.beta) and np.array_equal(ours.theta, theirs.theta)
            same += 1
    assert same >= 3


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
    assert planner.notes[-1] == "a at t = 0.100 s: it is improbable after what was seen before"
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
        (same,) = zones_of(planner)
        assert zone.covariance(time + 2.0) == pytest.approx(same.covariance(time + 2.0), rel=1e-6)
        sizes.append(math.sqrt(float(zone.covariance(time + 1.0)[0, 0])))
    # Within a second nothing is known but that it moves like others; the more is seen, the less it may do.
    assert sizes[0] > 2.0 and sizes[-1] < 0.5 * sizes[0]


def test_obstacle_that_is_not_seen_any_more_is_forgotten() -> None:
    scenario = scene(observed(seen("a", (12.0, -6.0), (0.0, 0.0), 0.1)))
    planner = Planner(scenario, online=OnlineSettings(forget_after=1.0))
    begin(planner, scenario)
    follow(planner, 0.9)
    assert [zone.id for zone in planner.zones] == ["a"]
    follow(planner, 1.1)
    assert planner.zones == () and planner.notes[-1] == "a: forgotten, not seen for 1 s"
    with pytest.raises(ValueError, match="observe: there is no obstacle 'a'"):
        planner.observe("a", 1.2, (0, 0))


def test_known_obstacle_that_is_observed_does_not_move_as_was_known() -> None:
    scenario = scene(disc("d", (12.0, -6.0), (0.0, 0.8)))
    planner = Planner(scenario)
    begin(planner, scenario)
    planner.observe("d", 0.1, (12.0, -2.0), 0.01 * np.eye(2))
    follow(planner, 0.1)
    assert planner.zones[0].covariances is not None
    assert planner.zones[0].center(0.1) == pytest.approx((12.0, -2.0), abs=1e-6)


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


# deadlines


def test_work_ends_before_the_deadline(monkeypatch: pytest.MonkeyPatch) -> None:
    scenario = scene(*CROSSERS)
    planner = Planner(
        scenario, replace(online_planner.SETTINGS, tolerance=1e-8), OnlineSettings(iterations=50, improve_every=1)
    )
    FakeClock(5e-4).rule(monkeypatch)  # from the beginning: what a look has taken says when the next one is begun
    begin(planner, scenario)
    monkeypatch.setattr(
        "scp_planner.online.decision.ScpLoop.run", _never_good_enough(ScpLoop.run)
    )  # a feasible trip would end the work
    steps = []
    for k, deadline in ((1, 0.030), (2, 0.009), (3, 0.003)):
        plan = follow(planner, k * PERIOD, deadline=deadline)
        assert plan.safe
        assert plan.wall_time <= deadline + planner.online.reserve  # the clock ticks in falling back, too
        steps.append(plan.iterations)
    assert steps[0] > steps[1] > steps[2] == 0


def _never_good_enough(run: Any) -> Any:
    def without(self: Any, *arguments: Any, **options: Any) -> Any:
        return run(self, *arguments, **{**options, "enough": None})

    return without


def test_search_for_other_ways_is_left_out_where_there_is_no_time_for_it(monkeypatch: pytest.MonkeyPatch) -> None:
    scenario = scene(*CROSSERS)
    planner = Planner(scenario, online=OnlineSettings(look_every=1, improve_every=2))
    begin(planner, scenario)
    searches: list[float] = []
    starts = Means.starts

    def counted(self: Means, *arguments: Any) -> Any:
        searches.append(1.0)
        return starts(self, *arguments)

    monkeypatch.setattr(Means, "starts", counted)
    follow(planner, 0.1, deadline=0.001)
    assert not searches
    follow(planner, 0.2)
    follow(planner, 0.3)
    assert searches


def test_without_a_deadline_the_same_calls_give_the_same_plans() -> None:
    scenario = scene(observed(seen("walker", (10.0, -6.0), (0.0, 1.0), 0.1)), *CROSSERS[:2])
    runs = []
    for _ in range(2):
        planner = Planner(scenario)
        plans = [begin(planner, scenario)]
        plans += [follow(planner, k * PERIOD) for k in range(1, 25)]
        runs.append([(plan.reason, plan.iterations, plan.position(9.0).tolist(), plan.arrival_time) for plan in plans])
    assert runs[0] == runs[1]


# misuse


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda p: p.observe("who", 0.0, (0, 0)), "observe: there is no obstacle 'who'; add_obstacle adds one"),
        (lambda p: p.observe("d", 10**400, (0, 0)), "time: 10+ is beyond 1e"),
        (lambda p: p.observe("d", -1e300, (0, 0)), r"time: -1e\+300 is beyond 1e"),
        (lambda p: p.observe("d", 0.0, (0, 1e13)), r"position: 1e\+13|10000000000000\.0 is beyond 1e"),
        (lambda p: p.observe("d", 0.0, (0, 10**400)), r"position: \(0, 10+\) is not a point"),
        (lambda p: p.observe("d", 0.0, (0, 0), [[1e300, 0], [0, 1e300]]), r"covariance: .* is beyond 1e"),
        (lambda p: p.observe("d", 0.0, (0, 0), [[10**400, 0], [0, 1]]), "covariance: it is not an array of numbers"),
        (lambda p: p.replan(1.1, (0, 0), 0.0, None), "speed: None is not a finite number"),
        (lambda p: p.replan(1.1, (0, 0), 0.0, 1.0, deadline="soon"), "deadline: 'soon' is not a positive number"),
        (lambda p: p.observe("d", math.nan, (0, 0)), "time: nan is not a finite number"),
        (lambda p: p.observe("d", 0.0, (0, math.inf)), r"position: \(0, inf\) is not a point \[x, y\] of finite"),
        (lambda p: p.observe("d", 0.0, "here"), r"position: 'here' is not a point \[x, y\]"),
        (lambda p: p.observe("d", 0.0, (0, 0), [[1, 2], [2, 1]]), "covariance"),
        (lambda p: p.add_obstacle("d", {"disc": 1.0}), "add_obstacle: there is an obstacle 'd' already"),
        (lambda p: p.add_obstacle("e", {"disc": -1.0}), "disc"),
        (lambda p: p.remove_obstacle("e"), "remove_obstacle: there is no obstacle 'e'"),
        (lambda p: p.replan(0.9, (0, 0), 0.0, 1.0), "time: 0.9 is before 1.0, the time of the last replan"),
        (lambda p: p.replan(1.1, (0, 0), 0.0, math.nan), "speed: nan is not a finite number"),
        (lambda p: p.replan(1.1, (0, 0), math.inf, 1.0), "heading: inf is not a finite number"),
        (lambda p: p.replan(1.1, (0, 0, 0), 0.0, 1.0), "position"),
        (lambda p: p.replan(1.1, (0, 0), 0.0, 1.0, deadline=0.0), "deadline: 0.0 is not a positive number"),
    ],
)
def test_misuse_is_refused_and_changes_nothing(call: Callable[[Planner], object], message: str) -> None:
    planner = Planner(scene(disc("d", (10.0, 5.0))))
    planner.replan(1.0, (0.0, 0.0), 0.0, 1.0)
    before = planner.plan
    with pytest.raises(ValueError, match=message):
        call(planner)
    assert planner.plan is before and list(planner.obstacles.tracks) == ["d"]
    assert planner.replan(1.1, planner.plan.position(1.1), 0.0, 1.0).safe  # type: ignore[union-attr]


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"period": 0.0}, r"period = 0.0: must be a number, above 0, up to 1e\+12 s, or none"),
        ({"tracking_error": -0.1}, r"tracking_error = -0.1: must be a number, 0 to 1e\+12 m"),
        ({"reaction_time": math.nan}, r"reaction_time = nan: must be a number, 0 to 1e\+12 s"),
        ({"foresight": -1.0}, "foresight = -1.0: must be a number, at least 0 s, or none"),
        ({"iterations": 0}, "iterations = 0: must be a whole number, 1 to 1000"),
        ({"look_every": 2.5}, "look_every = 2.5: must be a whole number, 1 to"),
    ],
)
def test_settings_are_checked(values: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        OnlineSettings(**values)


def test_unknown_solver_is_refused() -> None:
    with pytest.raises(ValueError, match="solver = 'magic': must be one of daqp"):
        Planner(scene(), solver="magic")


# what is left of a trip


@pytest.mark.parametrize("guide", [None, [[0, 0], [8, 0], [12, 4], [20, 4]]])
def test_what_is_left_of_a_trip_is_on_it(guide: list[list[float]] | None) -> None:
    """Over straight and curved guides: the rest passes where the trip did, at the same times."""
    goal = (20.0, 0.0 if guide is None else 4.0)
    scenario = scene(disc("post", (10.0, 1.0), radius=0.6), goal={"position": goal}, guide=guide)
    driving = Planner(scenario)
    begin(driving, scenario)
    plan = driving._last  # in the units of the scene
    assert plan is not None
    for time in (0.1, 1.5, 3.0, 5.0):
        state = State(time, tuple(plan.position(time).tolist()), float(plan.heading(time)), float(plan.speed(time)))
        planner = Planner(scenario)
        problem = build_problem(planner._means.scenario_at(state), (), planner.settings, planner._means.breakpoints)
        rest = Trip(problem.frame, remaining_trip(problem, plan.trip, state))
        end = problem.frame.time + rest.trajectory.travel_time
        assert end == pytest.approx(plan.arrival_time, abs=0.08)
        times = np.linspace(time, plan.arrival_time, 60)
        points = rest.frame.to_world(rest.at(times)[0].path.position)
        assert np.linalg.norm(points - plan.position(times), axis=1).max() < (0.12 if guide is None else 0.25)
        nearest = np.linalg.norm(points[:, None] - plan.position(np.linspace(time, plan.arrival_time, 800)), axis=2)
        assert nearest.min(axis=1).max() < (0.02 if guide is None else 0.06)


@pytest.mark.parametrize("spans", [1, 3, 7])
def test_stop_is_the_trip_up_to_where_it_leaves_it(spans: int) -> None:
    scenario = scene(*CROSSERS)
    trajectory = sp.plan(scenario, sp.Settings(acceleration_degree=0)).trip.trajectory
    stop = stop_after(trajectory, spans, 2.0)
    assert stop is not None
    breaks = trajectory.space.acceleration.breakpoints
    kept = trajectory.space.time_table(np.linspace(0.0, breaks[spans], 50))
    assert stop.at(kept).distance == pytest.approx(trajectory.at(kept).distance, abs=1e-12)
    speeds = stop.speed_at(np.linspace(0.0, 1.0, 401))
    assert speeds[-1] == pytest.approx(0.0, abs=1e-9) and speeds.min() > -1e-9
    assert stop.beta.min() >= -2.0 - 1e-9
    left = breaks[spans] * trajectory.travel_time
    (speed,) = trajectory.speed_at(breaks[spans : spans + 1])
    width = float(np.diff(breaks).max()) * trajectory.travel_time
    assert left + speed / 2.0 - 2e-3 <= standing_from(stop) <= left + speed / 2.0 + width


def test_stop_needs_spans_to_stop_in() -> None:
    trajectory = sp.plan(scene(), sp.Settings(acceleration_degree=0)).trip.trajectory
    assert stop_after(trajectory, 19, 2.0) is None


def test_what_comes_far_too_late_is_not_gated_by_a_covariance_that_is_none() -> None:
    """A covariance growing with the lag, as of process noise, is none long before its origin: below zero there."""
    growing = np.array([[0.01, 0.0, 0.01], [0.2, 0.0, 0.2]])  # variances 0.01 + 0.2 lag, m^2
    prediction = Prediction(10.0, np.zeros((2, 2)), growing, StudentErrors(4.0))
    noise = 0.01 * np.eye(2)
    assert prediction.exceedance(10.0, (3.0, 0.0), noise) < 0.01
    assert prediction.exceedance(5.0, (3.0, 0.0), noise) == 1.0


def test_trip_of_a_lower_level_is_driven_where_none_keeps_clear_at_the_level_asked_for() -> None:
    """Somebody is seen to have turned towards the vehicle; it is not certified, and says so, but goes round."""
    scenario = scene(observed(seen("a", (12.0, -6.0), (0.0, 0.8), 0.1, order=2)), start={"speed": 2.5})
    planner = Planner(scenario)
    begin(planner, scenario)
    rng, evading = np.random.default_rng(3), []
    for k in range(1, 50):
        time = 0.1 * k
        since = max(time - 1.0, 0.0)
        place = np.array([12.0 - 0.9 * since**2, -6.0 + 0.8 * time + 0.6 * since**2])
        planner.observe("a", time, place + 0.1 * rng.standard_normal(2))
        plan = follow(planner, time)
        if plan.reason is not None and "uncertainty is" in plan.reason:
            evading.append(plan)
            assert plan.outcome is Outcome.EVADING or plan.reason.startswith("goes on")
            assert not plan.certified and not plan.safe and plan.status is PlanStatus.INFEASIBLE
            share = float(plan.reason.rsplit("is ", 1)[1].split(" times")[0])
            (zone,) = planner.zones
            times = np.linspace(time, min(time + 0.5, plan.arrival_time), 20)
            offset = plan.position(times) - zone.center(times)
            directions = offset / np.linalg.norm(offset, axis=1)[:, None]
            spread = np.sqrt(np.einsum("ka,kab,kb->k", directions, zone.covariance(times), directions))
            # beyond the smaller zone's tangent in the direction of the offset, which is no farther than the zone
            room = np.linalg.norm(offset, axis=1) - zone.radius - scenario.vehicle.radius
            assert np.all(room >= share * spread.min() - 1e-6)
    assert evading
    assert planner.obstacles.tracks["a"].alarmed
