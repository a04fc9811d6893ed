"""Starts for any method: different ways round the obstacles, or bows where there is none."""

from __future__ import annotations

from collections.abc import Iterator

from scp_planner.problem.problem import Problem
from scp_planner.search.first_trips import bows, trip_along
from scp_planner.search.ways import WaySearch, ways
from scp_planner.trips.trajectory import Trajectory

COARSENESSES = (1.0, 4.0, 16.0)  # of the delays; coarser ones are tried only where there is no way with short delays


def starts(problem: Problem, searches: int) -> Iterator[tuple[float, Trajectory]]:
    """Yield estimated travel times and starts for any method: different ways round, or bows if there is none.

    Parameters
    ----------
    problem : Problem
    searches : int
        Sweeps of the search for ways, at most. The fastest estimate comes first; further ways pass one of the
        obstacles that the last one came closest to on its other side.

    Yields
    ------
    (float, Trajectory)
        Estimated travel time, s, and a start.
    """
    for coarseness in COARSENESSES:
        search = WaySearch(problem, coarseness)
        found = False
        for way in ways(search, searches):
            found = True
            yield way.travel_time, trip_along(problem, way)
        if found:
            return
    for start in bows(problem):
        yield 0.0, start
