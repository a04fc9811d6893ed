"""Ways round: their estimates, their sides, and trips along them."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scenes import CROSSERS, disc, scene

from scp_planner import plan
from scp_planner.certificate.lower_bound import kinematic_bound
from scp_planner.problem.build import build_problem
from scp_planner.problem.problem import Problem
from scp_planner.scenario.models import Scenario
from scp_planner.search.first_trips import arcs, trip_along
from scp_planner.search.starts import coarsenesses, starts
from scp_planner.search.ways import WaySearch, WayTree, ways
from scp_planner.settings.planning import Settings
from scp_planner.threat_zones.of_scenario import zones


def problem_of(scenario: Scenario) -> Problem:
    return build_problem(scenario, zones(scenario), Settings())


@pytest.mark.parametrize(
    "scenario",
    [
        scene(),
        scene(goal={"speed": 0.0}),
        scene(start={"speed": 0.0}),
        scene(start={"speed": 3.0}, goal={"position": [300.0, 0.0]}),
        scene(goal={"position": [0.5, 0.0]}),
        scene(vehicle={"max_speed": 30.0, "max_acceleration": 0.4}),
    ],
)
def test_without_obstacles_the_estimate_is_the_fastest_time(scenario: Scenario) -> None:
    way = WaySearch(problem_of(scenario)).best()
    assert way is not None
    # the planner's margins from limits take 1e-4
    assert way.travel_time == pytest.approx(kinematic_bound(scenario), rel=2e-3)
    assert np.all(way.offsets == 0.0)


def test_estimates_are_near_what_the_loop_makes_of_ways() -> None:
    scenario = scene(*CROSSERS)
    way = WaySearch(problem_of(scenario)).best()
    assert way is not None
    result = plan(scenario)
    assert result.certified
    assert way.travel_time == pytest.approx(result.travel_time, rel=0.02)


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_estimates_know_the_inside_of_a_bend_from_the_outside(side: float) -> None:
    """At top speed all the way it takes the length of the line through the way's places in the plane."""
    in_the_way = disc("at the bend", (10.0, 0.5 + side), radius=1.5)
    bent = scene(
        in_the_way,
        start={"speed": 3.0, "heading": None},
        goal={"position": [10.0, 12.0]},
        guide=[[0.0, 0.0], [10.0, 0.0], [10.0, 12.0]],
        vehicle={"max_lateral_acceleration": None},
    )
    problem = problem_of(bent)
    way = WaySearch(problem).best()
    assert way is not None
    fine = np.linspace(0.0, problem.space.length, 4001)
    frame = problem.space.guide.frame(fine)
    places = frame.position + np.interp(fine, way.stations, way.offsets)[:, None] * frame.normal
    driven = float(np.hypot(*np.diff(places, axis=0).T).sum())
    assert way.travel_time == pytest.approx(driven / 3.0, rel=3e-3)
    by_the_clock = float(way.times[-1])
    assert abs(by_the_clock - driven / 3.0) > 0.02 * by_the_clock
    slower = WaySearch(problem).best((), 1.001 * way.travel_time)
    assert slower is not None and slower.travel_time == way.travel_time
    assert WaySearch(problem).best((), 0.9 * way.travel_time) is None


def test_closed_sides_are_not_passed() -> None:
    problem = problem_of(scene(*CROSSERS))
    search = WaySearch(problem)
    first = search.best()
    assert first is not None
    for zone, side in first.sides:
        other = search.best(((zone, side),))
        assert other is not None
        assert (zone, side) not in other.sides
        assert other.travel_time >= first.travel_time - search.grid.delay_step


def test_ways_differ_and_come_with_rising_estimates() -> None:
    search = WaySearch(problem_of(scene(*CROSSERS)))
    tree = WayTree(search, 30)
    found = []
    while (way := tree.next()) is not None:
        found.append(way)
        tree.branch(way.sides[:3])
    assert len({way.sides_set for way in found}) == len(found) > 2
    # A way with more sides closed is no faster than the one it was branched from, to the rounding of delays.
    assert all(b.travel_time >= found[0].travel_time - search.grid.delay_step for b in found[1:])


def test_a_limit_on_the_estimate_only_leaves_out_slower_ways() -> None:
    search = WaySearch(problem_of(scene(*CROSSERS)))
    best = search.best()
    assert best is not None
    within = search.best((), best.travel_time + search.grid.delay_step)
    assert within is not None
    assert within.travel_time == pytest.approx(best.travel_time, abs=search.grid.delay_step)
    assert search.best((), search.grid.fastest[-1] - 3.0 * search.grid.delay_step) is None


def test_first_trips_keep_speed_and_acceleration() -> None:
    problem = problem_of(scene(*CROSSERS))
    limits = problem.limits
    for way in list(ways(WaySearch(problem), 6))[:4]:
        trip = trip_along(problem, way)
        assert trip.beta.max() <= limits.acceleration + 1e-9
        assert trip.beta.min() >= -limits.deceleration - 1e-9
        assert trip.speed_control_points().min() >= -1e-6
        assert trip.speed_control_points().max() <= limits.speed * 1.02
        assert trip.travel_time == pytest.approx(way.travel_time, rel=0.05)


def test_first_trips_ask_the_motor_for_what_it_has() -> None:
    """The speeds are those of the way: the first trip's own may be a little higher."""
    start = {"speed": 0.5}
    hard, weak = (problem_of(scene(start=start, vehicle=change)) for change in ({}, {"max_power": 0.3}))
    asked = {}
    for name, problem in (("hard", hard), ("weak", weak)):
        trip = trip_along(problem, next(iter(ways(WaySearch(hard), 1))))
        speeds = trip.speed_at(problem.space.acceleration.breakpoints)
        asked[name] = float((trip.beta * np.maximum(speeds[:-1], speeds[1:])).max())
    assert asked["hard"] > 0.6
    assert asked["weak"] <= 0.3 * 1.2


def test_ways_end_where_none_can_be_as_fast_as_what_has_been_found() -> None:
    problem = problem_of(scene(*CROSSERS))
    every = [way.travel_time for way in ways(WaySearch(problem), 8)]
    assert len(every) > 2 and every[1] < every[-1]
    most: list[float] = [np.inf]
    bounded: list[float] = []
    for way in ways(WaySearch(problem), 8, lambda: most[-1]):
        bounded.append(way.travel_time)
        if len(bounded) == 1:
            most.append(every[1] + 1e-6)
    assert bounded == [one for one in every if one <= most[-1]]


def test_a_way_waits_for_a_goal_that_opens_late() -> None:
    """The fastest drive takes under 4 s: even the coarsest of the usual delays would not last."""
    scenario = scene(
        *CROSSERS,
        start={"speed": 2.0},
        goal={"earliest_arrival": 60.0},
        vehicle={"max_speed": 50.0, "max_acceleration": 10.0},
    )
    problem = problem_of(scenario)
    first = coarsenesses(problem)[0]
    way = WaySearch(problem, first).best()
    assert way is not None
    assert way.travel_time >= 60.0
    assert trip_along(problem, way).travel_time == pytest.approx(60.0, rel=0.05)
    early = problem_of(scene(*CROSSERS, goal={"earliest_arrival": 1.0}))
    assert coarsenesses(early)[0] == 1.0


def test_after_the_deadline_no_way_is_found() -> None:
    problem = problem_of(scene(*[disc(f"o{k}", (2.0 + 0.4 * k, 3.0), radius=0.2) for k in range(40)]))
    assert WaySearch(problem).best() is not None
    assert WaySearch(problem, deadline=-np.inf).best() is None


# Trips along ways: what they fit best by least squares, and drives of the textbook


def of_crossers(**changes: object) -> Problem:
    scenario = scene(*CROSSERS, **changes)
    return build_problem(scenario, zones(scenario), Settings())


@pytest.mark.parametrize("smoothing", [1.0, 0.1])
def test_a_trip_along_a_way_fits_its_offsets_and_bends_as_little(smoothing: float) -> None:
    problem = of_crossers()
    way = WaySearch(problem).best()
    assert way is not None and np.abs(way.offsets).max() > 0.3
    trip = trip_along(problem, way, smoothing)
    space, free = problem.space, problem.ends.free
    rows = space.path.rows(way.stations / space.length)
    weighted = space.tables.station_bends * (smoothing / space.length**2)
    matrix, theta = np.concatenate([rows, weighted]), problem.ends.theta.copy()
    wanted = np.concatenate([way.offsets, np.zeros(len(weighted))]) - matrix @ theta
    theta[free] += np.linalg.lstsq(matrix[:, free], wanted, rcond=None)[0]
    assert trip.theta == pytest.approx(np.clip(theta, problem.ends.lower, problem.ends.upper), abs=1e-6)
    assert trip.travel_time == pytest.approx(way.times[-1], rel=0.05)
    assert np.all(trip.beta <= problem.highest_accelerations + 1e-9)
    assert np.all(trip.beta >= problem.lowest_accelerations - 1e-9)


def test_arcs_go_to_both_sides_and_arrive() -> None:
    problem = of_crossers()
    found = list(arcs(problem))
    middle = [float(trip.path.points(np.array([0.5])).position[0, 1]) for trip in found]
    assert [int(np.sign(round(y, 6))) for y in middle] == [0, 1, -1, 1, -1] * 2
    assert all(math.isfinite(trip.travel_time) for trip in found)
    assert min(trip.travel_time for trip in found[5:]) > max(trip.travel_time for trip in found[:1])


# Starts for any method: different ways round, and arcs where there is none


def coarse_problem(scenario: Scenario) -> Problem:
    return build_problem(scenario, zones(scenario), Settings(path_span=2.5, acceleration_spans=8, samples=80))


def test_starts_are_several_different_ways() -> None:
    found = list(starts(coarse_problem(scene(*CROSSERS)), 12))
    assert len(found) >= 3
    assert found[0][0] == min(estimate for estimate, _ in found)
    ends = {tuple(np.round(trajectory.theta, 3)) for _, trajectory in found}
    assert len(ends) == len(found)


def test_starts_are_arcs_where_there_is_no_way() -> None:
    problem = coarse_problem(scene(disc("on-goal", (20.0, 0.5), radius=2.0)))
    found = list(starts(problem, 4))
    assert {estimate for estimate, _ in found} == {0.0}
    assert [start.travel_time for _, start in found] == [arc.travel_time for arc in arcs(problem)]


def test_coarse_delays_do_not_let_a_way_jump_through_a_row() -> None:
    """Ten discs drive over the goal, closer than the vehicle fits between: it has to wait for the last one."""
    row = [disc(f"x{k}", (40.0 + 7.5 * k, 0.0), (-5.0, 0.0), radius=1.5) for k in range(10)]
    slow = {"radius": 1.5, "max_speed": 5.0, "max_acceleration": 5.0, "max_deceleration": 5.0, "max_curvature": 0.2}
    scenario = scene(*row, vehicle=slow, start={"speed": 0.0}, goal={"speed": 0.0})
    way = WaySearch(problem_of(scenario), 16.0).best()
    assert way is not None
    gone = (40.0 + 7.5 * 9 + 3.0 - 20.0) / 5.0  # when the last one has left the goal
    assert gone < way.travel_time < 1.4 * gone
    made = plan(scenario)
    assert made.certified
    assert made.travel_time < 1.1 * gone
