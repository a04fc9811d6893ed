"""Guides along polylines with rounded corners, and along curves that are known by their headings."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from scp_planner.arrays import Array, cross, left_of
from scp_planner.errors import TooLargeError
from scp_planner.mathematics.tolerances import SAME_DIRECTION
from scp_planner.trips.guide import CurvedGuide, Guide, StraightGuide


@dataclass(frozen=True)
class Smoothing:
    """Rounding of the corners of a polyline."""

    sharp: float = 0.3  # rad; corners that turn by less are rounded by the moving average alone
    arc_step: float = 0.15  # rad, between the points of an arc
    least_bend: float = 0.2  # radii; tighter bends, which have no room, are averaged over as much as these
    window: float = 1.5  # radii: width of the moving average
    samples_per_window: int = 60
    most_samples: int = 500_000  # of the average: windows get wider on guides that would need more
    # numbers in an array on the way to it: half a megabyte, as fetching more memory takes longer
    most_at_once: int = 2**16
    few_changes: int = 64  # of direction, that are looked at together
    loop: float = 0.01  # of its length: a guide whose ends are nearer to each other can not be turned and scaled
    bendings: int = 5  # of a loop, each of which misses the end by about the square of before
    most_pieces: int = 3400  # of the heading's spline: what the tables of paths over it have room for


SMOOTHING = Smoothing()


def smooth_guide(points: Array, radius: float, piece: float = 0.3, multiple: int = 5) -> Guide:
    """Return a guide along a polyline, its corners rounded."""
    lengths = np.hypot(*np.diff(points, axis=0).T)
    check_pieces(float(lengths.sum()), piece)
    corners, least = _rounded(np.asarray(points, dtype=float)[np.append(True, lengths > 0.0)], radius)
    legs = np.diff(corners, axis=0)
    lengths = np.hypot(legs[:, 0], legs[:, 1])
    directions = legs / lengths[:, None]
    turns = np.abs(directions[1:, 0] * directions[:-1, 1] - directions[1:, 1] * directions[:-1, 0])
    if np.all(turns < SAME_DIRECTION):
        return StraightGuide(float(np.hypot(*(corners[-1] - corners[0]))))
    places = np.cumsum(lengths)[:-1]
    total = float(lengths.sum())
    half = max(
        0.5 * min(SMOOTHING.window * least, 0.5 * total), SMOOTHING.samples_per_window * total / SMOOTHING.most_samples
    )
    # The average of the polyline over the window has this derivative; beyond its ends the polyline goes straight on.
    u = np.linspace(0.0, total, max(400, int(SMOOTHING.samples_per_window * total / half)) + 1)
    derivative = _averaged(directions, places, u, half)
    phi = np.unwrap(np.arctan2(derivative[:, 1], derivative[:, 0]))
    speed = np.hypot(derivative[:, 0], derivative[:, 1])
    driven = np.concatenate([[0.0], np.cumsum(0.5 * (speed[1:] + speed[:-1]) * np.diff(u))])
    pieces = multiple * max(4, round(driven[-1] / (multiple * piece)))
    headings = np.interp(np.linspace(0.0, driven[-1], pieces + 1), driven, phi)
    return _ending_at(corners[-1] - corners[0], driven[-1], headings)


def _averaged(directions: Array, places: Array, u: Array, half: float) -> Array:
    """Directions (n + 1, 2) that change at places (n,), averaged over a window about u, (m, 2); all along one line."""
    changes = np.diff(directions, axis=0)
    if len(u) * len(places) <= SMOOTHING.most_at_once:
        return directions[0] + _shares(u, places, half) @ changes
    averaged = np.empty((len(u), 2))
    first, last = np.searchsorted(places, u - half), np.searchsorted(places, u + half)
    begin = 0
    while begin < len(u):
        # As many as share most of their changes: others are looked at for nothing
        shared = first[begin] + max(2 * (last[begin] - first[begin]), SMOOTHING.few_changes)
        most = max(1, SMOOTHING.most_at_once // (shared - first[begin]))
        end = begin + min(max(1, int(np.searchsorted(last[begin:], shared, "right"))), most)
        near = slice(first[begin], last[end - 1])
        averaged[begin:end] = directions[near.start] + _shares(u[begin:end], places[near], half) @ changes[near]
        begin = end
    return averaged


def _shares(u: Array, places: Array, half: float) -> Array:
    """Share of the change at each place at each u, (m, n): 0 before the window, and 1 after it."""
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
    """Refuse a curve that would need more pieces than a guide may have, before anything is allocated."""
    if length > SMOOTHING.most_pieces * piece:
        raise TooLargeError(
            f"guide: a curve of {length:.6g} m in pieces of {piece:.3g} m would have {length / piece:.3g} of them;"
            f" at most {SMOOTHING.most_pieces} are allowed: a larger path_span makes them longer"
        )


def guide_through(headings: Array, length: float, goal: Array) -> CurvedGuide:
    """Return a guide along a curve that is known by its headings."""
    return _ending_at(goal, length, headings)


def _ending_at(goal: Array, length: float, headings: Array) -> CurvedGuide:
    """Return the guide with these headings, turned and scaled so that it ends at a point; a loop, bent all along."""
    if float(np.hypot(*goal)) < SMOOTHING.loop * length:
        return _bent_to(goal, length, headings)
    end = CurvedGuide(length, headings).frame(np.array([length])).position[0]
    turn = np.arctan2(goal[1], goal[0]) - np.arctan2(end[1], end[0])
    turn = np.arctan2(np.sin(turn), np.cos(turn))
    return CurvedGuide(length * float(np.hypot(*goal) / np.hypot(*end)), headings + turn)


def _bent_to(goal: Array, length: float, headings: Array) -> CurvedGuide:
    """Return the guide whose headings differ the least from these, and not at its ends, and that ends at a point."""
    weight = np.sin(np.linspace(0.0, np.pi, len(headings))) ** 2
    for _ in range(SMOOTHING.bendings):
        guide = CurvedGuide(length, headings)
        across = left_of(np.stack([np.cos(headings), np.sin(headings)], axis=1))
        moved = (length / len(headings)) * (weight[:, None] * across).T @ across  # of the end, by such a change
        missed = goal - guide.frame(np.array([length])).position[0]
        headings = headings + weight * (across @ np.linalg.solve(moved, missed))
    return CurvedGuide(length, headings)


def _rounded(points: Array, radius: float) -> tuple[Array, float]:
    """The polyline with arcs, of many short legs, in place of its sharp corners; and the least radius of them."""
    legs = np.diff(points, axis=0)
    lengths = np.hypot(legs[:, 0], legs[:, 1])
    directions = legs / lengths[:, None]
    before, after = directions[:-1], directions[1:]
    turn = np.arctan2(cross(before, after), before[:, 0] * after[:, 0] + before[:, 1] * after[:, 1])
    sharp = np.abs(turn) >= SMOOTHING.sharp
    # An inner leg is shared by its two corners.
    each = np.where((np.arange(len(legs)) == 0) | (np.arange(len(legs)) == len(legs) - 1), 1.0, 0.5)
    room = np.minimum(lengths[:-1] * each[:-1], lengths[1:] * each[1:])
    slope = np.tan(np.minimum(0.5 * np.abs(np.where(sharp, turn, SMOOTHING.sharp)), 0.499 * np.pi))
    tangent = np.minimum(radius * slope, 0.999 * room)
    bend = tangent / slope
    least = float(np.maximum(bend[sharp], SMOOTHING.least_bend * radius).min(initial=radius))
    spoke = (-bend * np.sign(turn))[:, None] * left_of(before)
    centre = points[1:-1] - tangent[:, None] * before - spoke
    steps = np.where(sharp, np.ceil(np.abs(turn) / SMOOTHING.arc_step), 0.0).astype(np.intp)
    corner = np.repeat(np.arange(len(turn)), steps + 1)
    number = np.arange(len(corner)) - np.repeat(np.cumsum(steps + 1) - (steps + 1), steps + 1)
    angle = turn[corner] * (number / np.maximum(steps, 1)[corner])
    c, s = np.cos(angle)[:, None], np.sin(angle)[:, None]
    from_centre = spoke[corner]
    arcs = centre[corner] + c * from_centre + s * left_of(from_centre)
    polyline = np.concatenate([points[:1], np.where(sharp[corner, None], arcs, points[1:-1][corner]), points[-1:]])
    apart = np.hypot(*np.diff(polyline, axis=0).T) > 1e-9 * max(1.0, float(lengths.sum()))
    return polyline[np.concatenate([[True], apart])], least
