"""How runs of the loop end."""

from __future__ import annotations

import weakref
from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from itertools import islice
from typing import Any

import pytest
from clock import FakeClock
from scenes import CROSSERS, scene

import scp_planner as sp
from scp_planner.problem.build import build_problem
from scp_planner.scp import iterations, together
from scp_planner.scp.evaluation import Evaluation, evaluate_trips
from scp_planner.scp.loop import ScpLoop
from scp_planner.scp.parameters import LOOP
from scp_planner.scp.projection import Projection
from scp_planner.scp.record import LoopStatus
from scp_planner.scp.step_solver import StepSolver
from scp_planner.scp.subproblem import Subproblem, build_subproblem
from scp_planner.search.first_trips import bows
from scp_planner.solvers import solver_named

pytestmark = pytest.mark.numerics
PROBLEM = build_problem(scene(*CROSSERS), sp.zones(scene(*CROSSERS)), sp.Settings())
START = next(iter(bows(PROBLEM)))


def test_a_run_ends_at_its_limits_and_else_converges(monkeypatch: pytest.MonkeyPatch) -> None:
    FakeClock(1.0).rule(monkeypatch)
    loop = ScpLoop(PROBLEM, solver_named("daqp"))
    whole = loop.run(START, 60)
    assert whole.status is LoopStatus.CONVERGED and whole.feasible
    short = loop.run(START, 2)
    assert short.status is LoopStatus.ITERATION_LIMIT and len(short.record) == 2 < len(whole.record)
    FakeClock(1.0).rule(monkeypatch)
    late = loop.run(START, 60, deadline=-1.0)
    assert late.status is LoopStatus.TIME_LIMIT and late.record == []
    assert late.evaluation.trajectory is START


def test_a_run_goes_on_with_the_prices_of_another() -> None:
    first = ScpLoop(PROBLEM, solver_named("daqp")).run(START, 60)
    end, dear = first.evaluation, first.penalties.copied()
    dear.raise_where(dear.weights > 0.0, 600.0)
    known = dear.weights.copy()
    again = ScpLoop(PROBLEM, solver_named("daqp"), penalties=dear).run(end.trajectory, 1)
    assert (dear.weights == known).all(), "those that were given stay as they are"
    assert (again.penalties.weights >= known).all()


@pytest.mark.parametrize("speed", [0.3, 2.4])
def test_runs_arrive_at_the_speed_of_the_goal_to_rounding(speed: float) -> None:
    wanted = scene(*CROSSERS, goal={"speed": speed})
    problem = build_problem(wanted, sp.zones(wanted), sp.Settings())
    for run in ScpLoop(problem, solver_named("daqp")).run_all(list(islice(bows(problem), 1, 3)), 60):
        assert run.status is LoopStatus.CONVERGED and run.feasible
        assert run.evaluation.trajectory.final_speed == pytest.approx(problem.ends.goal_speed, abs=1e-6)


def test_a_run_leaves_time_for_what_comes_after_it(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of 20 s it leaves four times what its last iteration took."""
    ended = []
    for spared in (0.0, 4.0):
        clock = FakeClock(1.0)
        clock.rule(monkeypatch)
        loop = ScpLoop(PROBLEM, solver_named("daqp"), parameters=replace(LOOP, spared=spared))
        run = loop.run(START, 60, deadline=20.0)
        assert run.status is LoopStatus.TIME_LIMIT
        ended.append(clock())
        each = ended[-1] / (1 + len(run.record))
    assert ended[0] > 20.0
    assert 20.0 - 5.5 * each < ended[1] <= 20.0 - 3.0 * each


@pytest.mark.parametrize("part", ["linearise_trips", "build_subproblem", "solve"])
def test_an_iteration_ends_between_its_parts_when_the_time_is_up(part: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """The clock stands still but for one part, which takes too long: none of what would follow is begun."""
    clock = FakeClock(0.0)
    clock.rule(monkeypatch)
    begun: list[str] = []

    def counted(name: str, work: Callable[..., Any]) -> Callable[..., Any]:
        def done(*given: Any) -> Any:
            begun.append(name)
            if name == part:
                clock.tick = 1.0
            found = work(*given)
            return None if name == part == "solve" else found

        return done

    parts = {"linearise_trips": together, "build_subproblem": iterations, "solve": StepSolver}
    for name, place in parts.items():
        monkeypatch.setattr(place, name, counted(name, getattr(place, name)))
    monkeypatch.setattr(Projection, "within_limits", counted("within_limits", Projection.within_limits))
    run = ScpLoop(PROBLEM, solver_named("daqp")).run(START, 60, deadline=0.5)
    assert run.status is LoopStatus.TIME_LIMIT and run.evaluation.trajectory is START
    assert begun == list(parts)[: list(parts).index(part) + 1]


def test_no_trip_is_linearised_twice_or_looked_at_in_vain(monkeypatch: pytest.MonkeyPatch) -> None:
    """After a step that is rejected the rows are known, and a trip that will be too slow is not looked at."""
    looks = Counter[str]()

    def counted(name: str) -> Callable[..., object]:
        real = getattr(together, name)

        def count(*given: object) -> object:
            looks[name] += 1
            return real(*given)

        return count

    for name in ("linearise_trips", "evaluate_trips"):
        monkeypatch.setattr(together, name, counted(name))
    loop = ScpLoop(PROBLEM, solver_named("daqp"))
    bow = next(islice(bows(PROBLEM), 3, None))
    run = loop.run(bow, 60, trust=LOOP.first_trust.scaled(3.0))  # so far that a step leads astray
    rejected = sum(not step.accepted for step in run.record)
    assert rejected > 0
    # The last one, from which nothing is left to gain, ends without a step.
    assert looks["linearise_trips"] <= len(run.record) + 1 - rejected and looks["evaluate_trips"] == len(run.record) + 1
    looks.clear()
    start = next(islice(bows(PROBLEM), 2, None))
    best = loop.run(start, 60).evaluation.trajectory.travel_time
    looks.clear()
    slow = loop.run(start, 60, cutoff=0.97 * best)
    assert slow.status is LoopStatus.SLOWER and slow.evaluation.trajectory.travel_time > 0.97 * best
    assert looks == {"linearise_trips": len(slow.record) + 1, "evaluate_trips": len(slow.record) + 1}


@pytest.mark.slow
def test_after_a_short_step_nothing_is_linearised_again(monkeypatch: pytest.MonkeyPatch) -> None:
    """What such a step is off the minimum by is of no account: the trip is the one that another look would keep."""
    name = "linearise_trips"
    looks, real = Counter[float](), getattr(together, name)
    ended = {}
    for short in (LOOP.short, 0.0):

        def counted(*given: Any, short: float = short) -> object:
            looks[short] += 1
            return real(*given)

        monkeypatch.setattr(together, name, counted)
        loop = ScpLoop(PROBLEM, solver_named("daqp"), parameters=replace(LOOP, short=short))
        ended[short] = [loop.run(bow, 60) for bow in bows(PROBLEM)]
    assert looks[LOOP.short] < looks[0.0]
    for sooner, later in zip(*ended.values(), strict=True):
        assert sooner.status is later.status
        times = (run.evaluation.trajectory.travel_time for run in (sooner, later))
        assert next(times) == pytest.approx(next(times), abs=PROBLEM.settings.tolerance)


def test_no_program_is_kept_while_a_trip_is_looked_at(monkeypatch: pytest.MonkeyPatch) -> None:
    """Among many zones it is the largest matrix of all."""
    matrices: list[weakref.ref[Any]] = []

    def built(*given: Any, **named: Any) -> Subproblem:
        sub = build_subproblem(*given, **named)
        matrices.append(weakref.ref(sub.program))
        return sub

    def looked(*given: Any, **named: Any) -> list[Evaluation]:
        assert [matrix() for matrix in matrices] == [None] * len(matrices)
        return evaluate_trips(*given, **named)

    monkeypatch.setattr(iterations, "build_subproblem", built)
    monkeypatch.setattr(together, "evaluate_trips", looked)
    run = ScpLoop(PROBLEM, solver_named("daqp")).run(START, 60)
    assert len(matrices) >= len(run.record) > 1
