"""In which directions a vehicle can set out."""

from __future__ import annotations

import math

from scp_planner.certificate.ends import can_reverse
from scp_planner.online.stops import STOPS
from scp_planner.scenario.models import Steering, Vehicle


def can_turn(vehicle: Vehicle, speed: float) -> bool:
    """True if it can set out in any direction, at a speed in units of the scene."""
    return vehicle.steering is Steering.ANY or (vehicle.steering is Steering.ON_THE_SPOT and speed <= STOPS.standing)


def direction(
    vehicle: Vehicle, position: tuple[float, float], heading: float | None, speed: float, goal: tuple[float, float]
) -> float | None:
    """In which direction a vehicle sets out for its goal."""
    if heading is None or can_turn(vehicle, speed):
        return None
    towards = math.atan2(goal[1] - position[1], goal[0] - position[0])
    if can_reverse(vehicle, speed) and math.cos(heading - towards) < 0.0:
        return math.remainder(heading + math.pi, 2.0 * math.pi)
    return float(heading)
