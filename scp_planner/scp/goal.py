"""When a run of the loop ends early: its limits of work, and the trips that it is measured against."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from scp_planner.scp.evaluation import Evaluation
from scp_planner.scp.parameters import LoopParameters
from scp_planner.scp.record import LoopRun, LoopStatus


@dataclass(frozen=True)
class RunLimits:
    """Limits of the work of one run.

    Attributes
    ----------
    max_iterations : int
    deadline : float
        Value of :func:`time.perf_counter` at which the run ends, s.
    enough : int or None
        After so many iterations a trip without grave violations is good enough, though not the fastest.
    hopeless_after : int
        A run that is still far from feasible after so many iterations ends.
    """

    max_iterations: int
    deadline: float
    enough: int | None
    hopeless_after: int


@dataclass
class Cutoff:
    """Runs are given up when they can hardly become faster than this time, s; in a race the fastest run sets it.

    They are given up as well when they come to go the way of a rival.
    """

    time: float
    race: bool
    rival: Evaluation | None
    parameters: LoopParameters

    def slower(self, trip: Evaluation, sooner: float) -> bool:
        """Whether a trip can hardly become fast enough, if the next step makes it sooner by so many s."""
        # What is still violated can only take more time.
        return trip.trajectory.travel_time - self.parameters.hope * max(sooner, 0.0) > self.time

    def same_way(self, trip: Evaluation) -> bool:
        """Whether a trip has come so near to the rival that it would end as that did."""
        if self.rival is None or trip.worst_violation > self.parameters.watch:
            return False
        apart = trip.points.path.position - self.rival.points.path.position
        return bool(np.abs(apart).max() < self.parameters.same_way)

    def hear(self, run: LoopRun) -> None:
        """Take note of how a run has ended."""
        if self.race and run.status is LoopStatus.CONVERGED:
            self.time = min(self.time, run.evaluation.trajectory.travel_time)
