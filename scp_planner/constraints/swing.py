from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from scp_planner.arrays import Array, left_of
from scp_planner.trips.path import Path, PathPoints


def disc_positions(path: PathPoints, offset: float | Array) -> Array:
    """Centres of a disc that is so far ahead, or each so far, of points of a path on its axis, (n, 2) m."""
    positions: Array = path.position + (offset / path.speed)[:, None] * path.direction
    return positions


@dataclass(frozen=True)
class Swing:
    across: Array  # (n, 2): the path's normal N
    value: Array  # (n,): derivative of the direction of the path by f
    slope: Array  # (n,): derivative of it by f'

    @classmethod
    def of(cls, points: PathPoints) -> Swing:
        """Return how directions of a path change at some of its points."""
        unit = points.direction / points.speed[:, None]
        squared = points.speed * points.speed
        curvature = points.turning[:, 0]
        return cls(
            left_of(unit),
            points.slope * curvature / squared,
            points.stretch / squared,
        )

    def rows(self, path: Path, points: PathPoints, normal: Array, offset: float | Array) -> Array:
        """Derivative of normal . q by theta at fixed stations, (n, K1)."""
        basis = path.space.path
        sideways = np.einsum("ij,ij->i", normal, np.broadcast_to(points.normal, normal.shape))
        turn = offset * np.einsum("ij,ij->i", normal, self.across)
        rows = (sideways + turn * self.value)[:, None] * basis.rows_at(points.span, points.local)
        slopes = basis.derivative.rows_at(points.span, points.local) / path.space.length
        found: Array = rows + (turn * self.slope)[:, None] * slopes
        return found

    def turn_rows(self, path: Path, points: PathPoints) -> Array:
        """Derivative of the direction of the path by theta at fixed stations, (n, K1) rad/m."""
        basis = path.space.path
        slopes = basis.derivative.rows_at(points.span, points.local) / path.space.length
        value, slope = (np.broadcast_to(part, points.station.shape) for part in (self.value, self.slope))
        found: Array = value[:, None] * basis.rows_at(points.span, points.local) + slope[:, None] * slopes
        return found
