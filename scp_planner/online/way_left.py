"""Shortest way to a goal for a vehicle with a bounded curvature, without obstacles."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from scp_planner.arrays import Array
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
    place = position + chord[..., None] * np.stack([np.cos(along), np.sin(along)], axis=-1)
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
