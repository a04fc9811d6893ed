from __future__ import annotations

from dataclasses import dataclass
from math import pi, remainder, sqrt, tan

import numpy as np

from scp_planner.arrays import Array
from scp_planner.mathematics.frames import PlanningFrame
from scp_planner.mathematics.tolerances import ANGLE_DECIMALS
from scp_planner.scenario.goal_sides import GoalSides
from scp_planner.scenario.models import Scenario
from scp_planner.trips.space import TripSpace

STEEPEST_PATH = 1.4  # rad; largest angle between path and guide at the ends
INSIDE = 1e-6  # units of length, from the border of the goal
LEAST_GOAL_SPEED = 1e-5  # units of speed: what a stop at the goal is planned with, as speeds below 0 are refused
FOLD = 0.8  # of the guide's radius of curvature: largest offset to the inside
FOLD_LOOKS = 16  # stations to a span at which the guide's curvature is looked at


@dataclass(frozen=True)
class EndConditions:
    theta: Array  # (K1,): fixed values where ``free`` excludes them, m
    free: slice  # the free control points
    goal_speed: float | None  # m/s
    # Bounds of the control points, m: the largest offset, and less where the guide would fold; the last one stays
    # within the radius of the goal
    lower: Array  # (K1,)
    upper: Array  # (K1,)
    start_acceleration: float | None = None  # what the first control point of the acceleration is to be, m/s^2

    def around(self, offsets: Array) -> Array:
        """Return all control points of a path (K1,), m, of its free ones."""
        theta = self.theta.copy()
        theta[self.free] = offsets
        return theta


def end_conditions(scenario: Scenario, frame: PlanningFrame, space: TripSpace, max_offset: float) -> EndConditions:
    """Return what holds at the ends of a scenario's trips, whose offsets are at most so many m."""
    theta = np.zeros(space.path_size)
    first, last = 1, space.path_size - 1
    degree = space.path.coefficients.shape[1] - 1
    spans = len(space.path.widths)
    reach = space.length / (degree * spans)
    ends = np.zeros(2)
    if not space.guide.straight:
        tangent = space.guide.frame(np.array([0.0, space.length])).tangent
        ends = np.arctan2(tangent[:, 1], tangent[:, 0])
    if scenario.start.heading is not None:
        theta[1] = reach * tan(_sideways(scenario.start.heading - frame.heading - float(ends[0])))
        first = 2
    lower, upper = _offset_bounds(space, max_offset)
    if scenario.goal.heading is None and (scenario.goal.radius > 0.0 or scenario.goal.region is not None):
        last += 1
        lower[-1], upper[-1] = _end_bounds(scenario, frame, space)
    if scenario.goal.heading is not None:
        theta[-2] = -reach * tan(_sideways(scenario.goal.heading - frame.heading - float(ends[1])))
        last -= 1
    goal_speed = scenario.goal.speed
    if goal_speed is not None:
        goal_speed = max(goal_speed, LEAST_GOAL_SPEED)
    return EndConditions(theta, slice(first, last), goal_speed, lower, upper, scenario.start.acceleration)


def _end_bounds(scenario: Scenario, frame: PlanningFrame, space: TripSpace) -> tuple[float, float]:
    """Offsets at the end of the guide that lie within the radius or the region of the goal, m."""
    end = space.guide.frame(np.array([space.length]))
    sides = GoalSides.of(scenario, frame, INSIDE)
    if sides is not None:
        # Of the vehicle's middle; it may be so much further to the side where it is ahead of the reference point.
        ahead = scenario.vehicle.centre
        first, last = sides.along(end.position[0] + ahead * end.tangent[0], end.normal[0])
        return min(first - abs(ahead), 0.0), max(last + abs(ahead), 0.0)
    goal = np.array([float(np.hypot(*np.subtract(scenario.goal.position, scenario.start.position))), 0.0])
    away = end.position[0] - goal
    along, across = float(away @ end.tangent[0]), float(away @ end.normal[0])
    half = sqrt(max(scenario.goal.radius**2 - along**2, 0.0))
    return min(-across - half + INSIDE, 0.0), max(-across + half - INSIDE, 0.0)


def _sideways(angle: float) -> float:
    """The nearest heading that a path over the guide can have."""
    return min(max(round(remainder(angle, 2.0 * pi), ANGLE_DECIMALS), -STEEPEST_PATH), STEEPEST_PATH)


def _offset_bounds(space: TripSpace, max_offset: float) -> tuple[Array, Array]:
    """Bounds of the control points: by convexity, wherever one has weight the guide does not fold."""
    upper = np.full(space.path_size, max_offset)
    lower = -upper
    if space.guide.straight:
        return lower, upper
    parameters = np.linspace(0.0, 1.0, FOLD_LOOKS * len(space.path.widths) + 1)
    curvature = space.guide.frame(parameters * space.length).curvature
    with np.errstate(divide="ignore"):
        left = np.where(curvature > 0.0, FOLD / np.maximum(curvature, 1e-300), np.inf)
        right = np.where(curvature < 0.0, FOLD / np.maximum(-curvature, 1e-300), np.inf)
    span, x = space.path.locate(parameters)
    for control, weight in space.path.weights_at(span, x):
        weighs = weight > 0.0
        np.minimum.at(upper, control[weighs], left[weighs])
        np.maximum.at(lower, control[weighs], -right[weighs])
    return lower, upper
