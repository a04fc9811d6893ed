"""Trips are found that the scenario's guide does not lead to."""

from __future__ import annotations

import numpy as np
import pytest
from scenes import disc, scene

import scp_planner as sp
from scp_planner.planning.other_guides import FastestGuide, with_headings
from scp_planner.planning.runs import CheckedRuns, Task
from scp_planner.planning.trip_search import TripSearch
from scp_planner.planning.ways_round import ways_round
from scp_planner.problem.build import build_problem
from scp_planner.settings.planning import Settings, for_scene

pytestmark = pytest.mark.numerics

DETOUR = [[0.0, 0.0], [10.0, 7.0], [20.0, 0.0]]


def test_a_guide_that_makes_a_detour_does_not_slow_the_trip_down() -> None:
    plan = sp.plan(scene(guide=DETOUR))
    assert plan.certified
    assert plan.travel_time < 1.001 * plan.lower_bound


def search_over(scenario: sp.Scenario, settings: Settings | None = None) -> TripSearch:
    task = Task(scenario, sp.zones(scenario), for_scene(settings or Settings()), np.inf)
    return TripSearch(CheckedRuns(task))


def test_nothing_is_tried_where_the_trip_is_hardly_slower_than_any_can_be() -> None:
    search = search_over(scene(guide=[[0.0, 0.0], [10.0, 0.3], [20.0, 0.0]]))
    search.walk(ways_round(search.runs))
    tried = search.tally.tried.total()
    search.walk([FastestGuide()])
    assert search.tally.tried.total() == tried


def test_over_another_guide_only_what_may_be_faster_is_gone_on_with() -> None:
    search = search_over(scene(disc("post", (10.0, 2.0)), guide=[[0.0, 0.0], [10.0, 3.0], [20.0, 0.0]]))
    search.walk(ways_round(search.runs))
    assert search.best is not None and search.best.holds
    done = search.tally.iterations
    faster, about_as_fast = (TripSearch(search.runs, share * search.best.travel_time) for share in (0.8, 1.01))
    faster.walk(ways_round(search.runs))
    assert faster.found is None
    assert search.tally.iterations - done < 0.5 * done
    about_as_fast.walk(ways_round(search.runs))
    assert about_as_fast.found is not None
    assert about_as_fast.found.holds


def test_a_way_turns_into_the_headings_that_it_would_miss() -> None:
    scenario = scene(start={"heading": 0.2}, goal={"heading": np.pi / 2})
    problem = build_problem(scenario, (), for_scene(Settings()))
    points = with_headings(np.array([[0.0, 0.0], [20.0, 0.0]]), problem)
    assert points == pytest.approx(np.array([[0.0, 0.0], [20.0, -1.0], [20.0, 0.0]]), abs=1e-9)
    problem = build_problem(scene(start={"heading": -2.0}), (), for_scene(Settings()))
    points = with_headings(np.array([[0.0, 0.0], [20.0, 0.0]]), problem)
    assert points == pytest.approx(np.array([[0.0, 0.0], [np.cos(-2.0), np.sin(-2.0)], [20.0, 0.0]]), abs=1e-9)
