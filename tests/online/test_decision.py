"""What a replan decides: room from those who may change their motion, and what it may cost."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scenes import disc, scene

from scp_planner.online import decision
from scp_planner.online.means import Means, Replan
from scp_planner.online.plan import OnlinePlan, Outcome
from scp_planner.online.planner import Planner
from scp_planner.online.remaining import State
from scp_planner.online.renewal import Renewal
from scp_planner.online.vetting import Refusal, Vetted
from scp_planner.planning.plan import PlanStatus
from scp_planner.problem.build import build_problem
from scp_planner.problem.problem import Problem
from scp_planner.scp.loop import ScpLoop
from scp_planner.settings.online import GiveWay, OnlineSettings
from scp_planner.settings.planning import Settings
from scp_planner.threat_zones.of_scenario import zones
from scp_planner.trips.trajectory import Trajectory

pytestmark = pytest.mark.numerics

NOISE = 0.1
PLACE = (10.0, 0.3)


def watched(name: str) -> dict[str, Any]:
    """A post that has been seen to stand for so long that it is known well."""
    times = np.linspace(-59.9, 0.0, 300)
    places = np.array(PLACE) + NOISE * np.random.default_rng(1).standard_normal((300, 2))
    spread = [[NOISE**2, 0.0], [0.0, NOISE**2]]
    seen = {"time": times.tolist(), "position": places.tolist(), "covariance": spread}
    return {"id": name, "shape": {"disc": 0.5}, "model": {"order": 0}, "observations": seen}


def driven(
    obstacle: dict[str, Any], price: float, monkeypatch: pytest.MonkeyPatch, replans: int = 12
) -> tuple[OnlinePlan, float]:
    """The plan after a while, where room may cost so much, and how far it keeps from the obstacle's centre, m."""
    monkeypatch.setattr(decision, "ROOM_PRICE", price)
    planner = Planner(scene(obstacle, start={"speed": 3.0}))
    plan = planner.replan(0.0, (0.0, 0.0), 0.0, 3.0)
    for time in 0.1 * np.arange(1, replans):
        plan = planner.replan(time, plan.position(time), float(plan.heading(time)), float(plan.speed(time)))
    away = plan.position(np.linspace(0.1 * (replans - 1), plan.arrival_time, 500)) - np.array(PLACE)
    return plan, float(np.hypot(*away.T).min())


def test_room_is_kept_from_who_may_change_its_motion(monkeypatch: pytest.MonkeyPatch) -> None:
    price = decision.ROOM_PRICE
    hurried, near = driven(watched("a"), -1.0, monkeypatch)
    plan, away = driven(watched("a"), price, monkeypatch)
    assert hurried.certified and plan.certified
    assert near + 0.8 * NOISE < away < near + 1.2 * NOISE
    assert hurried.arrival_time < plan.arrival_time < (1.0 + price) * hurried.arrival_time


def test_room_costs_no_more_than_it_may(monkeypatch: pytest.MonkeyPatch) -> None:
    hurried, near = driven(watched("a"), -1.0, monkeypatch)
    plan, away = driven(watched("a"), 1e-4, monkeypatch)
    assert plan.arrival_time < (1.0 + 2e-4) * hurried.arrival_time
    assert away < near + 0.5 * NOISE


def test_less_room_is_kept_where_all_of_it_is_too_dear(monkeypatch: pytest.MonkeyPatch) -> None:
    price = decision.ROOM_PRICE
    hurried, near = driven(watched("a"), -1.0, monkeypatch)
    dear, far = driven(watched("a"), price, monkeypatch)
    half = 0.5 * (dear.arrival_time / hurried.arrival_time - 1.0)
    plan, away = driven(watched("a"), half, monkeypatch, 24)
    assert near + 0.1 * (far - near) < away < far - 0.1 * (far - near)
    assert plan.arrival_time < (1.0 + half) * hurried.arrival_time


def test_where_room_is_dear_no_replan_improves_two_trips(monkeypatch: pytest.MonkeyPatch) -> None:
    """The last plan is kept, and improved without room at the next replan, and once more before room is tried again."""
    done, run, roomy = list[str](), ScpLoop.run, Means.roomy

    def counted(self: ScpLoop, *given: Any, **choices: Any) -> Any:
        done[-1] += "run"
        return run(self, *given, **choices)

    def tried(self: Means, problem: Problem, share: float) -> Problem | None:
        done[-1] += "room "
        return roomy(self, problem, share)

    monkeypatch.setattr(decision, "_clearance", lambda *_: 0.0)
    monkeypatch.setattr(decision, "ROOM_PRICE", -1.0)
    monkeypatch.setattr(decision, "UNFINISHED_SOONER", 1)
    planner = Planner(scene(watched("a"), start={"speed": 3.0}), online=OnlineSettings(improve_every=2))
    plan = planner.replan(0.0, (0.0, 0.0), 0.0, 3.0)
    monkeypatch.setattr(ScpLoop, "run", counted)
    monkeypatch.setattr(Means, "roomy", tried)
    for time in 0.1 * np.arange(1, 12):
        done.append("")
        plan = planner.replan(time, plan.position(time), float(plan.heading(time)), float(plan.speed(time)))
    assert done == ["", "room run", "run", "", "run", "", "room run", "run", "", "run", ""]


@pytest.mark.parametrize(("got_back", "left"), [(0.0, 0.0), (0.05, 0.0), (0.3, 0.7), (2.0, 0.0)])
def test_what_was_given_for_room_is_lost_where_it_is_not_got_back(
    got_back: float, left: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    planner = Planner(scene(disc("a", PLACE), start={"speed": 3.0}))
    planner.replan(0.0, (0.0, 0.0), 0.0, 3.0)
    means, decide, last = planner._means, planner._decision, planner._last
    assert last is not None
    now = Replan(means.moment(State(0.0, (0.0, 0.0), 0.0, 3.0 / planner._units.speed)), 0.0, math.inf, last, 1)
    trip = replace(last.trip, frame=replace(last.trip.frame, time=last.trip.frame.time - 0.02 * got_back))
    certificate = means.vetting.vet(now.moment, means.problem(now), last.trip.trajectory)
    assert isinstance(certificate, Vetted)
    monkeypatch.setattr(decide, "_without_room", lambda *_: replace(certificate, trip=trip))
    decide._spent = 0.02
    decide._continued(now, Renewal(means, now))
    assert decide._spent == pytest.approx(0.02 * left)


def test_no_room_is_kept_from_who_is_known_exactly(monkeypatch: pytest.MonkeyPatch) -> None:
    price = decision.ROOM_PRICE
    (hurried, near), (plan, away) = (driven(disc("a", PLACE), each, monkeypatch) for each in (-1.0, price))
    assert away == near and plan.arrival_time == hurried.arrival_time


def test_no_room_is_looked_for_on_a_trip_that_does_not_keep_clear() -> None:
    scenario = scene(disc("a", PLACE), start={"speed": 3.0})
    problem = build_problem(scenario, zones(scenario), Settings())
    space = problem.space
    through = Trajectory.of(space, np.zeros(space.path_size), np.zeros(space.acceleration_size))
    aside = np.full(space.path_size, 2.0)
    assert decision._clearance(problem, through) < 0.0
    assert decision._clearance(problem, Trajectory.of(space, aside, np.zeros(space.acceleration_size))) >= 0.0


@pytest.mark.parametrize(("radii", "runs"), [(-0.1, 1), (0.1, 2), (math.inf, 2), (-math.inf, 2)])
def test_what_no_stop_gets_out_of_is_not_gone_on_with(radii: float, runs: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """A trip that exceeds limits yet is improved for once more, unless all stops from it are inside of zones.

    Here the last one will not do.
    """
    planner = Planner(scene(disc("a", (10.0, 0.3)), start={"speed": 3.0}))
    planner.replan(0.0, (0.0, 0.0), 0.0, 3.0)
    means, made, run = planner._means, [], ScpLoop.run
    now = Replan(means.moment(State(0.0, (0.0, 0.0), 0.0, 3.0 / planner._units.speed)), 0.0, math.inf, planner._last, 1)
    refusal = Refusal("none", radii * now.moment.scenario.vehicle.radius)

    def unfinished(self: ScpLoop, *given: Any, **choices: Any) -> Any:
        made.append(run(self, *given, **choices))
        return made[-1]

    monkeypatch.setattr(ScpLoop, "run", unfinished)
    monkeypatch.setattr(means, "vet", lambda *_: refusal)
    monkeypatch.setattr(planner._decision, "_still_on", lambda *_: None)
    monkeypatch.setattr(decision, "FEASIBILITY", -1.0)
    loop = ScpLoop(means.problem(now), means.solver)
    space = loop.problem.space
    ahead = Trajectory.of(space, np.zeros(space.path_size), np.zeros(space.acceleration_size))
    assert planner._decision._without_room(now, loop, ahead) is refusal
    assert len(made) == runs


@pytest.mark.parametrize(
    ("radii", "deep", "improved"),
    [(-1.1, 0.6, False), (-0.9, 0.6, True), (0.5, 0.6, True), (-math.inf, 0.6, True), (-1.1, 0.4, True)],
)
def test_what_has_every_stop_far_inside_of_a_zone_is_not_improved(
    radii: float, deep: float, improved: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """But what is hardly inside of one itself is: most of the time it has one."""
    planner = Planner(scene(disc("a", (10.0, 0.3)), start={"speed": 3.0}))
    planner.replan(0.0, (0.0, 0.0), 0.0, 3.0)
    means, last, run, runs = planner._means, planner._last, ScpLoop.run, []
    assert last is not None
    now = Replan(means.moment(State(0.0, (0.0, 0.0), 0.0, 3.0 / planner._units.speed)), 0.0, math.inf, last, 1)

    def counted(self: ScpLoop, *given: Any, **choices: Any) -> Any:
        runs.append(run(self, *given, **choices))
        return runs[-1]

    monkeypatch.setattr(ScpLoop, "run", counted)
    radius = now.moment.scenario.vehicle.radius
    monkeypatch.setattr(decision, "_clearance", lambda *_: -deep * radius)
    monkeypatch.setattr(means.vetting, "most_room", lambda *_: radii * radius)
    found = planner._decision._continued(now, Renewal(means, now))
    assert isinstance(found, Vetted) is improved and (len(runs) > 0) is improved


@pytest.mark.parametrize("runs", [2, 3])
def test_what_does_not_keep_its_limits_yet_is_gone_on_with_at_the_next_replan(
    runs: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """From what has come of it, while the last trip will do; and there it is improved twice, if need be."""
    done, begun, run, vet = list[str](), list[Trajectory](), ScpLoop.run, Means.vet
    planner = Planner(scene(disc("a", (10.0, 0.3)), start={"speed": 3.0}), online=OnlineSettings(improve_every=2))
    plan = planner.replan(0.0, (0.0, 0.0), 0.0, 3.0)

    def noted(self: ScpLoop, start: Trajectory, *given: Any, **choices: Any) -> Any:
        done[-1] += "run "
        begun.append(start)
        return run(self, start, *given, **choices)

    def vetted(self: Means, *given: Any, **choices: Any) -> Any:
        return vet(self, *given, **choices) if len(begun) == runs else Refusal("unfinished", math.inf)

    monkeypatch.setattr(ScpLoop, "run", noted)
    monkeypatch.setattr(Means, "vet", vetted)
    monkeypatch.setattr(decision, "FEASIBILITY", -1.0)
    outcomes = []
    for time in (0.1, 0.2, 0.3):
        done.append("")
        plan = planner.replan(time, plan.position(time), float(plan.heading(time)), float(plan.speed(time)))
        outcomes.append(plan.outcome)
    assert done == ["", "run ", "run " * (runs - 1)]
    assert outcomes == [Outcome.KEPT, Outcome.KEPT, Outcome.IMPROVED]
    assert begun[1].travel_time == pytest.approx(begun[0].travel_time - 0.1, abs=0.02)


def refusing(monkeypatch: pytest.MonkeyPatch, safe: bool, give_way: GiveWay) -> list[str]:
    """What is done in replans in which all that is left of the last trip is refused; all else is, or is not, safe."""
    done: list[str] = []
    online = OnlineSettings(improve_every=1, give_way=give_way)
    planner = Planner(scene(disc("a", (10.0, 0.3)), start={"speed": 3.0}), online=online)
    plan = planner.replan(0.0, (0.0, 0.0), 0.0, 3.0)
    kept = planner._last
    assert kept is not None and kept.safe
    answer = replace(kept, status=PlanStatus.INFEASIBLE, stop=kept.trip if safe else None)
    decide = planner._decision

    def noted(owner: Any, name: str, what: str, answer: Any) -> None:
        def answered(*_: Any) -> Any:
            done.append(what)
            return answer

        monkeypatch.setattr(owner, name, answered)

    noted(decide, "_continued", "continue", Refusal("no stop"))
    noted(decide._looks, "look", "look", (None, "no way"))
    noted(decide._fallback, "fall_back", "fall back", answer)
    for time in (0.1, 0.2, 0.3, 0.4):
        done.append("replan")
        planner.replan(time, plan.position(time), float(plan.heading(time)), float(plan.speed(time)))
    return done


def test_other_ways_are_looked_at_every_other_time_that_a_trip_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    """In place of another improvement, where the vehicle gives way late."""
    put_off = ["replan", "continue", "fall back"]
    assert refusing(monkeypatch, True, GiveWay.LATE) == 2 * [*put_off, "replan", "look", "fall back"]
    monkeypatch.undo()
    assert refusing(monkeypatch, True, GiveWay.EARLY) == 2 * [*put_off, *put_off[:2], "look", "fall back"]


def test_other_ways_are_looked_at_at_once_where_nothing_else_is_safe(monkeypatch: pytest.MonkeyPatch) -> None:
    """Seldom where the vehicle gives way late."""
    done = refusing(monkeypatch, False, GiveWay.EARLY)
    assert done.count("look") == done.count("replan") == 4
    monkeypatch.undo()
    monkeypatch.setattr(decision, "WITHOUT_A_LOOK", 1)
    assert refusing(monkeypatch, False, GiveWay.LATE).count("look") == 1


@pytest.mark.parametrize(
    ("give_way", "safe", "done"),
    [
        (GiveWay.LATE, True, [["look", "go on"], ["look", "go on"], ["fall back"], ["look", "go on"]]),
        (GiveWay.LATE, False, [["fall back"], ["fall back"], ["look", "fall back"], ["fall back"]]),
        (GiveWay.EARLY, False, 4 * [["look", "fall back"]]),
        (GiveWay.EARLY, True, 4 * [["look", "fall back"]]),
    ],
)
def test_ways_and_dodges_are_looked_at_in_turns_where_the_vehicle_gives_way_late(
    give_way: GiveWay, safe: bool, done: list[list[str]], monkeypatch: pytest.MonkeyPatch
) -> None:
    """While the dodge that was begun is safe; where nothing is, ways are looked at seldom."""
    monkeypatch.setattr(decision, "WITHOUT_A_LOOK", 2)
    planner = Planner(scene(disc("a", (10.0, 0.3)), start={"speed": 3.0}), online=OnlineSettings(give_way=give_way))
    planner.replan(0.0, (0.0, 0.0), 0.0, 3.0)
    last, decide, found = planner._last, planner._decision, list[list[str]]()
    assert last is not None
    stop = last.trip if safe else None
    away = replace(last, outcome=Outcome.EVADING, status=PlanStatus.INFEASIBLE, stop=stop)

    def noted(owner: Any, name: str, what: str, answer: Any) -> None:
        def answered(*_: Any) -> Any:
            found[-1].append(what)
            return answer

        monkeypatch.setattr(owner, name, answered)

    noted(decide._looks, "look", "look", (None, "no way"))
    noted(decide._fallback, "go_on", "go on", away)
    noted(decide._fallback, "fall_back", "fall back", away)
    planner._last = away
    for time in (0.1, 0.2, 0.3, 0.4):
        found.append([])
        planner.replan(time, (3.0 * time, 0.0), 0.0, 3.0)
    assert found == done


def test_dodges_are_looked_at_at_once_where_the_one_that_was_begun_is_not_safe_any_more(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    planner = Planner(scene(disc("a", (10.0, 0.3)), start={"speed": 3.0}))
    planner.replan(0.0, (0.0, 0.0), 0.0, 3.0)
    last, decide, done = planner._last, planner._decision, list[str]()
    assert last is not None
    away = planner._last = replace(last, outcome=Outcome.EVADING, stop=last.trip)

    def fallen_back(*_: Any) -> OnlinePlan:
        done.append("fall back")
        return away

    monkeypatch.setattr(decide._looks, "look", lambda *_: (None, "no way"))
    monkeypatch.setattr(decide._fallback, "go_on", lambda *_: None)
    monkeypatch.setattr(decide._fallback, "fall_back", fallen_back)
    for time in (0.1, 0.2, 0.3, 0.4):
        planner.replan(time, (3.0 * time, 0.0), 0.0, 3.0)
    assert len(done) == 4 and decide._gone_on == 0
