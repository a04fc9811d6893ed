"""Where something heads that follows a course and stands now and then.

A shape that is the same after half a turn, a rectangle or an ellipse, heads along the velocity, one way or the other.
Where a course hardly moves its velocity is jitter and says nothing. There the last known heading serves, and turns into
the next one as the obstacle goes along, by the share of the way between them that is behind it; before the first known
heading that one serves.
"""

from __future__ import annotations

import numpy as np

from scp_planner.arrays import Array, Mask
from scp_planner.mathematics.polynomials import PiecewisePolynomials, expanded

SLOW = 0.05
"""Of the fastest that a course goes: slower than that it stands."""
ON_ITS_WAY = 0.1
"""Of its length. What has not come so far, or will not, in the time that it takes at the speed above, jitters."""
EACH_PIECE = 16
"""In each piece of a course."""


def course_heading(course: PiecewisePolynomials, length: float) -> PiecewisePolynomials | None:
    """Return what moves in the direction that a shape of a length, m, heads in on a course.

    Parameters
    ----------
    course : PiecewisePolynomials
        One, as of `scp_planner.mathematics.courses.course_polynomials`.
    length : float
        Of the shape, m.

    Returns
    -------
    PiecewisePolynomials or None
        The course itself where it is nowhere slow; None if it is on its way nowhere: then no heading is known.
    """
    times, moving = _looks(course, length)
    if moving.all():
        return course
    runs = _runs(moving)
    if not runs:
        return None
    pieces: list[tuple[float, Array]] = []
    for number, (first, last) in enumerate(runs):
        start, end = _unit(course, times[first]), _unit(course, times[last])
        if first > 0 and number == 0:
            pieces.append((times[0] - 1.0, _turning(start, start, 1.0)))
        begins = -np.inf if first == 0 else times[first]
        ends = np.inf if last == len(times) - 1 else times[last]
        pieces += _along(course, begins, ends)
        if last == len(times) - 1:
            break
        if number + 1 == len(runs):
            pieces.append((times[last], _turning(end, end, 1.0)))
        else:
            then = runs[number + 1][0]
            pieces += _turned(course, times[last : then + 1], end, _unit(course, times[then]))
    begins_at = np.array([begin for begin, _ in pieces])
    powers = max(len(one) for _, one in pieces)
    coefficients = np.zeros((len(pieces), powers, 2))
    for k, (_, one) in enumerate(pieces):
        coefficients[k, : len(one)] = one
    return PiecewisePolynomials(np.append(begins_at, np.inf)[None], coefficients[None])


def _looks(course: PiecewisePolynomials, length: float) -> tuple[Array, Mask]:
    """Times from the first of the course to its last, and whether it is on its way then."""
    breaks = course.breakpoints[0, 1:-1]
    share = np.arange(EACH_PIECE) / EACH_PIECE
    times = np.append((breaks[:-1, None] + np.diff(breaks)[:, None] * share).ravel(), breaks[-1])
    velocity = _at(course.derivative, times)
    speed = np.hypot(velocity[:, 0], velocity[:, 1])
    slow = SLOW * float(speed.max())
    if slow == 0.0:
        return times, np.zeros(len(times), dtype=bool)
    far = ON_ITS_WAY * length
    reach = far / slow
    place, ahead, behind = (_at(course, np.clip(times + d, times[0], times[-1])) for d in (0.0, reach, -reach))
    came, goes, passes = (np.hypot(*way.T) >= far for way in (place - behind, ahead - place, ahead - behind))
    # Where the course ends before that time, what is known of the other side has to do
    came |= (times - reach < times[0]) & passes
    goes |= (times + reach > times[-1]) & passes
    moving = (speed >= slow) & came & goes
    # Between two looks it may turn round: then its speed falls from what it is in the middle by no more than that
    half = 0.5 * np.diff(times)
    middle = _at(course.derivative, times[:-1] + half)
    bend = np.hypot(*_at(course.derivative.derivative, times).T)
    # to the left of a look its piece may be another one, but second derivatives of courses are continuous
    least = np.hypot(*middle.T) - half * np.maximum(bend[:-1], bend[1:])
    jerks = least < 0.5 * slow
    moving[:-1] &= ~jerks
    moving[1:] &= ~jerks
    return times, moving


def _runs(moving: Mask) -> list[tuple[int, int]]:
    """First and last of looks in a row that are on the way, at least two of them."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], moving, [False]]).astype(np.int8)))
    return [(int(a), int(b) - 1) for a, b in edges.reshape(-1, 2) if b - a >= 2]


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
    unit = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    return [
        (float(times[k]), _turning(unit[k], unit[k + 1], float(times[k + 1] - times[k]))) for k in range(len(times) - 1)
    ]


def _turning(first: Array, last: Array, duration: float) -> Array:
    """What moves with a velocity that goes straight from one unit vector to another."""
    return np.stack([np.zeros(2), first, 0.5 * (last - first) / duration])


def _unit(course: PiecewisePolynomials, time: float) -> Array:
    velocity = _at(course.derivative, np.array([time]))[0]
    unit: Array = velocity / np.hypot(*velocity)
    return unit


def _at(polynomials: PiecewisePolynomials, times: Array) -> Array:
    return polynomials.at(np.zeros(len(times), dtype=np.intp), times)
