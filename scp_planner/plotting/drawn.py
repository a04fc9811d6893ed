"""Selection of a recording's zones for a map."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from scp_planner.arrays import Array, Index
from scp_planner.plotting.recording import ObstacleRecord, Recording

LARGE, UNSURE = 0.24, 1.5
"""Outlines of zones that are far away are left out if they are larger than this part of the trip's extent, and so
many times as large as the obstacle: so little is known that they would only hide what matters."""


@dataclass(frozen=True)
class SelectionParameters:
    """Sizes as parts of the trip's extent."""

    close_by: float = 0.12  # Zones no farther from the vehicle than this part of the trip's extent are filled
    crowd: int = 12  # With more obstacles than this only those near the vehicle are drawn
    # Zones larger than this part of the trip's extent are not filled: they would paint over the whole map
    covers: float = 0.5
    still: float = 1e-3  # Share of the trip's extent: an obstacle that moves and grows by less stands still
    edge: float = 0.02  # Room between the edge of the map and what just fits, as a part of the trip's extent


SELECTION = SelectionParameters()


def length_of(recording: Recording) -> float:
    """Extent of a trip, m."""
    return float(np.ptp(recording.position, axis=0).max())


def is_near(recording: Recording, obstacle: ObstacleRecord, index: int) -> bool:
    """True if an obstacle's zone is near to the vehicle at a time."""
    return bool(obstacle.clearance[index] < SELECTION.close_by * length_of(recording))


def is_shown(recording: Recording, obstacle: ObstacleRecord, index: int) -> bool:
    """True if an obstacle's zone is drawn at a time: near ones are, others if they do not hide what matters."""
    if is_near(recording, obstacle, index):
        return True
    size, own = (
        float(np.ptp(points, axis=0).max()) for points in (obstacle.zone_at(index).reshape(-1, 2), obstacle.body)
    )
    large = size > LARGE * length_of(recording) and size > UNSURE * own
    return not large and len(recording.bodies) <= SELECTION.crowd


def stands(recording: Recording, obstacle: ObstacleRecord) -> bool:
    """True if an obstacle and its zone are the same all the time."""
    # Of what really was it is known whether it stood, whatever its zones did.
    courses = [obstacle.center, obstacle.boundary] if obstacle.truth is None else [obstacle.truth]
    # What is not known of at some time is NaN, and no less than anything.
    return all(np.ptp(course, axis=0).max() < SELECTION.still * length_of(recording) for course in courses)


def nearest(obstacle: ObstacleRecord) -> int:
    """Index of the time at which an obstacle's zone is nearest to the vehicle."""
    return int(np.where(np.isnan(obstacle.clearance), np.inf, obstacle.clearance).argmin())


def map_extent(recording: Recording, indices: Index) -> tuple[Array, Array]:
    """Corners of a map on which no zone that is drawn is cut off, (2,) and (2,) m."""
    low, high = recording.extent()
    shown = [
        (obstacle, int(index))
        for obstacle in recording.bodies
        for index in ([nearest(obstacle)] if stands(recording, obstacle) else indices)
    ]
    zones = [
        obstacle.zone_at(index).reshape(-1, 2)
        for obstacle, index in shown
        if not np.isnan(obstacle.center[index]).any() and is_shown(recording, obstacle, index)
    ]
    low, high = _with(recording, low, high, zones)
    truths = [(obstacle, index, obstacle.truth_at(index)) for obstacle, index in shown]
    # what really was is looked at with the room that zones have made
    return _with(recording, low, high, [one.body_at(index, at) for one, index, at in truths if at is not None])


def _with(recording: Recording, low: Array, high: Array, parts: list[Array]) -> tuple[Array, Array]:
    """Widen a box by parts, (n, 2) m each, that reach into it, and are not too large."""
    box, edge = (low, high), SELECTION.edge * _most(recording)
    for points in parts:
        least, greatest = points.min(axis=0), points.max(axis=0)
        met = bool(((greatest > box[0]) & (least < box[1])).all())
        if met and (greatest - least).max() <= _most(recording):
            low, high = np.minimum(low, least - edge), np.maximum(high, greatest + edge)
    return low, high


def is_cut_off(recording: Recording, points: Array, low: Array, high: Array) -> bool:
    """True if points (n, 2) m hang over the edge of a map that had room for all that the trip alone shows."""
    least, greatest = points.min(axis=0), points.max(axis=0)
    inside, outside = (least >= low) & (greatest <= high), (greatest < low) | (least > high)
    return not (inside.all() or outside.any()) and bool((greatest - least).max() <= _most(recording))


def covers_all(recording: Recording, obstacle: ObstacleRecord, index: int) -> bool:
    """True if an obstacle's zone is so large that it would paint over the whole map."""
    return float(np.ptp(obstacle.zone_at(index).reshape(-1, 2), axis=0).min()) > SELECTION.covers * length_of(recording)


def _most(recording: Recording) -> float:
    """Extent of the largest zone that a map has room for, m."""
    return max(length_of(recording), 4.0 * recording.radius)
