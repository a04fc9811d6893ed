"""Ways of a vehicle with a bounded curvature: the shortest one to a goal, and how far it can go on ahead."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from scp_planner.arrays import Array, Mask, left_of, unit_vectors
from scp_planner.online.manoeuvre_courses import COURSES
from scp_planner.online.tolerances import ANGLE


@dataclass(frozen=True)
class WayParameters:
    # Degrees: arcs before a vehicle turns back
    swung: tuple[float, ...] = (8.0, 16.0, 25.0, 35.0, 46.0, 60.0, 80.0, 105.0)
    far: float = 4.0  # Radii of the tightest turn: a way on that is longer is as good as any. To turn back takes 3.1
    steps: int = 16  # Places that are looked at on that way


WAY = WayParameters()


def way_left(position: Array, heading: Array, goal: Array, radius: float, within: float = 0.0) -> Array:
    """Length of the shortest way to a goal."""
    offset = goal - position
    distance: Array = np.hypot(offset[..., 0], offset[..., 1])
    if radius == 0.0:
        return distance
    # In radii, ahead of the vehicle and to the side that the goal is on: it turns to that side about (0, 1).
    c, s = np.cos(heading), np.sin(heading)
    ahead = (c * offset[..., 0] + s * offset[..., 1]) / radius
    aside = np.abs(c * offset[..., 1] - s * offset[..., 0]) / radius
    away = np.hypot(ahead, aside - 1.0)
    outside = away >= 1.0 - within / radius
    reached = np.maximum(away, 1.0)
    turn = _angle(np.arctan2(ahead, 1.0 - aside) - np.arccos(1.0 / reached))
    length = np.where(outside, turn + np.sqrt(reached**2 - 1.0), 0.0)
    if not outside.all():
        length[~outside] = _away_and_back(ahead[~outside], aside[~outside])
    return np.asarray(length * radius)


def way_left_both_ways(
    position: Array, heading: Array, goal: Array, radius: float, within: float, turning_back: float
) -> Array:
    """Length of a short way to a goal of a vehicle that drives forward and backward, and turns back once at most."""
    first = np.stack([heading, heading + np.pi])  # the direction of driving
    plain: Array = way_left(np.broadcast_to(position, (*first.shape, 2)), first, goal, radius, within).min(axis=0)
    if radius == 0.0:
        return plain
    arcs = np.radians(WAY.swung)
    swung = np.concatenate([arcs, -arcs]).reshape(-1, *(1,) * first.ndim)
    # The chord of an arc leads half of its angle aside.
    chord, along = 2.0 * radius * np.sin(0.5 * np.abs(swung)), first + 0.5 * swung
    place = position + chord[..., None] * unit_vectors(along)
    rest = way_left(place, first + swung + np.pi, goal, radius, within)
    return np.minimum(plain, (radius * np.abs(swung) + turning_back + rest).min(axis=(0, 1)))


def _away_and_back(ahead: Array, aside: Array) -> Array:
    """Lengths to points inside of the unit circle about (0, 1), (n,): a turn about (0, -1), then one the other way."""
    apart = np.hypot(ahead, aside + 1.0)
    middle = np.arctan2(ahead, aside + 1.0)
    spread = np.arccos(np.clip((apart**2 + 3.0) / (4.0 * apart), -1.0, 1.0))
    lengths = []
    for first in (_angle(middle - spread), _angle(middle + spread)):
        center = np.stack([2.0 * np.sin(first), 2.0 * np.cos(first) - 1.0])
        seen = np.arctan2(aside - center[1], ahead - center[0])
        lengths.append(first + _angle(seen - np.arctan2(-np.cos(first), -np.sin(first))))
    return np.minimum(*lengths)


def _angle(angle: Array) -> Array:
    """An angle in [0, 2 pi)."""
    angle = np.mod(angle, 2.0 * np.pi)
    return np.where(angle > 2.0 * np.pi - ANGLE, 0.0, angle)


def _courses() -> Array:
    """Places on courses from the origin ahead, (K, steps, 2), in radii: a turn to either side, and straight on.

    Those of a turn are corners of a polygon round its arc, of which no part goes farther aside than they do.
    """
    turns = np.radians(COURSES.turns)
    turn = np.concatenate([turns, -turns[1:]])[:, None]
    way = np.linspace(0.0, WAY.far, WAY.steps + 1)[1:]
    angle = np.minimum(way, np.abs(turn))
    side, on = np.sign(turn), way - angle
    out = np.where(on > 0.0, 1.0, 1.0 / np.cos(0.5 * way[0]))
    ahead = out * np.sin(angle) + on * np.cos(angle)
    return np.stack([ahead, side * (1.0 - out * np.cos(angle) + on * np.sin(angle))], axis=-1)


_WAYS_ON = _courses()


def way_on(place: Array, heading: Array, radius: float, clear: Callable[[Array], Mask]) -> Array:
    ahead = unit_vectors(heading)
    aside = left_of(ahead)
    local = radius * _WAYS_ON
    places = place[:, None, None] + local[..., :1] * ahead[:, None, None] + local[..., 1:] * aside[:, None, None]
    driven = np.logical_and.accumulate(clear(places), axis=-1).sum(axis=-1).max(axis=-1)
    return radius * WAY.far / WAY.steps * driven
