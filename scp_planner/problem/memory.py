"""Memory that planning takes, estimated before any of it is taken."""

from __future__ import annotations

from scp_planner.errors import TooLargeError
from scp_planner.pauses import SEARCH_BYTES
from scp_planner.trips.space import SIZE

MOST_BYTES = 500_000_000 - SEARCH_BYTES  # of all else of a plan
_ENTRY_BYTES = 8
_BEND_ENTRIES = 140  # of a span and a variable of a step: gradients of the arc length, rows of bends, all twice
_OBSTACLE_BYTES = 4000  # of an obstacle, wherever it is: in the scene's units, and as a zone
_LOOK_ENTRIES = 24  # of a sample and a zone: centres, covariances, distances, and rows where it is near


def plan_bytes(spans: int, drive_spans: int, samples: int, zones: int) -> int:
    """Memory that a plan takes, bytes: the tables of its splines, and the arrays of one trip among near zones."""
    tables = SIZE.path_entries * spans**2 + SIZE.acceleration_entries * drive_spans**2
    bends = _BEND_ENTRIES * spans * (spans + drive_spans)
    return _ENTRY_BYTES * (tables + bends + _LOOK_ENTRIES * (samples + drive_spans) * zones)


def check_obstacles(count: int) -> None:
    """Raise `TooLargeError` for a scene of more obstacles than can be made ready, wherever they are."""
    needed = _OBSTACLE_BYTES * count
    if needed > MOST_BYTES:
        raise TooLargeError(
            f"obstacles: {count} of them would take {needed / 1e6:.0f} MB to look at; {MOST_BYTES / 1e6:.0f} MB are "
            f"allowed: at most {MOST_BYTES // _OBSTACLE_BYTES}, those that the vehicle may meet, can be planned with"
        )


def check_memory(spans: int, drive_spans: int, samples: int, zones: int) -> None:
    """Raise `TooLargeError` for what would take too much memory, saying what needs most, and what to change."""
    needed = plan_bytes(spans, drive_spans, samples, zones)
    if needed <= MOST_BYTES:
        return
    if 2 * plan_bytes(spans, drive_spans, samples, 0) > needed:
        what = f"path: {spans} spans of its spline, and acceleration: {drive_spans} spans,"
        change = "a larger path_span, a guide with wider bends, or fewer acceleration_spans need less"
    else:
        what = f"obstacles: {zones} of them that may be met, at {samples} samples each,"
        change = "fewer samples, or without obstacles that are never met, it needs less"
    raise TooLargeError(
        f"{what} would take {needed / 1e6:.0f} MB to plan with; {MOST_BYTES / 1e6:.0f} MB are allowed: {change}"
    )
