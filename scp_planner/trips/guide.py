"""Guides: the curves that a path is a normal offset of."""

from __future__ import annotations

from dataclasses import dataclass
from math import factorial
from typing import Any, Protocol

import numpy as np

from scp_planner.arrays import Array, Index, left_of, unit_vectors
from scp_planner.mathematics.bell_polynomials import complete_bell_polynomials
from scp_planner.mathematics.intervals import Interval
from scp_planner.mathematics.polynomials import horner
from scp_planner.mathematics.quadrature import gauss_rule
from scp_planner.mathematics.splines import evaluate
from scp_planner.trips.tolerances import GUIDE_ERROR, SLIVER


@dataclass(frozen=True)
class GuideTable:
    """Size of the table of a guide's positions."""

    # of the table of positions, to a piece of the heading's spline, or twice as many, and so on
    cells_per_piece: int = 2
    most_cells: int = 200_000
    order: int = 6


TABLE = GuideTable()

# Power coefficients of the quintic from value, first and second derivative at 0 and at 1
_HERMITE = np.array(
    [
        [1.0, 0.0, 0.0, 0.0, 0.0, 0.0],
        [0.0, 1.0, 0.0, 0.0, 0.0, 0.0],
        [0.0, 0.0, 0.5, 0.0, 0.0, 0.0],
        [-10.0, -6.0, -1.5, 10.0, -4.0, 0.5],
        [15.0, 8.0, 1.5, -15.0, 7.0, -1.0],
        [-6.0, -3.0, -0.5, 6.0, -3.0, 0.5],
    ]
)


@dataclass(frozen=True)
class GuideFrame:
    """The moving frame of a guide at n stations."""

    position: Array  # (n, 2) Point in m; unit tangent; unit normal, to the left of the tangent
    tangent: Array  # (n, 2) Point in m; unit tangent; unit normal, to the left of the tangent
    normal: Array  # (n, 2) Point in m; unit tangent; unit normal, to the left of the tangent
    curvature: Array  # (n,) Signed curvature k, 1/m, positive to the left
    curvature_rate: Array  # (n,) dk/ds in 1/m^2, and its own derivative in 1/m^3; to the right where it jumps
    second_rate: Array  # (n,) dk/ds in 1/m^2, and its own derivative in 1/m^3; to the right where it jumps


class Guide(Protocol):
    """Interface of a guide for a trajectory."""

    @property
    def length(self) -> float:
        """Arc length in m."""
        ...

    @property
    def straight(self) -> bool:
        """True if the curvature is zero everywhere."""
        ...

    @property
    def pieces(self) -> int:
        """Number of equal pieces on each of which the curvature is one polynomial."""
        ...

    @property
    def error(self) -> float:
        """Largest distance of positions from the curve that the headings give, m."""
        ...

    def curvature(self, stations: Array) -> Array:
        """Signed curvature at arc lengths ``stations``, (n,), 1/m."""
        ...

    def frame(self, stations: Array) -> GuideFrame:
        """Return the moving frame at arc lengths ``stations``, (n,) m."""
        ...

    def curvature_ranges(self, stations: Array, width: Array) -> tuple[Interval, Interval, Interval]:
        """Enclose the curvature and its first two derivatives on [station - width, station + width]."""
        ...

    def in_units(self, length: float) -> Guide:
        """Return the guide where lengths are so many times as large."""
        ...

    def to_dict(self) -> dict[str, Any]:
        """Return what a plan file holds of the guide."""
        ...


@dataclass(frozen=True)
class StraightGuide:
    """The x axis of the planning frame, from the start at 0 to the goal."""

    length: float  # m

    straight = True
    pieces = 1
    error = 0.0

    def curvature(self, stations: Array) -> Array:
        """Signed curvature at arc lengths ``stations``, (n,), 1/m: none."""
        return np.zeros_like(stations)

    def frame(self, stations: Array) -> GuideFrame:
        """Return the moving frame at arc lengths ``stations``, (n,) m."""
        zeros = np.zeros_like(stations)
        ones = np.ones_like(stations)
        return GuideFrame(
            np.stack([stations, zeros], axis=-1),
            np.stack([ones, zeros], axis=-1),
            np.stack([zeros, ones], axis=-1),
            zeros,
            zeros,
            zeros,
        )

    def curvature_ranges(self, stations: Array, width: Array) -> tuple[Interval, Interval, Interval]:
        """Enclose the curvature and its first two derivatives on intervals of the station: all zero."""
        shape = np.broadcast_shapes(stations.shape, width.shape)
        zero = Interval(np.zeros(shape), np.zeros(shape))
        return zero, zero, zero

    def in_units(self, length: float) -> StraightGuide:
        """Return the guide where lengths are so many times as large."""
        return StraightGuide(self.length * length)

    def to_dict(self) -> dict[str, Any]:
        """Return what a plan file holds of the guide."""
        return {"kind": "straight", "length": self.length}


class CurvedGuide:
    """A curve given by its heading, a cubic spline of its arc length: |g'| = 1, and the curvature is smooth."""

    straight = False

    def __init__(self, length: float, headings: Array) -> None:
        from scipy.interpolate import CubicSpline

        self.length = float(length)
        self.headings = np.asarray(headings, dtype=float)
        pieces = len(self.headings) - 1
        self._width = self.length / pieces
        spline = CubicSpline(np.arange(pieces + 1) * self._width, self.headings)
        self._heading: Array = np.ascontiguousarray(spline.c[::-1].T)
        factors = np.array([1.0, 2.0, 3.0])
        self._curvature: Array = self._heading[:, 1:] * factors
        self._rate = self._curvature[:, 1:] * factors[:2]
        self._second = self._rate[:, 1]
        parts, self.error = self._parts()
        self._cell = self._width / parts
        self._cells = self._fit_cells(parts)

    @property
    def pieces(self) -> int:
        """Number of pieces of the heading's spline."""
        return len(self.headings) - 1

    def _parts(self) -> tuple[int, float]:
        """Number of cells to a piece of the heading, and the error of positions with them, m."""
        rate = np.maximum(np.abs(self._rate[:, 0]), np.abs(self._rate[:, 0] + self._second * self._width))
        bend = np.abs(self._curvature[:, 0]) + rate * self._width
        bells = complete_bell_polynomials(bend, rate, np.abs(self._second), 2 * TABLE.order)
        n, quintic, rule = TABLE.order, float(bells[5].max()), float(bells[2 * TABLE.order].sum())
        quintic /= 64 * factorial(6)
        rule *= factorial(n) ** 4 / ((2 * n + 1) * factorial(2 * n) ** 3)
        parts = TABLE.cells_per_piece
        while True:
            h = self._width / parts
            error = quintic * h**6 + rule * parts * h ** (2 * n + 1)
            if error <= GUIDE_ERROR * self.length or 2 * parts * self.pieces > TABLE.most_cells:
                return parts, error
            parts *= 2

    def _fit_cells(self, parts: int) -> Array:
        """Coefficients of the quintics, (cells, 6, 2), in powers of the share of the cell."""
        count = len(self._heading) * parts
        edges: Array = self._cell * np.arange(count + 1, dtype=np.float64)
        rule = gauss_rule(TABLE.order)
        inner: Array = (edges[:-1, None] + 0.5 * self._cell * (rule.nodes + 1.0)).ravel()
        phi = self._local(self._heading, inner).reshape(count, -1)
        steps = 0.5 * self._cell * np.stack([np.cos(phi) @ rule.weights, np.sin(phi) @ rule.weights], axis=1)
        place = np.concatenate([np.zeros((1, 2)), np.cumsum(steps, axis=0)])
        phi, bend = self._local(self._heading, edges), self._local(self._curvature, edges)
        first = self._cell * unit_vectors(phi)
        second = (self._cell**2 * bend)[:, None] * np.stack([-np.sin(phi), np.cos(phi)], axis=1)
        ends = np.stack([place[:-1], first[:-1], second[:-1], place[1:], first[1:], second[1:]], axis=1)
        return np.einsum("pq,mqk->mpk", _HERMITE, ends)

    def _local(self, coefficients: Array, stations: Array) -> Array:
        """Values of a piecewise polynomial over the pieces of the heading."""
        piece, x = self._locate(stations)
        return evaluate(coefficients, piece, x)

    def curvature(self, stations: Array) -> Array:
        """Signed curvature at arc lengths ``stations``, (n,), 1/m."""
        return self._local(self._curvature, stations)

    def _locate(self, stations: Array) -> tuple[Index, Array]:
        piece = np.clip((stations / self._width).astype(np.intp), 0, len(self._heading) - 1)
        return piece, stations - piece * self._width

    def frame(self, stations: Array) -> GuideFrame:
        """Return the moving frame at arc lengths ``stations``, (n,) m."""
        stations = np.asarray(stations, dtype=float)
        piece, x = self._locate(stations)
        a, b, c, d = self._heading[piece].T
        phi = a + x * (b + x * (c + x * d))
        tangent = unit_vectors(phi)
        normal = left_of(tangent)
        curvature, rate = b + x * (2.0 * c + 3.0 * d * x), 2.0 * c + 6.0 * d * x
        cell = np.clip((stations / self._cell).astype(np.intp), 0, len(self._cells) - 1)
        share = (stations / self._cell - cell)[:, None]
        position = horner(self._cells[cell].swapaxes(0, 1), share)
        return GuideFrame(position, tangent, normal, curvature, rate, self._second[piece])

    def curvature_ranges(self, stations: Array, width: Array) -> tuple[Interval, Interval, Interval]:
        """Enclose the curvature and its first two derivatives on [station - width, station + width]."""
        piece, x = self._locate(stations)
        _, b, c, d = self._heading[piece].T
        # An interval that ends at a border of pieces, to rounding, has nothing of the next one, whose own covers that.
        # So that it does to the last bit, the curvature and its rate are enclosed as much farther to both sides.
        sliver = SLIVER * self.length
        inner, outer = np.maximum(width - sliver, 0.0), width + sliver
        first, last = self._locate(stations - inner)[0], self._locate(stations + inner)[0]
        low: Array = self._second[first]
        high: Array = self._second[first]
        for further in range(1, int((last - first).max(initial=0)) + 1):
            value = self._second[np.minimum(first + further, last)]
            low, high = np.minimum(low, value), np.maximum(high, value)
        second = Interval(low, high)
        rate = Interval.around(2.0 * c + 6.0 * d * x, second.magnitude() * outer)
        bend = Interval.around(b + x * (2.0 * c + 3.0 * d * x), rate.magnitude() * outer)
        return bend, rate, second

    def in_units(self, length: float) -> CurvedGuide:
        """Return the guide where lengths are so many times as large."""
        return CurvedGuide(self.length * length, self.headings)

    def to_dict(self) -> dict[str, Any]:
        """Return what a plan file holds of the guide."""
        return {"kind": "curved", "length": self.length, "headings": self.headings.tolist()}
