"""Starts for the loop."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from scp_planner.problem import Problem
from scp_planner.trajectory import Trajectory


def starts(problem: Problem) -> Iterator[Trajectory]:
    """Bows to both sides with a fast speed profile."""
    space, ends = problem.space, problem.ends
    x = np.linspace(0.0, 1.0, space.path_size)
    for bow in (0.0, 1.5, -1.5, 3.0, -3.0):
        theta = ends.theta.copy()
        theta[ends.free] = (bow * np.sin(np.pi * x))[ends.free]
        beta = np.zeros(space.acceleration_size)
        beta[: max(1, space.acceleration_size // 5)] = 0.6 * problem.limits.acceleration
        yield space.trajectory(theta, beta)
