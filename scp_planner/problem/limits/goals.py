"""Goals that leave something open: a region to end in, a range of speeds or headings. Optional limits."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from math import pi, remainder
from typing import ClassVar, Self

import numpy as np

from scp_planner.arrays import Array, Index
from scp_planner.mathematics.rounding import ANGLE_DECIMALS
from scp_planner.problem.limits.discs import Swing, disc_positions, of_offsets_alone
from scp_planner.problem.limits.inputs import LimitInputs
from scp_planner.problem.limits.limit import OptionalLimit
from scp_planner.scenario.goal_sides import GoalSides
from scp_planner.trips.space import TripSpace
from scp_planner.trips.trajectory import Trajectory

REGION_MARGIN = 4e-4  # units of length, from the border of a region that only constraints of a step keep
HEADING_MARGIN = 1e-5  # rad, from the ends of a range of headings at the goal
SPEED_MARGIN = 1e-5  # of the top speed, from the ends of a range of speeds at the goal
_END = np.ones(1)


@dataclass(frozen=True)
class GoalRegion(OptionalLimit):
    """How far beyond each side of a convex region the middle of the vehicle is on arrival, m.

    Attributes
    ----------
    ahead : float
        Of the reference point, where the middle is, m.
    free : slice
        The free control points of the offset.
    step_size : int
        Number of variables of a step.
    normals, offsets : (S, 2), (S,) arrays
        Of the sides: normal . q <= offset.
    """

    name: ClassVar[str] = "goal region"
    near: ClassVar[float] = np.inf

    ahead: float
    free: slice
    step_size: int
    normals: Array
    offsets: Array

    def tightened(self, more: float) -> Self:
        """Return a smaller region."""
        return type(self)(self.ahead, self.free, self.step_size, self.normals, self.offsets - more)

    def excess(self, trajectory: Trajectory) -> Array:
        """Return the distance beyond each side, (S,) m."""
        middle = disc_positions(trajectory.path.points(_END), self.ahead)
        return (middle @ self.normals.T - self.offsets).ravel()

    def gradient(self, trajectory: Trajectory, index: Index) -> Array:
        """Return the gradients of the distances."""
        path = trajectory.path
        points = path.points(np.ones(len(index)))
        theta = Swing.of(points).rows(path, points, self.normals[index], self.ahead)[:, self.free]
        return of_offsets_alone(theta, self.step_size)


@dataclass(frozen=True)
class GoalHeading(OptionalLimit):
    """How far the heading on arrival is outside its range, rad: to the left of it, then to the right.

    Attributes
    ----------
    middle, half : float
        Of the range, rad in the planning frame.
    free : slice
        The free control points of the offset.
    step_size : int
        Number of variables of a step.
    """

    name: ClassVar[str] = "goal heading"
    near: ClassVar[float] = np.inf

    middle: float
    half: float
    free: slice
    step_size: int

    def tightened(self, more: float) -> Self:
        """Return a narrower range."""
        return type(self)(self.middle, self.half - more, self.free, self.step_size)

    def excess(self, trajectory: Trajectory) -> Array:
        """Return by how much the heading is beyond each end of the range, (2,) rad."""
        direction = trajectory.path.points(_END).direction[0]
        turn = float(np.arctan2(direction[1], direction[0])) - self.middle
        turn -= 2.0 * pi * round(turn / (2.0 * pi))
        return np.array([turn - self.half, -turn - self.half])

    def gradient(self, trajectory: Trajectory, index: Index) -> Array:
        """Return the gradients of the heading, and of its negative."""
        path = trajectory.path
        points = path.points(_END)
        turn = Swing.of(points).turn_rows(path, points)[0, self.free]
        return of_offsets_alone(np.where(index == 0, 1.0, -1.0)[:, None] * turn, self.step_size)


@dataclass(frozen=True)
class GoalSpeed(OptionalLimit):
    """How far the speed on arrival is outside its range, m/s: above it, then below.

    Attributes
    ----------
    space : TripSpace
    lowest, highest : float
        m/s.
    free_size : int
        Number of free control points of the offset.
    """

    name: ClassVar[str] = "goal speed"
    near: ClassVar[float] = np.inf

    space: TripSpace
    lowest: float
    highest: float
    free_size: int

    def tightened(self, more: float) -> Self:
        """Return a narrower range."""
        return type(self)(self.space, self.lowest + more, self.highest - more, self.free_size)

    def excess(self, trajectory: Trajectory) -> Array:
        """Return by how much the speed is beyond each end of the range, (2,) m/s."""
        speed = trajectory.final_speed
        return np.array([speed - self.highest, self.lowest - speed])

    def gradient(self, trajectory: Trajectory, index: Index) -> Array:
        """Return the gradients of the speed, and of its negative."""
        rise = trajectory.travel_time * self.space.tables.final_speed
        speed = np.concatenate([np.zeros(self.free_size), rise, [self.space.start_speed - trajectory.final_speed]])
        signed: Array = np.where(index == 0, 1.0, -1.0)[:, None] * speed
        return signed


def goal_limits(inputs: LimitInputs) -> Iterator[OptionalLimit]:
    """Make what a goal asks for that leaves something open; a region only where the bounds of the end do not do."""
    scenario, frame, free = inputs.scenario, inputs.frame, inputs.free
    goal = scenario.goal
    sides = GoalSides.of(scenario, frame, REGION_MARGIN)
    if sides is not None and scenario.vehicle.centre != 0.0:
        yield GoalRegion(scenario.vehicle.centre, free, inputs.step_size, sides.normals, sides.offsets)
    if goal.heading_range is not None and goal.heading_range[1] - goal.heading_range[0] < 2.0 * pi:
        low, high = goal.heading_range
        half = max(0.5 * (high - low) - HEADING_MARGIN, 0.0)
        middle = round(remainder(0.5 * (low + high) - frame.heading, 2.0 * pi), ANGLE_DECIMALS)
        yield GoalHeading(middle, half, free, inputs.step_size)
    if goal.speed_range is not None:
        low, high = goal.speed_range
        margin = min(SPEED_MARGIN * scenario.vehicle.max_speed, 0.5 * (high - low))
        yield GoalSpeed(inputs.space, low + margin, high - margin, inputs.free_size)
