"""Bounds of speed and distance at each time of a trip of given duration."""

from __future__ import annotations

from math import sqrt

import numpy as np

from scp_planner.arrays import Array
from scp_planner.certificate.tolerances import GOAL_SPEED_TOLERANCE, ROUNDING, SPEED_ROUNDING
from scp_planner.scenario.models import Scenario

LONGEST_STEP = 0.25  # units of time between instants, before the vehicle is fast


class Speeds:
    """The highest speed at each time of a trip of given duration, and how far it leads."""

    def __init__(self, scenario: Scenario, duration: float) -> None:
        vehicle, goal_speed = scenario.vehicle, scenario.goal.speed
        self.first = scenario.start.speed + ROUNDING
        self.gain, self.top, self.loss = vehicle.max_acceleration, vehicle.max_speed, vehicle.max_deceleration
        self.last = np.inf if goal_speed is None else goal_speed + GOAL_SPEED_TOLERANCE + ROUNDING
        self.duration = duration
        knots = [0.0, duration, (self.top - self.first) / self.gain]
        if np.isfinite(self.last):
            brake = self.last + self.loss * duration
            knots += [(brake - self.top) / self.loss, (brake - self.first) / (self.gain + self.loss)]
        self.knots = np.unique(np.clip(knots, 0.0, duration))
        speeds = self.at(self.knots)
        self.driven_at_knots = np.concatenate(
            [[0.0], np.cumsum(0.5 * (speeds[1:] + speeds[:-1]) * np.diff(self.knots))]
        )

    def at(self, times: Array) -> Array:
        """Highest speeds at times (n,), m/s."""
        rising = np.minimum(self.first + self.gain * times, self.top)
        if not np.isfinite(self.last):
            return rising
        falling: Array = np.minimum(rising, self.last + self.loss * (self.duration - times))
        return falling

    def driven(self, times: Array) -> Array:
        """Longest distances from the start until times (n,), m; exact, since speeds are linear between knots."""
        times = np.minimum(times, self.duration)
        knot = np.clip(np.searchsorted(self.knots, times, "right") - 1, 0, len(self.knots) - 1)
        begun = self.knots[knot]
        distance = self.driven_at_knots[knot] + 0.5 * (self.at(begun) + self.at(times)) * (times - begun)
        return (1.0 + SPEED_ROUNDING) * distance

    def instants(self, step: float) -> Array:
        """Times at which the vehicle has driven one step more each time, if nothing but its own speed holds it up."""
        times, knee = [0.0], max(self.top - self.first, 0.0) / self.gain
        to_knee = 0.5 * (self.first + self.top) * knee
        while times[-1] < self.duration:
            now = times[-1]
            rising = min(now, knee)
            wanted = self.first * rising + 0.5 * self.gain * rising**2 + self.top * (now - rising) + step
            if wanted <= to_knee:
                then = (sqrt(self.first**2 + 2.0 * self.gain * wanted) - self.first) / self.gain
            else:
                then = knee + (wanted - to_knee) / self.top
            times.append(min(then, now + LONGEST_STEP))
        return np.array(times)
