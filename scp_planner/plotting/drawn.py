"""What of a recording a map shows: which zones at which times, and how much room they take."""

from __future__ import annotations

import numpy as np

from scp_planner.arrays import Array, Index
from scp_planner.plotting.recording import ObstacleRecord, Recording

CLOSE_BY = 0.12
"""Zones no farther from the vehicle than this part of the trip's extent are filled."""
CROWD = 12
"""With more obstacles than this only those near the vehicle are drawn."""
LARGE, UNSURE = 0.24, 1.5
"""Outlines of zones that are far away are left out if they are larger than this part of the trip's extent, and so
many times as large as the obstacle: so little is known that they would only hide what matters."""
STILL = 1e-3
"""What moves and grows by less than this part of the trip's extent stands."""
EDGE = 0.02
"""Room between the edge of the map and what just fits, as a part of the trip's extent."""


def length_of(recording: Recording) -> float:
    """Extent of a trip, m."""
    return float(np.ptp(recording.position, axis=0).max())


def is_near(recording: Recording, obstacle: ObstacleRecord, index: int) -> bool:
    """Whether an obstacle's zone is near to the vehicle at a time."""
    return bool(obstacle.clearance[index] < CLOSE_BY * length_of(recording))


def is_shown(recording: Recording, obstacle: ObstacleRecord, index: int) -> bool:
    """Whether an obstacle's zone is drawn at a time: near ones are, others if they do not hide what matters."""
    if is_near(recording, obstacle, index):
        return True
    size, own = (
        float(np.ptp(points, axis=0).max()) for points in (obstacle.zone_at(index).reshape(-1, 2), obstacle.body)
    )
    large = size > LARGE * length_of(recording) and size > UNSURE * own
    return not large and len(recording.bodies) <= CROWD


def stands(recording: Recording, obstacle: ObstacleRecord) -> bool:
    """Whether an obstacle and its zone are the same all the time."""
    # Of what really was it is known whether it stood, whatever its zones did.
    courses = [obstacle.center, obstacle.boundary] if obstacle.truth is None else [obstacle.truth]
    # What is not known of at some time is NaN, and no less than anything.
    return all(np.ptp(course, axis=0).max() < STILL * length_of(recording) for course in courses)


def nearest(obstacle: ObstacleRecord) -> int:
    """Index of the time at which an obstacle's zone is nearest to the vehicle."""
    return int(np.where(np.isnan(obstacle.clearance), np.inf, obstacle.clearance).argmin())


def map_extent(recording: Recording, indices: Index) -> tuple[Array, Array]:
    """Corners of a map on which no zone that is drawn is cut off, (2,) and (2,) m.

    Zones that do not even touch the recording's own extent stay outside, and those that are larger than the trip
    are cut off all the same: they would shrink it to a dot.

    Parameters
    ----------
    recording : Recording
    indices : (k,) array of int
        Of the times that the map shows.

    Returns
    -------
    low, high : (2,) arrays
        m.
    """
    low, high = recording.extent()
    box, most = (low, high), max(length_of(recording), 4.0 * recording.radius)
    edge = EDGE * most
    for obstacle in recording.bodies:
        times = [nearest(obstacle)] if stands(recording, obstacle) else [int(index) for index in indices]
        for index in times:
            for points in _drawn_at(recording, obstacle, index):
                least, greatest = points.min(axis=0), points.max(axis=0)
                met = bool(((greatest > box[0]) & (least < box[1])).all())
                if met and (greatest - least).max() <= most:
                    low, high = np.minimum(low, least - edge), np.maximum(high, greatest + edge)
    return low, high


def _drawn_at(recording: Recording, obstacle: ObstacleRecord, index: int) -> list[Array]:
    """Points of all that is drawn of an obstacle at a time, (n, 2) m each."""
    parts = []
    if not np.isnan(obstacle.center[index]).any() and is_shown(recording, obstacle, index):
        parts.append(obstacle.zone_at(index).reshape(-1, 2))
    center = obstacle.truth_at(index)
    if center is not None:
        parts.append(obstacle.body_at(index, center))
    return parts
