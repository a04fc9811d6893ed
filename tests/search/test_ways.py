"""Ways round: their estimates, their sides, and trips along them."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scenes import CROSSERS, disc, scene

from scp_planner import plan
from scp_planner.certificate.lower_bound import kinematic_bound
from scp_planner.problem.build import build_problem
from scp_planner.problem.problem import Problem
from scp_planner.scenario.models import Scenario
from scp_planner.search.first_trips import trip_along
from scp_planner.search.starts import coarsenesses
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


def test_the_same_search_twice_is_the_same_to_the_bit() -> None:
    problem = problem_of(scene(*CROSSERS))
    first, second = (list(ways(WaySearch(problem), 8)) for _ in range(2))
    assert len(first) == len(second) > 1
    for a, b in zip(first, second, strict=True):
        assert a.travel_time == b.travel_time
        np.testing.assert_array_equal(a.offsets, b.offsets)
        np.testing.assert_array_equal(a.times, b.times)


def test_scaling_a_scene_scales_its_ways() -> None:
    """Lengths by eight and times by four: the same grid, so the same cells and ways."""
    length, time = 8.0, 4.0

    def scaled(obstacle: dict[str, Any]) -> dict[str, Any]:
        motion = obstacle["motion"]
        return disc(
            obstacle["id"],
            tuple(length * x for x in motion["position"]),
            tuple(length / time * x for x in motion["velocity"]),
            tuple(length / time**2 * x for x in motion["acceleration"]),
            length * obstacle["shape"]["disc"],
        )

    vehicle = {
        "radius": 0.3 * length,
        "max_speed": 3.0 * length / time,
        "max_acceleration": 1.5 * length / time**2,
        "max_deceleration": 2.0 * length / time**2,
        "max_lateral_acceleration": 2.0 * length / time**2,
        "max_curvature": 1.0 / length,
    }
    small = problem_of(scene(*CROSSERS))
    large_scene = scene(
        *map(scaled, CROSSERS),
        vehicle=vehicle,
        start={"speed": length / time},
        goal={"position": [20.0 * length, 0.0]},
    )
    settings = Settings(max_offset=8.0 * length, clearance_margin=1e-3 * length, path_span=1.5 * length)
    large = build_problem(large_scene, zones(large_scene), settings)
    for a, b in zip(ways(WaySearch(small), 4), ways(WaySearch(large), 4), strict=True):
        assert b.travel_time == pytest.approx(time * a.travel_time, rel=1e-9)
        np.testing.assert_allclose(b.offsets, length * a.offsets, atol=1e-9)


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
