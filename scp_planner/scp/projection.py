"""Result of a step, and the nearest trip that keeps all hard constraints."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from scp_planner.arrays import Array
from scp_planner.certificate.tolerances import END_TOLERANCE
from scp_planner.constraints.drive import DriveRows
from scp_planner.constraints.rows import Rows
from scp_planner.problem.problem import Problem
from scp_planner.scp.parameters import LoopParameters
from scp_planner.scp.record import FEASIBILITY
from scp_planner.scp.step_solver import StepSolver
from scp_planner.scp.subproblem import build_subproblem
from scp_planner.trips.trajectory import Trajectory


def trip_after(problem: Problem, trajectory: Trajectory, z: Array) -> Trajectory | None:
    """Return the trip after a step, its travel time from the closed form; None if it would never arrive."""
    free = problem.ends.free
    count = free.stop - free.start
    size = problem.space.acceleration_size
    theta = trajectory.theta.copy()
    theta[free] += z[:count]
    beta = (trajectory.beta + z[count : count + size]) / (1.0 + z[count + size]) ** 2
    if problem.ends.start_acceleration is not None:
        beta[0] = problem.ends.start_acceleration  # the row is exact to first order
    moved = Trajectory.of(problem.space, theta, beta, trajectory.travel_time * (1.0 + z[count + size]))
    return moved if np.isfinite(moved.travel_time) else None


class Projection:
    """Onto what every step must keep: speed, acceleration, a user's constraints."""

    def __init__(self, problem: Problem, drive: DriveRows, solver: StepSolver, parameters: LoopParameters) -> None:
        self.problem = problem
        self.drive = drive
        self.solver = solver
        self.parameters = parameters

    def kept(self, start: Trajectory, deadline: float) -> Trajectory:
        """Return the nearest trip that keeps all that; the start as it is if none is found."""
        near = start
        for _ in range(self.parameters.projections):
            moved = self._nearest(near, Rows.none(self.problem.step_size), np.zeros(0), deadline)
            if moved is None:
                return start
            near = moved
        return near

    def misses_goal_speed(self, trip: Trajectory) -> bool:
        """True if a trip arrives at another speed than the goal's, by more than rounding."""
        goal = self.problem.ends.goal_speed
        return goal is not None and abs(trip.final_speed - goal) > END_TOLERANCE

    def mended(self, trip: Trajectory, rows: Rows, groups: int, deadline: float) -> Trajectory | None:
        """Return the nearest trip that keeps all that and everything else, to first order; None if none is found."""
        return self._nearest(trip, rows, np.full(groups, self.parameters.last_penalty), deadline)

    def _nearest(self, start: Trajectory, rows: Rows, weights: Array, deadline: float) -> Trajectory | None:
        """The nearest trip that keeps all that, and rows at their prices beside it, to first order."""
        problem, parameters = self.problem, self.parameters
        sub = build_subproblem(problem, self.drive, start, rows, weights, parameters.projection_trust)
        count = problem.step_size
        nearness = np.full(len(sub.program.gradient), parameters.acceleration_nearness)
        nearness[: problem.ends.free.stop - problem.ends.free.start] = 1.0
        nearness[count - 1] = parameters.time_nearness
        gradient = np.where(np.arange(len(nearness)) < count, 0.0, sub.program.gradient)
        solution = self.solver.solve(replace(sub.program, hessian=np.diag(nearness), gradient=gradient), deadline)
        return None if solution is None else trip_after(problem, start, solution.x)

    def within_limits(self, trip: Trajectory, deadline: float) -> Trajectory | None:
        """Return the nearest trip within speed and acceleration; None if this one is, or nothing better is found."""
        excess = self.drive.excess(trip)
        if excess <= FEASIBILITY:
            return None
        kept = self.kept(trip, deadline)
        return kept if self.drive.excess(kept) < 0.5 * excess else None
