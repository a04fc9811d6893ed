"""Motions of obstacles that are measured together."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

Array = np.ndarray


@dataclass(frozen=True)
class Motion:
    """True positions of one obstacle.

    Attributes
    ----------
    times : (n,) array
        s, increasing.
    positions : (n, 2) array
        m.
    changes : (k,) array
        Times at which the motion changes, s.
    model : str or None
        Class model of a user who labels the obstacle.
    """

    times: Array
    positions: Array
    changes: Array
    model: str | None

    def at(self, times: Array) -> Array:
        """Positions (n, 2) at times, NaN outside of the motion."""
        found = np.stack([np.interp(times, self.times, self.positions[:, k]) for k in (0, 1)], axis=1)
        found[(times < self.times[0]) | (times > self.times[-1])] = np.nan
        return found


@dataclass(frozen=True)
class Sensor:
    """How motions are measured."""

    rate: float = 10.0  # Hz
    noise: float = 0.04  # m
    outliers: float = 0.0  # share of the measurements with ten times the noise


@dataclass(frozen=True)
class Family:
    """Scenes of motions that are tracked together."""

    name: str
    scenes: Sequence[Sequence[Motion]]
    sensor: Sensor = Sensor()
