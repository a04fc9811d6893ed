"""Optimal reciprocal collision avoidance: how discs that see each other's velocities give way to each other."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from itertools import combinations

import numpy as np

from scp_planner.arrays import Array, Index, cross, left_of
from scp_planner.simulation.tolerances import PARALLEL, ROUNDING


@dataclass(frozen=True)
class Bodies:
    """Discs that move."""

    position: Array  # (..., 2) m, m/s
    velocity: Array  # (..., 2) m, m/s
    radius: Array  # (...) m


@dataclass(frozen=True)
class HalfPlanes:
    """Velocities v with ``normal . v >= offset``, for each row."""

    normal: Array  # (..., M, 2)
    offset: Array  # (..., M) m/s; minus infinity where there is no row


def half_planes(own: Bodies, other: Bodies, horizon: float, step: float, share: float = 0.5) -> HalfPlanes:
    """Half-planes of ORCA for each pair of bodies."""
    place = other.position - own.position
    reach = own.radius + other.radius
    relative = own.velocity - other.velocity
    apart = np.hypot(place[..., 0], place[..., 1])
    within = np.where(apart > reach, horizon, step)
    # The obstacle of velocities is a cone cut off by a disc of radius reach / within about place / within.
    from_disc = relative - place / within[..., None]
    size = np.hypot(from_disc[..., 0], from_disc[..., 1])
    towards = _dot(from_disc, place)
    on_disc = (apart <= reach) | ((towards < 0.0) & (towards**2 > (reach * size) ** 2))
    outward = from_disc / np.where(size > 0.0, size, 1.0)[..., None]
    away = np.where((apart > 0.0)[..., None], -place / np.where(apart > 0.0, apart, 1.0)[..., None], [1.0, 0.0])
    outward = np.where((size > 0.0)[..., None], outward, away)
    depth = reach / within - size
    # Otherwise the nearer leg; its outward normal is that of a tangent of the disc about place through the origin.
    left = cross(place, from_disc) > 0.0
    leg = np.sqrt(np.maximum(apart**2 - reach**2, 0.0))
    side = np.where(left, 1.0, -1.0)
    across = side[..., None] * left_of(place)
    square = np.where(apart > 0.0, apart, 1.0)[..., None] ** 2
    leg_normal = (leg[..., None] * across - reach[..., None] * place) / square
    normal = np.where(on_disc[..., None], outward, leg_normal)
    # To the border of the obstacle: u = depth * normal.
    depth = np.where(on_disc, depth, -_dot(leg_normal, relative))
    return HalfPlanes(normal, _dot(normal, own.velocity) + share * depth)


def nearest_velocities(rows: HalfPlanes, wanted: Array, top_speed: Array) -> Array:
    """Velocities nearest to those that are wanted, in all half-planes and within the top speed."""
    # In multiples of the top speed, so that it is 1.
    scale = top_speed[:, None]
    wanted, rows = wanted / scale, _binding(HalfPlanes(rows.normal, rows.offset / scale))
    candidates = _vertices(rows, wanted)
    slack = candidates @ rows.normal.transpose(0, 2, 1) - rows.offset[:, None, :]
    least = slack.min(axis=2, initial=np.inf)
    kept = (least >= -ROUNDING) & (np.hypot(candidates[..., 0], candidates[..., 1]) <= 1.0 + ROUNDING)
    distance = np.where(kept, ((candidates - wanted[:, None]) ** 2).sum(axis=2), np.inf)
    best = np.argmin(distance, axis=1)
    found = candidates[np.arange(len(wanted)), best]
    for k in np.flatnonzero(~kept.any(axis=1)):
        found[k] = _least_bad(rows.normal[k], rows.offset[k], wanted[k])
    return np.asarray(found * scale)


def _binding(rows: HalfPlanes) -> HalfPlanes:
    """Rows that exclude any velocity of the unit disc; as many for each body as for the one with the most."""
    order = np.argsort(-rows.offset, axis=1, kind="stable")
    many = int((rows.offset > -1.0).sum(axis=1).max(initial=0))
    order = order[:, :many]
    return HalfPlanes(
        np.take_along_axis(rows.normal, order[..., None], axis=1), np.take_along_axis(rows.offset, order, axis=1)
    )


def _vertices(rows: HalfPlanes, wanted: Array) -> Array:
    """Candidates of the nearest velocity, (N, C, 2): the wish, its feet on disc and lines, intersections."""
    normal, offset = rows.normal, np.where(np.isfinite(rows.offset), rows.offset, 2.0)
    count, lines = offset.shape
    size = np.hypot(wanted[:, 0], wanted[:, 1])[:, None]
    limited = wanted / np.maximum(size, 1.0)
    missing = offset - (normal @ wanted[..., None])[..., 0]
    feet = wanted[:, None] + missing[..., None] * normal
    half = np.sqrt(np.maximum(1.0 - offset**2, 0.0))[..., None]
    along = left_of(normal)
    middle = offset[..., None] * normal
    parts = [limited[:, None], feet, middle + half * along, middle - half * along]
    if lines > 1:
        one, two = np.triu_indices(lines, 1)
        parts.append(_meeting(normal[:, one], offset[:, one], normal[:, two], offset[:, two]))
    return np.concatenate(parts, axis=1).reshape(count, -1, 2)


def _meeting(one: Array, first: Array, two: Array, second: Array) -> Array:
    """Intersections of lines, (..., 2); far outside where there are none."""
    sine = cross(one, two)
    parallel = np.abs(sine) < PARALLEL
    sine = np.where(parallel, 1.0, sine)
    x = (first * two[..., 1] - second * one[..., 1]) / sine
    y = (second * one[..., 0] - first * two[..., 0]) / sine
    return np.where(parallel[..., None], 2.0, np.stack([x, y], axis=-1))


def _least_bad(normal: Array, offset: Array, wanted: Array) -> Array:
    """The velocity in the unit disc that is out of the worst half-plane by least, (2,); of several the nearest."""
    there = np.isfinite(offset)
    normal, offset = normal[there], offset[there]
    parts = [normal]
    lines = len(offset)
    if lines > 1:
        one, two = np.triu_indices(lines, 1)
        parts.append(_on_disc(normal[one] - normal[two], offset[one] - offset[two]))
    if lines > 2:
        i, j, k = _triples(lines)
        parts.append(
            _meeting(normal[i] - normal[j], offset[i] - offset[j], normal[i] - normal[k], offset[i] - offset[k])
        )
    candidates = np.concatenate(parts)
    inside = np.hypot(candidates[:, 0], candidates[:, 1]) <= 1.0 + ROUNDING
    candidates = candidates[inside]
    least = (candidates @ normal.T - offset).min(axis=1)
    equal = candidates[least >= least.max() - ROUNDING]
    return np.asarray(equal[np.argmin(((equal - wanted) ** 2).sum(axis=1))])


def _on_disc(normal: Array, offset: Array) -> Array:
    """Intersections of lines normal . v = offset, (K, 2) and (K,), with the unit circle, (2 K, 2)."""
    size = np.hypot(normal[:, 0], normal[:, 1])
    some = size > PARALLEL
    size = np.where(some, size, 1.0)
    unit, distance = normal / size[:, None], offset / size
    meets = (some & (np.abs(distance) <= 1.0))[:, None]
    half = np.sqrt(np.maximum(1.0 - distance**2, 0.0))[:, None]
    along = left_of(unit)
    middle = distance[:, None] * unit
    return np.concatenate([np.where(meets, middle + half * along, 2.0), np.where(meets, middle - half * along, 2.0)])


@cache
def _triples(count: int) -> Index:
    return np.array(list(combinations(range(count), 3)), dtype=np.intp).T


def _dot(one: Array, two: Array) -> Array:
    return np.asarray(one[..., 0] * two[..., 0] + one[..., 1] * two[..., 1])
