"""Rows of what the drive along the path must keep: speed, acceleration, the speed at the goal."""

from __future__ import annotations

import numpy as np

from scp_planner.arrays import Array
from scp_planner.problem.problem import Problem
from scp_planner.scp.rows.base import Rows
from scp_planner.scp.rows.bends import STILL
from scp_planner.trips.trajectory import Trajectory


class KinematicRows:
    """Arrival, speed and acceleration rows: linear in (b, tau), made once and scaled at each iterate.

    Parameters
    ----------
    problem : Problem
    """

    def __init__(self, problem: Problem) -> None:
        space, limits = problem.space, problem.limits
        self.problem = problem
        self.theta_size = problem.ends.free.stop - problem.ends.free.start
        count = space.acceleration_size
        self.equalities = 1
        width = self.theta_size + count + 1
        speeds = space.tables.speed_control[1:]
        moves = np.flatnonzero(np.abs(speeds).sum(axis=1) > 0)
        self._speeds = speeds[moves]
        # Speeds that are fixed at 0, as at a start from rest, stay as they are
        free = (self._speeds @ problem.highest_accelerations > 0.0) | (space.start_speed > 0.0)
        self._still = np.where(free, STILL, 0.0)
        eye = np.eye(count)
        self._beta = slice(self.theta_size, self.theta_size + count)
        first = self.equalities
        self._upper = slice(first, first + len(moves))
        self._lower = slice(self._upper.stop, self._upper.stop + len(moves))
        self._up = slice(self._lower.stop, self._lower.stop + count)
        self._down = slice(self._up.stop, self._up.stop + count)
        # What is the same at every iterate
        self._fixed = np.zeros((self._down.stop, width))
        self._fixed[self._upper, -1] = space.start_speed - limits.speed
        self._fixed[self._lower, -1] = -space.start_speed
        self._fixed[self._up, self._beta] = eye
        self._fixed[self._up, -1] = -2.0 * problem.highest_accelerations
        self._fixed[self._down, self._beta] = -eye
        self._fixed[self._down, -1] = 2.0 * problem.lowest_accelerations
        self.count, self.width = self._fixed.shape

    def write(self, trajectory: Trajectory, matrix: Array) -> None:
        """Write the rows of the step from a trip: the first ``equalities`` ones hold with equality.

        Parameters
        ----------
        trajectory : Trajectory
        matrix : (count, width) array
            Of the caller, who also keeps it.
        """
        problem = self.problem
        tables, tau = problem.space.tables, trajectory.travel_time
        matrix[:] = self._fixed
        # Arrival: v0 tau + C2(1) b = L(theta)
        matrix[0, : self.theta_size] = -trajectory.path.final_gradient[problem.ends.free]
        matrix[0, self._beta] = tau * tau * tables.final_distance
        matrix[0, -1] = problem.space.start_speed * tau
        np.multiply(self._speeds, tau, out=matrix[self._upper, self._beta])
        np.multiply(self._speeds, -tau, out=matrix[self._lower, self._beta])

    def bounds(self, trajectory: Trajectory) -> Array:
        """Return the bounds of the rows, (count,).

        Parameters
        ----------
        trajectory : Trajectory

        Returns
        -------
        (count,) array
            In m for the arrival, then m/s of the speeds and m/s^2 of the accelerations.
        """
        problem = self.problem
        tables, limits, v0 = problem.space.tables, problem.limits, problem.space.start_speed
        tau, beta, path = trajectory.travel_time, trajectory.beta, trajectory.path
        bound = np.empty(self.count)
        bound[0] = path.arc_length - v0 * tau - tau * tau * float(tables.final_distance @ beta)
        speeds = v0 + tau * (self._speeds @ beta)
        bound[self._upper] = limits.speed - speeds
        bound[self._lower] = speeds - self._still
        bound[self._up] = problem.highest_accelerations - beta
        bound[self._down] = beta - problem.lowest_accelerations
        return bound

    def excess(self, trajectory: Trajectory) -> float:
        """Largest excess over the bounds of speed (m/s) and acceleration (m/s^2), 0 where there is none."""
        return max(0.0, -float(self.bounds(trajectory)[self.equalities :].min()))

    def timing_curvature(self, prices: Array) -> float:
        """Second derivative of the bounds b_k <= a tau^2 with respect to rho, times the multipliers of all rows."""
        problem = self.problem
        up, down = prices[self._up], prices[self._down]
        return float(2.0 * (down @ problem.lowest_accelerations - up @ problem.highest_accelerations))


def goal_speed_rows(problem: Problem, trip: Trajectory, group: int) -> Rows:
    """Return the rows of v(1) = goal speed, m/s: linear in (b, tau), v0 tau + C1(1) b = v_goal tau."""
    space, goal = problem.space, problem.ends.goal_speed
    if goal is None:
        return Rows.none(problem.step_size)
    gradient = np.zeros((1, problem.step_size))
    gradient[:, -1 - space.acceleration_size : -1] = trip.travel_time * space.tables.final_speed
    gradient[:, -1] = space.start_speed - goal
    excess = trip.final_speed - goal
    both = np.concatenate([gradient, -gradient])
    return Rows(both, np.array([-excess, excess]), np.full(2, group, dtype=np.intp), np.arange(2))
