"""The fastest drive along a guide where places limit the speed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from scp_planner.arrays import Array

NEAR_SWITCH = 0.03  # units of time; the acceleration of a profile changes once in so much time


@dataclass(frozen=True)
class SpeedProfile:
    """The fastest drive along a line."""

    stations: Array  # (n,), m
    times: Array  # (n,), s
    switches: tuple[float, ...]  # times at which the acceleration changes, s

    def times_at(self, stations: Array) -> Array:
        """Times at which stations (n,) m are reached, s; beyond the end at the last speed."""
        speed = (self.stations[-1] - self.stations[-2]) / (self.times[-1] - self.times[-2])
        beyond = np.maximum(stations - self.stations[-1], 0.0) / speed
        return np.asarray(np.interp(stations, self.stations, self.times) + beyond)


def fastest_profile(
    stations: Array,
    limits: Array,
    start: float,
    goal: float | None,
    acceleration: float,
    deceleration: float,
    power: float = np.inf,
) -> SpeedProfile:
    """Return the fastest drive with given limits of the speed, by one pass forwards and one backwards.

    From a start beyond them it brakes until it is within.
    """
    step = float(stations[1] - stations[0])
    squared = np.maximum(limits.astype(float) ** 2, start**2 - 2.0 * deceleration * (stations - stations[0]))
    squared[0] = start**2
    if goal is not None:
        squared[-1] = min(squared[-1], goal**2)
    for i in range(1, len(squared)):
        rise = acceleration
        if squared[i - 1] * rise * rise > power * power:
            rise = power / squared[i - 1] ** 0.5
        squared[i] = min(squared[i], squared[i - 1] + 2.0 * rise * step)
    for i in range(len(squared) - 2, 0, -1):
        squared[i] = min(squared[i], squared[i + 1] + 2.0 * deceleration * step)
    speeds = np.sqrt(squared)
    times = np.concatenate([[0.0], np.cumsum(2.0 * step / np.maximum(speeds[1:] + speeds[:-1], 1e-6))])
    rates = np.diff(squared) / (2.0 * step)
    switches: list[float] = []
    for time in times[1:-1][np.abs(np.diff(rates)) > 0.2 * min(acceleration, deceleration)].tolist():
        if not switches or time - switches[-1] > NEAR_SWITCH:
            switches.append(time)
    return SpeedProfile(stations, times, tuple(switches))
