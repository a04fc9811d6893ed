"""Starts for any method: different ways round the obstacles, or bows where there is none."""

from __future__ import annotations

from collections.abc import Iterator

from scp_planner.problem import Problem
from scp_planner.seeds import WaySearch, bows, ways
from scp_planner.trajectory import Trajectory

DELAY_STEPS = (0.05, 0.2, 0.8)  # s; coarser ones are tried only where there is no way with short delays


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
    for delay_step in DELAY_STEPS:
        search = WaySearch(problem, delay_step)
        found = False
        for way in ways(search, searches):
            found = True
            yield way.travel_time, search.start(way)
        if found:
            return
    for start in bows(problem):
        yield 0.0, start
