"""What tables of closed loops say of each of them."""

from __future__ import annotations

from typing import Any

import numpy as np

from scp_planner.simulation.run import Run


def facts_of(run: Run) -> dict[str, Any]:
    """How a closed loop went: times in s, lengths in m, what replans took (all but the first one) in ms."""
    wall = 1e3 * run.wall_times[1:]
    return {
        "arrived": int(run.arrived),
        "contact": int(run.contact),
        "contact_standing": int(run.contact_standing),
        "travel_time": run.travel_time,
        "least_clearance": run.least_clearance,
        "cycles": len(run.records),
        **run.outcomes,
        "unsafe": sum(not record.safe for record in run.records),
        "median_ms": float(np.median(wall)),
        "longest_ms": float(wall.max()),
    }
