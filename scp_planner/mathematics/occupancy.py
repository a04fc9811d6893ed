"""Ground as a grid of square cells, each occupied or free."""

from __future__ import annotations

import hashlib
import sys
from collections.abc import Sequence
from dataclasses import dataclass, field
from math import cos, sin
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from scp_planner.arrays import Array, Index, Mask
from scp_planner.units import Point, Units

NAME = "map"  # what occupied cells are called among obstacles


@dataclass(frozen=True, eq=False)
class OccupancyMap:
    """Square cells of the ground, occupied or free.

    Parameters
    ----------
    occupied : array_like of bool
        (rows, columns), or numbers 0 and 1, which is copied; the first row is the lowest one, as in
        ``nav_msgs/OccupancyGrid``. A cell is closed: its border belongs to it.
    resolution : float
        Edge of a cell, m.
    origin : tuple of float
        [x, y] of the lower left corner of the first cell, m.
    yaw : float
        Direction of the rows, rad, counterclockwise from the x axis.
    beyond : bool
        Whether what lies beyond the grid is occupied.
    source : str or None
        File that the map was read from.

    Attributes
    ----------
    resolution : float
        Edge of a cell, m.
    yaw : float
        Direction of the rows, rad.
    beyond : bool
        Whether what lies beyond the grid is occupied.
    source : str or None
        File that the map was read from.

    Raises
    ------
    ValueError
        If the cells are no grid of these, or the resolution, the origin or the yaw are no numbers that can be.
    """

    occupied: Mask
    resolution: float
    origin: Point = (0.0, 0.0)
    yaw: float = 0.0
    beyond: bool = True
    source: str | None = field(default=None, repr=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "occupied", _cells(self.occupied))
        if not (_is_finite(self.resolution) and self.resolution > 0.0):
            raise ValueError(f"resolution: {self.resolution!r} must be a positive number of m")
        origin = self.origin if isinstance(self.origin, (Sequence, np.ndarray)) else ()
        if len(origin) != 2 or not all(map(_is_finite, origin)):
            raise ValueError(f"origin: {self.origin!r} must be two numbers of m")
        if not _is_finite(self.yaw):
            raise ValueError(f"yaw: {self.yaw!r} must be a number of rad")
        if not isinstance(self.beyond, (bool, np.bool_)):
            raise ValueError(f"beyond: {self.beyond!r} must be true or false")
        object.__setattr__(self, "origin", (float(origin[0]), float(origin[1])))

    def __repr__(self) -> str:
        rows, columns = self.occupied.shape
        return f"OccupancyMap({rows} x {columns} cells of {self.resolution:g} m)"

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, OccupancyMap):
            return NotImplemented
        return self is other or (
            (self.resolution, self.origin, self.yaw, self.beyond)
            == (other.resolution, other.origin, other.yaw, other.beyond)
            and np.array_equal(self.occupied, other.occupied)
        )

    def __hash__(self) -> int:
        return hash((self.resolution, self.origin, self.yaw, self.occupied.shape))

    @property
    def sha256(self) -> str:
        """Digest of the cells and of where they are."""
        digest = hashlib.sha256(repr((self.resolution, self.origin, self.yaw, self.beyond)).encode())
        digest.update(repr(self.occupied.shape).encode())
        digest.update(np.packbits(self.occupied).tobytes())
        return digest.hexdigest()

    @property
    def rotation(self) -> Array:
        """(2, 2) matrix that turns directions of the grid, m, into those of the world."""
        return np.array([[cos(self.yaw), -sin(self.yaw)], [sin(self.yaw), cos(self.yaw)]])

    def local(self, points: ArrayLike) -> Array:
        """Return points (..., 2), m, in cells from the lower left corner: columns, rows."""
        return (np.asarray(points, dtype=float) - self.origin) @ self.rotation / self.resolution

    def world(self, cells: Array) -> Array:
        """Return points (..., 2) in cells, as :meth:`local` gives them, in m."""
        return np.asarray(self.origin) + self.resolution * cells @ self.rotation.T

    def at(self, cells: Index) -> Mask:
        """True for cells (..., 2), column and row, that are occupied; beyond the grid as is said of it."""
        column, row = cells[..., 0], cells[..., 1]
        rows, columns = self.occupied.shape
        inside = (column >= 0) & (column < columns) & (row >= 0) & (row < rows)
        found = self.occupied[np.clip(row, 0, rows - 1), np.clip(column, 0, columns - 1)]
        return np.where(inside, found, self.beyond)

    def window(self, low: Index, high: Index) -> Mask:
        """Return the cells from a lower left one to an upper right one, both with them, (column, row)."""
        shape = self.occupied.shape[::-1]
        found = np.full((high[1] - low[1] + 1, high[0] - low[0] + 1), self.beyond)
        first, last = np.clip(low, 0, shape), np.clip(high + 1, 0, shape)
        if (first < last).all():
            part = self.occupied[first[1] : last[1], first[0] : last[0]]
            found[first[1] - low[1] : last[1] - low[1], first[0] - low[0] : last[0] - low[0]] = part
        return found

    def clipped(self, places: Array, beyond: int = 1) -> Index:
        """Return the cells of places, (..., 2) relative to a cell's size; beyond the grid the nearest ones so far out.

        So no window is larger than the grid and a border, however small its cells and however far off a place is.
        """
        last = np.array(self.occupied.shape[::-1]) - 1
        return np.clip(np.floor(places), -beyond, last + beyond).astype(np.intp)

    def occupied_in(self, low: Array, high: Array) -> Index:
        """Return the occupied cells (n, 2), column and row, between two places, (2,) relative to a cell's size.

        Of those beyond the grid these are the nearest alone.
        """
        first = self.clipped(low)
        rows, columns = np.nonzero(self.window(first, self.clipped(high)))
        cells: Index = np.stack([columns, rows], axis=1) + first
        return cells

    def distance(self, point: Point, within: float) -> float:
        """Distance of a point from the nearest occupied cell, m; inf if that is not within a distance, m."""
        place, reach = self.local(point), within / self.resolution
        if self.at(self.clipped(place)):
            return 0.0
        away = self.occupied_in(place - reach, place + reach) - place
        outside = np.maximum(np.maximum(away, -1.0 - away), 0.0)  # of the square from the corner on
        return self.resolution * float(np.hypot(*outside.T).min(initial=np.inf))

    def inside(self, units: Units) -> OccupancyMap:
        """Return the map in units of a scene."""
        return OccupancyMap(
            self.occupied, self.resolution / units.length, units.place(self.origin), self.yaw, self.beyond, self.source
        )


def _cells(given: Any) -> Mask:
    """Copy cells, which their caller may change, as booleans."""
    if np.ma.is_masked(given):
        raise ValueError("occupied: must have no masked cells: fill them with what they count as")
    try:
        cells = np.array(given)
    except ValueError:
        raise ValueError("occupied: must be a grid whose rows are equally long") from None
    if cells.ndim != 2 or 0 in cells.shape:
        raise ValueError(f"occupied: must be a grid of rows and columns, not of shape {cells.shape}")
    odd = np.argwhere(~((cells == 0) | (cells == 1))) if cells.dtype.kind in "biuf" else [(0, 0)]
    if len(odd):
        row, column = odd[0]
        text = "must be a boolean, or 0 or 1: compare others with what counts as occupied"
        raise ValueError(f"occupied[{row}][{column}]: {cells.tolist()[row][column]!r} {text}")
    return cells.astype(bool)


def _is_finite(value: Any) -> bool:
    return (
        type(value) is not bool
        and isinstance(value, (int, float, np.integer, np.floating))
        and bool(-sys.float_info.max <= value <= sys.float_info.max)
    )


def pooled(ground: OccupancyMap, count: int) -> OccupancyMap:
    """The map with so many cells as one, or as one as many as it has, occupied where one of them is."""
    rows, columns = ground.occupied.shape
    count = min(count, max(rows, columns))
    if count == 1:
        return ground
    padded = np.pad(ground.occupied, ((0, -rows % count), (0, -columns % count)), constant_values=ground.beyond)
    shape = padded.shape[0] // count, count, padded.shape[1] // count, count
    found: Mask = np.any(padded.reshape(shape), axis=(1, 3))
    return OccupancyMap(found, ground.resolution * count, ground.origin, ground.yaw, ground.beyond)
