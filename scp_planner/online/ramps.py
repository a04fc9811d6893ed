"""Changes of speed in which the acceleration does not jump: it rises or falls along ramps, with a largest slope."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from scp_planner.arrays import Array, Mask
from scp_planner.online.tolerances import SPEED


@dataclass(frozen=True)
class Ramps:
    """n changes of speed of three phases: a ramp, a hold, a ramp."""

    start_speed: Array  # (n,) m/s
    knots: Array  # (n, 4)
    acceleration: Array  # (n, 4) Then, m/s^2; straight in between

    @classmethod
    def between(
        cls, speed: Array, acceleration: Array, wanted: Array, rise: float, fall: float, jerk: float | Array
    ) -> Ramps:
        left = speed + acceleration * np.abs(acceleration) / (2.0 * jerk)
        sign = np.where(wanted >= left, 1.0, -1.0)
        begun = sign * acceleration
        most = np.maximum(np.where(sign > 0.0, rise, fall), begun)
        gain = sign * (wanted - speed)
        # At least what it begins with, but for rounding.
        free = np.maximum(np.sqrt(np.maximum(jerk * gain + 0.5 * acceleration**2, 0.0)), np.maximum(begun, 0.0))
        peak = np.minimum(free, most)
        up, down = (peak - begun) / jerk, peak / jerk
        missing = np.where(free > most, gain - (peak**2 - 0.5 * acceleration**2) / jerk, 0.0)
        hold = np.maximum(missing, 0.0) / np.where(peak > 0.0, peak, 1.0)
        knots = np.stack([np.zeros_like(up), up, up + hold, up + hold + down], axis=1)
        height = sign * peak
        values = np.stack([acceleration, height, height, np.zeros_like(height)], axis=1)
        return cls(np.asarray(speed, dtype=float), knots, values)

    @classmethod
    def stopping(cls, speed: Array, acceleration: Array, deceleration: float, jerk: float) -> Ramps:
        still = (speed <= SPEED) & (acceleration <= 0.0)
        speed, acceleration = np.where(still, 0.0, speed), np.where(still, 0.0, acceleration)
        braking = np.minimum(acceleration, 0.0)
        needed = np.maximum(jerk, braking**2 / np.maximum(2.0 * speed, SPEED))
        return cls.between(speed, acceleration, np.zeros_like(speed), np.inf, deceleration, needed)

    def where(self, mine: Mask, other: Ramps) -> Ramps:
        """Return some of these, (n,), and else those of another, which begin alike."""
        return Ramps(
            self.start_speed,
            np.where(mine[:, None], self.knots, other.knots),
            np.where(mine[:, None], self.acceleration, other.acceleration),
        )

    def last(self, count: int) -> Ramps:
        return Ramps(self.start_speed[-count:], self.knots[-count:], self.acceleration[-count:])

    @property
    def duration(self) -> Array:
        return self.knots[:, -1]

    @cached_property
    def _speeds(self) -> Array:
        """At the knots, (n, 4) m/s."""
        gained = 0.5 * np.diff(self.knots, axis=1) * (self.acceleration[:, 1:] + self.acceleration[:, :-1])
        return self.start_speed[:, None] + np.concatenate([np.zeros((len(gained), 1)), gained.cumsum(axis=1)], axis=1)

    @property
    def fastest(self) -> Array:
        """Highest speeds, (n,) m/s: where the acceleration goes through nothing in the first ramp, or at a knot."""
        first, second = self.acceleration[:, 0], self.acceleration[:, 1]
        falls = (first > 0.0) & (second < 0.0)
        until = self.knots[:, 1] * np.where(falls, first / np.where(falls, first - second, 1.0), 0.0)
        return np.maximum(self._speeds.max(axis=1), self.start_speed + 0.5 * first * until)

    @property
    def way(self) -> Array:
        """Distances driven until the end, (n,) m."""
        return self.distance(self.duration[:, None])[:, 0]

    def distance(self, times: Array) -> Array:
        """Distances driven, (n, k) m, at times (n, k), s; at the end's speed after the end."""
        driven = np.zeros(np.broadcast_shapes(times.shape, (len(self.knots), 1)))
        speeds = self._speeds
        length = np.diff(self.knots, axis=1)
        slope = np.diff(self.acceleration, axis=1) / np.where(length > 0.0, length, np.inf)
        for phase in range(3):
            x = np.minimum(np.maximum(times - self.knots[:, phase, None], 0.0), length[:, phase, None])
            start, rate = self.acceleration[:, phase, None], slope[:, phase, None]
            driven += x * (speeds[:, phase, None] + x * (0.5 * start + x * rate / 6.0))
        driven += np.maximum(times - self.knots[:, -1:], 0.0) * np.maximum(speeds[:, -1:], 0.0)
        return driven
