"""Which ways round are tried."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from clock import FakeClock
from scenes import disc, scene

from scp_planner import zones
from scp_planner.planning import ways_round
from scp_planner.planning.runs import CheckedRuns, ScpAttempt, Task
from scp_planner.planning.ways_round import Branch, WaysRound
from scp_planner.search.first_trips import bows
from scp_planner.search.ways import WaySearch
from scp_planner.settings.planning import Settings, for_scene
from scp_planner.solvers import QuadraticProgram
from scp_planner.solvers.daqp_solver import DaqpSolver
from scp_planner.solvers.interface import Solution

STANDING = scene(disc("right", (6.0, 0.2)), disc("left", (10.0, -0.4), radius=0.8), disc("last", (14.0, 0.3)))


class Watched(WaysRound):
    """Keeps what was tried, and may forget by how much estimates missed."""

    def __init__(self, forgets: bool = False) -> None:
        super().__init__(CheckedRuns(Task(STANDING, zones(STANDING), Settings(), np.inf)))
        self.forgets = forgets
        self.branches: list[Branch] = []
        self.attempts: list[ScpAttempt] = []

    def tried(self, start: Branch) -> ScpAttempt:
        attempt = super().tried(start)
        self.branches.append(start)
        self.attempts.append(attempt)
        if self.forgets:
            start.missed = 0.0
        return attempt


def test_a_way_may_turn_out_better_than_its_estimate_by_as_much_as_another_did(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(ways_round, "ESTIMATE_ERROR", 0.0)
    search, forgetful = Watched(), Watched(forgets=True)
    best, without = search.best(), forgetful.best()
    assert len(search.branches) > len(forgetful.branches)
    assert best.holds and without.holds
    assert best.travel_time < without.travel_time
    first, attempt = search.branches[0], search.attempts[0]
    assert attempt.holds
    assert first.missed == first.estimate - attempt.travel_time > 0.0
    # The second one is estimated to be slower than what the first led to, and is not.
    assert attempt.travel_time < search.branches[1].estimate <= attempt.travel_time + first.missed


def test_of_bows_none_is_begun_when_the_time_is_up(monkeypatch: pytest.MonkeyPatch) -> None:
    """The clock stands still until there is no way, and goes on by more than all that is left in the first run."""
    clock = FakeClock(0.0)
    clock.rule(monkeypatch)

    class Slow(DaqpSolver):
        def solve(self, program: QuadraticProgram) -> Solution:
            clock.tick = 1.0
            return super().solve(program)

    blocked = scene(disc("right", (6.0, 2.0), radius=3.0), disc("left", (6.0, -2.0), radius=3.0))
    runs = CheckedRuns(Task(blocked, zones(blocked), Settings(), 0.5, own_solver=Slow()))
    assert len(list(bows(runs.problem))) > 3
    search = WaysRound(runs)
    assert not search.best().holds
    assert search.tally.tried == 1


def test_a_search_that_takes_most_of_the_time_leaves_enough_for_one_trip(monkeypatch: pytest.MonkeyPatch) -> None:
    """The search finds nothing in its share of the time: one bow is run, once, in what is left."""
    clock = FakeClock(0.0)
    clock.rule(monkeypatch)
    deadlines: list[float] = []

    class Slow(WaySearch):
        def __init__(self, *given: Any, **named: Any) -> None:
            super().__init__(*given, **named)
            deadlines.append(self.deadline)

        def best_of(self, cases: Any, within: float = np.inf) -> list[Any]:
            monkeypatch.setattr(FakeClock, "__call__", lambda _: 0.8)
            return [None] * len(cases)

    monkeypatch.setattr(ways_round, "WaySearch", Slow)
    search = WaysRound(CheckedRuns(Task(STANDING, zones(STANDING), Settings(), 1.0)))
    best = search.best()
    assert deadlines == [ways_round.FIRST_SEARCH]
    assert search.tally.tried == 1
    assert best.run.record, "there was time for it"


@pytest.mark.parametrize("thorough", [True, False])
def test_bows_are_tried_where_no_way_leads_to_a_trip_if_all_is_to_be_tried(
    thorough: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    hemmed_in = scene(*(disc(f"o{k}", (10.0, y), radius=0.6) for k, y in enumerate(np.arange(-12.0, 13.0))))
    asked: list[WaysRound] = []
    from_bows = WaysRound._from_bows

    def watched(search: WaysRound, *rest: Any) -> ScpAttempt:
        asked.append(search)
        return from_bows(search, *rest)

    monkeypatch.setattr(WaysRound, "_from_bows", watched)
    task = Task(hemmed_in, zones(hemmed_in), for_scene(Settings()), np.inf, thorough=thorough)
    search = WaysRound(CheckedRuns(task))
    search._failed = [Branch(1.0, lambda _: next(bows(search.problem)), exhausted=True)]
    search.incumbent = search.runs.attempt(next(bows(search.problem)))
    assert not search.incumbent.holds
    list(search._second_thoughts())
    assert len(asked) == int(thorough)
