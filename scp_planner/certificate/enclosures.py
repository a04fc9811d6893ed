"""Pieces of a trip, and what encloses each of them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from scp_planner.arrays import Array, Mask, left_of
from scp_planner.threat_zones.bounds import MovingPoint
from scp_planner.trips.path import PathPoints

_QUARTERS = np.array([-3.0, -1.0, 1.0, 3.0])


@dataclass(frozen=True)
class Pieces:
    """Intervals of time, none across a knot."""

    middle: Array  # (n,) Middles and half widths, in normalised time
    half: Array  # (n,) Middles and half widths, in normalised time

    @classmethod
    def between(cls, edges: Array) -> Pieces:
        """Return the intervals between times that do not decrease, (n + 1,), but for those of no length."""
        before, after = edges[:-1], edges[1:]
        wide = after > before
        return cls((0.5 * (before + after))[wide], (0.5 * (after - before))[wide])

    def part(self, index: slice | Mask) -> Pieces:
        """Return some of the intervals."""
        return Pieces(self.middle[index], self.half[index])

    def with_more(self, more: Pieces) -> Pieces:
        """Return these intervals and, after them, others."""
        return Pieces(np.concatenate([self.middle, more.middle]), np.concatenate([self.half, more.half]))

    def halves(self, keep: Mask) -> Pieces:
        """Return the halves of some of the intervals."""
        middle, half = self.middle[keep], 0.5 * self.half[keep]
        return Pieces(np.concatenate([middle - half, middle + half]), np.concatenate([half, half]))

    def quarters(self, keep: Mask) -> Pieces:
        """Return the quarters of some of the intervals."""
        middle, half = self.middle[keep], 0.25 * self.half[keep]
        return Pieces((middle + _QUARTERS[:, None] * half).ravel(), np.tile(half, len(_QUARTERS)))


@dataclass(frozen=True)
class Enclosure:
    """Bounds that hold on whole intervals."""

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

    @property
    def power_bound(self) -> Array:
        """Upper bounds of the acceleration, where it is positive, times the speed on the whole intervals, m^2/s^3."""
        highest = self.acceleration + (self.acceleration_bound - np.abs(self.acceleration))
        fastest = self.speed + self.acceleration_bound * self.half
        bound: Array = np.maximum(highest, 0.0) * np.maximum(fastest, 0.0)
        return bound

    def disc(self, offset: float) -> MovingPoint:
        """The centre of a disc on the vehicle's axis, so far ahead of the reference point, m."""
        position, velocity = disc_in_the_middle(self.path, self.speed, self.curvature, offset)
        own = np.sqrt(self.acceleration_bound**2 + self.lateral_bound**2)
        if offset == 0.0:
            return MovingPoint(self.time, self.half, position, velocity, own)
        fastest = self.speed + self.acceleration_bound * self.half
        turning = fastest * self.curvature_bound
        change = fastest * self.curvature_rate + self.acceleration_bound * self.curvature_bound
        bound = own + abs(offset) * np.hypot(change, turning**2)
        return MovingPoint(self.time, self.half, position, velocity, bound)


def disc_in_the_middle(path: PathPoints, speed: Array, curvature: Array, offset: float) -> tuple[Array, Array]:
    """Centre of a disc at a distance ahead of the reference point, (n, 2) m, and its velocity, (n, 2) m/s."""
    unit = path.direction / path.speed[:, None]
    velocity = speed[:, None] * unit
    if offset == 0.0:
        return path.position, velocity
    across = left_of(unit)
    return path.position + offset * unit, velocity + (offset * speed * curvature)[:, None] * across
