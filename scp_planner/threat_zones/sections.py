"""Intersections of convex zones with straight lines across a guide."""

from __future__ import annotations

import numpy as np

from scp_planner.arrays import Array, Index, unit_vectors
from scp_planner.mathematics.ellipse import support
from scp_planner.mathematics.frames import covariance_turned_back, directions_of, turned_back
from scp_planner.mathematics.intervals import Interval
from scp_planner.threat_zones.batch import ZoneBatch
from scp_planner.threat_zones.tolerances import LEVEL

FAN = 16  # directions, none of them along the guide


def sections(zones: ZoneBatch, index: Index, times: Array, origins: Array, tangents: Array) -> Interval:
    """Return the offsets that zones block on lines across a guide; empty ones have lower > upper."""
    center = turned_back(zones.centers.at(index, times) - origins, tangents)
    lower, upper = np.full(len(index), -np.inf), np.full(len(index), np.inf)
    known = np.zeros(zones.size, dtype=bool)
    if zones.outlines is not None:
        known[zones.shaped] = (zones.outlines.counts > 0) & (zones.slot[zones.shaped] < 0)
    rows = np.flatnonzero(known[index])
    if len(rows):
        cut = _polygons(zones, index[rows], times[rows], center[rows], tangents[rows])
        lower[rows], upper[rows] = cut.lower, cut.upper
    others = np.flatnonzero(~known[index])
    order = others[np.argsort(index[others], kind="stable")]
    for rows in np.split(order, np.flatnonzero(np.diff(index[order])) + 1):
        if len(rows):
            cut = _one_zone(zones, int(index[rows[0]]), times[rows], center[rows], tangents[rows])
            lower[rows], upper[rows] = cut.lower, cut.upper
    return Interval(lower, upper)


def _polygons(zones: ZoneBatch, index: Index, times: Array, center: Array, tangents: Array) -> Interval:
    """Sections of polygons that are known, their centres (n, 2) given along and across the guide."""
    assert zones.outlines is not None
    heading = turned_back(np.broadcast_to([1.0, 0.0], tangents.shape), tangents)
    turning = np.flatnonzero(zones.turning[index])
    if len(turning):
        own = directions_of(zones.directions.at(index[turning], times[turning]))
        heading[turning] = turned_back(own, tangents[turning])
    starts, edge, owner = zones.outlines.ragged(zones.outline_slot[index])
    forward = (heading * [1.0, -1.0])[owner]
    corner = center[owner] + turned_back(zones.outlines.edges.start[edge], forward)
    normal = turned_back(zones.outlines.edges.normal[edge], forward)
    radius = zones.radius[index]
    fan = _fan()
    room = np.maximum.reduceat(corner @ fan.T, starts, axis=0) + radius[:, None]
    by_fan = _offsets(np.broadcast_to(fan[:, 1], room.shape), room)
    # and nu_n f <= nu . c + h of the edges, in the same way
    by_edge = _offsets(normal[:, 1], (normal * corner).sum(axis=1) + radius[owner])
    upper = np.minimum(by_fan.upper.min(axis=1), np.minimum.reduceat(by_edge.upper, starts))
    lower = np.maximum(by_fan.lower.max(axis=1), np.maximum.reduceat(by_edge.lower, starts))
    return Interval(lower, upper)


def _fan() -> Array:
    """Unit vectors, (FAN, 2), along and across the guide."""
    angle = 2.0 * np.pi * (np.arange(FAN) + 0.5) / FAN
    return unit_vectors(angle)


def _offsets(across: Array, room: Array) -> Interval:
    """Interval of offsets f with across f <= room for each direction; from inf to -inf if empty."""
    level = np.abs(across) < LEVEL
    with np.errstate(divide="ignore", invalid="ignore"):
        bound = room / across
    missed = level & (room < 0.0)
    upper = np.where(~level & (across > 0.0), bound, np.where(missed, -np.inf, np.inf))
    lower = np.where(~level & (across < 0.0), bound, np.where(missed, np.inf, -np.inf))
    return Interval(lower, upper)


def _one_zone(zones: ZoneBatch, zone: int, times: Array, center: Array, tangents: Array) -> Interval:
    """Sections of one zone, its centres (n, 2) given along and across the guide."""
    fan = _fan()
    here = np.full(len(times), zone)
    # Headings of the outline, seen from the guide
    heading = turned_back(np.broadcast_to([1.0, 0.0], tangents.shape), tangents)
    if zones.turning[zone]:
        heading = turned_back(directions_of(zones.directions.at(here, times)), tangents)
    slot = zones.outline_slot[zone]
    if slot < 0 or zones.outlines is None:
        directions = np.broadcast_to(fan, (len(times), FAN, 2))
        reach = np.full(directions.shape[:2], zones.radius[zone])
    else:
        outline = zones.outlines.outlines[slot]
        back = heading * [1.0, -1.0]
        directions = np.broadcast_to(fan, (len(times), FAN, 2))
        if outline.vertices is not None:
            edges = turned_back(np.broadcast_to(outline.normals, (len(times), *outline.normals.shape)), back[:, None])
            directions = np.concatenate([directions, edges], axis=1)
        reach = zones.radius[zone] + outline.support(turned_back(directions, heading[:, None]))
    if zones.slot[zone] >= 0 and zones.covariances is not None:
        covariance = zones.covariances.at(np.full(len(times), zones.slot[zone]), times)
        reach = reach + support(covariance_turned_back(covariance, tangents)[:, None], directions)
    # nu_n f <= nu . c + h with c = (along, across); the line is at 0 along
    room = reach + (directions * center[:, None]).sum(axis=2)
    found = _offsets(directions[:, :, 1], room)
    return Interval(found.lower.max(axis=1), found.upper.min(axis=1))
