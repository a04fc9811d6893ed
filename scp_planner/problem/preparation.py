"""Time that it may take to make a scene ready."""

from __future__ import annotations

from time import perf_counter

import numpy as np

from scp_planner.pauses import GoOn, OutOfTimeError

PREPARING, LEAST_PREPARING = 0.85, 0.01  # of the time limit, and s: after that the rest is too little to plan in


CHECKING, LEAST_CHECKING = 0.05, 0.01  # of the time limit, and s, by which the last certificate may go over it
BEFORE_CHECK = 0.9  # of the time that is left, for a plan whose certificate among more follows


def last_check(limit: float | None, began: float) -> float:
    """Return when the last certificate is given up, a value of :func:`time.perf_counter`."""
    return np.inf if limit is None else began + (1.0 + CHECKING) * limit + LEAST_CHECKING


def left_before_check(limit: float | None, began: float) -> float | None:
    """Return the wall time for a plan whose certificate among more follows, s; None: any."""
    return None if limit is None else max(BEFORE_CHECK * (began + limit - perf_counter()), 0.0)


def asked_for_time(limit: float, began: float) -> GoOn | None:
    """Return what is to be asked now and then whether to go on making a scene ready."""
    if not np.isfinite(limit):
        return None
    until = began + PREPARING * limit + LEAST_PREPARING

    def go_on() -> None:
        if perf_counter() > until:
            raise OutOfTimeError(
                f"time_limit: most of {limit:g} s is over before all obstacles are ready to be looked at, and without"
                " them no trip is safe: with more time, fewer observations of each, fewer corners of polygons, or"
                " without obstacles that are never met, it can be planned"
            )

    return go_on
