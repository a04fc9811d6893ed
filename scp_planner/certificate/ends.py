"""End conditions of a trip against its scenario, whoever made the trip."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from math import atan2, cos, dist, pi, remainder, sin

import numpy as np

from scp_planner.certificate.checked_trip import CheckedTrip
from scp_planner.certificate.tolerances import ARRIVAL_TOLERANCE, END_TOLERANCE, GOAL_SPEED_TOLERANCE, LENGTH_TOLERANCE
from scp_planner.certificate.verdict import EARLIEST, LATEST, OFF_STEP, Ends, Violation, off_a_step
from scp_planner.mathematics import corridor
from scp_planner.mathematics.planar import distance_to_polygon
from scp_planner.scenario.goals import distance_outside
from scp_planner.scenario.models import Goal, Scenario, Steering, Vehicle
from scp_planner.threat_zones.target import goal_on_arrival
from scp_planner.units import Point


@dataclass(frozen=True)
class EndState:
    """A trip at one of its ends."""

    time: float  # Absolute, s
    position: Point  # In world coordinates, m
    heading: float  # rad
    speed: float  # m/s
    acceleration: float  # Along the path, m/s^2


def can_reverse(vehicle: Vehicle, speed: float) -> bool:
    """True if it can set out against its heading as well as along it, at a speed in units of the scene."""
    return vehicle.steering is Steering.BOTH_WAYS and speed <= END_TOLERANCE


def sets_out_backwards(scenario: Scenario, first: EndState) -> bool:
    """True if a trip that begins so sets out from a stand against the heading of the start: the front is behind."""
    wanted = scenario.start.heading
    return wanted is not None and can_reverse(scenario.vehicle, first.speed) and cos(first.heading - wanted) < 0.0


def start_violations(scenario: Scenario, first: EndState) -> Iterator[Violation]:
    """Tell how a trip begins otherwise than its scenario asks, both in natural units."""
    start = scenario.start
    found = [
        ("start time", abs(first.time - start.time)),
        ("distance from the start", dist(first.position, start.position)),
        ("start speed", abs(first.speed - start.speed)),
    ]
    if start.acceleration is not None:
        found.append(("start acceleration error", abs(first.acceleration - start.acceleration)))
    if start.heading is not None:
        round_to = pi if can_reverse(scenario.vehicle, first.speed) else 2.0 * pi
        found.append(("start heading", abs(remainder(first.heading - start.heading, round_to))))
    for name, value in found:
        if not value <= END_TOLERANCE:
            yield Violation(name, value, 0.0, first.time)


def beside_corridor(scenario: Scenario, time: float, position: Point, heading: float) -> Violation | None:
    """Tell how far beside the corridor a disc of the vehicle begins; None where all begin in it."""
    if scenario.corridor is None:
        return None
    for offset in scenario.vehicle.discs:
        centre = _ahead(position, heading, offset)
        beside = min(distance_to_polygon(centre, polygon) for polygon in scenario.corridor)
        if beside > LENGTH_TOLERANCE:
            return Violation("clearance", -beside, 0.0, time, corridor.NAME)
    return None


def goal_violations(scenario: Scenario, last: EndState, began: float, backwards: bool) -> Iterator[Violation]:
    """Tell how a trip ends otherwise than its scenario asks, both in natural units."""
    goal, time = goal_on_arrival(scenario, last.time), last.time
    yield from _window(scenario, time, began)
    found = [*_place(scenario.vehicle, goal, last, backwards), *_heading_and_speed(goal, last)]
    if goal.arrival_step is not None:
        missed = abs(remainder(time - began, goal.arrival_step))
        found.append(Violation(OFF_STEP, missed, off_a_step(goal.arrival_step), time))
    yield from (one for one in found if not one.value <= one.allowed + END_TOLERANCE)


def _window(scenario: Scenario, time: float, began: float) -> Iterator[Violation]:
    """Tell whether it arrives too early or too late; on a step, which is nearly met, it arrives at that."""
    goal, slack = scenario.goal, ARRIVAL_TOLERANCE * (time - began)
    step = goal.arrival_step
    counted = time if step is None else began + step * round((time - began) / step)
    if goal.earliest_arrival is not None and not counted >= goal.earliest_arrival - slack:
        yield Violation(EARLIEST, time, goal.earliest_arrival, time)
    if goal.latest_arrival is not None and not counted <= goal.latest_arrival + slack:
        yield Violation(LATEST, time, goal.latest_arrival, time)


def _ahead(position: Point, heading: float, distance: float) -> Point:
    """The point so far ahead of a position."""
    return position[0] + distance * cos(heading), position[1] + distance * sin(heading)


def _place(vehicle: Vehicle, goal: Goal, last: EndState, backwards: bool) -> Iterator[Violation]:
    """Distance of the end from the goal, and the allowed one."""
    ahead = -vehicle.centre if backwards else vehicle.centre
    if goal.region is None:
        yield Violation("distance from the goal", dist(last.position, goal.position), goal.radius, last.time)
        return
    middle = _ahead(last.position, last.heading, ahead)
    yield Violation("distance from the goal region", distance_outside(goal.region, middle), 0.0, last.time)


def _heading_and_speed(goal: Goal, last: EndState) -> Iterator[Violation]:
    """Errors of heading and speed at the end against the goal's, and the allowed ones."""
    time = last.time
    if goal.heading is not None:
        yield Violation("goal heading", abs(remainder(last.heading - goal.heading, 2.0 * pi)), 0.0, time)
    if goal.heading_range is not None:
        low, high = goal.heading_range
        turn = remainder(last.heading - 0.5 * (low + high), 2.0 * pi)
        yield Violation("goal heading", max(abs(turn) - 0.5 * (high - low), 0.0), 0.0, time)
    if goal.speed is not None:
        yield Violation("goal speed error", abs(last.speed - goal.speed), GOAL_SPEED_TOLERANCE, time)
    if goal.speed_range is not None:
        low, high = goal.speed_range
        yield Violation("goal speed", max(low - last.speed, last.speed - high, 0.0), 0.0, time)


def ends_broken(checked: CheckedTrip, ends: Ends) -> tuple[Violation, ...]:
    """Return what a trip breaks at its ends."""
    scenario, trajectory = checked.scenario, checked.trajectory
    driven = float(trajectory.distance_at(np.ones(1))[0])
    # A trip that goes on beyond its path would be held at the goal, at a speed that it does not have.
    beyond = Violation("distance beyond the path", driven - trajectory.path.driven_length, 0.0, checked.absolute(1.0))
    found = [] if beyond.value <= END_TOLERANCE else [beyond]
    backwards = False  # what goes on with a trip heads as it drives
    if Ends.START in ends:
        first = _state(checked, 0.0)
        backwards = sets_out_backwards(scenario, first)
        found += start_violations(scenario, first)
    if Ends.GOAL in ends:
        found += goal_violations(scenario, _state(checked, 1.0), checked.absolute(0.0), backwards)
    return tuple(sorted(found, key=lambda one: one.what != EARLIEST))


def _state(checked: CheckedTrip, sigma: float) -> EndState:
    """State of a trip at a normalised time."""
    trajectory, frame = checked.trajectory, checked.trip.frame
    path, drive = trajectory.path, trajectory.drive_at(np.array([sigma]))
    point = path.points(path.exact.parameter_at(drive.distance))
    ((x, y),), ((ahead, aside),) = (
        frame.to_world(point.position).tolist(),
        frame.vectors_to_world(point.direction).tolist(),
    )
    speed, acceleration = float(drive.speed[0]), float(drive.acceleration[0])
    return EndState(checked.absolute(sigma), (x, y), atan2(aside, ahead), speed, acceleration)


def begins_beside(checked: CheckedTrip) -> Violation | None:
    """Return where what is checked of a trip begins beside the corridor; None where it begins in it."""
    if checked.scenario.corridor is None:
        return None
    state = _state(checked, checked.first)
    return beside_corridor(checked.scenario, state.time, state.position, state.heading)
