"""Pieces of a motion, and what encloses each of them."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np

from scp_planner.arrays import Array, Mask, left_of
from scp_planner.threat_zones.bounds import MovingPoint
from scp_planner.threat_zones.error_tube import TrackingTube
from scp_planner.trips.path import PathPoints


@dataclass(frozen=True)
class Pieces:
    """Intervals of time, none across a knot, on the clock of what is checked."""

    middle: Array  # (n,)
    half: Array  # (n,) Half widths

    @classmethod
    def between(cls, edges: Array) -> Pieces:
        """Return the intervals between times that do not decrease, (n + 1,), but for those of no length."""
        before, after = edges[:-1], edges[1:]
        wide = after > before
        return cls((0.5 * (before + after))[wide], (0.5 * (after - before))[wide])

    def after(self, begin: float) -> Pieces:
        """Return the intervals after a time, and the part after it of the one in which it lies."""
        low, high = np.maximum(self.middle - self.half, begin), self.middle + self.half
        left = high > low
        left[np.argmax(high)] = True  # where nothing is left, the end is
        low = np.minimum(low, high)
        return Pieces(0.5 * (low + high)[left], 0.5 * (high - low)[left])

    def cut(self, keep: Mask, parts: int) -> Pieces:
        """Return equal parts of some of the intervals: the first part of each, then the second of each, and so on."""
        middle, half = self.middle[keep], self.half[keep] / parts
        places = np.arange(1.0 - parts, parts, 2.0)
        return Pieces((middle + places[:, None] * half).ravel(), np.tile(half, parts))


@dataclass(frozen=True)
class VehicleDisc(MovingPoint):
    """The centre of a disc of the vehicle on pieces of time, and how far the disc may be from there."""

    off: Array  # (n,) In the middles, m
    most_off: Array  # (n,) On the whole intervals, m


@dataclass(frozen=True)
class Pace:
    """Speed and place of the vehicle on pieces of time."""

    half: Array  # (n,) Half widths, s
    position: Array  # (n, 2) In the middles, planning frame, m
    speed: Array  # (n,) In the middles, m/s
    fastest: Array  # (n,) On the whole intervals, m/s
    progress: Array  # (n,) Grows along the motion, as in `Checked.followed`


class Enclosed(ABC):
    """Bounds of a motion on pieces of time."""

    @property
    @abstractmethod
    def pace(self) -> Pace:
        """Speeds and places."""

    @abstractmethod
    def disc(self, offset: float) -> VehicleDisc:
        """A disc on the vehicle's axis, so far ahead of the reference point, m."""


@dataclass(frozen=True)
class Enclosure(Enclosed):
    """Bounds of a trip that hold on whole intervals."""

    time: Array  # (n,) Middles on the planning clock and half widths, s
    half: Array  # (n,) Middles on the planning clock and half widths, s
    speed: Array  # (n,) At the middles, m/s
    path: PathPoints  # At the middles
    curvature: Array  # (n,) At the middles, signed
    lateral: Array  # (n,) At the middles, signed
    curvature_bound: Array  # (n,) Upper bounds of the absolute values on the whole intervals
    lateral_bound: Array  # (n,) Upper bounds of the absolute values on the whole intervals
    acceleration_bound: Array  # (n,) Upper bounds of the absolute values on the whole intervals
    curvature_rate: Array  # (n,) Upper bounds of the absolute rate of the curvature over time, 1/(m s)
    acceleration: Array  # (n,) At the middles, along the path, m/s^2
    tube: TrackingTube | None = None  # In which the vehicle stays round the trip

    @property
    def fastest(self) -> Array:
        """Upper bounds of the speed on the whole intervals, m/s."""
        bound: Array = self.speed + self.acceleration_bound * self.half
        return bound

    @property
    def pace(self) -> Pace:
        return Pace(self.half, self.path.position, self.speed, self.fastest, self.path.station)

    @property
    def power_bound(self) -> Array:
        """Upper bounds of the acceleration, where it is positive, times the speed on the whole intervals, m^2/s^3."""
        highest = self.acceleration + (self.acceleration_bound - np.abs(self.acceleration))
        bound: Array = np.maximum(highest, 0.0) * np.maximum(self.fastest, 0.0)
        return bound

    def disc(self, offset: float) -> VehicleDisc:
        position, velocity = disc_in_the_middle(self.path, self.speed, self.curvature, offset)
        bound, fastest = np.sqrt(self.acceleration_bound**2 + self.lateral_bound**2), self.fastest
        if offset != 0.0:
            turning = fastest * self.curvature_bound
            change = fastest * self.curvature_rate + self.acceleration_bound * self.curvature_bound
            bound = bound + abs(offset) * np.hypot(change, turning**2)
        off = most_off = np.zeros(len(self.time))
        if self.tube is not None:
            standing, per_speed, per_lateral = self.tube.standing, self.tube.per_speed, self.tube.per_lateral
            off = standing + per_speed * self.speed + per_lateral * np.abs(self.lateral)
            most_off = np.maximum(off, standing + per_speed * fastest + per_lateral * self.lateral_bound)
        return VehicleDisc(self.time, self.half, position, velocity, bound, off, most_off)


def disc_in_the_middle(path: PathPoints, speed: Array, curvature: Array, offset: float) -> tuple[Array, Array]:
    """Centre of a disc at a distance ahead of the reference point, (n, 2) m, and its velocity, (n, 2) m/s."""
    unit = path.direction / path.speed[:, None]
    velocity = speed[:, None] * unit
    if offset == 0.0:
        return path.position, velocity
    across = left_of(unit)
    return path.position + offset * unit, velocity + (offset * speed * curvature)[:, None] * across
