"""Sensors of a simulated vehicle: what they see, how well, how often, and when the news arrives."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from scp_planner.arrays import Array
from scp_planner.scenario.values import NotNegative, Number, Text, Vector
from scp_planner.simulation.tolerances import ROUNDING

LEAST_NOISE = 1e-4
"""Units of length of the scene. A noise of nothing is told to the planner as this: no covariance may be singular."""


@dataclass(frozen=True)
class Observation:
    """One position that a sensor saw."""

    obstacle: Text
    time: Number  # s
    arrival: Number  # s
    position: Vector  # m
    deviation: NotNegative  # Standard deviation of each coordinate, m


@dataclass(frozen=True)
class Sensor:
    """A sensor on the vehicle.

    Attributes
    ----------
    rate : float
        Looks per second, Hz.
    noise : float
        Standard deviation of each coordinate of a position, m.
    range : float
        m; farther obstacles are not seen.
    field_of_view : float
        rad, about the heading; 2 pi: all round.
    latency : float
        s, from a look to its arrival at the planner.
    dropout : float
        Probability that an obstacle is missed at a look.
    """

    rate: float = 10.0
    noise: float = 0.1
    range: float = math.inf
    field_of_view: float = 2.0 * math.pi
    latency: float = 0.0
    dropout: float = 0.0

    def __post_init__(self) -> None:
        for name, value, fits, allowed in (
            ("rate", self.rate, 0.0 < self.rate < math.inf, "finite and greater than 0"),
            ("noise", self.noise, 0.0 <= self.noise < math.inf, "finite and at least 0"),
            ("range", self.range, self.range > 0.0, "greater than 0"),
            ("field_of_view", self.field_of_view, 0.0 < self.field_of_view <= 7.0, "in (0, 2 pi]"),
            ("latency", self.latency, 0.0 <= self.latency < math.inf, "finite and at least 0"),
            ("dropout", self.dropout, 0.0 <= self.dropout < 1.0, "in [0, 1)"),
        ):
            if not fits:
                raise ValueError(f"sensor: {name} {value!r} must be {allowed}")

    def looks(self, after: float, until: float, start: float) -> Array:
        """Times of its looks in (after, until], (n,) s; it looks at ``start`` and every 1 / rate before and after."""
        first = math.floor((after - start) * self.rate + ROUNDING) + 1
        last = math.floor((until - start) * self.rate + ROUNDING)
        return start + np.arange(first, last + 1) / self.rate

    def sees(self, position: Array, heading: float, target: Array) -> bool:
        """True if a target is in range and in the field of view.

        Parameters
        ----------
        position : (2,) array
            Of the vehicle, m.
        heading : float
            Of the vehicle, rad.
        target : (2,) array
            Its centre, m.

        Returns
        -------
        bool
        """
        dx, dy = float(target[0] - position[0]), float(target[1] - position[1])
        if math.hypot(dx, dy) > self.range:
            return False
        if self.field_of_view >= 2.0 * math.pi:
            return True
        bearing = math.remainder(math.atan2(dy, dx) - heading, 2.0 * math.pi)
        return abs(bearing) <= 0.5 * self.field_of_view

    def look(
        self,
        time: float,
        position: Array,
        heading: float,
        targets: Mapping[str, Array],
        rng: np.random.Generator,
        least_noise: float = LEAST_NOISE,
    ) -> list[Observation]:
        """Measurements at a time, from a position (2,) m and a heading, of obstacles at (2,) m each.

        The noise is told as ``least_noise``, m, if it is less.
        """
        seen = []
        for name, target in targets.items():
            # Drawn for every obstacle, so that what is seen of one does not depend on the others being in view.
            error, missed = rng.standard_normal(2), rng.random() < self.dropout
            if not missed and self.sees(position, heading, target):
                place = target + self.noise * error
                seen.append(
                    Observation(
                        name,
                        time,
                        time + self.latency,
                        (float(place[0]), float(place[1])),
                        max(self.noise, least_noise),
                    )
                )
        return seen
