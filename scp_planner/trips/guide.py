"""Guides: the curves that a path is a normal offset of.

A guide g(s), s in [0, length], is parametrised by its own arc length, so g' = T is a unit tangent,
n = T turned by +90 degrees the normal, T' = k n and n' = -k T with k the signed curvature.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import comb, factorial
from typing import Any, Protocol

import numpy as np

from scp_planner.arrays import Array, Index
from scp_planner.errors import TooLargeError
from scp_planner.mathematics.intervals import Interval

CELLS_PER_PIECE = 2  # of the table of positions, to a piece of the heading's spline, or twice as many, and so on
STRAYS = 1e-12  # of the length: how far positions may be off, as far as that takes no more cells than this
MOST_CELLS = 200_000
QUADRATURE_ORDER = 6
SHARP = 0.3  # rad; corners that turn by less are rounded by the moving average alone
ARC_STEP = 0.15  # rad, between the points of an arc
IN_LINE = 1e-9  # rad; a polyline that turns by less is straight
SLIVER = 1e-11  # of the length; intervals overlap the next piece by less from rounding alone
LEAST_BEND = 0.2  # radii; tighter bends, which have no room, are averaged over as much as these
WINDOW = 1.5  # radii: width of the moving average
SAMPLES_PER_WINDOW = 60
MOST_SAMPLES = 500_000  # of the average: windows get wider on guides that would need more
MOST_AT_ONCE = 4_000_000  # numbers in an array on the way to it
FEW_CHANGES = 64  # of direction, that are looked at together
MOST_PIECES = 3400  # of the heading's spline: what the tables of paths over it have room for

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
    """The moving frame of a guide at n stations.

    Attributes
    ----------
    position, tangent, normal : (n, 2) arrays
        Point in m; unit tangent; unit normal, to the left of the tangent.
    curvature : (n,) array
        Signed curvature k, 1/m, positive to the left.
    curvature_rate : (n,) array
        dk/ds, 1/m^2.
    """

    position: Array
    tangent: Array
    normal: Array
    curvature: Array
    curvature_rate: Array


class Guide(Protocol):
    """What the trajectory needs to know of a guide."""

    @property
    def length(self) -> float:
        """Arc length in m."""
        ...

    @property
    def straight(self) -> bool:
        """Whether the curvature is zero everywhere."""
        ...

    @property
    def pieces(self) -> int:
        """Number of equal pieces on each of which the curvature is one polynomial."""
        ...

    @property
    def error(self) -> float:
        """How far positions are at most from the curve that the headings give, m."""
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
        """Return what :func:`guide_from_dict` needs to make the same guide."""
        ...


@dataclass(frozen=True)
class StraightGuide:
    """The x axis of the planning frame, from the start at 0 to the goal.

    Attributes
    ----------
    length : float
        m.
    """

    length: float

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
        )

    def curvature_ranges(self, stations: Array, width: Array) -> tuple[Interval, Interval, Interval]:
        """Enclose the curvature and its first two derivatives on intervals of the station: all zero."""
        zero = Interval(np.zeros_like(stations), np.zeros_like(stations))
        return zero, zero, zero

    def in_units(self, length: float) -> StraightGuide:
        """Return the guide where lengths are so many times as large."""
        return StraightGuide(self.length * length)

    def to_dict(self) -> dict[str, Any]:
        """Return what :func:`guide_from_dict` needs to make the same guide."""
        return {"kind": "straight", "length": self.length}


class CurvedGuide:
    """A curve given by its heading, a cubic spline of its arc length: |g'| = 1, and the curvature is smooth.

    The position is the integral of (cos phi, sin phi), tabulated, and in between the quintic that fits position,
    tangent and curvature at both ends of a cell. How far that strays follows from bounds of the derivatives of the
    heading; cells are as short as it takes.

    Parameters
    ----------
    length : float
        m.
    headings : (n,) array
        phi in rad at n >= 4 equidistant arc lengths from 0 to ``length``, in the planning frame.
    """

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
        """How many cells a piece of the heading has, and how far positions are off with them, m.

        The quintic is off by h^6 / (64 6!) |g^(6)|, Gauss' rule of n nodes by h^(2n+1) (n!)^4 / ((2n+1) (2n)!^3) times
        |g^(2n+1)| a cell. Derivatives of g' = exp(i phi) are at most Bell's polynomials of those of phi.
        """
        rate = np.maximum(np.abs(self._rate[:, 0]), np.abs(self._rate[:, 0] + self._second * self._width))
        bend = np.abs(self._curvature[:, 0]) + rate * self._width
        bells = _bell_polynomials(bend, rate, np.abs(self._second), 2 * QUADRATURE_ORDER)
        n, quintic, rule = QUADRATURE_ORDER, float(bells[5].max()), float(bells[2 * QUADRATURE_ORDER].sum())
        quintic /= 64 * factorial(6)
        rule *= factorial(n) ** 4 / ((2 * n + 1) * factorial(2 * n) ** 3)
        parts = CELLS_PER_PIECE
        while True:
            h = self._width / parts
            error = quintic * h**6 + rule * parts * h ** (2 * n + 1)
            if error <= STRAYS * self.length or 2 * parts * self.pieces > MOST_CELLS:
                return parts, error
            parts *= 2

    def _fit_cells(self, parts: int) -> Array:
        """Coefficients of the quintics, (cells, 6, 2), in powers of the share of the cell."""
        count = len(self._heading) * parts
        edges: Array = self._cell * np.arange(count + 1, dtype=np.float64)
        rule = np.polynomial.legendre.leggauss(QUADRATURE_ORDER)
        nodes, weights = (np.asarray(values, dtype=np.float64) for values in rule)
        inner: Array = (edges[:-1, None] + 0.5 * self._cell * (nodes + 1.0)).ravel()
        phi = self._local(self._heading, inner).reshape(count, -1)
        steps = 0.5 * self._cell * np.stack([np.cos(phi) @ weights, np.sin(phi) @ weights], axis=1)
        place = np.concatenate([np.zeros((1, 2)), np.cumsum(steps, axis=0)])
        phi, bend = self._local(self._heading, edges), self._local(self._curvature, edges)
        first = self._cell * np.stack([np.cos(phi), np.sin(phi)], axis=1)
        second = (self._cell**2 * bend)[:, None] * np.stack([-np.sin(phi), np.cos(phi)], axis=1)
        ends = np.stack([place[:-1], first[:-1], second[:-1], place[1:], first[1:], second[1:]], axis=1)
        return np.einsum("pq,mqk->mpk", _HERMITE, ends)

    def _local(self, coefficients: Array, stations: Array) -> Array:
        """Values of a piecewise polynomial over the pieces of the heading."""
        piece, x = self._locate(stations)
        local = coefficients[piece]
        value: Array = local[:, -1].copy()
        for power in range(local.shape[1] - 2, -1, -1):
            value *= x
            value += local[:, power]
        return value

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
        tangent = np.stack([np.cos(phi), np.sin(phi)], axis=1)
        normal = np.stack([-tangent[:, 1], tangent[:, 0]], axis=1)
        curvature, rate = b + x * (2.0 * c + 3.0 * d * x), 2.0 * c + 6.0 * d * x
        cell = np.clip((stations / self._cell).astype(np.intp), 0, len(self._cells) - 1)
        share = (stations / self._cell - cell)[:, None]
        local = self._cells[cell]
        position = local[:, 5].copy()
        for power in range(4, -1, -1):
            position *= share
            position += local[:, power]
        return GuideFrame(position, tangent, normal, curvature, rate)

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
        """Return what :func:`guide_from_dict` needs to make the same guide."""
        return {"kind": "curved", "length": self.length, "headings": self.headings.tolist()}


def _bell_polynomials(first: Array, second: Array, third: Array, count: int) -> list[Array]:
    """Complete Bell polynomials 0 to count of x1, x2, x3 and nothing further, each (n,)."""
    bells = [np.ones_like(first)]
    for m in range(count):
        terms = zip((first, second, third), range(min(m, 2) + 1), strict=False)
        bells.append(sum((comb(m, k) * x * bells[m - k] for x, k in terms), np.zeros_like(first)))
    return bells


def smooth_guide(points: Array, radius: float, piece: float = 0.3, multiple: int = 5) -> Guide:
    """Return a guide along a polyline, its corners rounded.

    Sharp corners are cut by arcs of the radius, as far as their legs have room. Then the curve is averaged over a
    moving window of arc length, which leaves straight parts where they are. At last it is turned and scaled by the
    tiny amount that brings its end onto the polyline's.

    Parameters
    ----------
    points : (n, 2) array
        In the planning frame, from the start at the origin to the goal, m.
    radius : float
        Wanted radius of rounded corners, m.
    piece : float
        Length of a piece of the heading's spline, m. Where paths over the guide are integrated, no knot may lie inside
        a cell.
    multiple : int
        The number of pieces is a multiple of this, and at least four times as much.

    Returns
    -------
    Guide

    Raises
    ------
    TooLargeError
        If there are more pieces than a guide may have.
    """
    check_pieces(float(np.hypot(*np.diff(points, axis=0).T).sum()), piece)
    corners, least = _rounded(np.asarray(points, dtype=float), radius)
    legs = np.diff(corners, axis=0)
    lengths = np.hypot(legs[:, 0], legs[:, 1])
    directions = legs / lengths[:, None]
    turns = np.abs(directions[1:, 0] * directions[:-1, 1] - directions[1:, 1] * directions[:-1, 0])
    if np.all(turns < IN_LINE):
        return StraightGuide(float(np.hypot(*(corners[-1] - corners[0]))))
    places = np.cumsum(lengths)[:-1]
    total = float(lengths.sum())
    half = max(0.5 * min(WINDOW * least, 0.5 * total), SAMPLES_PER_WINDOW * total / MOST_SAMPLES)
    # The average of the polyline over the window has this derivative; beyond its ends the polyline goes straight on.
    u = np.linspace(0.0, total, max(400, int(SAMPLES_PER_WINDOW * total / half)) + 1)
    derivative = _averaged(directions, places, u, half)
    phi = np.unwrap(np.arctan2(derivative[:, 1], derivative[:, 0]))
    speed = np.hypot(derivative[:, 0], derivative[:, 1])
    driven = np.concatenate([[0.0], np.cumsum(0.5 * (speed[1:] + speed[:-1]) * np.diff(u))])
    pieces = multiple * max(4, round(driven[-1] / (multiple * piece)))
    headings = np.interp(np.linspace(0.0, driven[-1], pieces + 1), driven, phi)
    return _ending_at(corners[-1] - corners[0], driven[-1], headings)


def _averaged(directions: Array, places: Array, u: Array, half: float) -> Array:
    """Directions (n + 1, 2) that change at places (n,), averaged over a window about u, (m, 2); all along one line.

    Changes that lie wholly before the window of u are over, those behind it are still to come.
    """
    changes = np.diff(directions, axis=0)
    if len(u) * len(places) <= MOST_AT_ONCE:
        return directions[0] + _shares(u, places, half) @ changes
    averaged = np.empty((len(u), 2))
    first, last = np.searchsorted(places, u - half), np.searchsorted(places, u + half)
    begin = 0
    while begin < len(u):
        # As many as share most of their changes: others are looked at for nothing
        shared = first[begin] + max(2 * (last[begin] - first[begin]), FEW_CHANGES)
        most = max(1, MOST_AT_ONCE // (shared - first[begin]))
        end = begin + min(max(1, int(np.searchsorted(last[begin:], shared, "right"))), most)
        near = slice(first[begin], last[end - 1])
        averaged[begin:end] = directions[near.start] + _shares(u[begin:end], places[near], half) @ changes[near]
        begin = end
    return averaged


def _shares(u: Array, places: Array, half: float) -> Array:
    """How much of the change at each place has come at each u, (m, n): 0 before the window, and 1 after it."""
    share = u[:, None] - places
    share /= half
    np.clip(share, -1.0, 1.0, out=share)
    square = share * share
    # 1 / 2 + 35 / 32 (x - x^3 + 3 / 5 x^5 - x^7 / 7)
    shares: Array = square * (-1.0 / 7.0)
    for coefficient in (0.6, -1.0):
        shares += coefficient
        shares *= square
    shares += 1.0
    shares *= share
    shares *= 35.0 / 32.0
    shares += 0.5
    return shares


def check_pieces(length: float, piece: float) -> None:
    """Refuse a curve that would need more pieces than a guide may have, before anything is allocated.

    Parameters
    ----------
    length : float
        m.
    piece : float
        Length of a piece, m.

    Raises
    ------
    TooLargeError
        Naming both.
    """
    if length > MOST_PIECES * piece:
        raise TooLargeError(
            f"guide: a curve of {length:.6g} m in pieces of {piece:.3g} m would have {length / piece:.3g} of them;"
            f" at most {MOST_PIECES} are allowed: a larger path_span makes them longer"
        )


def guide_through(headings: Array, length: float, goal: Array) -> CurvedGuide:
    """Return a guide along a curve that is known by its headings.

    Parameters
    ----------
    headings : (n,) array
        In the planning frame at equidistant arc lengths from the start to the goal, rad; without jumps by full turns.
    length : float
        m.
    goal : (2,) array
        Where the guide is to end, m.

    Returns
    -------
    CurvedGuide
    """
    return _ending_at(goal, length, headings)


def _ending_at(goal: Array, length: float, headings: Array) -> CurvedGuide:
    """Return the guide with these headings, turned and scaled so that it ends at a point."""
    end = CurvedGuide(length, headings).frame(np.array([length])).position[0]
    turn = np.arctan2(goal[1], goal[0]) - np.arctan2(end[1], end[0])
    turn = np.arctan2(np.sin(turn), np.cos(turn))
    return CurvedGuide(length * float(np.hypot(*goal) / np.hypot(*end)), headings + turn)


def _rounded(points: Array, radius: float) -> tuple[Array, float]:
    """The polyline with arcs, of many short legs, in place of its sharp corners; and the least radius of them."""
    corners, least = [points[:1]], radius
    legs = np.diff(points, axis=0)
    lengths = np.hypot(legs[:, 0], legs[:, 1])
    for k in range(1, len(points) - 1):
        before, after = legs[k - 1] / lengths[k - 1], legs[k] / lengths[k]
        turn = float(np.arctan2(before[0] * after[1] - before[1] * after[0], before @ after))
        if abs(turn) < SHARP:
            corners.append(points[k : k + 1])
            continue
        # An inner leg is shared by its two corners.
        room = min(lengths[k - 1] * (1.0 if k == 1 else 0.5), lengths[k] * (1.0 if k == len(points) - 2 else 0.5))
        half = min(0.5 * abs(turn), 0.499 * np.pi)
        tangent = min(radius * np.tan(half), 0.999 * room)
        bend = tangent / np.tan(half)
        least = min(least, max(bend, LEAST_BEND * radius))
        left = np.sign(turn) * np.array([-before[1], before[0]])
        center = points[k] - tangent * before + bend * left
        angles = np.linspace(0.0, turn, int(np.ceil(abs(turn) / ARC_STEP)) + 1)
        c, s = np.cos(angles)[:, None], np.sin(angles)[:, None]
        spoke = -bend * left
        corners.append(center + c * spoke + s * np.array([-spoke[1], spoke[0]]))
    polyline = np.concatenate([*corners, points[-1:]])
    apart = np.hypot(*np.diff(polyline, axis=0).T) > 1e-9 * max(1.0, float(lengths.sum()))
    return polyline[np.concatenate([[True], apart])], float(least)


def guide_from_dict(data: dict[str, Any]) -> Guide:
    """Return the guide of a plan file.

    Parameters
    ----------
    data : dict
        What the plan file has under ``path.guide``.

    Returns
    -------
    Guide

    Raises
    ------
    KeyError, TypeError, ValueError
        If the dictionary does not describe a guide.
    """
    kind = data["kind"]
    if kind == "straight":
        length = float(data["length"])
        if not (0.0 < length < float("inf")):
            raise ValueError(f"length {length!r} is not a positive number")
        return StraightGuide(length)
    if kind == "curved":
        length, headings = float(data["length"]), np.asarray(data["headings"], dtype=float)
        if not (0.0 < length < float("inf")):
            raise ValueError(f"length {length!r} is not a positive number")
        if headings.ndim != 1 or len(headings) < 4 or not np.all(np.isfinite(headings)):
            raise ValueError("headings are not at least 4 finite numbers")
        return CurvedGuide(length, headings)
    raise ValueError(f"kind {kind!r} is none of straight, curved")
