"""Dead ends: from where a vehicle that only drives ahead, in bends, cannot go on any more."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from scp_planner.arrays import Array, Mask
from scp_planner.online.dodge_courses import COURSES
from scp_planner.online.way_left import WAY


def _courses() -> Array:
    """Places on courses from the origin ahead, (K, steps, 2), in radii: a turn to either side, and straight on."""
    turns = np.radians(COURSES.turns)
    turn = np.concatenate([turns, -turns[1:]])[:, None]
    way = np.linspace(0.0, WAY.far, WAY.steps + 1)[1:]
    angle = np.minimum(way, np.abs(turn))
    side, on = np.sign(turn), way - angle
    ahead = np.sin(angle) + on * np.cos(angle)
    return np.stack([ahead, side * (1.0 - np.cos(angle) + on * np.sin(angle))], axis=-1)


_WAYS_ON = _courses()


def way_on(place: Array, heading: Array, radius: float, clear: Callable[[Array], Mask]) -> Array:
    ahead = np.stack([np.cos(heading), np.sin(heading)], axis=-1)
    aside = np.stack([-ahead[:, 1], ahead[:, 0]], axis=-1)
    local = radius * _WAYS_ON
    places = place[:, None, None] + local[..., :1] * ahead[:, None, None] + local[..., 1:] * aside[:, None, None]
    driven = np.logical_and.accumulate(clear(places), axis=-1).sum(axis=-1).max(axis=-1)
    longest: Array = radius * WAY.far / WAY.steps * driven
    return longest
