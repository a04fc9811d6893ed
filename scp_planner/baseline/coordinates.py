"""The coordinates that penalty descent moves in: scaled offsets, and accelerations within their bounds."""

from __future__ import annotations

import numpy as np

from scp_planner.arrays import Array
from scp_planner.baseline.tolerances import MET_SPEED, REPAIRABLE
from scp_planner.problem.problem import Problem
from scp_planner.trips.trajectory import Trajectory


class Coordinates:
    """Coordinates y of the trips of a problem, about a start whose offsets are 0."""

    def __init__(self, problem: Problem, start: Trajectory) -> None:
        self.problem = problem
        self.path_size = problem.free_size
        self.scaling = path_scaling(problem)
        self.base = start.theta[problem.ends.free]
        free = np.full(self.path_size, np.inf)
        self.lower = np.concatenate([-free, problem.lowest_accelerations])
        self.upper = np.concatenate([free, problem.highest_accelerations])
        self.origin = np.clip(np.concatenate([np.zeros(self.path_size), start.beta]), self.lower, self.upper)

    def omega(self, y: Array) -> Array:
        """Return the variables of the objective, (K,)."""
        omega = y.copy()
        omega[: self.path_size] = self.base + self.scaling @ y[: self.path_size]
        return omega

    def slope(self, gradient: Array) -> Array:
        """Return the gradient with respect to y of that with respect to omega, (K,)."""
        slope = gradient.copy()
        slope[: self.path_size] = self.scaling.T @ slope[: self.path_size]
        return slope

    def trajectory(self, y: Array) -> Trajectory:
        """Return the trip."""
        omega = self.omega(y)
        theta = self.problem.ends.around(omega[: self.path_size])
        return Trajectory.of(self.problem.space, theta, omega[self.path_size :])

    def with_goal_speed(self, y: Array) -> Array:
        """Return y with the accelerations that are free to be corrected, the least that gives the goal speed."""
        wanted, row = self.problem.ends.goal_speed, self.problem.space.drive.final_speed
        if wanted is None:
            return y
        met = y.copy()
        beta = met[self.path_size :]
        for _ in range(20):
            trajectory = self.trajectory(met)
            gap = wanted - trajectory.final_speed
            if not np.isfinite(gap) or abs(gap) > REPAIRABLE:
                return y
            if abs(gap) < MET_SPEED:
                break
            room = np.where(gap * row > 0.0, self.upper[self.path_size :] - beta, beta - self.lower[self.path_size :])
            usable = np.where(room > 1e-3, row, 0.0)
            if not usable.any():
                return y
            beta += usable * gap / (trajectory.travel_time * float(usable @ usable))
        return np.clip(met, self.lower, self.upper)


def path_scaling(problem: Problem) -> Array:
    """Map from scaled coordinates to free offsets in which the curvature of travel time / arc length is about 1."""
    space, tables = problem.space, problem.space.tables
    step = np.tile(tables.weights, tables.cells) * (space.length / tables.cells)
    slopes = tables.node_slopes[:, problem.ends.free] / space.length
    rows = tables.node_rows[:, problem.ends.free]
    bending = (slopes * step[:, None]).T @ slopes / problem.limits.speed
    # The second term keeps the scaling regular beside the curvature of the arc length.
    matrix = bending + 1e-3 * (rows * step[:, None]).T @ rows
    return np.linalg.inv(np.linalg.cholesky(matrix)).T
