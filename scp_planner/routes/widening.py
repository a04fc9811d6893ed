"""Routes with wider bends: elastic bands between all that stands.

A taut polyline turns at corners, perhaps tighter than the vehicle can. Here its points move along their normals, as
far as there is room, to the least of the integral of curvature^2 + tension. The tension is that of bends of a wanted
radius, and the curvature has more weight where it is above what the vehicle can (S. Quinlan and O. Khatib, Elastic
bands: connecting path planning and control, ICRA 1993).
"""

from __future__ import annotations

from dataclasses import dataclass
from math import inf

import numpy as np
from scipy.linalg import solveh_banded

from scp_planner.arrays import Array, left_of
from scp_planner.mathematics.polylines import points_at
from scp_planner.mathematics.taut import ConvexPolygons
from scp_planner.scenario.limits import Box


@dataclass(frozen=True)
class WideningSettings:
    """Shape and fineness of the bands; lengths are in least turning radii of the vehicle."""

    tension: float = 0.56  # 1 / radius of the bends that are wanted, by which a band without room turns round a point
    allowed: float = 0.88  # curvature above which it has more weight: in proportion to it, after each move
    apart: float = 0.025  # distance that is kept from what stands
    step: float = 0.25  # between points
    seen: float = 1.0  # of the smallest size of a polygon, between points at most: none lies between two of them
    most_points: int = 2000
    farthest: float = 1.25  # to a side in one move
    moves: int = 12  # of all points
    steps: int = 25  # of the interior point method, in a move
    barrier: float = 0.4  # factor of its barrier in each step
    closest: float = 0.95  # share of the way to the bounds that a step goes at most


WIDENING = WideningSettings()


def widened(points: Array, polygons: ConvexPolygons, box: Box, radius: float, fixed: tuple[int, int]) -> Array:
    """Return a polyline, (n, 2) m, with bends of a radius, m, where there is room; so many points at its ends stay."""
    length = float(np.hypot(*np.diff(points, axis=0).T).sum())
    smallest = float((polygons.high - polygons.low).min(initial=inf))
    step = min(WIDENING.step * radius, WIDENING.seen * smallest)
    count = min(round(length / step), WIDENING.most_points)
    if count < 2 + sum(fixed):
        return points
    weights = np.ones(count - 1)
    for _ in range(WIDENING.moves):
        points = _resampled(points, count)
        tangents = np.gradient(points, axis=0)
        tangents /= np.hypot(*tangents.T)[:, None]
        normals = left_of(tangents)
        step = float(np.hypot(*np.diff(points, axis=0).T).mean())
        bends = radius * np.hypot(*np.diff(points, 2, axis=0).T) / step**2
        weights = weights * np.maximum(bends / WIDENING.allowed, 1.0)
        low, high = _room(points, normals, polygons, box, radius)
        bands, force = _energy(points, normals, weights, (WIDENING.tension * step / radius) ** 2)
        free = slice(fixed[0], len(points) - fixed[1])
        moves = _least(bands[:, free], force[free], low[free], high[free])
        points[free] += moves[:, None] * normals[free]
    return points


def _resampled(points: Array, count: int) -> Array:
    """Points at equal distances along a polyline, one more than ``count``."""
    along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(points, axis=0).T))])
    places = np.linspace(0.0, along[-1], count + 1)
    return points_at(places, along, points)


def _room(points: Array, normals: Array, polygons: ConvexPolygons, box: Box, radius: float) -> tuple[Array, Array]:
    """Return the least, negative, and largest moves of points along their normals, m."""
    most, apart = WIDENING.farthest * radius, WIDENING.apart * radius
    low, high = np.full(len(points), -most), np.full(len(points), most)
    point, polygon = polygons.near(points, points, most)
    sides, offsets = polygons.take(polygon)
    distance = offsets - np.einsum("pei,pi->pe", sides, points[point])
    slope = np.einsum("pei,pi->pe", sides, normals[point])
    with np.errstate(divide="ignore", invalid="ignore"):
        share = distance / slope
    enters = np.where(slope < 0.0, share, -inf).max(axis=1)
    leaves = np.where(slope > 0.0, share, inf).min(axis=1)
    met = (enters < leaves) & ~((slope == 0.0) & (distance < 0.0)).any(axis=1)
    left = enters + leaves > 0.0
    np.minimum.at(high, point[met & left], enters[met & left] - apart)
    np.maximum.at(low, point[met & ~left], leaves[met & ~left] + apart)
    for normal, offset in zip(box.normals, box.offsets.tolist(), strict=True):
        towards, room = normals @ normal, offset - apart - points @ normal
        with np.errstate(divide="ignore", invalid="ignore"):
            share = room / towards
        high = np.where(towards > 0.0, np.minimum(high, share), high)
        low = np.where(towards < 0.0, np.maximum(low, share), low)
    # A point outside the box, along whose border it moves, would come back only far away
    return np.clip(low, -most, most), np.clip(high, -most, most)


def _energy(points: Array, normals: Array, weights: Array, tension: float) -> tuple[Array, Array]:
    """Hessian, by its lower bands, and gradient of the energy by moves along the normals."""
    count = len(points)
    dots = [np.einsum("ij,ij->i", normals[: count - k], normals[k:]) for k in (1, 2)]
    bands, pull = np.zeros((3, count)), np.zeros((count, 2))
    second, first = weights[:, None] * np.diff(points, 2, axis=0), tension * np.diff(points, axis=0)
    for k, factor in enumerate((1.0, -2.0, 1.0)):  # of the second differences
        bands[0, k : count - 2 + k] += factor**2 * weights
        pull[k : count - 2 + k] += factor * second
    for k in (0, 1):
        bands[1, k : count - 2 + k] -= 2.0 * dots[0][k : count - 2 + k] * weights
        bands[0, k : count - 1 + k] += tension
    bands[1, : count - 1] -= tension * dots[0]
    bands[2, : count - 2] = dots[1] * weights
    pull[:-1] -= first
    pull[1:] += first
    return bands, np.einsum("ij,ij->i", pull, normals)


def _least(bands: Array, force: Array, low: Array, high: Array) -> Array:
    """Least of x' H x / 2 + force' x between bounds, by a primal interior point method."""
    middle, half = 0.5 * (low + high), np.maximum(0.5 * (high - low), 1e-6 * float(np.abs(high).max()))
    low, high, x = middle - half, middle + half, middle
    barrier = float(bands[0].max() * half.max()) * half
    least = np.spacing(np.abs(low) + np.abs(high))  # m, from a bound: what rounding leaves of nearer points
    for _ in range(WIDENING.steps):
        product = bands[0] * x
        for k in (1, 2):
            product[k:] += bands[k, :-k] * x[:-k]
            product[:-k] += bands[k, :-k] * x[k:]
        above, below = np.maximum(x - low, least), np.maximum(high - x, least)
        system = bands.copy()
        system[0] += barrier / above**2 + barrier / below**2
        move = solveh_banded(system, barrier / above - barrier / below - product - force, lower=True)
        used = np.maximum(move / below, -move / above).max()
        x = x + min(1.0, WIDENING.closest / max(float(used), WIDENING.closest)) * move
        barrier = WIDENING.barrier * barrier
    return x
