"""Plans as users get them: fast, certified, the same in every frame, and honest when there is none."""

from __future__ import annotations

import re
from time import process_time
from typing import Any

import numpy as np
import pytest
from clock import FakeClock
from scenes import CROSSERS, disc, scene

import scp_planner as sp
from scp_planner.planning.plan_search import planned
from scp_planner.planning.sources.routes import RouteChoice
from scp_planner.problem.build import build_problem
from scp_planner.problem.problem import Problem
from scp_planner.scenario.units import NaturalUnits
from scp_planner.scp.loop import ScpLoop
from scp_planner.scp.record import LoopStatus
from scp_planner.search.first_trips import arcs
from scp_planner.search.ways import WaySearch
from scp_planner.solvers import solver_named
from scp_planner.trips.trajectory import Trajectory

pytestmark = pytest.mark.numerics

SCENES = {
    "crossers": scene(*CROSSERS),
    "slow": scene(disc("wall", (9.0, 0.2), radius=1.2), disc("walker", (14.0, -3.0), (0.0, 0.5))),
    "boxed": scene(disc("o", (10.0, 0.0), (-0.2, 0.0)), bounds={"min": [-1.0, -1.2], "max": [21.0, 3.0]}),
}


def test_a_closed_wall_of_discs_is_explained() -> None:
    around = 2.0 * np.pi * np.arange(24) / 24
    wall = [disc(f"w{k}", (20.0 + 4.0 * np.cos(a), 4.0 * np.sin(a)), radius=0.8) for k, a in enumerate(around)]
    plan = sp.plan(scene(*wall))
    assert not plan.certified
    assert plan.reason is not None and "clearance to w" in plan.reason


@pytest.mark.filterwarnings("error::RuntimeWarning")
def test_a_start_that_hardly_moves_is_one_at_rest() -> None:
    # Round the tightest turn, which only arcs lead to
    start = {"time": 0.0, "position": (21.23465, 0.44402), "heading": 2.79293, "speed": 0.0}
    vehicle = {"radius": 0.3, "max_speed": 3.0, "max_acceleration": 1.5, "max_deceleration": 2.0, "max_curvature": 1.0}
    vehicle["max_lateral_acceleration"] = 2.0
    times = []
    for speed in (0.0, 5e-324, 1e-160, 1e-9):
        scenario = sp.Scenario(vehicle=vehicle, start={**start, "speed": speed}, goal={"position": (20.0, 0.0)})
        plan = sp.plan(scenario)
        assert plan.certified
        times.append(plan.travel_time)
    assert times[1:] == pytest.approx([times[0]] * 3, rel=1e-6)


def test_a_disc_that_must_be_waited_for_is_waited_for() -> None:
    # It drives ahead in a corridor that is too narrow to pass it.
    scenario = scene(
        disc("ahead", (3.0, 0.0), (1.0, 0.0), radius=0.5),
        bounds={"min": [-1.0, -0.7], "max": [40.0, 0.7]},
    )
    plan = sp.plan(scenario)
    assert plan.certified, plan.reason
    # It reaches the goal 0.8 m behind the other disc's centre.
    assert plan.travel_time == pytest.approx((20.0 + 0.8 - 3.0) / 1.0, abs=0.02)


def test_the_short_way_round_a_wall_that_the_straight_guide_serves_badly_is_found() -> None:
    back = {"shape": {"rectangle": [0.3, 10.62]}, "motion": {"position": [10.15, -1.94]}}
    arm = {"shape": {"rectangle": [3.5, 0.3]}, "motion": {"position": [8.25, 3.22]}}
    limits = {"max_speed": 2.0, "max_acceleration": 1.5, "max_lateral_acceleration": 2.0, "max_curvature": 2.0}
    plan = sp.plan(
        scene(
            {"id": "back", **back},
            {"id": "arm", **arm},
            vehicle={"radius": 0.3, "max_deceleration": 2.0, **limits},
            start={"speed": 0.0},
            goal={"position": [20.0, -1.52], "speed": 0.0},
        )
    )
    assert plan.certified, plan.reason
    assert plan.travel_time < 1.01 * plan.lower_bound


def test_after_the_time_limit_no_other_grid_is_searched_and_one_arc_is_enough(monkeypatch: pytest.MonkeyPatch) -> None:
    FakeClock(1.0).rule(monkeypatch)
    plan = sp.plan(SCENES["crossers"], time_limit=0.5)
    assert not plan.iterations
    assert plan.reason is not None and "Best of 1 arc; the time limit was reached" in plan.reason


def test_the_time_limit_is_kept_and_the_best_so_far_is_returned(monkeypatch: pytest.MonkeyPatch) -> None:
    """By a clock that goes on by half a millisecond a look; what is left to do after it takes a few looks."""
    FakeClock(5e-4).rule(monkeypatch)
    rng = np.random.default_rng(0)
    crowd = [
        disc(f"c{k}", tuple(rng.uniform([2, -8], [18, 8])), tuple(rng.normal(size=2)), radius=0.4) for k in range(60)
    ]
    crowded = scene(*[c for c in crowd if abs(c["motion"]["position"][1]) > 1.0])
    quick = sp.plan(crowded, time_limit=1e-3)
    assert quick.wall_time <= 0.001 + 0.02
    assert quick.iterations == 0
    exact = sp.Settings(tolerance=1e-8)
    plans = [sp.plan(SCENES["slow"], exact, time_limit=limit) for limit in (0.001, 0.03, None)]
    iterations = [plan.iterations for plan in plans]
    assert 0 == iterations[0] < iterations[1] < iterations[2]
    assert plans[1].wall_time <= 0.03 + 0.02
    assert plans[1].certified and plans[1].travel_time == pytest.approx(plans[2].travel_time, rel=0.05)


def test_far_obstacles_change_nothing() -> None:
    far = [disc(f"far{k}", (500.0 + 10 * k, 300.0), (0.1, 0.0)) for k in range(200)]
    near = sp.plan(SCENES["crossers"])
    both = sp.plan(scene(*CROSSERS, *far))
    assert both.certified
    assert both.travel_time == pytest.approx(near.travel_time, rel=1e-9)


def test_a_run_that_comes_to_go_the_way_of_a_rival_is_given_up() -> None:
    problem = build_problem(scene(*CROSSERS), sp.zones(scene(*CROSSERS)), sp.Settings())
    loop = ScpLoop(problem, solver_named("daqp"))
    best = loop.run(next(iter(arcs(problem))), 60)
    assert best.status is LoopStatus.CONVERGED
    trip = best.evaluation.trajectory
    theta = trip.theta.copy()
    theta[problem.ends.free] += 0.3 * np.sin(np.linspace(0.0, np.pi, len(theta)))[problem.ends.free]
    near = Trajectory.of(problem.space, theta, 0.9 * trip.beta, trip.travel_time)
    alone, against = loop.run(near, 60), loop.run(near, 60, rival=best.evaluation)
    assert alone.evaluation.trajectory.travel_time == pytest.approx(trip.travel_time, abs=1e-3)
    assert against.status is LoopStatus.SAME_WAY
    assert len(against.record) < len(alone.record)
    others = 0
    for start in arcs(problem):
        alone = loop.run(start, 60)
        if alone.feasible and alone.evaluation.trajectory.travel_time > trip.travel_time + 0.1:
            against = loop.run(start, 60, rival=best.evaluation)
            assert against.status is alone.status
            assert against.evaluation.trajectory.travel_time == alone.evaluation.trajectory.travel_time
            others += 1
    assert others > 0


def test_runs_far_from_feasible_end_early_where_there_are_others() -> None:
    blocked = scene(disc("all", (12.0, 0.0), radius=7.0))
    problem = build_problem(blocked, sp.zones(blocked), sp.Settings(max_offset=2.0))
    start = next(iter(arcs(problem)))
    solver = solver_named("daqp")
    impatient, patient = ScpLoop(problem, solver, None, 4).run(start, 60), ScpLoop(problem, solver).run(start, 60)
    assert impatient.status is patient.status is LoopStatus.INFEASIBLE
    assert len(impatient.record) == 4 < len(patient.record)
    free = build_problem(scene(*CROSSERS), sp.zones(scene(*CROSSERS)), sp.Settings())
    way = next(iter(arcs(free)))
    alone, among = ScpLoop(free, solver).run(way, 60), ScpLoop(free, solver, None, 8).run(way, 60)
    assert alone.status is among.status is LoopStatus.CONVERGED
    assert alone.evaluation.trajectory.travel_time == among.evaluation.trajectory.travel_time


def test_goals_close_behind_something_are_reached_steeply() -> None:
    """The way turns by more than 50 degrees on its last metres: flatter ones do not exist."""
    scenario = scene(disc("post", (18.5, 0.0), radius=1.0))
    way = WaySearch(build_problem(scenario, sp.zones(scenario), sp.Settings())).best()
    assert way is not None
    assert np.abs(np.diff(way.offsets) / np.diff(way.stations)).max() > 1.2
    made, more = sp.plan(scenario), sp.plan(scenario, sp.Settings(effort=4.0))
    assert made.certified
    assert made.travel_time <= 1.001 * more.travel_time
    assert made.gap < 0.035
    # it is known how near that is to the best: by the way round the post
    assert made.lower_bound <= more.lower_bound <= more.travel_time
    assert more.gap <= made.gap


def test_spans_of_long_straight_trips_grow_instead_of_their_number() -> None:
    blocks = [
        {"id": f"block {x}", "shape": {"rectangle": [6.0, 2.0], "heading": 0.0}, "motion": {"position": [x, side]}}
        for x, side in ((40.0, 1.5), (100.0, -1.5), (160.0, 1.2), (215.0, -1.2))
    ]
    vehicle = {"max_speed": 20.0, "max_acceleration": 3.0, "max_deceleration": 6.0, "max_curvature": 0.2}
    long_trip = scene(*blocks, vehicle=vehicle, start={"speed": 10.0}, goal={"position": [250.0, 0.0]})
    plan = sp.plan(long_trip)
    assert plan.certified, plan.reason
    assert plan.travel_time < 1.005 * plan.lower_bound
    spans = [
        len(problem_of(each, settings).space.path.widths)
        for each, settings in (
            (long_trip, None),
            (long_trip, sp.Settings(max_path_spans=160)),
            (long_trip, sp.Settings(path_span=5.0)),
            (scene(), None),
        )
    ]
    assert spans == [100, 160, 50, 13]


def problem_of(scenario: sp.Scenario, settings: sp.Settings | None) -> Problem:
    return build_problem(scenario, sp.zones(scenario), settings or sp.Settings())


def test_the_guide_of_a_user_is_the_only_one() -> None:
    arc = scene(guide=[[0.0, 0.0], [10.0, 15.0], [20.0, 0.0]], goal={"latest_arrival": 8.0})
    late = sp.plan(arc)
    assert not late.certified and late.travel_time > 8.0
    assert sp.plan(arc.model_copy(update={"guide": None})).certified


def test_more_jerk_makes_no_trip_slower_or_impossible() -> None:
    """The vehicle brakes as it begins: at a low jerk it has nearly stopped before it may speed up."""
    braking = {"max_speed": 15.0, "max_acceleration": 2.0, "max_deceleration": 4.0, "max_lateral_acceleration": None}
    times = []
    for jerk in (0.45, 0.5, 0.6, 0.8, 1.5):
        vehicle = {**braking, "radius": 1.0, "max_curvature": None, "max_jerk": jerk}
        plan = sp.plan(scene(vehicle=vehicle, start={"speed": 5.0, "acceleration": -2.0}, goal={"speed": 0.0}))
        assert plan.certified, plan.reason
        times.append(plan.travel_time)
    assert times == sorted(times, reverse=True)


def test_posts_on_a_long_trip_are_passed_wherever_they_stand_between_samples() -> None:
    """Samples are 125 m apart on 20 km; the first post stands where the vehicle still speeds up."""
    places = [(39.0, 0.3), (60.0, -0.4), *((1000.0 * k, 0.5 * (-1) ** k) for k in range(1, 20)), (19985.0, 0.2)]
    posts = [disc(f"post {x}", (x, y), radius=0.5) for x, y in places]
    plan = sp.plan(scene(*posts, start={"speed": 1.0}, goal={"position": [20000.0, 0.0]}))
    assert plan.certified, plan.reason
    assert plan.travel_time < 1.005 * plan.lower_bound


def test_a_long_slow_place_is_driven_as_fast_with_little_jerk() -> None:
    """A limit of the jerk of 3 m/s^3 costs at most 0.7 s at each of the two ramps that 2 m/s^2 bring."""
    slow = [{"from": 5.0, "to": 25.0, "speed": 0.7}]
    trip = {"goal": {"position": [30.0, 0.0]}, "start": {"speed": 0.0}, "speed_limits": slow}
    times = []
    for jerk in (None, 3.0):
        plan = sp.plan(scene(**trip, vehicle={"max_jerk": jerk}))
        assert plan.certified, plan.reason
        times.append(plan.travel_time)
    assert times[1] - times[0] < 1.4


def test_a_trip_to_begin_with_that_leads_nowhere_is_explained() -> None:
    begin = sp.plan(scene()).trip
    found = planned(scene(disc("there", (20.0, 0.0))), begin=begin)
    assert not found.certified and found.reason is not None
    assert "1 given trip" in found.reason


def test_the_widest_gap_is_not_told_where_there_is_no_time_to_find_it() -> None:
    posts = [disc(f"o{k}", (10.0, 1.1 * k)) for k in range(-6, 7)]
    shut = scene(*posts, bounds={"min": [-5.0, -6.0], "max": [25.0, 6.0]})
    problem = build_problem(shut, sp.zones(shut), sp.Settings())
    routes = RouteChoice.of(problem, np.inf)
    assert routes is not None and routes.next() is None
    assert "the widest passage" in routes.told(shut, NaturalUnits.of(shut))
    routes.roadmap.deadline = -1.0
    assert routes.told(shut, NaturalUnits.of(shut)) == ". No route leads to the goal"


NEAR_AND_FAR: dict[str, tuple[dict[str, Any], dict[str, Any], dict[str, Any]]] = {
    "plain": ({}, {}, {}),
    "moving": ({}, {"speed": 2.0}, {}),
    "parks": ({"max_jerk": 2.0}, {}, {"speed": 0.0, "heading": 0.0}),
    "backs_up": ({"reverse": {"max_speed": 3.0}}, {}, {}),
    "turns_on_the_spot": ({"max_turn_rate": 1.0, "steering": "on_the_spot"}, {}, {}),
    "meets": ({}, {}, {"target": {"motion": {"time": [0.0, 1e4], "position": [(0.0, 0.0), (1e4, 0.0)]}}}),
    "passes": ({}, {}, {"position": (20.0, 0.0)}),
}


@pytest.mark.parametrize("kind", NEAR_AND_FAR)
@pytest.mark.parametrize("away", [0.0, 1e-9, 1e-3, 1e6])
def test_what_is_however_near_or_far_is_planned_or_refused_by_name(kind: str, away: float) -> None:
    with_, begun, asked = NEAR_AND_FAR[kind]
    vehicle = {"radius": 0.5, "max_speed": 10.0, "max_acceleration": 2.0, "max_deceleration": 3.0, **with_}
    start = {"time": 0.0, "position": (0.0, 0.0), "heading": 0.0, "speed": 0.0, **begun}
    for ahead, left in ((1.0, 0.0), (-1.0, 0.0), (0.0, 1.0)):
        place = (ahead * away, left * away)
        goal: dict[str, Any] = {"position": place, **asked}
        if "target" in asked:
            ends = [place, (place[0] + 1e4, place[1])]
            goal = {"target": {"motion": {"time": [0.0, 1e4], "position": ends}}}
        scene = {"vehicle": {**vehicle, "max_curvature": 0.2}, "start": start, "goal": goal}
        goals = {"goals": [{"position": place}]} if kind == "passes" else {}
        try:
            scenario = sp.Scenario(**scene, **goals)
        except sp.ScenarioError as error:
            assert away == 0.0 and re.search(r"goals?(\[0\])?\.position", str(error))
            continue
        began = process_time()
        plan = sp.plan(scenario, time_limit=0.1)
        assert process_time() - began < 3.0
        assert plan.certified or plan.reason


@pytest.mark.parametrize("away", [1e-9, 1e-3])
@pytest.mark.parametrize("toward", [1.6, np.pi, -2.0])
def test_a_vehicle_that_has_to_turn_about_drives_a_loop_to_where_it_is(away: float, toward: float) -> None:
    vehicle = {"radius": 0.5, "max_speed": 10.0, "max_acceleration": 2.0, "max_deceleration": 3.0, "max_curvature": 0.2}
    start = {"time": 0.0, "position": (0.0, 0.0), "heading": 0.0, "speed": 0.0}
    goal = (away * np.cos(toward), away * np.sin(toward))
    plan = sp.plan(sp.Scenario(vehicle=vehicle, start=start, goal={"position": goal}))
    assert plan.certified
    np.testing.assert_allclose(plan.position(plan.arrival_time), goal, atol=1e-5)
    # No way back to where it was, with another heading, is shorter than a circle of 5 m but by what it is away
    times = np.linspace(plan.start_time, plan.arrival_time, 10_001)
    driven = np.hypot(*np.diff(plan.position(times), axis=0).T).sum()
    assert 10.0 * np.pi * (1.0 - 1e-3) - 2.0 * away < driven < 10.0 * np.pi * 1.02
