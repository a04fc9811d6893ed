"""Starts for any method: different ways round the obstacles, or bows where there is none."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from scp_planner.problem.problem import Problem
from scp_planner.search.ways import WaySearch, ways
from scp_planner.trips.trajectory import Trajectory


def bows(problem: Problem) -> Iterator[Trajectory]:
    """Yield bows to both sides, driven fast, then slowly: what to start from where the search finds no way."""
    space, ends = problem.space, problem.ends
    shape = np.sin(np.pi * np.linspace(0.0, 1.0, space.path_size))
    for speeding in (0.6, 0.0):
        for height in (0.0, 1.5, -1.5, 3.0, -3.0):
            theta = ends.theta.copy()
            theta[ends.free] = np.clip(height * shape, ends.lower, ends.upper)[ends.free]
            beta = np.zeros(space.acceleration_size)
            beta[: max(1, space.acceleration_size // 5)] = speeding * problem.limits.acceleration
            if space.start_speed == 0.0:
                beta[:] = np.maximum(beta, 0.05 * problem.limits.acceleration)
            yield Trajectory.of(space, theta, beta)


DELAY_STEPS = (0.05, 0.2, 0.8)  # units of time; coarser ones are tried only where there is no way with short delays


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
