"""Replans that run out of time: each stage ends, and what is answered is honest."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import islice
from typing import Any

import numpy as np
import pytest
from clock import FakeClock
from scenes import disc, scene

import scp_planner as sp
from scp_planner.online import evasion
from scp_planner.online.decision import Decision
from scp_planner.online.dodge_outlooks import DodgeOutlooks
from scp_planner.online.dodges import Dodges
from scp_planner.online.fallback import Fallback
from scp_planner.online.looks import GRIDS
from scp_planner.online.means import Replan
from scp_planner.online.plan import AWAY, Outcome
from scp_planner.online.planner import Planner
from scp_planner.search.ways import WaySearch

COUNT = 120


class SetClock(FakeClock):
    """One that shows what it is set to."""

    now = 0.0

    def __call__(self) -> float:
        return self.now


def surprised(low: Sequence[float] = (4.0, -8.0), high: Sequence[float] = (30.0, 8.0)) -> Planner:
    """A planner on its way, into whose view comes a crowd."""
    planner = Planner(scene(goal={"position": [60.0, 0.0]}))
    planner.replan(0.0, (0.0, 0.0), 0.0, 1.0)
    places = np.random.default_rng(0).uniform(low, high, (COUNT, 2))
    for number, place in enumerate(places):
        planner.add_obstacle(f"n{number}", {"disc": 0.4}, covariance=[[0.0025, 0.0], [0.0, 0.0025]])
        planner.observe(f"n{number}", 0.1, place)
    return planner


def looks_counted(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """How many distances each look at dodges finds, as they are made."""
    looked: list[int] = []
    rounds = Dodges._from_rounds

    def counted(self: Dodges, *given: Any) -> Any:
        found = rounds(self, *given)
        looked.append(found[0].size)
        return found

    monkeypatch.setattr(Dodges, "_from_rounds", counted)
    return looked


def test_who_is_late_gets_out_of_the_way_of_a_crowd_with_little_work(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(evasion, "HURRIED", 100_000)
    looked = looks_counted(monkeypatch)
    planner = surprised()
    assert not looked
    in_time = planner.replan(0.1, (0.1, 0.0), 0.0, 1.0)
    at_leisure = max(looked)
    looked.clear()
    planner = surprised()
    FakeClock(1.0).rule(monkeypatch)
    late = planner.replan(0.1, (0.1, 0.0), 0.0, 1.0, deadline=0.5)
    assert late.outcome in AWAY and in_time.outcome in AWAY
    assert looked and max(looked) < 0.2 * at_leisure
    assert late.certified or late.reason


def test_a_search_for_ways_ends_with_the_time_and_is_coarser_then(monkeypatch: pytest.MonkeyPatch) -> None:
    """The clock jumps past the deadline while the search looks at the first obstacles."""
    clock = SetClock()
    clock.rule(monkeypatch)
    searches: list[WaySearch] = []
    init = WaySearch.__init__

    def made(self: WaySearch, *arguments: Any, **options: Any) -> None:
        init(self, *arguments, **options)
        searches.append(self)
        clock.now += 1.0

    monkeypatch.setattr(WaySearch, "__init__", made)
    planner = Planner(
        scene(*[disc(f"d{k}", (8.0 + k, 0.4 * (-1) ** k)) for k in range(6)], goal={"position": [60.0, 0.0]})
    )
    late = planner.replan(0.0, (0.0, 0.0), 0.0, 0.0, deadline=0.5)
    assert len(searches) == 1 and searches[0].deadline < clock.now
    assert not searches[0].cells.cut_off or searches[0].cells.out_of_time
    assert late.reason and not late.arrived
    planner.replan(0.1, (0.0, 0.0), 0.0, 0.0, deadline=0.5)
    assert len(searches) == 2
    assert len(searches[1].grid.lines) < len(searches[0].grid.lines), "the next one is coarser"
    monkeypatch.setattr(WaySearch, "__init__", init)
    plans = [planner.replan(0.1 * k, (0.0, 0.0), 0.0, 0.0, deadline=0.5) for k in range(2, 20)]
    assert any(plan.outcome is Outcome.IMPROVED for plan in plans), "until there is time"


def test_a_search_that_goes_on_at_the_next_replan_has_its_time() -> None:
    """Ways are found one by one, each by the deadline of the replan that asks for it."""
    asked: list[float] = []
    found = WaySearch.go_on_until
    deadlines = iter([10.0, 20.0, 30.0])
    planner = Planner(scene(*[disc(f"d{k}", (8.0 + 3.0 * k, 0.4 * (-1) ** k)) for k in range(4)]))
    plan = planner.replan(0.0, (0.0, 0.0), 0.0, 0.0)
    assert plan.certified
    means = planner._means
    with pytest.MonkeyPatch.context() as patched:

        def noted(self: WaySearch, deadline: float) -> None:
            asked.append(deadline)
            found(self, math.inf)

        patched.setattr(WaySearch, "go_on_until", noted)
        problem = _problem(planner)
        starts = means.starts(problem, lambda: math.inf, lambda: next(deadlines) + 1e9, GRIDS[0])
        assert len(list(islice(starts, 2))) == 2
    assert asked == [20.0 + 1e9]


def _problem(planner: Planner) -> Any:
    assert planner._state is not None
    moment = planner._means.moment(planner._state)
    return planner._means.problem(Replan(moment, 0.0, math.inf, None, 0))


def test_a_look_at_all_dodges_is_not_begun_that_takes_longer_than_is_left(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(evasion, "HURRIED", 100_000)
    looked = looks_counted(monkeypatch)
    clock = SetClock()
    clock.rule(monkeypatch)
    most = []
    for each in (0.0, 1.0):
        planner = surprised()
        planner._decision._fallback._evasion._each = each  # s that a dodge takes, as was seen before
        looked.clear()
        assert planner.replan(0.1, (0.1, 0.0), 0.0, 1.0, deadline=0.5).outcome in AWAY
        most.append(max(looked))
    assert most[1] < 0.2 * most[0]


def test_what_replans_take_beyond_their_deadline_is_kept_back_of_the_next_ones(monkeypatch: pytest.MonkeyPatch) -> None:
    clock, left = SetClock(), list[float]()
    clock.rule(monkeypatch)
    answer, beyond = Decision.answer, iter([0.02, 0.0, 10.0, 0.0])

    def slow(self: Decision, now: Replan) -> Any:
        left.append(now.deadline - clock.now)
        plan = answer(self, now)
        clock.now = now.deadline + next(beyond)
        return plan

    monkeypatch.setattr(Decision, "answer", slow)
    planner = Planner(scene())
    for number in range(4):
        planner.replan(0.1 * number, (0.0, 0.0), 0.0, 0.0, deadline=0.1)
    reserve = sp.OnlineSettings().reserve
    assert left == pytest.approx([0.1 - reserve - back for back in (0.0, 0.02, 0.8 * 0.02, 0.05)])


def test_few_dodges_are_looked_at_first_where_the_pace_is_not_known(monkeypatch: pytest.MonkeyPatch) -> None:
    """The clock goes on by so much for each distance: by little, all are looked at after it, or else no more."""
    monkeypatch.setattr(evasion, "HURRIED", 100_000)
    seen = DodgeOutlooks.of
    for each in (1e-9, 1e-5):
        clock, looked = SetClock(), list[int]()

        def slow(
            self: DodgeOutlooks, *given: Any, clock: SetClock = clock, looked: list[int] = looked, each: float = each
        ) -> Any:
            found = seen(self, *given)
            looked.append(found.room.each.size)
            clock.now += each * looked[-1]
            return found

        with pytest.MonkeyPatch.context() as patched:
            clock.rule(patched)
            patched.setattr(DodgeOutlooks, "of", slow)
            planner = surprised()
            assert planner.replan(0.1, (0.1, 0.0), 0.0, 1.0, deadline=0.5).outcome in AWAY
        assert looked[0] < 200_000
        assert (max(looked) > 500_000) == (each == 1e-9)


def test_who_is_late_and_hemmed_in_looks_at_one_stop(monkeypatch: pytest.MonkeyPatch) -> None:
    counts = []
    for deadline in (None, 0.5):
        given, stops = list[Any](), Fallback._stops

        def counted(self: Fallback, *of: Any, given: list[Any] = given, stops: Any = stops) -> Any:
            for stop in stops(self, *of):
                given.append(stop)
                yield stop

        with pytest.MonkeyPatch.context() as patched:
            patched.setattr(Fallback, "_stops", counted)
            planner = surprised([-1.0, -1.5], [2.5, 1.5])
            if deadline is not None:
                FakeClock(1.0).rule(patched)
            plan = planner.replan(0.1, (0.1, 0.0), 0.0, 1.0, deadline=deadline)
        assert not plan.certified and plan.reason
        counts.append(len(given))
    assert counts[0] > 1 and counts[1] == 1
