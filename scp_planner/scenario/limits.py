"""Limits of a vehicle and its workspace."""

from __future__ import annotations

from dataclasses import astuple, dataclass, replace
from math import hypot, sqrt

import numpy as np

from scp_planner.arrays import Array
from scp_planner.mathematics.frames import PlanningFrame
from scp_planner.mathematics.tolerances import ANGLE_DECIMALS, DECIMALS, to_digits
from scp_planner.scenario.models import Scenario


@dataclass(frozen=True)
class Limits:
    """Limits of the vehicle as planned with: the scenario's, less the margin; inf where there is none."""

    speed: float  # m/s
    acceleration: float  # m/s^2, both positive
    deceleration: float  # m/s^2, both positive
    lateral_acceleration: float  # m/s^2
    curvature: float  # 1/m

    @classmethod
    def of(cls, scenario: Scenario, margin: float = 0.0) -> Limits:
        """Return the limits of a scenario's vehicle, each reduced by a relative margin."""
        vehicle, keep = scenario.vehicle, 1.0 - margin
        return cls(
            vehicle.max_speed * keep,
            vehicle.max_acceleration * keep,
            vehicle.max_deceleration * keep,
            np.inf if vehicle.max_lateral_acceleration is None else vehicle.max_lateral_acceleration * keep,
            np.inf if vehicle.max_curvature is None else vehicle.max_curvature * keep,
        )

    def both_within(self, total: float | None) -> Limits:
        """Return limits in the same proportions within which accelerations along and across keep a total one, m/s2."""
        if total is None:
            return self
        along, across = max(self.acceleration, self.deceleration), min(self.lateral_acceleration, total)
        share = min(1.0, total / hypot(along, across))
        return replace(
            self,
            acceleration=share * self.acceleration,
            deceleration=share * self.deceleration,
            lateral_acceleration=share * across,
        )

    def rounded(self) -> Limits:
        """Return the limits as they are planned with: a scene in other units has other last bits of them."""
        return Limits(*map(to_digits, astuple(self)))


@dataclass(frozen=True)
class Box:
    """Half planes normal . r <= offset of the planning frame that the vehicle's reference point stays in."""

    normals: Array  # (S, 2) Outward unit normals; S is 0 without a workspace box
    offsets: Array  # (S,) m, already less the vehicle's radius and the planner's margin

    @classmethod
    def of(cls, scenario: Scenario, frame: PlanningFrame, margin: float) -> Box:
        """Return the workspace box of a scenario, in the planning frame."""
        if scenario.bounds is None:
            return cls(np.zeros((0, 2)), np.zeros(0))
        keep = scenario.vehicle.radius + margin
        world = np.array([[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]])
        low, high = scenario.bounds.min, scenario.bounds.max
        offsets = np.array([high[0], -low[0], high[1], -low[1]]) - keep
        normals = np.round(world @ frame.rotation, ANGLE_DECIMALS)
        return cls(normals, np.round(offsets - world @ np.asarray(frame.origin), DECIMALS))

    def room(self, position: Array) -> Array:
        """Distances of positions (..., 2) to the border, m, negative outside; inf without a workspace box."""
        least: Array = (self.offsets - position @ self.normals.T).min(axis=-1, initial=np.inf)
        return least


def straight_trip_time(scenario: Scenario, limits: Limits) -> float:
    """Return the time of a straight trip without obstacles to the goal of a scenario, s; 0 of one that is there."""
    start, goal = scenario.start, scenario.goal
    length = float(np.hypot(*np.subtract(goal.position, start.position))) - goal.radius
    return 0.0 if length <= 0.0 else straight_travel_time(length, start.speed, limits, goal.speed)[0]


def straight_travel_time(
    length: float, start_speed: float, limits: Limits, goal_speed: float | None = None
) -> tuple[float, tuple[float, ...]]:
    """Shortest time to drive a length: accelerate, cruise, and decelerate to the goal speed if there is one."""
    a, d, top = limits.acceleration, limits.deceleration, max(limits.speed, start_speed)
    end = goal_speed
    # The peak speed that uses up the length: (vp^2 - v0^2) / 2a + (vp^2 - ve^2) / 2d = length
    if end is None:
        peak = sqrt(start_speed**2 + 2.0 * a * length)
    else:
        peak = sqrt(max((2.0 * a * d * length + d * start_speed**2 + a * end**2) / (a + d), 0.0))
    peak = max(min(peak, top), start_speed)
    rise = (peak - start_speed) / a
    fall = 0.0 if end is None else max(peak - end, 0.0) / d
    driven = (peak**2 - start_speed**2) / (2 * a) + (0.0 if end is None else (peak**2 - end**2) / (2 * d))
    rest = max(length - driven, 0.0)
    cruise = rest / peak if rest > 0.0 else 0.0
    return rise + cruise + fall, (rise, rise + cruise)
