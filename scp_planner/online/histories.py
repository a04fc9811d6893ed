"""Observations that a scenario holds, as the tracks of a planner keep them."""

from __future__ import annotations

import numpy as np

from scp_planner.arrays import Array
from scp_planner.online.track import ObstacleTrack
from scp_planner.scenario.models import Observations


def remember(track: ObstacleTrack, seen: Observations) -> None:
    """Put the observations of an obstacle into its track."""
    each: list[Array | None] = [None] * len(seen.time)
    if seen.covariance is not None:
        given = np.array(seen.covariance)
        given = 0.5 * (given + given.swapaxes(-1, -2))  # but for rounding it is the same
        if given.ndim == 3:
            track.varying, each = True, list(given)
        else:
            track.covariance = given
    track.times, track.positions, track.covariances = list(seen.time), list(seen.position), each
