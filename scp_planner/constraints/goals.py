"""The speed at the goal, and goals that leave something open: a region to end in, a range of speeds or headings."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from math import pi, remainder
from typing import ClassVar, Self

import numpy as np

from scp_planner.arrays import Array, Index
from scp_planner.constraints.constraint import Constraint
from scp_planner.constraints.rows import Rows
from scp_planner.constraints.setup import Setup
from scp_planner.constraints.swing import Swing, disc_positions
from scp_planner.mathematics.tolerances import ANGLE_DECIMALS
from scp_planner.scenario.goal_sides import GoalSides
from scp_planner.trips.trajectory import Trajectory

REGION_MARGIN = 4e-4  # units of length, from the border of a region that only constraints of a step keep
HEADING_MARGIN = 1e-5  # rad, from the ends of a range of headings at the goal
SPEED_MARGIN = 1e-5  # of the top speed, from the ends of a range of speeds at the goal
_END = np.ones(1)


@dataclass(frozen=True)
class GoalSpeedRange(Constraint):
    name: ClassVar[str] = "goal speed"

    lowest: float
    highest: float

    def tightened(self, more: float) -> Self:
        return replace(self, lowest=self.lowest + more, highest=self.highest - more)

    def excess(self, trip: Trajectory) -> Array:
        speed = trip.final_speed
        return np.array([speed - self.highest, self.lowest - speed])

    def gradient(self, trip: Trajectory, index: Index) -> Array:
        space, sign = self.setup.space, np.where(index == 0, 1.0, -1.0)
        beta, rho = trip.travel_time * space.drive.final_speed, space.start_speed - trip.final_speed
        return self.setup.of_drive(sign[:, None] * beta, sign * rho)


class GoalSpeed(GoalSpeedRange):
    def tightened(self, more: float) -> Self:
        del more  # it is met to rounding
        return self

    def rows(self, trip: Trajectory, excess: Array) -> Rows:
        """Return rows that are linear in (b, tau), and so exact: v0 tau + C1(1) b = v_goal tau."""
        rows, rho = super().rows(trip, excess), self.setup.space.start_speed - self.highest
        rows.matrix[:, -1] = rho, -rho
        return rows


@dataclass(frozen=True)
class GoalRegion(Constraint):
    name: ClassVar[str] = "goal region"

    ahead: float
    normals: Array
    offsets: Array

    def tightened(self, more: float) -> Self:
        return replace(self, offsets=self.offsets - more)

    def excess(self, trip: Trajectory) -> Array:
        """Return the distance beyond each side, (S,) m."""
        middle = disc_positions(trip.path.points(_END), self.ahead)
        return (middle @ self.normals.T - self.offsets).ravel()

    def gradient(self, trip: Trajectory, index: Index) -> Array:
        points = trip.path.points(np.ones(len(index)))
        theta = Swing.of(points).rows(trip.path, points, self.normals[index], self.ahead)
        return self.setup.of_path(theta[:, self.setup.ends.free])


@dataclass(frozen=True)
class GoalHeading(Constraint):
    name: ClassVar[str] = "goal heading"

    middle: float
    half: float

    def tightened(self, more: float) -> Self:
        return replace(self, half=self.half - more)

    def excess(self, trip: Trajectory) -> Array:
        direction = trip.path.points(_END).direction[0]
        turn = float(np.arctan2(direction[1], direction[0])) - self.middle
        turn -= 2.0 * pi * round(turn / (2.0 * pi))
        return np.array([turn - self.half, -turn - self.half])

    def gradient(self, trip: Trajectory, index: Index) -> Array:
        points = trip.path.points(_END)
        turn = Swing.of(points).turn_rows(trip.path, points)[0, self.setup.ends.free]
        return self.setup.of_path(np.where(index == 0, 1.0, -1.0)[:, None] * turn)


def goal_speed(setup: Setup) -> Iterator[Constraint]:
    """Make the constraint of a goal with one speed."""
    speed = setup.ends.goal_speed
    if speed is not None:
        yield GoalSpeed(setup, speed, speed)


def open_goal(setup: Setup) -> Iterator[Constraint]:
    """Make what a goal asks for that leaves something open; a region only where the bounds of the end do not do."""
    scenario, goal = setup.scenario, setup.scenario.goal
    sides = GoalSides.of(scenario, setup.frame, REGION_MARGIN)
    if sides is not None and scenario.vehicle.centre != 0.0:
        yield GoalRegion(setup, scenario.vehicle.centre, sides.normals, sides.offsets)
    if goal.heading_range is not None and goal.heading_range[1] - goal.heading_range[0] < 2.0 * pi:
        low, high = goal.heading_range
        half = max(0.5 * (high - low) - HEADING_MARGIN, 0.0)
        middle = round(remainder(0.5 * (low + high) - setup.frame.heading, 2.0 * pi), ANGLE_DECIMALS)
        yield GoalHeading(setup, middle, half)
    if goal.speed_range is not None:
        low, high = goal.speed_range
        margin = min(SPEED_MARGIN * scenario.vehicle.max_speed, 0.5 * (high - low))
        yield GoalSpeedRange(setup, low + margin, high - margin)
