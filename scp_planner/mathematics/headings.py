"""Heading of something that follows a course and stands now and then."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from scp_planner.arrays import Array, Mask, unit_vectors
from scp_planner.mathematics.polynomials import PiecewisePolynomials, expanded
from scp_planner.mathematics.tolerances import NEARLY_REAL, NO_LEAD, SHORTEST_COURSE


@dataclass(frozen=True)
class Standing:
    """Measures of a course that stands or jitters."""

    slow: float = 0.05  # Share of a course's top speed below which it stands
    # Share of a course's length: a place that is not left by so much at the speed above jitters
    on_its_way: float = 0.1
    each_piece: int = 16  # Looks at how far it has come, where it stands, in each piece of a course


STANDING = Standing()


def course_heading(course: PiecewisePolynomials, length: float) -> PiecewisePolynomials | None:
    """Return what moves in the direction that a shape of a length, m, heads in on a course."""
    first, last = course.breakpoints[0, [1, -2]].tolist()
    runs = _runs(course, length)
    if not runs:
        return None
    if runs == [(first, last)]:
        return course
    pieces: list[tuple[float, Array]] = []
    for number, (begin, end) in enumerate(runs):
        start, stop = _unit(course, begin), _unit(course, end)
        if begin > first and number == 0:
            pieces.append((first - 1.0, _turning(start, start, 1.0)))
        pieces += _along(course, -np.inf if begin == first else begin, np.inf if end == last else end)
        if end == last:
            break
        if number + 1 == len(runs):
            pieces.append((end, _turning(stop, stop, 1.0)))
        else:
            then = runs[number + 1][0]
            pieces += _turned(course, _looks(course, end, then), stop, _unit(course, then))
    begins_at = np.array([begin for begin, _ in pieces])
    powers = max(len(one) for _, one in pieces)
    coefficients = np.zeros((len(pieces), powers, 2))
    for k, (_, one) in enumerate(pieces):
        coefficients[k, : len(one)] = one
    return PiecewisePolynomials(np.append(begins_at, np.inf)[None], coefficients[None])


def _runs(course: PiecewisePolynomials, length: float) -> list[tuple[float, float]]:
    """Times from and to which a course is on its way, s, in order."""
    breaks = course.breakpoints[0, 1:-1]
    first, last = breaks[[0, -1]].tolist()
    slow = STANDING.slow * _fastest(course, breaks)
    if slow == 0.0:
        return []
    far = STANDING.on_its_way * length
    reach = far / slow
    knots = np.unique(np.clip(np.concatenate([breaks, breaks - reach, breaks + reach]), first, last))
    middle, half = 0.5 * (knots[1:] + knots[:-1]), 0.5 * np.diff(knots)
    place, ahead, behind = (_local(course, middle + away, half) for away in (0.0, reach, -reach))
    velocity = _local(course.derivative, middle, half)
    conditions = [_square(velocity, slow)]
    conditions += [_square(way, far) for way in (place - behind, ahead - place, ahead - behind)]
    roots = np.concatenate([(middle[:, None] + half[:, None] * _roots(one)).ravel() for one in conditions])
    edges = np.unique(np.concatenate([knots, roots[np.isfinite(roots)]]))
    edges = edges[np.append(np.diff(edges) > SHORTEST_COURSE * (last - first), True)]
    edges[0] = first
    moving = _moves(course, 0.5 * (edges[1:] + edges[:-1]), slow, far)
    turns = np.flatnonzero(np.diff(np.concatenate([[False], moving, [False]]).astype(np.int8)))
    return [(begin, end) for begin, end in edges[turns].reshape(-1, 2).tolist()]


def _fastest(course: PiecewisePolynomials, breaks: Array) -> float:
    """The highest speed between the first time of a course and the last, m/s."""
    middle, half = 0.5 * (breaks[1:] + breaks[:-1]), 0.5 * np.diff(breaks)
    square = _square(_local(course.derivative, middle, half), 0.0)
    summits = middle[:, None] + half[:, None] * _roots(square[:, 1:] * np.arange(1, square.shape[1]))
    times = np.concatenate([breaks, summits[np.isfinite(summits)]])
    return float(np.hypot(*_at(course.derivative, times).T).max())


def _moves(course: PiecewisePolynomials, times: Array, slow: float, far: float) -> Mask:
    """True if a course is on its way at times (n,) s: not slow, and far from where it was and will be."""
    first, last = course.breakpoints[0, [1, -2]].tolist()
    reach = far / slow
    place, ahead, behind = (_at(course, np.clip(times + d, first, last)) for d in (0.0, reach, -reach))
    came, goes, passes = (np.hypot(*way.T) >= far for way in (place - behind, ahead - place, ahead - behind))
    # Where the course ends before that time, what is known of the other side has to do
    came |= (times - reach < first) & passes
    goes |= (times + reach > last) & passes
    moves: Mask = (np.hypot(*_at(course.derivative, times).T) >= slow) & came & goes
    return moves


def _local(course: PiecewisePolynomials, middle: Array, half: Array) -> Array:
    """Coefficients (n, P, 2) of powers of u in [-1, 1] on intervals (n,) by their middles and half widths, s."""
    first, last = course.breakpoints[0, [1, -2]]
    found = course.taylor(np.zeros(len(middle), dtype=np.intp), np.clip(middle, first, last))
    found = found * half[:, None, None] ** np.arange(found.shape[1])[:, None]
    found[(middle < first) | (middle > last), 1:] = 0.0
    return found


def _square(way: Array, least: float) -> Array:
    """The square of the length of vectors that are polynomials, (n, P, 2), less that of a length: (n, 2 P - 1)."""
    powers = way.shape[1]
    found = np.zeros((len(way), 2 * powers - 1))
    for k in range(powers):
        found[:, k : k + powers] += (way[:, k, None] * way).sum(axis=2)
    found[:, 0] -= least * least
    return found


def _roots(coefficients: Array) -> Array:
    """Real roots in [-1, 1] of polynomials, (n, P) ascending coefficients to (n, P - 1); nan in place of others."""
    degree = coefficients.shape[1] - 1
    found = np.full((len(coefficients), degree), np.nan)
    size = np.abs(coefficients).max(axis=1)
    may = np.flatnonzero(np.abs(coefficients[:, 0]) <= np.abs(coefficients[:, 1:]).sum(axis=1))
    may = may[size[may] > 0.0]
    monic = coefficients[may] / size[may, None]
    monic[np.abs(monic[:, -1]) < NO_LEAD, -1] = NO_LEAD  # then there are roots far away
    companion = np.zeros((len(may), degree, degree))
    companion[:, 1:, :-1] = np.eye(degree - 1)
    companion[:, :, -1] = -monic[:, :-1] / monic[:, -1:]
    values = np.linalg.eigvals(companion)
    real = (np.abs(values.imag) <= NEARLY_REAL) & (np.abs(values.real) <= 1.0)
    found[may] = np.where(real, values.real, np.nan)
    return found


def _looks(course: PiecewisePolynomials, begin: float, end: float) -> Array:
    """Times in each piece of a course between two, and these, s."""
    breaks = course.breakpoints[0, 1:-1]
    share = np.arange(STANDING.each_piece) / STANDING.each_piece
    times = (breaks[:-1, None] + np.diff(breaks)[:, None] * share).ravel()
    return np.concatenate([[begin], times[(times > begin) & (times < end)], [end]])


def _along(course: PiecewisePolynomials, first: float, last: float) -> list[tuple[float, Array]]:
    """The pieces of the course itself between two times."""
    breaks, found = course.breakpoints[0], []
    # of long courses, which are on their way in many parts, only the pieces between the two
    some = breaks[1:-1].searchsorted([first, last], "right")
    for k in range(int(some[0]), int(some[1]) + 1):
        coefficients = course.coefficients[0, k]
        begin, end = (-np.inf if k == 0 else breaks[k]), breaks[k + 1]
        start = max(begin, first)
        if start < min(end, last):
            start = breaks[0] if start == -np.inf else start
            found.append((float(start), expanded(coefficients[None], np.array([start - breaks[k]]))[0]))
    return found


def _turned(course: PiecewisePolynomials, times: Array, first: Array, last: Array) -> list[tuple[float, Array]]:
    """From one heading to another, by the share of the way between them, the shorter way round of lines."""
    turn = float(np.arctan2(first[0] * last[1] - first[1] * last[0], first @ last))
    turn -= np.pi * round(turn / np.pi)
    way = np.append(0.0, np.cumsum(np.hypot(*np.diff(_at(course, times), axis=0).T)))
    share = way / way[-1] if way[-1] > 0.0 else (times - times[0]) / (times[-1] - times[0])
    angle = np.arctan2(first[1], first[0]) + turn * share
    unit = unit_vectors(angle)
    return [
        (float(times[k]), _turning(unit[k], unit[k + 1], float(times[k + 1] - times[k]))) for k in range(len(times) - 1)
    ]


def _turning(first: Array, last: Array, duration: float) -> Array:
    return np.stack([np.zeros(2), first, 0.5 * (last - first) / duration])


def _unit(course: PiecewisePolynomials, time: float) -> Array:
    velocity = _at(course.derivative, np.array([time]))[0]
    unit: Array = velocity / np.hypot(*velocity)
    return unit


def _at(polynomials: PiecewisePolynomials, times: Array) -> Array:
    return polynomials.at(np.zeros(len(times), dtype=np.intp), times)
