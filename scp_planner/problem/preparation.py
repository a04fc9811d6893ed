"""How long it may take to make a scene ready: what is not ready when the time is over is refused, not planned late."""

from __future__ import annotations

from time import perf_counter

import numpy as np

from scp_planner.errors import TooLargeError
from scp_planner.pauses import GoOn


def asked_for_time(limit: float, until: float) -> GoOn | None:
    """Return what is to be asked now and then whether to go on making a scene ready.

    Parameters
    ----------
    limit : float
        The time limit, s, which is told; inf: none.
    until : float
        Value of :func:`time.perf_counter` after which it refuses.

    Returns
    -------
    callable or None
        None without a limit.

    Raises
    ------
    TooLargeError
        When it is asked too late: saying what to change.
    """
    if not np.isfinite(limit):
        return None

    def go_on() -> None:
        if perf_counter() > until:
            raise TooLargeError(
                f"time_limit: {limit:g} s are over before all obstacles are ready to be looked at, and without them no"
                " trip is safe: more time, fewer observations of each, fewer corners of polygons, or without obstacles"
                " that are never met, it can be planned"
            )

    return go_on
