"""Stop-and-go: the shortest way at top speed; a stop wherever somebody comes too near at constant velocity."""

from __future__ import annotations

import math

import numpy as np

from benchmarks.everyday.controllers.baseline import Baseline, Discs
from benchmarks.everyday.motions import Array, Robot

KEEPS = 0.35  # radii of the vehicle, between it and others
LATER = 0.5  # s, after the vehicle stands


class StopAndGo(Baseline):
    """Brake if another comes within a distance while the vehicle drives on for its stopping time."""

    def command(self, robot: Robot, others: Discs) -> tuple[float, float]:
        vehicle, period = self.vehicle, self.scene.period
        speed = max(robot.speed, 0.0)
        ahead = max(4.0 * self.field.cell, vehicle.radius, 0.5 * speed)
        way = self.field.direction(robot.position, ahead)
        off = math.remainder(math.atan2(way[1], way[0]) - robot.heading, 2.0 * math.pi)
        curvature = 2.0 * math.sin(max(min(off, 0.5 * math.pi), -0.5 * math.pi)) / ahead
        left = float(self.field.distance(robot.position))
        wanted = min(vehicle.top_speed, self.speed_to_goal(left - 0.25 * vehicle.top_speed * period))
        if abs(off) > 0.6:
            wanted = min(wanted, 0.4 * vehicle.top_speed)
        acceleration = (wanted - speed) / period
        if self._blocked(robot, curvature, max(speed, vehicle.acceleration * period), others):
            acceleration = -vehicle.deceleration
        return acceleration, curvature

    def _blocked(self, robot: Robot, curvature: float, speed: float, others: Discs) -> bool:
        if not len(others.radius):
            return False
        vehicle = self.vehicle
        times = np.linspace(0.0, speed / vehicle.deceleration + LATER, 12)
        limit = float(vehicle.allowed_curvature(speed))
        bend = min(max(curvature, -limit), limit)
        places = _arc(robot, bend, speed * times)
        lever = vehicle.discs[:, None, None] * np.stack(
            [np.cos(robot.heading + bend * speed * times), np.sin(robot.heading + bend * speed * times)], axis=1
        )
        apart = np.linalg.norm((places + lever)[:, None] - others.at(times)[None], axis=-1)
        return bool((apart - others.radius[:, None] < (1.0 + KEEPS) * vehicle.radius).any())


def _arc(robot: Robot, curvature: float, ways: Array) -> Array:
    middle = robot.heading + 0.5 * curvature * ways
    chord = ways * np.sinc(0.5 * curvature * ways / np.pi)
    return np.asarray(robot.position + chord[:, None] * np.stack([np.cos(middle), np.sin(middle)], axis=1))
