"""The fastest way on the ground, against ways that are known or tried one by one."""

from __future__ import annotations

from itertools import pairwise, product
from typing import Any

import numpy as np
import pytest
from clock import FakeClock
from scenes import disc, scene

import scp_planner as sp
from scp_planner.problem.build import build_problem, slow_stretches
from scp_planner.problem.problem import Problem
from scp_planner.problem.shortcuts import fastest_way, ground_of
from scp_planner.scenario.places import Line
from scp_planner.settings.planning import Settings, for_scene

Array = np.ndarray


def shelf(x: float, y: float, width: float, height: float) -> dict[str, Any]:
    shape = {"rectangle": [width, height], "heading": 0.0}
    return {"id": f"shelf {x} {y}", "shape": shape, "motion": {"position": [x, y]}}


def problem_of(scenario: sp.Scenario, **settings: Any) -> Problem:
    return build_problem(scenario, sp.zones(scenario), for_scene(Settings(**settings)))


def way_of(problem: Problem) -> Array | None:
    return fastest_way(problem, slow_stretches(problem.scenario, problem.frame, problem.settings))


def length(points: Array) -> float:
    return float(np.hypot(*np.diff(points, axis=0).T).sum())


def test_on_empty_ground_it_is_the_straight_line_whatever_the_guide() -> None:
    way = way_of(problem_of(scene(guide=[[0.0, 0.0], [10.0, 5.0], [20.0, 0.0]])))
    assert way == pytest.approx(np.array([[0.0, 0.0], [20.0, 0.0]]), abs=1e-9)


def test_it_leads_round_the_nearer_corners_of_what_stands() -> None:
    way = way_of(problem_of(scene(shelf(10.0, 1.0, 2.0, 6.0))))
    assert way is not None
    # Below, past corners that are inflated by the vehicle's radius of 0.3
    least = 2.0 * np.hypot(9.0, 2.3) + 2.0
    assert least * 0.99 < length(way) < least * 1.03
    assert way[:, 1].min() < -2.2
    assert way[:, 1].max() < 1e-9


def test_what_moves_is_not_in_its_way() -> None:
    way = way_of(problem_of(scene(disc("moves", (10.0, 0.0), (0.0, 0.1), radius=2.0))))
    assert way is not None
    assert len(way) == 2


def test_there_is_none_through_a_wall_or_beyond_the_largest_offset() -> None:
    wall = shelf(10.0, 0.0, 0.2, 12.0)
    assert way_of(problem_of(scene(wall), max_offset=5.0)) is None
    round_it = way_of(problem_of(scene(wall), max_offset=8.0))
    assert round_it is not None
    assert np.abs(round_it[:, 1]).max() > 6.0
    assert way_of(problem_of(scene(wall, bounds={"min": [-1.0, -5.0], "max": [21.0, 5.0]}))) is None


def test_it_stays_within_the_largest_offset_of_the_guide() -> None:
    guide = [[0.0, 0.0], [10.0, 9.0], [20.0, 0.0]]
    way = way_of(problem_of(scene(guide=guide), max_offset=3.0))
    assert way is not None
    fine = np.concatenate([a + np.linspace(0.0, 1.0, 50)[:, None] * (b - a) for a, b in pairwise(way)])
    assert Line(np.array(guide)).distances(fine).max() < 3.3  # a leg between nodes may be a little beyond
    assert length(way) < 0.95 * length(np.array(guide))


def test_no_way_with_two_corners_round_a_slow_place_is_faster() -> None:
    line = [[0.0, -3.0], [6.0, 3.0], [13.0, -3.0], [20.0, 3.0]]
    scenario = scene(speed_limits=[{"from": 9.0, "to": 16.0, "speed": 0.6, "line": line}])
    problem = problem_of(scenario)
    ground = ground_of(problem, slow_stretches(scenario, problem.frame, problem.settings))

    def duration(points: Array) -> float:
        return sum(ground.duration(a, b, 0.05) for a, b in pairwise(points))

    way = way_of(problem)
    assert way is not None
    places = [np.array(corner) for corner in product((5.0, 8.0, 11.0, 14.0), (-6.0, -3.0, 0.0, 3.0, 6.0))]
    start, goal = np.zeros(2), np.array([20.0, 0.0])
    tried = min(duration(np.array([start, a, b, goal])) for a in places for b in places if a[0] <= b[0])
    assert duration(way) < 0.8 * duration(np.array([start, goal]))
    assert duration(way) <= 1.01 * tried


def test_it_keeps_away_from_slow_places_if_it_is_to() -> None:
    """How far it can be moved up before a point of it is slow."""
    line = [[7.0, -0.4], [10.0, 5.0], [13.0, -0.4]]
    scenario = scene(speed_limits=[{"from": 2.0, "to": 10.4, "speed": 0.5, "line": line}])
    problem = problem_of(scenario)
    slow = slow_stretches(scenario, problem.frame, problem.settings)
    ground = ground_of(problem, slow)
    least = []
    for beside in (0.0, 0.5):
        way = fastest_way(problem, slow, beside)
        assert way is not None
        places = np.concatenate([np.linspace(a, b, 200) for a, b in pairwise(way)])
        shifts = np.linspace(0.0, 1.0, 101)
        free = [ground.slowness(places + np.array([0.0, up])).max() < 0.5 for up in shifts]
        least.append(float(shifts[free.index(False)]))
    assert least[1] > least[0] + 0.1


def test_more_than_enough_room_is_not_measured_exactly() -> None:
    problem = problem_of(scene(shelf(10.0, 1.0, 2.0, 6.0), shelf(14.0, -3.0, 3.0, 1.0), disc("o", (5.0, -4.0))))
    ground = ground_of(problem, ())
    places = np.random.default_rng(0).uniform([0.0, -6.0], [20.0, 6.0], (2000, 2))
    exact = ground.room(places, np.inf)
    for enough in (0.0, 0.7):
        found = ground.room(places, enough)
        near = exact <= enough
        assert 0.05 < near.mean() < 0.95
        assert np.array_equal(found[near], exact[near])
        assert np.all((found[~near] > enough) & (found[~near] <= exact[~near] + 1e-12))


def test_a_look_at_the_ground_is_given_up_at_its_deadline(monkeypatch: pytest.MonkeyPatch) -> None:
    """Among many slow places each part of a look takes long: the clock goes on by 1 at each time it is looked at."""
    lines = [[[x, -6.0], [x + 1.0, 0.3 * x], [x + 2.0, 6.0]] for x in np.linspace(2.0, 16.0, 40)]
    limits = [{"from": 1.0, "to": 3.0, "speed": 1.0, "line": line} for line in lines]
    scenario = scene(shelf(10.0, 1.0, 2.0, 6.0), speed_limits=limits)
    problem = problem_of(scenario)
    slow = slow_stretches(scenario, problem.frame, problem.settings)
    whole = fastest_way(problem, slow)
    assert whole is not None
    clock = FakeClock(1.0)
    clock.rule(monkeypatch)
    assert fastest_way(problem, slow, deadline=2.5) is None
    assert clock() == 4.0, "the look at which it was late was the last"
    assert np.array_equal(whole, np.asarray(fastest_way(problem, slow, deadline=1e9)))
