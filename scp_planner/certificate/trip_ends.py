"""Start and end of a trip against its scenario."""

from __future__ import annotations

from math import atan2

import numpy as np

from scp_planner.certificate.checked_trip import CheckedTrip
from scp_planner.certificate.ends import (
    EndState,
    beside_corridor,
    goal_violations,
    sets_out_backwards,
    start_violations,
)
from scp_planner.certificate.tolerances import END_TOLERANCE
from scp_planner.certificate.verdict import EARLIEST, Ends, Violation


def ends_broken(checked: CheckedTrip, ends: Ends) -> tuple[Violation, ...]:
    """Return what a trip breaks at its ends."""
    scenario, trajectory, frame = checked.scenario, checked.trajectory, checked.trip.frame
    path, drive = trajectory.path, trajectory.drive_at(np.array([0.0, 1.0]))
    # A trip that goes on beyond its path would be held at the goal, at a speed that it does not have.
    beyond = Violation(
        "distance beyond the path", float(drive.distance[1]) - path.driven_length, 0.0, checked.absolute(1.0)
    )
    found = [] if beyond.value <= END_TOLERANCE else [beyond]
    wanted = [k for k, end in enumerate((Ends.START, Ends.GOAL)) if end in ends]
    if not wanted:
        return tuple(found)
    # One by one: stops are asked for their start alone, and to find one station takes no NUMPY-CALLS
    points = path.points(np.concatenate([path.exact.parameter_at(drive.distance[k : k + 1]) for k in wanted]))
    position, direction = frame.to_world(points.position).tolist(), frame.vectors_to_world(points.direction).tolist()
    backwards = False  # what goes on with a trip heads as it drives
    for k, (x, y), (ahead, aside) in zip(wanted, position, direction, strict=True):
        sigma, speed, acceleration = float(k), float(drive.speed[k]), float(drive.acceleration[k])
        state = EndState(checked.absolute(sigma), (x, y), atan2(aside, ahead), speed, acceleration)
        if k:
            found += goal_violations(scenario, state, checked.absolute(0.0), backwards)
        else:
            backwards = sets_out_backwards(scenario, state)
            found += start_violations(scenario, state)
    return tuple(sorted(found, key=lambda one: one.what != EARLIEST))


def begins_beside(checked: CheckedTrip) -> Violation | None:
    """Return where what is checked of a trip begins beside the corridor; None where it begins in it."""
    if checked.scenario.corridor is None:
        return None
    trajectory, frame = checked.trajectory, checked.trip.frame
    path, drive = trajectory.path, trajectory.drive_at(np.array([checked.first]))
    point = path.points(path.exact.parameter_at(drive.distance))
    ((x, y),), ((ahead, aside),) = (
        frame.to_world(point.position).tolist(),
        frame.vectors_to_world(point.direction).tolist(),
    )
    return beside_corridor(checked.scenario, checked.absolute(checked.first), (x, y), atan2(aside, ahead))
