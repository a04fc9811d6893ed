"""ORCA for a vehicle with a heading: drive the velocity that it finds, within the limits.

van den Berg et al., Reciprocal n-Body Collision Avoidance, ISRR 2011.
"""

from __future__ import annotations

import math

import numpy as np

from benchmarks.everyday.bodies import polygon_distance
from benchmarks.everyday.controllers.baseline import Baseline, Discs
from benchmarks.everyday.motions import Array, Robot
from scp_planner.simulation.orca import Bodies, HalfPlanes, half_planes, nearest_velocities

HORIZON = 3.0  # s
WALL_HORIZON = 1.0  # s
WIDER = 1.1  # of the radius: the vehicle turns to a velocity on an arc


class Orca(Baseline):
    """Others do half of what is to be done, as ORCA assumes."""

    def command(self, robot: Robot, others: Discs) -> tuple[float, float]:
        vehicle, period = self.vehicle, self.scene.period
        speed = max(robot.speed, 0.0)
        ahead = np.array([math.cos(robot.heading), math.sin(robot.heading)])
        left = float(self.field.distance(robot.position))
        look = max(6.0 * self.field.cell, 2.0 * vehicle.radius)
        wanted = min(vehicle.top_speed, self.speed_to_goal(left - 0.25 * vehicle.top_speed * period))
        wish = wanted * self.field.direction(robot.position, look)
        velocity = nearest_velocities(
            self._rows(robot, speed * ahead, others), wish[None], np.array([vehicle.top_speed])
        )[0]
        size = float(np.hypot(*velocity))
        off = (
            math.remainder(math.atan2(velocity[1], velocity[0]) - robot.heading, 2.0 * math.pi) if size > 1e-3 else 0.0
        )
        turning = max(min(off, 0.5 * math.pi), -0.5 * math.pi) / (2.0 * period)
        driven = max(size * max(math.cos(off), 0.0), min(size, 0.1 * vehicle.top_speed))
        return (driven - speed) / period, turning / max(driven, 0.05 * vehicle.top_speed)

    def _rows(self, robot: Robot, velocity: Array, others: Discs) -> HalfPlanes:
        vehicle = self.vehicle
        lever = float(np.abs(vehicle.discs).max())
        radius = WIDER * vehicle.radius + 0.5 * lever
        count = len(others.radius)
        normals, offsets = self._walls(robot.position)
        if count:
            own = Bodies(np.tile(robot.position, (count, 1)), np.tile(velocity, (count, 1)), np.full(count, radius))
            rows = half_planes(own, Bodies(others.position, others.velocity, others.radius), HORIZON, self.scene.period)
            normals, offsets = np.concatenate([normals, rows.normal]), np.concatenate([offsets, rows.offset])
        return HalfPlanes(normals[None], offsets[None])

    def _walls(self, place: Array) -> tuple[Array, Array]:
        """Half-planes of velocities that reach no wall within ``WALL_HORIZON``."""
        normals, offsets = [], []
        step = 1e-4 * self.vehicle.radius
        for wall in self.walls:
            around = place + step * np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
            at, right, up = polygon_distance(around, wall)
            slope = np.array([right - at, up - at]) / step
            normals.append(slope / max(float(np.hypot(*slope)), 1e-9))
            offsets.append(-(at - self.vehicle.radius) / WALL_HORIZON)
        if self.scene.bounds is not None:
            for sign, corner in zip((1.0, -1.0), self.scene.bounds, strict=True):
                for axis in (0, 1):
                    normals.append(sign * np.eye(2)[axis])
                    offsets.append(-(sign * (place[axis] - corner[axis]) - self.vehicle.radius) / WALL_HORIZON)
        return np.array(normals).reshape(-1, 2), np.array(offsets)
