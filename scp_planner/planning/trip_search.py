"""State of the search for a trip over one guide, shared by its attempts."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from scp_planner.planning.attempts import ATTEMPTS, Search
from scp_planner.planning.runs import CheckedRuns, ScpRun
from scp_planner.scp.goal import to_beat
from scp_planner.trips.trajectory import Trajectory


@dataclass
class Start:
    """A way as a start for the loop, given how smooth, and what its runs came to."""

    estimate: float  # travel time, s
    trip: Callable[[float], Trajectory]
    touched: tuple[tuple[int, int], ...] = ()  # zones that the run touched, and on which side of them it is
    missed: float = 0.0  # by how much the run was faster than the estimate, s, where that is one to go by
    exhausted: bool = False  # the run from the start closest to the way ended hardly infeasible


class TripSearch(Search[ScpRun]):
    """Search for the fastest trip over one guide, or for one that is faster than a known travel time, s, of a rival."""

    def __init__(self, runs: CheckedRuns, known: float = np.inf, rival: ScpRun | None = None) -> None:
        task = runs.task
        enough = runs.lower_bound * (1.0 + ATTEMPTS.good_enough / task.settings.effort)
        super().__init__(task.tally, task.deadline, runs.lower_bound, enough, task.arrival_step)
        self.runs, self.task, self.known, self.rival = runs, task, known, rival
        self.failed: list[Start] = []
        self.near: ScpRun | None = None  # fails by the least of those that may be faster than the known time
        self.nearly: ScpRun | None = None  # the fastest of those that hardly fail
        self.from_ways = 0  # runs from ways
        self.cut_off = False  # there was no time for even the first way

    @property
    def found(self) -> ScpRun | None:
        """The best run; else the one that fails by the least."""
        return self.near if self.best is None else self.best

    @property
    def cutoff(self) -> float:
        """Travel time that another trip has to beat, s."""
        if self.best is None or not self.best.holds:
            return self.known
        return to_beat(self.best.travel_time, self.arrival_step)
