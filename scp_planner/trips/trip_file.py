"""Trips in a plan's file."""

from __future__ import annotations

from typing import Any, TypeVar

from scp_planner.mathematics.splines import clamped_knots
from scp_planner.trips.legs import Legs
from scp_planner.trips.trip import Trip

T = TypeVar("T")


def trip_written(trip: Trip) -> dict[str, Any]:
    """Return the path and the acceleration of a trip for a plan file."""
    trajectory, frame = trip.trajectory, trip.frame
    space = trajectory.space
    path_degree, drive_degree = (spline.coefficients.shape[1] - 1 for spline in (space.path, space.acceleration))
    return {
        "path": {
            "degree": path_degree,
            "knots": (clamped_knots(path_degree, space.path.breakpoints) * space.length).tolist(),
            "offsets": trajectory.theta.tolist(),
            "guide": {"origin": list(frame.origin), "heading": frame.heading, **space.guide.to_dict()},
        },
        "acceleration": {
            "degree": drive_degree,
            "knots": clamped_knots(drive_degree, space.acceleration.breakpoints).tolist(),
            "coefficients": trajectory.beta.tolist(),
            "start_speed": space.start_speed,
        },
    }


def legs_written(legs: Legs) -> dict[str, Any]:
    """Return legs for a plan file."""
    each = [
        {
            "backward": leg.backward,
            "start_time": leg.begin,
            "travel_time": leg.trip.trajectory.travel_time,
            **({} if leg.trip.trajectory.arrives else {"stops": True}),
            **trip_written(leg.trip),
        }
        for leg in legs.legs
    ]
    return {"legs": each, "first_heading": legs.first.heading, "last_heading": legs.last.heading}
