"""Limits of the vehicle: linear rows that hold for all times, and linearised rows of curvature and lateral acceleration.

In the variables (b, tau) with b = tau^2 beta, bounds on the control points of speed and acceleration are linear, except
that tau^2 in the acceleration's bounds is replaced by its tangent 2 tau_k tau - tau_k^2 <= tau^2: conservative.
"""

from __future__ import annotations

import numpy as np

from scp_planner.constraints import Rows
from scp_planner.constraints.clearance import join_blocks
from scp_planner.problem import Problem
from scp_planner.trajectory import Array, PathBend, Trajectory, TripPoints


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
        self.equalities = 1 if problem.ends.goal_speed is None else 2
        width = self.theta_size + count + 1
        speeds = space.tables.speed_control[1:]
        moves = np.flatnonzero(np.abs(speeds).sum(axis=1) > 0)
        self._speeds = speeds[moves]
        eye = np.eye(count)
        self._beta = slice(self.theta_size, self.theta_size + count)
        first = self.equalities
        self._upper = slice(first, first + len(moves))
        self._lower = slice(self._upper.stop, self._upper.stop + len(moves))
        self._up = slice(self._lower.stop, self._lower.stop + count)
        self._down = slice(self._up.stop, self._up.stop + count)
        self.matrix = np.zeros((self._down.stop, width))
        self.matrix[self._upper, -1] = space.start_speed - limits.speed
        self.matrix[self._lower, -1] = -space.start_speed
        self.matrix[self._up, self._beta] = eye
        self.matrix[self._up, -1] = -2.0 * limits.acceleration
        self.matrix[self._down, self._beta] = -eye
        self.matrix[self._down, -1] = -2.0 * limits.deceleration
        self.bound = np.zeros(self._down.stop)

    def at(self, trajectory: Trajectory) -> tuple[Array, Array]:
        """Rows and bounds of the step from a trip: the first ``equalities`` rows with equality.

        Returns
        -------
        (matrix, bound)
            Reused at the next call.
        """
        problem, matrix, bound = self.problem, self.matrix, self.bound
        tables, limits, v0 = problem.space.tables, problem.limits, problem.space.start_speed
        tau, beta, path = trajectory.travel_time, trajectory.beta, trajectory.path
        # Arrival: v0 tau + C2(1) b = L(theta)
        matrix[0, : self.theta_size] = -path.final_gradient[problem.ends.free]
        matrix[0, self._beta] = tau * tau * tables.final_distance
        matrix[0, -1] = v0 * tau
        bound[0] = path.arc_length - v0 * tau - tau * tau * float(tables.final_distance @ beta)
        if problem.ends.goal_speed is not None:
            # Speed at the goal: v0 tau + C1(1) b = v_goal tau
            matrix[1, self._beta] = tau * tables.final_speed
            matrix[1, -1] = v0 - problem.ends.goal_speed
            bound[1] = problem.ends.goal_speed - v0 - tau * float(tables.final_speed @ beta)
        np.multiply(self._speeds, tau, out=matrix[self._upper, self._beta])
        np.multiply(self._speeds, -tau, out=matrix[self._lower, self._beta])
        speeds = v0 + tau * (self._speeds @ beta)
        bound[self._upper] = limits.speed - speeds
        bound[self._lower] = speeds
        bound[self._up] = limits.acceleration - beta
        bound[self._down] = limits.deceleration + beta
        return matrix, bound


def curvature_rows(problem: Problem, trajectory: Trajectory, points: TripPoints, group: int) -> Rows:
    """Return the rows of -limit <= curvature <= limit at points of a trip, relative to the limit.

    Both sides are rows wherever a step could reach them: the curvature may change its sign in one step.
    """
    limit = problem.limits.curvature
    bend = trajectory.path.bend(points.path)
    theta = _curvature_gradient(problem, trajectory, points, bend) / limit
    zeros = np.zeros((len(theta), problem.space.acceleration_size + 1))
    return _both_sides(np.concatenate([theta, zeros], axis=1), bend.curvature / limit, group)


def lateral_rows(problem: Problem, trajectory: Trajectory, points: TripPoints, group: int) -> Rows:
    """Return the rows of -limit <= v^2 curvature <= limit at fixed stations of a trip, relative to the limit.

    At a fixed station D(sigma) = S(theta) moves sigma, and with it the speed:
    d(v^2) = 2 v (C1 db / tau - (v - v0) dtau / tau) + 2 a (dS - C2 db - v0 sigma dtau), regular also at v = 0.
    """
    limit = problem.limits.lateral_acceleration
    bend = trajectory.path.bend(points.path)
    curvature = bend.curvature / limit
    tau, v0 = trajectory.travel_time, problem.space.start_speed
    v, a, table = points.speed, points.acceleration, points.table
    squared = v * v
    stations = trajectory.path.arc_length_gradient(points.parameter)[:, problem.ends.free]
    theta = (squared / limit)[:, None] * _curvature_gradient(problem, trajectory, points, bend)
    theta += (curvature * 2.0 * a)[:, None] * stations
    beta = curvature[:, None] * (
        (2.0 * tau * v)[:, None] * table.speed - (2.0 * tau * tau * a)[:, None] * table.distance
    )
    rho = -2.0 * curvature * (v * (v - v0) + a * v0 * tau * table.sigma)
    return _both_sides(join_blocks(theta, beta, rho), curvature * squared, group)


def _both_sides(gradient: Array, value: Array, group: int) -> Rows:
    """Rows of -1 <= value + gradient z <= 1."""
    return Rows(
        np.concatenate([gradient, -gradient]),
        np.concatenate([1.0 - value, 1.0 + value]),
        np.full(2 * len(value), group, dtype=np.intp),
    )


def _curvature_gradient(problem: Problem, trajectory: Trajectory, points: TripPoints, bend: PathBend) -> Array:
    """Derivative of the curvature at fixed stations with respect to the free offsets, (m, K1 free)."""
    space, path = problem.space, points.path
    basis = space.path
    gradient = (bend.slope / space.length)[:, None] * basis.derivative.rows_at(path.span, path.local)
    gradient += (bend.bend / space.length**2)[:, None] * basis.derivative.derivative.rows_at(path.span, path.local)
    if not space.guide.straight:
        gradient += bend.value[:, None] * basis.rows_at(path.span, path.local)
    return gradient[:, problem.ends.free]
