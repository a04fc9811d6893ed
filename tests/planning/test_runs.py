"""Runs that go on from where they were cut short."""

from __future__ import annotations

from typing import Any, cast

import numpy as np
import pytest
from clock import FakeClock
from scenes import disc, scene

import scp_planner as sp
from scp_planner.planning.runs import CheckedRuns, Task
from scp_planner.scp.evaluation import evaluate_trip
from scp_planner.scp.loop import ScpLoop
from scp_planner.scp.merit import Penalties
from scp_planner.scp.record import LoopRun, LoopStatus
from scp_planner.search.first_trips import bows
from scp_planner.settings.planning import Settings
from scp_planner.trips.trajectory import Trajectory


class Scripted:
    """A loop whose runs come to nothing, and end as is written."""

    def __init__(self, runs: CheckedRuns, start: Trajectory, *ends: LoopStatus) -> None:
        evaluation = evaluate_trip(runs.problem, start)
        self.left = [LoopRun(end, evaluation, Penalties.uniform(runs.problem, 5.0)) for end in ends]

    def run(self, *_: Any, **__: Any) -> LoopRun:
        return self.left.pop(0)


@pytest.mark.parametrize(
    ("further", "told"),
    [(LoopStatus.INFEASIBLE, LoopStatus.INFEASIBLE), (LoopStatus.STALLED, LoopStatus.ITERATION_LIMIT)],
)
def test_a_run_that_nothing_comes_nearer_to_than_it_is_was_not_cut_short(further: LoopStatus, told: LoopStatus) -> None:
    """Else the same start is tried again, with patience, and as much in vain."""
    scenario = scene(disc("in the way", (10.0, 0.0)))
    runs = CheckedRuns(Task(scenario, sp.zones(scenario), Settings(), np.inf))
    problem = runs.problem
    start = Trajectory.of(problem.space, problem.ends.theta, np.zeros(problem.space.acceleration_size))
    loop = Scripted(runs, start, LoopStatus.ITERATION_LIMIT, further)
    attempt = runs.attempt(start, loop=cast(ScpLoop, loop))
    assert not loop.left
    assert attempt.run.status is told
    assert not attempt.holds


def test_a_run_that_circles_what_is_a_little_too_narrow_makes_room() -> None:
    """Among crossers every 4 m on 200 m one run stays wrong by some thousandths: it took 160 of 278 iterations."""
    along = np.arange(15.0, 195.0, 4.0)
    rng = np.random.default_rng(0)
    pace = rng.choice([-1.0, 1.0], len(along)) * rng.uniform(0.4, 1.5, len(along))
    when = along / 3.0 + rng.uniform(-3.0, 3.0, len(along))
    crossers = [disc(f"o{k}", (x, -v * t), (0.0, v)) for k, (x, v, t) in enumerate(zip(along, pace, when, strict=True))]
    found = sp.plan(scene(*crossers, goal={"position": [200.0, 0.0]}))
    assert found.certified
    assert found.lower_bound is not None
    assert found.travel_time < 1.002 * found.lower_bound
    assert found.iterations < 150


def test_what_a_certificate_misses_is_not_asked_for_when_the_time_is_up(monkeypatch: pytest.MonkeyPatch) -> None:
    """One that was given up for want of time says of nothing that it holds."""
    clock = FakeClock(0.0)
    clock.rule(monkeypatch)
    scenario = scene()
    runs = CheckedRuns(Task(scenario, (), Settings(), 0.5, last_check=0.6))
    start = next(iter(bows(runs.problem)))
    found = ScpLoop(runs.problem, runs.solver).run(start, 60)
    assert found.feasible
    ran: list[LoopRun] = []

    class Late:
        """A loop that finds that, too late."""

        def run(self, *_: Any, **__: Any) -> LoopRun:
            clock.tick = 1.0
            ran.append(found)
            return found

    monkeypatch.setattr(CheckedRuns, "_loop", lambda *_, **__: Late())
    attempt = runs.attempt(start, loop=cast(ScpLoop, Late()))
    assert len(ran) == 1
    assert not attempt.holds
