"""The best-first search itself, on skeletons that are numbers: their digits are decisions, a trip takes their value."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from math import inf

import numpy as np
import pytest
from scenes import CROSSERS, disc, scene

import scp_planner as sp
from scp_planner.pauses import Budget
from scp_planner.planning.plan_search import planned
from scp_planner.planning.search import Search, SearchLog, Source
from scp_planner.planning.sources.routes import WithoutGuide


@dataclass(frozen=True)
class Number:
    travel_time: float


class Digits(Source[str, Number]):
    """One digit more, the least first; a trip takes no less than its first digits say."""

    name = "digits"

    def __init__(self, digits: str = "123", rank: int = 0) -> None:
        self.digits, self.rank, self.proposed = digits, rank, list[str]()

    def children(self, skeleton: str, found: Number | None) -> Iterator[tuple[float, str]]:
        for digit in self.digits if found is None else "":
            child = skeleton + digit
            self.proposed.append(child)
            yield float(child.ljust(3, "0")), child


@dataclass
class Numbers(Search[str, Number]):
    """Numbers of three digits are complete; those in ``wrong`` are not certified."""

    wrong: frozenset[str] = frozenset()
    completed: list[str] = field(default_factory=list)

    def __init__(self, *sources: Source[str, Number], wrong: tuple[str, ...] = (), deadline: float = inf) -> None:
        super().__init__(SearchLog(), Budget(deadline), sources)
        self.wrong, self.completed = frozenset(wrong), []

    def accepts(self, result: Number) -> bool:
        return str(int(result.travel_time)) not in self.wrong

    def is_better(self, result: Number, other: Number) -> bool:
        return (not self.accepts(result), result.travel_time) < (not self.accepts(other), other.travel_time)

    def is_open(self, skeleton: str) -> bool:
        return len(skeleton) < 3

    def describe(self, skeleton: str) -> str:
        return skeleton

    def complete(self, skeleton: str) -> Number | None:
        self.completed.append(skeleton)
        return Number(float(skeleton))


def test_the_least_bound_is_tried_first_and_nothing_else_that_cannot_win() -> None:
    source = Digits()
    search = Numbers(source)
    assert search.explore("") == Number(111.0)
    assert search.completed == ["111"]
    assert "31" not in source.proposed and "21" not in source.proposed


def test_where_a_trip_is_not_certified_the_next_one_is_tried() -> None:
    search = Numbers(Digits(), wrong=("111", "112"))
    assert search.explore("") == Number(113.0)
    assert search.completed == ["111", "112", "113"]
    assert [(one.what, one.result, one.bound) for one in search.log.skeletons] == [
        ("111", "violated", 111.0),
        ("112", "violated", 112.0),
        ("113", "certified", 113.0),
    ]


def test_a_source_of_a_higher_rank_waits() -> None:
    late = Digits("0", rank=1)
    search = Numbers(Digits("1"), late, wrong=("111",))
    assert search.explore("") == Number(0.0)
    assert search.completed[0] == "111"


def test_after_the_first_trip_the_search_ends_with_its_budget() -> None:
    search = Numbers(Digits(), wrong=("111", "112"), deadline=-1.0)
    assert search.explore("") == Number(111.0)
    assert search.completed == ["111"]


class Drawn(sp.Source[sp.Skeleton, sp.Plan]):
    """Guides that somebody drew."""

    name = "drawn"

    def children(self, skeleton: sp.Skeleton, found: sp.Plan | None) -> Iterator[tuple[float, sp.Skeleton]]:
        if not skeleton.decided:
            yield 0.0, skeleton.along([(0.0, 0.0), (10.0, 4.0), (20.0, 0.0)])


def test_guides_of_a_user_are_tried_and_the_plan_says_so() -> None:
    given = scene(disc("post", (10.0, 0.0)))
    alone, drawn = sp.plan(given), sp.plan(given, sources=[Drawn()])
    assert "drawn guide" in {one.what for one in drawn.tried}
    assert "drawn guide" not in {one.what for one in alone.tried}
    assert next(one for one in drawn.tried if one.what == "drawn guide").result == "nothing faster"
    assert drawn.certified and drawn.travel_time <= alone.travel_time * (1.0 + 1e-9)


@pytest.mark.parametrize("time_limit", [None, 0.0])
def test_the_plan_lists_what_was_tried(time_limit: float | None) -> None:
    plan = sp.plan(scene(*CROSSERS), time_limit=time_limit)
    assert plan.tried[-1].travel_time == plan.travel_time
    assert (plan.tried[-1].result == "certified") is plan.certified
    assert str(plan.tried[-1]) in plan.explanation
    assert sum(one.wall_time for one in plan.tried if one.what != "one trip") <= plan.wall_time


def test_a_guide_that_cannot_be_followed_is_left() -> None:
    """It turns sharply where the vehicle drives fast: an offset of it is no trip, and the straight line is."""
    bends = [[0.0, 0.0], [3.0, 0.0], [3.0, 9.0], [6.0, 9.0], [6.0, 0.0], [20.0, 0.0]]
    given = scene(guide=bends, goal={"latest_arrival": 8.0})
    alone, without = planned(given), planned(given, sources=[WithoutGuide()])
    assert not alone.certified
    assert without.certified and without.arrival_time <= 8.0
    assert without.tried[-1].what == "without the guide"
    held = given.model_copy(update={"corridor": (((-1.0, -1.0), (21.0, -1.0), (21.0, 10.0), (-1.0, 10.0)),)})
    assert not planned(held, sources=[WithoutGuide()]).certified


def test_a_gap_is_proven_where_it_is_asked_for() -> None:
    """A disc drives ahead in a corridor that is too narrow to pass it: it is waited for, to 0.8 m behind its centre."""
    given = scene(disc("ahead", (3.0, 0.0), (1.0, 0.0), radius=0.5), bounds={"min": [-1.0, -0.7], "max": [40.0, 0.7]})
    plain, proven = sp.plan(given), sp.plan(given, prove=0.01)
    assert proven.travel_time == plain.travel_time
    assert plain.gap > 1.0
    assert proven.gap <= 0.01 * (1.0 + 1e-6)
    assert proven.lower_bound <= 20.0 + 0.8 - 3.0
    with pytest.raises(ValueError, match="prove"):
        sp.plan(given, prove=-0.1)


def test_a_time_limit_over_a_map_is_kept_by_the_search_for_routes() -> None:
    """In no time there is no route, and a trip that was not checked against the cells is not certified."""
    cells = np.zeros((300, 300), dtype=bool)
    cells[:200, 150:152] = True
    given = scene(goal={"position": [20.0, 0.0]}, ground={"map": sp.OccupancyMap(cells, 0.1, (-5.0, -5.0))})
    assert not sp.plan(given, time_limit=0.0).certified
    assert sp.plan(given).certified
