"""Starting points from which a replan renews a trip."""

from __future__ import annotations

from functools import cached_property

from scp_planner.online.means import Means, Replan
from scp_planner.online.remaining import remaining_trip
from scp_planner.problem.problem import Problem
from scp_planner.scp.loop import ScpLoop
from scp_planner.trips.trajectory import Trajectory
from scp_planner.trips.trip import Trip


class Renewal:
    """The problem of a replan, and what is left of the last trip in it: made when they are asked for."""

    def __init__(self, means: Means, now: Replan, unfinished: Trip | None = None) -> None:
        self._means, self._now, self.unfinished = means, now, unfinished

    @cached_property
    def problem(self) -> Problem:
        """The problem from the present state to the goal."""
        problem = self._means.problem(self._now)
        self._now.lap("problem")
        return problem

    @cached_property
    def loop(self) -> ScpLoop:
        loop = ScpLoop(self.problem, self._means.solver)
        self._now.lap("problem")
        return loop

    @cached_property
    def ahead(self) -> Trajectory | None:
        return None if self._now.last is None else self.left_of(self._now.last.trip)

    def left_of(self, trip: Trip) -> Trajectory:
        """Return what is left of a trip in the problem."""
        left = remaining_trip(self.problem, trip, self._now.moment.state)
        self._now.lap("problem")
        return left
