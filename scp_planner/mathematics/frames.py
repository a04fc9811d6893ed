"""The planning frame: the start at the origin, the goal on the positive x axis, the start time at 0."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import atan2, cos, sin

import numpy as np

from scp_planner.arrays import Array
from scp_planner.mathematics.polynomials import PiecewisePolynomials


def directions_of(velocity: Array) -> Array:
    """Unit vectors along velocities, (..., 2); the x axis for no velocity."""
    speed = np.hypot(velocity[..., 0], velocity[..., 1])[..., None]
    unit: Array = np.where(speed > 0.0, velocity / np.where(speed > 0.0, speed, 1.0), [1.0, 0.0])
    return unit


def turned_back(vectors: Array, headings: Array) -> Array:
    """Components of vectors (..., 2) along headings, unit vectors (..., 2), and across them."""
    c, s = headings[..., 0], headings[..., 1]
    x, y = vectors[..., 0], vectors[..., 1]
    return np.stack([c * x + s * y, c * y - s * x], axis=-1)


def covariance_turned_back(covariance: Array, headings: Array) -> Array:
    """(xx, xy, yy), (n, 3), seen from frames with these headings."""
    c, s = headings[:, 0], headings[:, 1]
    xx, xy, yy = covariance.T
    along = c * c * xx + 2.0 * s * c * xy + s * s * yy
    mixed = s * c * (yy - xx) + (c * c - s * s) * xy
    return np.stack([along, mixed, s * s * xx - 2.0 * s * c * xy + c * c * yy], axis=1)


@dataclass(frozen=True)
class PlanningFrame:
    """A planar frame and a clock."""

    origin: tuple[float, float]
    heading: float  # Direction of the frame's x axis in the world, rad
    time: float  # Absolute time of the frame's clock at 0, s

    @classmethod
    def between(cls, start: tuple[float, float], goal: tuple[float, float], time: float) -> PlanningFrame:
        """Return the frame of a start, a goal and a start time."""
        return cls(start, atan2(goal[1] - start[1], goal[0] - start[0]), time)

    @property
    def rotation(self) -> Array:
        """Matrix from frame to world components of a vector, (2, 2)."""
        c, s = cos(self.heading), sin(self.heading)
        return np.array([[c, -s], [s, c]])

    def to_frame(self, points: Array) -> Array:
        """World points (..., 2) in m to the frame."""
        return (np.asarray(points, dtype=float) - np.asarray(self.origin)) @ self.rotation

    def to_world(self, points: Array) -> Array:
        """Points of the frame (..., 2) in m to the world."""
        return np.asarray(points, dtype=float) @ self.rotation.T + np.asarray(self.origin)

    def vectors_to_world(self, vectors: Array) -> Array:
        """Vectors of the frame (..., 2) to the world."""
        return np.asarray(vectors, dtype=float) @ self.rotation.T

    def points_batch(self, items: Sequence[PiecewisePolynomials]) -> PiecewisePolynomials:
        """Moving points of the world, stacked, as seen in the frame and on its clock."""
        stacked = PiecewisePolynomials.stack(items).shifted(self.time).rebased(0.0)
        coefficients = stacked.coefficients.copy()
        coefficients[:, :, 0] -= np.asarray(self.origin)
        return PiecewisePolynomials(stacked.breakpoints, coefficients @ self.rotation)

    def covariances_batch(self, items: Sequence[PiecewisePolynomials]) -> PiecewisePolynomials:
        """Covariances (xx, xy, yy) of the world, stacked, as seen in the frame and on its clock."""
        stacked = PiecewisePolynomials.stack(items, width=3).shifted(self.time).rebased(0.0)
        c, s = cos(self.heading), sin(self.heading)
        turn = np.array([[c * c, -s * c, s * s], [2 * s * c, c * c - s * s, -2 * s * c], [s * s, s * c, c * c]])
        return PiecewisePolynomials(stacked.breakpoints, stacked.coefficients @ turn)
