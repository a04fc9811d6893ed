"""Ends of a drive against its scenario, and the seams between its legs, whoever made it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from math import atan2, cos, dist, pi, remainder, sin

import numpy as np

from scp_planner.certificate.passing import Pass, places_missed
from scp_planner.certificate.tolerances import (
    ARRIVAL_TOLERANCE,
    END_TOLERANCE,
    GOAL_SPEED_TOLERANCE,
    LENGTH_TOLERANCE,
    TripUnit,
)
from scp_planner.certificate.verdict import EARLIEST, LATEST, OFF_STEP, Ends, Violation, off_a_step
from scp_planner.mathematics import corridor
from scp_planner.mathematics.planar import distance_to_polygon
from scp_planner.scenario.goals import distance_outside
from scp_planner.scenario.models import Goal, Scenario, Steering, Vehicle
from scp_planner.threat_zones.target import goal_on_arrival
from scp_planner.trips.legs import Leg, Stand
from scp_planner.units import Point

SAME = TripUnit()


@dataclass(frozen=True)
class EndState:
    """A drive at an instant, such as one of its ends."""

    time: float  # Absolute, s
    position: Point  # In world coordinates, m
    heading: float  # Of the vehicle, rad
    speed: float  # m/s, negative backwards
    acceleration: float  # Along the heading, m/s^2

    @classmethod
    def along(cls, leg: Leg, sigma: Sequence[float]) -> list[EndState]:
        """States of a leg at normalised times."""
        trajectory, frame = leg.trip.trajectory, leg.trip.frame
        path, drive = trajectory.path, trajectory.drive_at(np.array(sigma))
        points = path.points(path.exact.parameter_at(drive.distance))
        gear = -1.0 if leg.backward else 1.0
        times = [frame.time + trajectory.travel_time * part for part in sigma]
        headings = (gear * frame.vectors_to_world(points.direction)).tolist()
        moves = (gear * drive.speed).tolist(), (gear * drive.acceleration).tolist()
        states = zip(times, frame.to_world(points.position).tolist(), headings, *moves, strict=True)
        return [cls(time, (x, y), atan2(aside, ahead), *rates) for time, (x, y), (ahead, aside), *rates in states]

    def at(self, stand: Stand, unit: TripUnit) -> EndState:
        """Return the state at a stand before or after this one; at the same time it may but head elsewhere."""
        if abs(stand.time - self.time) <= END_TOLERANCE * unit.time:
            return replace(self, time=stand.time, heading=stand.heading)
        return EndState(stand.time, self.position, stand.heading, 0.0, 0.0)


@dataclass(frozen=True)
class Course:
    """States of a drive: at its first moment, where each leg begins and ends in turn, and at its last one."""

    states: Sequence[EndState]

    @classmethod
    def of(cls, legs: Sequence[Leg]) -> Course:
        """Return the states of legs of which the first sets out at once, and the last one ends the drive."""
        ends = [state for leg in legs for state in EndState.along(leg, (0.0, 1.0))]
        return cls([ends[0], *ends, ends[-1]])

    def between(self, first: Stand, last: Stand, unit: TripUnit) -> Course:
        """Return the course of a drive that may begin and end with a pause."""
        return Course([self.states[0].at(first, unit), *self.states[1:-1], self.states[-1].at(last, unit)])

    @property
    def pauses(self) -> list[tuple[EndState, EndState]]:
        """States before and after each time between legs, before the first and after the last one."""
        return list(zip(self.states[::2], self.states[1::2], strict=True))

    def broken(self, scenario: Scenario, ends: Ends, passed: Sequence[Pass], unit: TripUnit) -> list[Violation]:
        """Return what a drive breaks at its ends, at places on its way, and between its legs."""
        first, last, backwards = self.states[0], self.states[-1], False  # what goes on heads as it drives
        found = list[Violation]()
        if Ends.START in ends:
            backwards = sets_out_backwards(scenario, first, unit)
            found += start_violations(scenario, first, unit)
        found += self._torn(scenario.vehicle.max_turn_rate or 0.0, unit)
        if Ends.GOAL in ends:
            found += goal_violations(scenario, last, first.time, backwards, unit)
        found.sort(key=lambda one: one.what != EARLIEST)
        return [*found, *places_missed(passed, scenario)]

    def _torn(self, rate: float, unit: TripUnit) -> Iterator[Violation]:
        """Tell where a drive is not one: of place, heading and signed speed at the seams of its legs."""
        pauses = self.pauses
        for number, (before, after) in enumerate(pauses):
            lasts, time = after.time - before.time, before.time
            turn = abs(remainder(after.heading - before.heading, 2.0 * pi))
            allowed = rate * max(lasts, 0.0) * (1.0 + END_TOLERANCE)
            rests = 0 < number < len(pauses) - 1 or lasts > END_TOLERANCE * unit.time
            found = [
                (Violation("overlap of legs", -lasts, 0.0, time), unit.time),
                (Violation("gap between legs", dist(before.position, after.position), 0.0, time), unit.length),
                (Violation("turn while standing", turn, allowed, time), 1.0),
            ]
            if rests:
                at_rest = GOAL_SPEED_TOLERANCE * unit.speed
                found += [
                    (Violation("speed at rest", abs(before.speed), at_rest, time), unit.speed),
                    (Violation("speed at rest", abs(after.speed), 0.0, after.time), unit.speed),
                ]
            yield from _exceeded(found)


def _exceeded(found: Sequence[tuple[Violation, float]]) -> Iterator[Violation]:
    """Keep those that exceed what is allowed by more than the tolerance, in a unit each."""
    yield from (one for one, unit in found if not one.value <= one.allowed + END_TOLERANCE * unit)


def can_reverse(vehicle: Vehicle, speed: float, unit: TripUnit = SAME) -> bool:
    """True if it can set out against its heading as well as along it, at a speed in units of the scene."""
    return vehicle.steering is Steering.BOTH_WAYS and abs(speed) <= END_TOLERANCE * unit.speed


def sets_out_backwards(scenario: Scenario, first: EndState, unit: TripUnit) -> bool:
    """True if a drive that begins so sets out from a stand against the heading of the start: the front is behind."""
    wanted = scenario.start.heading
    both = can_reverse(scenario.vehicle, first.speed, unit)
    return both and wanted is not None and cos(first.heading - wanted) < 0.0


def start_violations(scenario: Scenario, first: EndState, unit: TripUnit = SAME) -> Iterator[Violation]:
    """Tell how a drive begins otherwise than its scenario asks."""
    start = scenario.start
    found = [
        ("start time", abs(first.time - start.time), unit.time),
        ("distance from the start", dist(first.position, start.position), unit.length),
        ("start speed", abs(first.speed - start.speed), unit.speed),
    ]
    if start.acceleration is not None:
        found.append(("start acceleration error", abs(first.acceleration - start.acceleration), unit.acceleration))
    if start.heading is not None:
        round_to = pi if can_reverse(scenario.vehicle, first.speed, unit) else 2.0 * pi
        found.append(("start heading", abs(remainder(first.heading - start.heading, round_to)), 1.0))
    yield from _exceeded([(Violation(name, value, 0.0, first.time), size) for name, value, size in found])


def beside_corridor(scenario: Scenario, first: EndState, unit: TripUnit) -> Violation | None:
    """Tell how far beside the corridor a disc of the vehicle begins; None where all begin in it."""
    if scenario.corridor is None:
        return None
    slack = LENGTH_TOLERANCE * unit.length
    for offset in scenario.vehicle.discs:
        centre = _ahead(first.position, first.heading, offset)
        beside = min(distance_to_polygon(centre, polygon) for polygon in scenario.corridor)
        if beside > slack:
            return Violation("clearance", -beside, 0.0, first.time, corridor.NAME, slack)
    return None


def goal_violations(
    scenario: Scenario, last: EndState, began: float, backwards: bool, unit: TripUnit = SAME
) -> Iterator[Violation]:
    """Tell how a drive ends otherwise than its scenario asks."""
    goal, time = goal_on_arrival(scenario, last.time), last.time
    yield from _window(scenario, time, began)
    if scenario.goal.match_velocity and last.speed < 0.0:
        last = replace(last, heading=last.heading + pi)  # the target's velocity is matched, not where the front is
    found = [*_place(scenario.vehicle, goal, last, backwards, unit), *_heading_and_speed(goal, last, unit)]
    if goal.arrival_step is not None:
        missed = abs(remainder(time - began, goal.arrival_step))
        found.append((Violation(OFF_STEP, missed, off_a_step(goal.arrival_step, unit.time), time), unit.time))
    yield from _exceeded(found)


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


def _place(
    vehicle: Vehicle, goal: Goal, last: EndState, backwards: bool, unit: TripUnit
) -> Iterator[tuple[Violation, float]]:
    """Distance of the end from the goal, the allowed one, and the unit."""
    ahead = -vehicle.centre if backwards else vehicle.centre
    if goal.region is None:
        away = dist(last.position, goal.position)
        yield Violation("distance from the goal", away, goal.radius, last.time), unit.length
        return
    middle = _ahead(last.position, last.heading, ahead)
    outside = distance_outside(goal.region, middle)
    yield Violation("distance from the goal region", outside, 0.0, last.time), unit.length


def _heading_and_speed(goal: Goal, last: EndState, unit: TripUnit) -> Iterator[tuple[Violation, float]]:
    """Errors of heading and speed at the end against the goal's, the allowed ones, and their units."""
    time, speed = last.time, abs(last.speed)
    if goal.heading is not None:
        yield Violation("goal heading", abs(remainder(last.heading - goal.heading, 2.0 * pi)), 0.0, time), 1.0
    if goal.heading_range is not None:
        low, high = goal.heading_range
        turn = remainder(last.heading - 0.5 * (low + high), 2.0 * pi)
        yield Violation("goal heading", max(abs(turn) - 0.5 * (high - low), 0.0), 0.0, time), 1.0
    if goal.speed is not None:
        allowed = GOAL_SPEED_TOLERANCE * unit.speed
        yield Violation("goal speed error", abs(speed - goal.speed), allowed, time), unit.speed
    if goal.speed_range is not None:
        low, high = goal.speed_range
        yield Violation("goal speed", max(low - speed, speed - high, 0.0), 0.0, time), unit.speed
