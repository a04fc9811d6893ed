"""When other ways round are looked for while there is a plan."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from scenes import CROSSERS, VEHICLE, disc, scene

from scp_planner.online import looks
from scp_planner.online.looks import LOOK_GAIN, Look, Looks
from scp_planner.online.means import Means, Replan
from scp_planner.online.planner import Planner
from scp_planner.planning.plan import PlanStatus
from scp_planner.scp.loop import ScpLoop
from scp_planner.search.grid import Fineness
from scp_planner.search.ways import BRANCHES, WaySearch
from scp_planner.settings.online import GiveWay, OnlineSettings

pytestmark = pytest.mark.numerics

IN_THE_WAY = disc("post", (10.0, 0.1), radius=3.5)


def driven(*obstacles: dict[str, Any], cycles: int = 12) -> Planner:
    """A planner that looks at other ways in each replan where that is worth while, after some of them."""
    planner = Planner(scene(*obstacles), online=OnlineSettings(look_every=1, improve_every=2))
    plan = planner.replan(0.0, (0.0, 0.0), 0.0, 1.0)
    for time in 0.1 * np.arange(1, cycles):
        plan = planner.replan(time, plan.position(time), float(plan.heading(time)), float(plan.speed(time)))
    return planner


def counted(owner: type, name: str, calls: list[str], monkeypatch: pytest.MonkeyPatch) -> None:
    """Put down each call of a method."""
    method = getattr(owner, name)

    def noted(*arguments: Any, **choices: Any) -> Any:
        calls.append(name)
        return method(*arguments, **choices)

    monkeypatch.setattr(owner, name, noted)


def straight_time() -> float:
    """Time of the straight trip of 20 m from 1 m/s on: it accelerates, then cruises."""
    top, acceleration = VEHICLE["max_speed"], VEHICLE["max_acceleration"]
    ramp = (top**2 - 1.0) / (2.0 * acceleration)
    return (top - 1.0) / acceleration + (20.0 - ramp) / top


def test_no_way_is_looked_for_where_a_straight_one_would_not_be_faster_enough(monkeypatch: pytest.MonkeyPatch) -> None:
    calls: list[str] = []
    counted(Looks, "look", calls, monkeypatch)
    near = driven(*CROSSERS).plan
    assert near is not None and near.arrival_time < (1.0 + LOOK_GAIN) * straight_time()
    assert calls == ["look"]  # for the first plan
    delayed = driven(IN_THE_WAY).plan
    assert delayed is not None and delayed.arrival_time > (1.0 + 2.0 * LOOK_GAIN) * straight_time()
    assert len(calls) > 5


def test_time_of_the_straight_way_is_that_of_its_limits() -> None:
    planner = Planner(scene())
    means = planner._means
    found = means.least_time(planner.given) * planner._units.time
    assert straight_time() < found < straight_time() / (1.0 - 2.0 * means.settings.limit_margin)
    there = planner.given.model_copy(update={"goal": planner.given.goal.model_copy(update={"radius": 1e3})})
    assert means.least_time(there) == 0.0


def test_each_look_searches_or_improves_a_way(monkeypatch: pytest.MonkeyPatch) -> None:
    """Also the last one: a look ends with its last way, and not at the replan after it. Here no way is taken."""
    for name, value in (("_cutoff", lambda *_: 1e3), ("FEASIBILITY", -1.0), ("NEARLY_CLEAR", -1.0)):
        monkeypatch.setattr(looks, name, value)
    calls: list[str] = []
    starts = Means.starts

    def searched(self: Means, *arguments: Any) -> Iterator[Any]:
        for start in starts(self, *arguments):
            calls.append("search")
            yield start
        calls.append("search")

    monkeypatch.setattr(Means, "starts", searched)
    counted(ScpLoop, "run", calls, monkeypatch)
    counted(Looks, "look", calls, monkeypatch)
    counted(Planner, "replan", calls, monkeypatch)
    driven(IN_THE_WAY, cycles=25)
    after = [then for call, then in pairwise(calls) if call == "look"]
    assert len(after) > 10 and set(after) == {"search", "run"}


@pytest.mark.parametrize("part", [1, 2, BRANCHES])
def test_ways_are_the_same_however_many_branches_are_looked_for_at_a_time(
    part: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """None comes in between, after each part that is not the last."""
    planner = driven(*CROSSERS, cycles=1)
    means, cases, state = planner._means, list[int](), planner._state
    assert state is not None
    problem = means.problem(Replan(means.moment(state), 0.0, math.inf, None, 1))
    whole = list(means.starts(problem, lambda: math.inf, lambda: math.inf, Fineness()))
    best_of = WaySearch.best_of

    def counting(self: WaySearch, some: Any, within: float = math.inf) -> Any:
        cases.append(len(some))
        return best_of(self, some, within)

    monkeypatch.setattr(WaySearch, "best_of", counting)
    found = list(means.starts(problem, lambda: math.inf, lambda: math.inf, Fineness(), part))
    assert [trip for trip in found if trip is not None] == whole and len(whole) > 2
    assert max(cases) <= part
    assert (None in found) is (part < BRANCHES)


def test_a_look_goes_on_where_no_more_has_been_looked_for_yet() -> None:
    trip = driven(cycles=1).plan
    assert trip is not None
    look = Look(2, math.inf, iter([trip.trip, None, trip.trip, trip.trip]))
    seen = [(look.begin_next(), look.trip is trip.trip, look.runs, look.over) for _ in range(4)]
    assert seen == [(True, True, 1, False), (True, False, 1, False), (True, True, 0, False), (False, False, 0, True)]
    assert not Look(2, math.inf, iter([])).begin_next()


@pytest.mark.parametrize(
    ("give_way", "safe", "steps"),
    [(GiveWay.LATE, True, 2), (GiveWay.LATE, False, 4), (GiveWay.EARLY, True, 4)],
)
def test_a_look_takes_fewer_steps_where_there_is_something_to_fall_back_on(
    give_way: GiveWay, safe: bool, steps: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It is looked at in the same replan."""
    planner = Planner(scene(*CROSSERS), online=OnlineSettings(give_way=give_way))
    planner.replan(0.0, (0.0, 0.0), 0.0, 1.0)
    means, last, state = planner._means, planner._last, planner._state
    assert last is not None and state is not None and means.online.look_steps == 4
    away = replace(last, status=PlanStatus.INFEASIBLE, stop=last.trip if safe else None)
    now = Replan(means.moment(state), 0.0, math.inf, away, 1)
    look, asked, run = planner._decision._looks, list[int](), ScpLoop.run

    def counting(self: ScpLoop, start: Any, most: int, *given: Any, **choices: Any) -> Any:
        asked.append(most)
        return run(self, start, most, *given, **choices)

    monkeypatch.setattr(ScpLoop, "run", counting)
    loop = ScpLoop(means.problem(now), means.solver)
    look.look(now, loop, None)
    assert not asked  # the search is enough for one replan
    look.look(now, loop, None)
    assert asked[0] == steps
