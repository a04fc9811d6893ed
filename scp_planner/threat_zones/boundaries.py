"""Boundaries of zones, as points."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Protocol

import numpy as np

from scp_planner.arrays import Array, unit_vectors
from scp_planner.threat_zones.zone import ThreatZone

POINTS = 60
PHASE = 0.0123
"""rad. Turns the directions, so that none is normal to an edge: the boundary point would not be unique."""
STEP = 1e-6
"""Relative step of the differences of the support function."""


class Convex(Protocol):
    """Anything convex that moves."""

    def support(self, t: Array, directions: Array) -> Array:
        """Support function about the centre at times (...) s in directions (..., 2), m."""
        ...


def boundary_of(zone: Convex, times: Array, count: int = POINTS) -> Array:
    """Points on the boundary of a convex zone about its centre: the gradient of its support function."""
    angles = PHASE + np.linspace(0.0, 2.0 * np.pi, count, endpoint=False)
    shape = (len(times), count)
    directions = np.broadcast_to(unit_vectors(angles), (*shape, 2))
    t = np.broadcast_to(times[:, None], shape)
    points = np.empty((*shape, 2))
    epsilon = STEP
    for axis in (0, 1):
        step = np.zeros(2)
        step[axis] = epsilon
        points[..., axis] = (zone.support(t, directions + step) - zone.support(t, directions - step)) / (2.0 * epsilon)
    return points


def convex_pieces_of(zone: ThreatZone) -> list[ThreatZone]:
    """Give zones of which a zone is the union, and that are convex, so that their support functions tell all."""
    if len(zone.outlines) < 2:
        return [zone]
    return [replace(zone, outlines=(outline,)) for outline in zone.outlines]


def boundaries_of(zones: Sequence[ThreatZone], times: Array, count: int = POINTS) -> Array:
    """Points on the boundaries of all convex pieces of an obstacle's zones about the centre of the first one."""
    center = zones[0].center(times)
    pieces = [
        boundary_of(piece, times, count) + (zone.center(times) - center)[:, None]
        for zone in zones
        for piece in convex_pieces_of(zone)
    ]
    return np.stack(pieces, axis=1)
