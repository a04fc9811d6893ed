"""Sets of cells of the plane as bits of one integer, and what reaches, touches or covers them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from math import ceil, floor, sqrt

import numpy as np

from scp_planner.arrays import Array, Index, Mask
from scp_planner.certificate.tolerances import CELL_EDGE, ROUNDING
from scp_planner.scenario.limits import Box


@dataclass(frozen=True)
class Window:
    """A part of a grid: its first column, its first row, and how many rows."""

    column: int
    row: int
    rows: int

    def bits_after(self, other: Window, stride: int) -> int:
        """By how many bits it begins after another one."""
        return (self.row - other.row) * stride + self.column - other.column


class CellGrid:
    """Cells of the planning frame, as bits of one integer: row after row, with room between the rows."""

    def __init__(self, low: Array, high: Array, cell: Array, room: int, window: int | None = None) -> None:
        self.cell = cell
        # The start lies just before the end of its cell, so that nothing is gained by the rest of it.
        columns_before = ceil(-low[0] / cell[0]) + 1
        rows_below = ceil(-low[1] / cell[1] - 0.5) + 1
        self.columns = columns_before + ceil(high[0] / cell[0]) + 1
        self.rows = rows_below + ceil(high[1] / cell[1] + 0.5) + 1
        self.window = self.columns if window is None else min(window, self.columns)
        self.stride = self.window + room
        self.origin = np.array([ROUNDING - columns_before * cell[0], -(rows_below + 0.5) * cell[1]])
        self.start_column, self.start_row = columns_before - 1, rows_below
        self._column = np.arange(self.stride, dtype=np.int32)

    @property
    def lines(self) -> Array:
        """Borders between rows, (rows + 1,) m."""
        lines: Array = self.origin[1] + self.cell[1] * np.arange(self.rows + 1)
        return lines

    @property
    def whole(self) -> Window:
        """All rows, from the first column on."""
        return Window(0, 0, self.rows)

    def windows(self, back: Array, half: Array) -> list[Window]:
        """Windows that begin at or before x = back (n,) m, and hold all rows between y = -half and half, m."""
        column = np.floor((back - self.origin[0]) / self.cell[0] - CELL_EDGE)
        column = np.clip(column, 0, self.columns - 1).astype(np.intp)
        # No row is lost by rounding
        first = np.floor((-half - self.origin[1]) / self.cell[1]) - 1.0
        last = np.floor((half - self.origin[1]) / self.cell[1]) + 1.0
        first = np.clip(first, 0, self.start_row).astype(np.intp)
        last = np.clip(last, self.start_row, self.rows - 1).astype(np.intp)
        column[0] = min(int(column[0]), self.start_column)
        return [
            Window(*where) for where in zip(column.tolist(), first.tolist(), (last - first + 1).tolist(), strict=True)
        ]

    def start(self, window: Window) -> int:
        """The cell that holds the origin."""
        return 1 << ((self.start_row - window.row) * self.stride + self.start_column - window.column)

    def packed(self, mask: Mask) -> int:
        """Bits of a mask, (rows, stride)."""
        return int.from_bytes(np.packbits(mask, bitorder="little").tobytes(), "little")

    def disc(self, center: tuple[float, float], radius: float, window: Window) -> Mask:
        """Cells of a window that a disc touches, (rows, stride)."""
        lines = self.lines[window.row : window.row + window.rows + 1]
        away = np.clip(center[1], lines[:-1], lines[1:]) - center[1]
        half = np.sqrt(np.maximum(radius**2 - away**2, 0.0))
        begin = np.floor((center[0] - half - self.origin[0]) / self.cell[0] - CELL_EDGE) - window.column
        last = np.floor((center[0] + half - self.origin[0]) / self.cell[0] + CELL_EDGE) - window.column
        last[np.abs(away) > radius] = -1.0
        begin = np.clip(begin, 0, self.stride).astype(np.int32)
        last = np.clip(last, -1, self._columns_of(window) - 1).astype(np.int32)
        mask: Mask = (self._column >= begin[:, None]) & (self._column <= last[:, None])
        return mask

    def _columns_of(self, window: Window) -> int:
        return min(self.columns - window.column, self.window)

    def inside(self, box: Box, window: Window) -> Mask:
        """Cells of a window that touch the workspace, (rows, stride)."""
        lines = self.lines[window.row : window.row + window.rows + 1]
        x = self.origin[0] + (self._column + window.column + 0.5) * self.cell[0]
        y = 0.5 * (lines[:-1] + lines[1:])
        mask = np.broadcast_to(self._column < self._columns_of(window), (window.rows, self.stride)).copy()
        for normal, offset in zip(box.normals, box.offsets, strict=True):
            nearest = 0.5 * float(np.abs(normal) @ self.cell)
            mask &= normal[0] * x + normal[1] * y[:, None] - nearest <= offset + ROUNDING
        return mask

    def covered(self, polygons: Array) -> tuple[Index, Index, Index, Index]:
        """Cells that lie wholly in convex polygons, one for each instant."""
        bottom = polygons[:, :, 1].min(axis=1)
        first_line = np.clip(np.ceil((bottom - self.origin[1]) / self.cell[1]), 0, self.rows).astype(np.intp)
        tallest = float((polygons[:, :, 1].max(axis=1) - bottom).max())
        count = min(floor(tallest / self.cell[1]) + 2, self.rows + 1)
        line = first_line[:, None] + np.arange(count)
        y = (self.origin[1] + self.cell[1] * line)[:, :, None]
        here, there = polygons[:, None], np.roll(polygons, -1, axis=1)[:, None]
        rise = there[..., 1] - here[..., 1]
        crossed = ((here[..., 1] <= y) != (there[..., 1] <= y)) & (rise != 0.0)
        share = np.where(crossed, (y - here[..., 1]) / np.where(rise == 0.0, 1.0, rise), 0.0)
        x = here[..., 0] + share * (there[..., 0] - here[..., 0])
        left = np.where(crossed, x, np.inf).min(axis=2)
        right = np.where(crossed, x, -np.inf).max(axis=2)
        # A cell lies in a convex polygon if both lines that bound its row do so at both of its ends.
        begin = np.ceil((np.maximum(left[:, :-1], left[:, 1:]) - self.origin[0]) / self.cell[0] + CELL_EDGE)
        end = np.floor((np.minimum(right[:, :-1], right[:, 1:]) - self.origin[0]) / self.cell[0] - CELL_EDGE)
        begin, end = np.clip(begin, 0, self.columns), np.clip(end, 0, self.columns)
        which, place = np.nonzero((end > begin) & (line[:, :-1] < self.rows))
        return (
            which,
            line[which, place],
            begin[which, place].astype(np.intp),
            end[which, place].astype(np.intp),
        )

    def reached_from(self, bits: int, distance: float) -> int:
        """Cells of which any point is within a distance, m, of any point of some cells."""
        # All are kept moved to the left by their width: so a row is made wider by one shift instead of two.
        up = down = 0
        wide, width = bits, 0
        for wanted in widths(distance, float(self.cell[0]), float(self.cell[1])):
            wider = wanted - width
            missing = 2 * wider
            while missing:
                shift = min(missing, 2 * wanted - missing + 1)
                wide |= wide << shift
                missing -= shift
            width = wanted
            up, down = (up << self.stride + wider) | wide, (down >> self.stride - wider) | wide
        return (up | down) >> width


@lru_cache(maxsize=256)
def widths(distance: float, length: float, width: float) -> tuple[int, ...]:
    """By how many columns a step leads at most, in rows from the farthest that it leads to."""
    rows = floor(distance / width) + 1
    gaps = (max(row - 1, 0) * width for row in range(rows, -1, -1))
    return tuple(floor(sqrt(max(distance**2 - gap**2, 0.0)) / length + CELL_EDGE) + 1 for gap in gaps)
