"""States of the tracks of Stone Soup, as planners take them."""

from __future__ import annotations

from datetime import UTC
from typing import Any

import numpy as np


def stone_soup_state(
    track: Any, position: tuple[int, int] = (0, 2), velocity: tuple[int, int] = (1, 3)
) -> dict[str, Any]:
    """Give the newest state of a track: ``planner.update_obstacle(track.id, **stone_soup_state(track))``.

    Parameters
    ----------
    track : stonesoup.types.track.Track
        Or a Gaussian state with a timestamp; one without a time zone is in UTC.
    position, velocity : (int, int)
        Where x and y, and their rates, are in the state vector: as in a combined model of constant velocity.

    Returns
    -------
    dict
        ``time``, s since 1970, ``position``, (2,) m, ``velocity``, (2,) m/s, and ``covariance``, (4, 4) in m and s.
    """
    state = getattr(track, "state", track)
    stamp = state.timestamp if state.timestamp.tzinfo is not None else state.timestamp.replace(tzinfo=UTC)
    index = [*position, *velocity]
    mean = np.asarray(state.state_vector, dtype=float).ravel()[index]
    covariance = np.asarray(state.covar, dtype=float)[np.ix_(index, index)]
    return {"time": stamp.timestamp(), "position": mean[:2], "velocity": mean[2:], "covariance": covariance}
