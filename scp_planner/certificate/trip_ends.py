"""Whether a trip begins and ends as its scenario asks."""

from __future__ import annotations

from math import atan2

import numpy as np

from scp_planner.certificate.checked_trip import CheckedTrip
from scp_planner.certificate.ends import EndState, goal_violations, start_violations
from scp_planner.certificate.verdict import EARLIEST, END_TOLERANCE, Ends, Violation

_BOTH_ENDS = np.array([0.0, 1.0])


def ends_broken(checked: CheckedTrip, ends: Ends) -> tuple[Violation, ...]:
    """Return what a trip breaks at its ends.

    Parameters
    ----------
    checked : CheckedTrip
    ends : Ends
        That must be those of the scenario.

    Returns
    -------
    tuple of Violation
    """
    scenario, trajectory, frame = checked.scenario, checked.trajectory, checked.trip.frame
    path, drive = trajectory.path, trajectory.drive_at(_BOTH_ENDS)
    # A trip that goes on beyond its path would be held at the goal, at a speed that it does not have.
    beyond = Violation(
        "distance beyond the path", float(drive.distance[1]) - path.driven_length, 0.0, checked.absolute(1.0)
    )
    found = [] if beyond.value <= END_TOLERANCE else [beyond]
    if ends:
        points = path.points(path.exact.parameter_at(drive.distance))
        position, direction = frame.to_world(points.position), frame.vectors_to_world(points.direction)
        start, goal = (
            EndState(
                checked.absolute(float(sigma)),
                (float(position[k, 0]), float(position[k, 1])),
                atan2(direction[k, 1], direction[k, 0]),
                float(drive.speed[k]),
                float(drive.acceleration[k]),
            )
            for k, sigma in enumerate(_BOTH_ENDS)
        )
    if Ends.START in ends:
        found += start_violations(scenario, start)
    if Ends.GOAL in ends:
        found += goal_violations(scenario, goal, checked.absolute(0.0))
    return tuple(sorted(found, key=lambda one: one.what != EARLIEST))
