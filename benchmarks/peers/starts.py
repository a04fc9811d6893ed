"""The starts that all methods share: a bow to one side of the straight line, at a share of the top speed."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from scp_planner.arrays import Array


@dataclass(frozen=True)
class Start:
    """A first guess: how far to the left at half way, m, and at which share of the top speed to cruise."""

    bow: float
    speed_share: float = 1.0


# The first one is the start of the `one` runs.
TEN_STARTS = (
    Start(0.0),
    Start(0.5),
    Start(-0.5),
    Start(1.5),
    Start(-1.5),
    Start(3.0),
    Start(-3.0),
    Start(4.5),
    Start(-4.5),
    Start(0.0, 0.6),
)


@dataclass(frozen=True)
class FirstGuess:
    """A trip that obeys the ends and the speed limits but knows of no obstacle, sampled finely.

    Attributes
    ----------
    times : (n,) s, on the scenario's clock
    states : (n, 4) x m, y m, heading rad, speed m/s
    accelerations : (n,) m/s2
    curvatures : (n,) 1/m
    """

    times: Array
    states: Array
    accelerations: Array
    curvatures: Array

    @property
    def duration(self) -> float:
        """Travel time of the guess, s."""
        return float(self.times[-1] - self.times[0])

    def at(self, shares: Array) -> FirstGuess:
        """The guess at shares (m,) in [0, 1] of its duration."""
        times = self.times[0] + self.duration * shares
        states = np.stack([np.interp(times, self.times, column) for column in self.states.T], axis=1)
        return FirstGuess(
            times,
            states,
            np.interp(times, self.times, self.accelerations),
            np.interp(times, self.times, self.curvatures),
        )


def first_guess(scenario: Mapping[str, Any], start: Start, samples: int = 2000) -> FirstGuess:
    """Trip along y = bow sin^2(pi x / length), accelerating to its cruising speed as fast as allowed.

    The squared sine leaves the start along the straight line, as a given start heading usually does.
    """
    vehicle = scenario["vehicle"]
    origin = np.asarray(scenario["start"]["position"], dtype=float)
    reach = np.asarray(scenario["goal"]["position"], dtype=float) - origin
    length = float(np.linalg.norm(reach))
    along = reach / length
    across = np.array([-along[1], along[0]])

    x = np.linspace(0.0, length, samples)
    wave = np.pi / length
    offset = start.bow * np.sin(wave * x) ** 2
    slope = start.bow * wave * np.sin(2.0 * wave * x)
    bend = 2.0 * start.bow * wave**2 * np.cos(2.0 * wave * x)
    distance = np.concatenate([[0.0], np.cumsum(np.hypot(np.diff(x), np.diff(offset)))])

    speed = float(scenario["start"]["speed"])
    cruise = start.speed_share * float(vehicle["max_speed"])
    rate = float(vehicle["max_acceleration"]) if cruise > speed else -float(vehicle["max_deceleration"])
    ramp = (cruise**2 - speed**2) / (2.0 * rate)
    speeds = np.where(distance < ramp, np.sqrt(np.maximum(speed**2 + 2.0 * rate * distance, 0.0)), cruise)
    ramp_time = (cruise - speed) / rate
    elapsed = np.where(distance < ramp, (speeds - speed) / rate, ramp_time + (distance - ramp) / cruise)

    heading = np.arctan2(along[1], along[0]) + np.arctan(slope)
    place = origin + x[:, None] * along + offset[:, None] * across
    return FirstGuess(
        times=float(scenario["start"].get("time", 0.0)) + elapsed,
        states=np.column_stack([place, heading, speeds]),
        accelerations=np.where(distance < ramp, rate, 0.0),
        curvatures=bend / (1.0 + slope**2) ** 1.5,
    )
