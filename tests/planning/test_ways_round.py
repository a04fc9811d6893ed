"""Ways round that are tried, and arcs where there are none."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest
from clock import FakeClock
from scenes import disc, scene

import scp_planner as sp
from scp_planner.planning.attempts import Attempt
from scp_planner.planning.runs import CheckedRuns, ScpRun, Task
from scp_planner.planning.trip_search import TripSearch
from scp_planner.planning.ways_round import Arcs, Ways, ways_round
from scp_planner.search.first_trips import bows
from scp_planner.settings.planning import Settings, for_scene
from scp_planner.solvers.interface import QuadraticProgram, Solution, solver_named

STANDING = scene(disc("right", (6.0, 0.2)), disc("left", (10.0, -0.4), radius=0.8), disc("last", (14.0, 0.3)))


def search_in(scenario: sp.Scenario, settings: Settings | None = None, deadline: float = np.inf) -> TripSearch:
    task = Task(scenario, sp.zones(scenario), for_scene(settings or Settings()), deadline)
    return TripSearch(CheckedRuns(task))


class Failed(Attempt[TripSearch, ScpRun]):
    """Stands for runs from ways round, of which none leads anywhere."""

    what = "way round"
    most = 100

    def __init__(self, count: int, first: ScpRun | None = None) -> None:
        self.count, self.first = count, first

    def runs(self, search: TripSearch) -> Iterator[ScpRun]:
        search.tally.tried[self.what] += self.count
        if self.first is not None:
            yield self.first


def test_a_way_may_turn_out_better_than_its_estimate_by_as_much_as_another_did() -> None:
    """The second way is estimated to be slower than what the first led to, and turns out to be faster."""
    search = search_in(STANDING)
    first, ways = search_in(STANDING), Ways(search.runs)
    ways.most = 1
    first.walk([ways])
    ways = Ways(search.runs)
    ways.estimate_error = 0.0
    search.walk([ways])
    assert search.tally.tried["way round"] > 1
    assert search.best is not None and first.best is not None
    assert search.best.holds and search.best.travel_time < first.best.travel_time


def test_no_arc_is_begun_when_the_time_is_up(monkeypatch: pytest.MonkeyPatch) -> None:
    """The clock stands still, but that the first subproblem takes as long as all that is left."""
    clock = FakeClock(0.0)
    clock.rule(monkeypatch)
    daqp = solver_named("daqp")

    class Slow:
        name = "slow"

        def solve(self, program: QuadraticProgram) -> Solution:
            clock.tick = 1.0
            return daqp.solve(program)

    search = search_in(STANDING, deadline=0.5)
    search = TripSearch(CheckedRuns(replace(search.task, own_solver=Slow())))
    assert len(list(bows(search.runs.problem))) > 3
    search.walk([Arcs(search.runs)])
    assert search.tally.tried["arc"] == 2, "the first one, and what it came to, to be judged"
    assert search.best is not None and not search.best.holds


def test_after_a_search_that_takes_most_of_the_time_there_is_enough_for_one_arc(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    clock = FakeClock(0.0)
    clock.rule(monkeypatch)
    search = search_in(STANDING, deadline=0.5)
    clock.tick = 1.0
    search.walk([Ways(search.runs)])
    assert search.count == 0 and search.cut_off
    clock.tick = 0.0
    search.walk([Arcs(search.runs)])
    assert search.tally.tried == {"arc": 1}
    assert search.best is not None and search.best.run.record, "there was time for it"


@pytest.mark.parametrize("covered", [False, True])
def test_a_goal_that_is_covered_for_good_takes_a_single_arc(covered: bool) -> None:
    lid = disc("lid", (20.0, 0.2 if covered else 3.0), radius=1.0)
    search = search_in(scene(lid))
    search.walk(ways_round(search.runs))
    assert (search.tally.tried == {"arc": 1}) is covered


@pytest.mark.parametrize(
    ("thorough", "effort", "ways", "tried"),
    [
        (True, 1.0, 1, True),
        (False, 1.0, 1, False),
        (True, 1.0, Settings().max_runs, False),
        (True, 2.0, Settings().max_runs, True),
    ],
)
def test_arcs_are_tried_where_fewer_ways_than_usual_have_failed(
    thorough: bool, effort: float, ways: int, tried: bool
) -> None:
    """More effort does not take their place: more ways are tried with it, and arcs as well."""
    settings = for_scene(Settings(effort=effort, max_offset=2.0))
    blocked = scene(disc("all", (12.0, 0.0), radius=7.0))
    search = TripSearch(CheckedRuns(Task(blocked, sp.zones(blocked), settings, np.inf, thorough=thorough)))
    failed = search.runs.attempt(next(bows(search.runs.problem)))
    assert not failed.holds
    search.walk([Failed(ways - 1, failed), Arcs(search.runs)])
    assert (search.tally.tried["arc"] > 0) is tried


def test_where_there_is_no_way_arcs_are_tried_however_much_was_over_another_guide() -> None:
    search = search_in(scene())
    search.walk([Failed(search.runs.most_ways), Arcs(search.runs)])
    assert search.best is not None and search.best.certificate is not None
