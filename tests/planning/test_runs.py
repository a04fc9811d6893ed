"""Runs that go on from where they were cut short."""

from __future__ import annotations

from typing import Any, cast

import numpy as np
import pytest
from scenes import disc, scene

import scp_planner as sp
from scp_planner.planning.runs import CheckedRuns, Task
from scp_planner.scp.evaluation import evaluate_trip
from scp_planner.scp.loop import ScpLoop
from scp_planner.scp.merit import Penalties
from scp_planner.scp.record import LoopRun, LoopStatus
from scp_planner.settings.planning import Settings
from scp_planner.trips.trajectory import Trajectory


class Scripted:
    """A loop whose runs come to nothing, and end as is written."""

    def __init__(self, runs: CheckedRuns, start: Trajectory, *ends: LoopStatus) -> None:
        evaluation = evaluate_trip(runs.problem, start, 1.0)
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
