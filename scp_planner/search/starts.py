"""Starts for any method: different ways round the obstacles, or arcs where there is none."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from time import perf_counter

import numpy as np

from scp_planner.constraints.arrival import EarliestArrival
from scp_planner.problem.problem import Problem
from scp_planner.search.first_trips import arcs, trip_along
from scp_planner.search.grid import DELAYS, Fineness, Grid
from scp_planner.search.ways import WaySearch, ways
from scp_planner.trips.trajectory import Trajectory


@dataclass(frozen=True)
class StartDelays:
    """Delays at the start."""

    # of the delays; coarser ones are tried only where there is no way with short delays
    coarsenesses: tuple[float, ...] = (1.0, 4.0, 16.0)
    waited: float = 0.6  # of all delays: the wait for a time before which the goal may not be reached


START_DELAYS = StartDelays()


def coarsenesses(problem: Problem) -> tuple[float, ...]:
    """Return factors of the steps of delays, in turn: with the first one all delays hold what must be waited."""
    earliest = max(
        (limit.travel_time for limit in problem.constraints if isinstance(limit, EarliestArrival)), default=0.0
    )
    if earliest == 0.0:
        return START_DELAYS.coarsenesses
    grid = Grid.of(problem, Fineness())
    needed = (earliest - float(grid.fastest[-1])) / (START_DELAYS.waited * DELAYS * grid.delay_step)
    return tuple(max(needed, 1.0) * each for each in START_DELAYS.coarsenesses)


def starts(problem: Problem, searches: int, deadline: float = np.inf) -> Iterator[tuple[float, Trajectory]]:
    """Yield estimated travel times and starts for any method: different ways round, or arcs if there is none."""
    for coarseness in coarsenesses(problem):
        if perf_counter() > deadline:
            break
        search = WaySearch(problem, coarseness, deadline=deadline)
        found = False
        for way in ways(search, searches):
            found = True
            yield way.travel_time, trip_along(problem, way)
        if found:
            return
    for start in arcs(problem):
        yield 0.0, start
