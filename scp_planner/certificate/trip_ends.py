"""Whether a trip begins and ends as its scenario asks."""

from __future__ import annotations

from dataclasses import dataclass
from math import pi, remainder

import numpy as np

from scp_planner.arrays import Array
from scp_planner.certificate.checked_trip import CheckedTrip
from scp_planner.certificate.verdict import (
    ARRIVAL_TOLERANCE,
    EARLIEST,
    END_TOLERANCE,
    GOAL_SPEED_TOLERANCE,
    LATEST,
    Ends,
    Violation,
    off_a_step,
)
from scp_planner.scenario.goals import distance_outside
from scp_planner.scenario.models import Scenario

_BOTH_ENDS = np.array([0.0, 1.0])


@dataclass(frozen=True)
class _End:
    """A trip at one of its ends: absolute time, position and direction in the world, speed and acceleration."""

    time: float
    position: Array
    direction: Array
    speed: float
    acceleration: float


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
    beyond = float(drive.distance[1]) - path.driven_length
    found = [Violation("distance beyond the path", beyond, 0.0, checked.absolute(1.0))]
    early, headings = [], []
    if ends:
        points = path.points(path.exact.parameter_at(drive.distance))
        position, direction = frame.to_world(points.position), frame.vectors_to_world(points.direction)
        start, goal = (
            _End(
                checked.absolute(float(sigma)),
                position[k],
                direction[k],
                float(drive.speed[k]),
                float(drive.acceleration[k]),
            )
            for k, sigma in enumerate(_BOTH_ENDS)
        )
    if Ends.START in ends:
        found += _start(scenario, start)
        headings.append(_heading("start heading", scenario.start.heading, start))
    if Ends.GOAL in ends:
        earliest = scenario.goal.earliest_arrival
        if earliest is not None and goal.time < earliest - ARRIVAL_TOLERANCE:
            early.append(Violation(EARLIEST, goal.time, earliest, goal.time))
        found += _goal(scenario, goal, checked.absolute(0.0))
        headings.append(_heading("goal heading", scenario.goal.heading, goal))
    found += [one for one in headings if one is not None]
    return (*early, *(one for one in found if not one.value <= one.allowed + END_TOLERANCE))


def _start(scenario: Scenario, at: _End) -> list[Violation]:
    """How far a trip begins from what the start asks for, but for the heading."""
    start = scenario.start
    found = [
        Violation("start time", abs(at.time - start.time), 0.0, at.time),
        Violation("distance from the start", float(np.hypot(*(at.position - start.position))), 0.0, at.time),
        Violation("start speed", abs(at.speed - start.speed), 0.0, at.time),
    ]
    if start.acceleration is not None:
        error = abs(at.acceleration - start.acceleration)
        found.append(Violation("start acceleration error", error, 0.0, at.time))
    return found


def _goal(scenario: Scenario, at: _End, began: float) -> list[Violation]:
    """How far a trip ends from what the goal asks for, and what is allowed; but for its one heading."""
    goal = scenario.goal
    found = []
    if goal.region is None:
        away = float(np.hypot(*(at.position - goal.position)))
        found.append(Violation("distance from the goal", away, goal.radius, at.time))
    else:
        ahead = scenario.vehicle.centre / float(np.hypot(*at.direction))
        middle = tuple((at.position + ahead * at.direction).tolist())
        outside = distance_outside(goal.region, middle)
        found.append(Violation("distance from the goal region", outside, 0.0, at.time))
    if goal.heading_range is not None:
        low, high = goal.heading_range
        turn = remainder(float(np.arctan2(at.direction[1], at.direction[0])) - 0.5 * (low + high), 2.0 * pi)
        found.append(Violation("goal heading", max(abs(turn) - 0.5 * (high - low), 0.0), 0.0, at.time))
    if goal.speed_range is not None:
        low, high = goal.speed_range
        found.append(Violation("goal speed", max(low - at.speed, at.speed - high, 0.0), 0.0, at.time))
    if goal.arrival_step is not None:
        missed = abs(remainder(at.time - began, goal.arrival_step))
        found.append(Violation("arrival off the step", missed, off_a_step(goal.arrival_step), at.time))
    if goal.speed is not None:
        found.append(Violation("goal speed error", abs(at.speed - goal.speed), GOAL_SPEED_TOLERANCE, at.time))
    if goal.latest_arrival is not None:
        found.append(Violation(LATEST, at.time, goal.latest_arrival + ARRIVAL_TOLERANCE, at.time))
    return found


def _heading(what: str, wanted: float | None, at: _End) -> Violation | None:
    """How far a trip points from a heading that is asked for, rad."""
    if wanted is None:
        return None
    turn = np.arctan2(at.direction[1], at.direction[0]) - wanted
    return Violation(what, abs(float(np.arctan2(np.sin(turn), np.cos(turn)))), 0.0, at.time)
