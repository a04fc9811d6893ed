"""Gaps between the vehicle and what surrounds it, and contacts between two samples."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from benchmarks.everyday.motions import Array


def disc_centres(vehicle: Mapping[str, Any], place: Array, heading: float) -> Array:
    """Centres of the vehicle's discs, (n, 2) m."""
    ahead = np.array([math.cos(heading), math.sin(heading)])
    return np.asarray(place + np.array(vehicle.get("discs", [0.0]))[:, None] * ahead)


def rectangle_distance(points: Array, centre: Array, heading: float, length: float, width: float) -> Array:
    """Signed distances of points (n, 2) to a rectangle along its heading, m; negative inside."""
    cos, sin = math.cos(heading), math.sin(heading)
    apart = points - centre
    along = np.abs(cos * apart[:, 0] + sin * apart[:, 1]) - 0.5 * length
    across = np.abs(cos * apart[:, 1] - sin * apart[:, 0]) - 0.5 * width
    outside = np.hypot(np.maximum(along, 0.0), np.maximum(across, 0.0))
    return np.asarray(outside + np.minimum(np.maximum(along, across), 0.0))


def polygon_distance(points: Array, polygon: Sequence[Sequence[float]]) -> Array:
    """Signed distances of points (n, 2) to a simple polygon, m; negative inside."""
    first = np.array(polygon, dtype=float)
    second = np.roll(first, -1, axis=0)
    edge = second - first
    apart = points[:, None] - first
    share = np.clip((apart * edge).sum(axis=2) / (edge * edge).sum(axis=1), 0.0, 1.0)
    distance = np.linalg.norm(apart - share[..., None] * edge, axis=2).min(axis=1)
    above = first[:, 1] > points[:, None, 1]
    crosses = above != (second[:, 1] > points[:, None, 1])
    rise = np.where(edge[:, 1] == 0.0, 1.0, edge[:, 1])
    left = points[:, None, 0] < first[:, 0] + edge[:, 0] * (points[:, None, 1] - first[:, 1]) / rise
    inside = (crosses & left).sum(axis=1) % 2 == 1
    return np.where(inside, -distance, distance)


Pose = tuple[Array, float]
"""Position (2,) m and heading, rad."""


def gap(vehicle: Mapping[str, Any], place: Array, heading: float, shape: Mapping[str, Any], at: Pose) -> float:
    """Distance from the vehicle to an obstacle, m; negative where they overlap."""
    centres = disc_centres(vehicle, place, heading)
    if "disc" in shape:
        return float(np.linalg.norm(centres - at[0], axis=1).min() - shape["disc"] - vehicle["radius"])
    length, width = shape["rectangle"]
    return float(rectangle_distance(centres, at[0], at[1], length, width).min() - vehicle["radius"])


def least_gap(
    vehicle: Mapping[str, Any], shape: Mapping[str, Any], own: tuple[Pose, Pose], other: tuple[Pose, Pose]
) -> float:
    """Smallest gap, m, to 1 mm, while both move evenly from their first poses to their second ones."""
    lever = max(abs(each) for each in vehicle.get("discs", [0.0]))
    size = shape.get("disc") or 0.5 * math.hypot(*shape["rectangle"])
    (p0, h0), (p1, h1) = own
    (q0, g0), (q1, g1) = other
    turn, spin = math.remainder(h1 - h0, 2.0 * math.pi), math.remainder(g1 - g0, 2.0 * math.pi)
    # The gap changes by no more than this from one end to the other.
    most = float(np.hypot(*((q1 - q0) - (p1 - p0)))) + abs(turn) * lever + abs(spin) * size

    def at(share: float) -> float:
        pose = (q0 + share * (q1 - q0), g0 + share * spin)
        return gap(vehicle, p0 + share * (p1 - p0), h0 + share * turn, shape, pose)

    best = min(at(0.0), at(1.0))
    waiting = [(0.0, at(0.0), 1.0, at(1.0))]
    while waiting:
        a, at_a, b, at_b = waiting.pop()
        if 0.5 * (at_a + at_b - most * (b - a)) >= best - 1e-3:
            continue
        middle = 0.5 * (a + b)
        found = at(middle)
        best = min(best, found)
        waiting += [(a, at_a, middle, found), (middle, found, b, at_b)]
    return best


def ground_gap(scene_walls: Any, bounds: Any, vehicle: Mapping[str, Any], place: Array, heading: float) -> float:
    """Distance from the vehicle to walls and to the border of the workspace, m; infinite without any."""
    centres = disc_centres(vehicle, place, heading)
    gaps = [float(polygon_distance(centres, wall).min()) for wall in scene_walls]
    if bounds is not None:
        low, high = np.array(bounds[0]), np.array(bounds[1])
        gaps.append(float(min((centres - low).min(), (high - centres).min())))
    return min(gaps, default=math.inf) - float(vehicle["radius"])
