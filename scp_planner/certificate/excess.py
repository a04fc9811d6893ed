"""Excess of a start over a limit: allowed as long as no vehicle could have less of it, as it brakes its hardest."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from scp_planner.arrays import Array
from scp_planner.certificate.tolerances import BRAKING_SHARE
from scp_planner.scenario.models import Vehicle

_NODES = np.array([0.1, 0.35, 0.65, 0.9])  # inside of a piece, as accelerations jump at its ends
_TO_POWERS = np.linalg.inv(np.vander(_NODES, increasing=True)).T


@dataclass(frozen=True)
class HardestStop:
    """The speed of a vehicle that stops as soon as it can: no other one is slower at any time.

    The acceleration is straight between its knots.
    """

    time: Array  # (5,) s, from the start on, not decreasing
    acceleration: Array  # (5,) m/s^2
    speed: Array  # (5,) m/s

    @classmethod
    def from_state(cls, speed: float, acceleration: float, vehicle: Vehicle) -> HardestStop:
        """Brake from a state, a given acceleration included where the jerk is limited."""
        most = BRAKING_SHARE * min(vehicle.max_deceleration, vehicle.max_total_acceleration or np.inf)
        if vehicle.max_jerk is None:
            duration = np.array([0.0, 0.0, 0.0, speed / most, 0.0])
            values = np.array([-most, -most, -most, -most, -most])
        else:
            jerk = BRAKING_SHARE * vehicle.max_jerk
            peak = min(most, np.sqrt(jerk * speed + 0.5 * acceleration**2))
            rise, turn = max(acceleration, 0.0), min(acceleration, 0.0)
            # Brakes that are on too hard are eased with the largest jerk: slower would brake more.
            ramp = abs(peak + turn) / (jerk if turn > -peak else vehicle.max_jerk)
            lost = peak**2 / (2.0 * jerk) + 0.5 * (peak - turn) * ramp - rise**2 / (2.0 * jerk)
            hold = max(speed - lost, 0.0) / max(peak, 1e-300)
            duration = np.array([0.0, rise / jerk, ramp, hold, peak / jerk])
            values = np.array([acceleration, turn, -peak, -peak, 0.0])
        gained = 0.5 * (values[1:] + values[:-1]) * duration[1:]
        return cls(duration.cumsum(), values, speed + np.concatenate([[0.0], gained.cumsum()]))

    def speed_at(self, time: Array) -> Array:
        """Speeds, m/s, at times from the start on, s; 0 after the end."""
        phase = np.minimum(np.searchsorted(self.time[1:-1], time, "right"), 3)
        since, slope = time - self.time[phase], self._slopes[phase]
        speed = self.speed[phase] + since * (self.acceleration[phase] + 0.5 * slope * since)
        return np.where(time < self.time[-1], np.maximum(speed, 0.0), 0.0)

    @property
    def _slopes(self) -> Array:
        duration = np.diff(self.time)
        return np.diff(self.acceleration) / np.where(duration > 0.0, duration, np.inf)

    def slows_to(self, limit: float) -> float:
        """Time from which on it is no faster than a limit, s; 0 if it never is."""
        for phase in range(3, -1, -1):
            more = float(self.speed[phase]) - limit
            if more > 0.0:
                a = float(self.acceleration[phase])
                root = np.sqrt(max(a * a - 2.0 * float(self._slopes[phase]) * more, 0.0))
                return min(float(self.time[phase]) + 2.0 * more / max(root - a, 1e-300), float(self.time[-1]))
        return 0.0

    def eases_to(self, least: float, most: float) -> float:
        """Time from which on its acceleration is within limits, m/s^2, s: 0 where the acceleration may jump."""
        outside = np.flatnonzero((self.acceleration < least) | (self.acceleration > most))
        if not len(outside) or self.time[2] == 0.0 or outside[-1] > 1:
            return 0.0
        bound = most if self.acceleration[outside[-1]] > most else least
        slope = abs(float(self._slopes[outside[-1]]))
        away = abs(float(self.acceleration[outside[-1]]) - bound)
        return (float(self.time[outside[-1]]) + away / slope) / BRAKING_SHARE if slope > 0.0 else 0.0


def cubics(value: Callable[[Array], Array], edges: Array) -> Array:
    """Local power coefficients, (n, 4), of what is a polynomial of degree 3 at most between edges, (n + 1,)."""
    nodes = edges[:-1, None] + np.diff(edges)[:, None] * _NODES
    coefficients: Array = value(nodes.ravel()).reshape(nodes.shape) @ _TO_POWERS
    return coefficients
