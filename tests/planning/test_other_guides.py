"""Trips are found that the scenario's guide does not lead to."""

from __future__ import annotations

import numpy as np
import pytest
from scenes import disc, scene

import scp_planner as sp
from scp_planner.planning.other_guides import with_headings, with_the_fastest_way
from scp_planner.planning.runs import CheckedRuns, Task
from scp_planner.planning.ways_round import WaysRound
from scp_planner.problem.build import build_problem
from scp_planner.search.first_trips import bows
from scp_planner.settings.planning import Settings, for_scene

pytestmark = pytest.mark.numerics

DETOUR = [[0.0, 0.0], [10.0, 7.0], [20.0, 0.0]]


def test_a_guide_that_makes_a_detour_does_not_slow_the_trip_down() -> None:
    plan = sp.plan(scene(guide=DETOUR))
    assert plan.certified
    assert plan.travel_time < 1.001 * plan.lower_bound


def test_nothing_is_tried_where_the_trip_is_hardly_slower_than_any_can_be() -> None:
    scenario = scene(guide=[[0.0, 0.0], [10.0, 0.3], [20.0, 0.0]])
    runs = CheckedRuns(Task(scenario, (), for_scene(Settings()), np.inf))
    best = WaysRound(runs).best()
    tried = runs.task.tally.tried
    assert with_the_fastest_way(runs, best) == [(runs, best)]
    assert runs.task.tally.tried == tried


def test_over_another_guide_only_what_may_be_faster_is_gone_on_with() -> None:
    bow = [[0.0, 0.0], [10.0, 3.0], [20.0, 0.0]]
    runs = CheckedRuns(Task(scene(disc("post", (10.0, 2.0)), guide=bow), (), for_scene(Settings()), np.inf))
    best = WaysRound(runs).best()
    assert best.holds
    done = runs.task.tally.iterations
    assert WaysRound(runs).faster_than(0.8 * best.travel_time) is None
    assert runs.task.tally.iterations - done < 0.5 * done
    found = WaysRound(runs).faster_than(1.01 * best.travel_time)
    assert found is not None
    assert found.holds


def test_a_way_turns_into_the_headings_that_it_would_miss() -> None:
    scenario = scene(start={"heading": 0.2}, goal={"heading": np.pi / 2})
    problem = build_problem(scenario, (), for_scene(Settings()))
    points = with_headings(np.array([[0.0, 0.0], [20.0, 0.0]]), problem)
    assert points == pytest.approx(np.array([[0.0, 0.0], [20.0, -1.0], [20.0, 0.0]]), abs=1e-9)
    problem = build_problem(scene(start={"heading": -2.0}), (), for_scene(Settings()))
    points = with_headings(np.array([[0.0, 0.0], [20.0, 0.0]]), problem)
    assert points == pytest.approx(np.array([[0.0, 0.0], [np.cos(-2.0), np.sin(-2.0)], [20.0, 0.0]]), abs=1e-9)


def test_where_there_is_no_way_something_is_tried_however_much_was_over_another_guide(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    runs = CheckedRuns(Task(scene(), (), for_scene(Settings()), np.inf))
    runs.task.tally.tried = runs.task.settings.max_runs
    search = WaysRound(runs)
    monkeypatch.setattr(search, "_branches", lambda: iter(()))
    assert search.best().certificate is not None


@pytest.mark.parametrize(("effort", "tried"), [(1.0, 0), (2.0, 1)])
def test_more_effort_does_not_take_the_place_of_bows(
    effort: float, tried: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Where as many ways as usual have failed, more are tried with more effort, and bows as well."""
    runs = CheckedRuns(Task(scene(), (), for_scene(Settings(effort=effort)), np.inf))
    search = WaysRound(runs)
    search.incumbent = search.runs.attempt(next(bows(runs.problem)))
    search.tally.tried = runs.task.settings.max_runs
    from_bows = search.incumbent
    monkeypatch.setattr(search, "_from_bows", lambda: from_bows)
    assert list(search._second_thoughts()) == [from_bows] * tried
