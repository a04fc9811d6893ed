"""Model predictive path integral control among constant velocities.

Williams et al., Journal of Guidance, Control, and Dynamics 40, 2017.
"""

from __future__ import annotations

import numpy as np

from benchmarks.everyday.controllers.baseline import Baseline, Discs
from benchmarks.everyday.motions import Array, Robot
from benchmarks.everyday.scene import Scene

SAMPLES = 400
STEPS = 16
HELD = 4  # steps in a row with one control
NEAR = 0.6  # widths of the vehicle over which the cost of being near falls by e
TEMPERATURE = 0.15  # widths of the vehicle


class Mppi(Baseline):
    """Sample accelerations and curvatures, weigh the rollouts by their cost, drive the mean."""

    def __init__(self, scene: Scene, seed: int = 0) -> None:
        super().__init__(scene)
        self._rng = np.random.default_rng(seed)
        horizon = max(3.2, 2.0 * self.vehicle.top_speed / self.vehicle.deceleration)
        self._dt = max(horizon / STEPS, scene.period)
        self._mean = np.zeros((STEPS, 2))

    def command(self, robot: Robot, others: Discs) -> tuple[float, float]:
        controls = self._sampled()
        cost = self._cost(controls, robot, others)
        width = 2.0 * self.vehicle.radius
        weight = np.exp(-(cost - cost.min()) / (TEMPERATURE * width))
        mean = np.tensordot(weight / weight.sum(), controls, 1)
        # The mean of two sides may lead between them: it is driven where it is as good as the best rollout.
        if self._cost(mean[None], robot, others)[0] > cost.min() + width:
            mean = controls[int(cost.argmin())]
        self._mean = mean
        return float(mean[0, 0]), float(mean[0, 1])

    def _sampled(self) -> Array:
        vehicle = self.vehicle
        a, d, most = vehicle.acceleration, vehicle.deceleration, vehicle.curvature
        noise = self._rng.normal(0.0, 1.0, (SAMPLES, STEPS // HELD, 2)).repeat(HELD, axis=1)
        controls = self._mean + noise * [0.8 * max(a, d), 0.6 * most]
        controls[0], controls[1] = [-d, 0.0], self._mean
        for k, (rate, bend) in enumerate(((a, 0.0), (0.0, most), (0.0, -most), (a, most), (a, -most)), 2):
            controls[k] = [rate, bend]
        controls[..., 0] = np.clip(controls[..., 0], -d, a)
        controls[..., 1] = np.clip(controls[..., 1], -most, most)
        return np.asarray(controls)

    def _cost(self, controls: Array, robot: Robot, others: Discs) -> Array:
        vehicle, dt, count = self.vehicle, self._dt, len(controls)
        width = 2.0 * vehicle.radius
        place, heading = np.tile(robot.position, (count, 1)), np.full(count, robot.heading)
        speed, cost, braked = np.full(count, max(robot.speed, 0.0)), np.zeros(count), np.zeros(count)
        for k in range(controls.shape[1]):
            speed = np.clip(speed + controls[:, k, 0] * dt, 0.0, vehicle.top_speed)
            limit = vehicle.allowed_curvature(speed)
            bend = np.clip(controls[:, k, 1], -limit, limit)
            heading = heading + bend * speed * dt
            ahead = np.stack([np.cos(heading), np.sin(heading)], axis=1)
            place = place + (speed * dt)[:, None] * ahead
            cost += self._near(place, ahead, others, (k + 1) * dt, width) / (1.0 + 0.3 * k)
            cost += 0.02 * vehicle.top_speed * dt * (bend / vehicle.curvature) ** 2
            if self.stops:
                left = np.linalg.norm(place - self.field.goal, axis=1)
                braked = np.maximum(braked, speed**2 / (2.0 * vehicle.deceleration) - left)
                cost += 0.3 * dt * np.minimum(left, self.field.distance(place))
        return np.asarray(cost + 1.5 * self.field.distance(place) + 4.0 * np.maximum(braked, 0.0))

    def _near(self, place: Array, ahead: Array, others: Discs, time: float, width: float) -> Array:
        cost = np.zeros(len(place))
        there = others.at(np.array([time]))[:, 0]
        for lever in self.vehicle.discs:
            body = place + lever * ahead
            if len(there):
                apart = np.hypot(*np.moveaxis(body[:, None] - there, -1, 0)) - others.radius - self.vehicle.radius
                least = apart.min(axis=1)
                cost += np.where(least < 0.05 * width, 60.0 * width, 0.0)
                cost += 2.0 * width * np.exp(-np.maximum(least, 0.0) / (0.5 * NEAR * width))
            cost += np.where(self.field.is_free(body), 0.0, 80.0 * width)
        return cost
