"""The certificate of trips of several legs: each leg by itself, the vehicle at rest between them, and all together."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from math import pi, remainder

import numpy as np

from scp_planner.certificate.checked_trip import Scope
from scp_planner.certificate.ends import EndState, goal_violations
from scp_planner.certificate.tolerances import END_TOLERANCE, GOAL_SPEED_TOLERANCE
from scp_planner.certificate.verdict import Certificate, Clearance, Ends, LimitUse, Violation
from scp_planner.mathematics.frames import PlanningFrame
from scp_planner.scenario.models import Scenario, Start
from scp_planner.scenario.reversing import ahead, backwards, with_lines
from scp_planner.scenario.units import changed
from scp_planner.trips.guide import StraightGuide
from scp_planner.trips.legs import Legs, Pause
from scp_planner.trips.path import Path
from scp_planner.trips.space import TripSpace
from scp_planner.trips.trajectory import Trajectory
from scp_planner.trips.trip import Trip

CheckTrip = Callable[[Scenario, Trip, Scope], Certificate]
"""Checks one trip against a scenario, both in its natural units."""


def certify_legs(scenario: Scenario, legs: Legs, scope: Scope, check: CheckTrip) -> Certificate:
    """Check legs against a scenario, all in its natural units, in continuous time."""
    scenario = with_lines(scenario)
    found = [_leg_checked(scenario, legs, number, scope, check) for number in range(len(legs.legs))]
    for pause in legs.pauses:
        if pause.end.time > pause.begin.time:
            stands = changed(ahead(scenario), start=_start(scenario, pause))
            whole = replace(scope, ends=Ends(0))
            found.append(check(stands, _standing_trip(pause), whole))
    violations = [*_ends_broken(scenario, legs), *(each for one in found for each in one.violations)]
    clearance = min((one.clearance for one in found), key=lambda one: one.minimum)
    holds = not violations and all(one.holds for one in found)
    return Certificate(holds, clearance, _worst([one.limits for one in found[: len(legs.legs)]]), tuple(violations))


def _leg_checked(scenario: Scenario, legs: Legs, number: int, scope: Scope, check: CheckTrip) -> Certificate:
    """Check a leg but for its end: its start is that of the scenario, or where the leg before it stopped."""
    leg, start = legs.legs[number], scenario.start
    if leg.backward and scenario.vehicle.reverse is None:
        backed = Violation("speed", -leg.trip.trajectory.path.arc_length, 0.0, leg.begin)
        return Certificate(False, Clearance(-np.inf), {}, (backed,))
    if number or legs.first.time < leg.begin:
        start = _start(scenario, legs.pauses[number])
    scene = changed(scenario, start=start)
    scene = backwards(scene) if leg.backward else ahead(scene)
    part = replace(scope, ends=Ends.START)
    return check(scene, leg.trip, part)


def _start(scenario: Scenario, pause: Pause) -> Start:
    """The start of what follows on a pause, as it stands in the scenario."""
    return changed(
        scenario.start,
        time=pause.end.time,
        position=pause.position,
        heading=pause.end.heading,
        speed=0.0,
        acceleration=None,
    )


def _standing_trip(pause: Pause) -> Trip:
    """The trip that stands for as long as a pause."""
    space = TripSpace(StraightGuide(1.0), 0.0, 3, 4, 0, (0.0, 1.0))
    still = Trajectory(Path(space, np.zeros(space.path_size)), np.zeros(1), pause.end.time - pause.begin.time)
    return Trip(PlanningFrame(pause.position, pause.end.heading, pause.begin.time), still)


def _ends_broken(scenario: Scenario, legs: Legs) -> Iterator[Violation]:
    """Tell what is wrong with the start, the goal, and what is between the legs."""
    start, vehicle, first, last = scenario.start, scenario.vehicle, legs.first, legs.last
    late = abs(first.time - start.time)
    if not late <= END_TOLERANCE:
        yield Violation("start time", late, 0.0, first.time)
    if start.heading is not None:
        missed = abs(remainder(first.heading - start.heading, 2.0 * pi))
        if not missed <= END_TOLERANCE:
            yield Violation("start heading", missed, 0.0, first.time)
    rate = vehicle.max_turn_rate or 0.0
    pauses = legs.pauses
    speeds = [start.speed, *(leg.state(leg.end)[2] for leg in legs.legs)]
    for number, (pause, speed) in enumerate(zip(pauses, speeds, strict=True)):
        duration = pause.end.time - pause.begin.time
        inner, at_once = 0 < number < len(legs.legs), duration <= END_TOLERANCE
        if not duration >= -END_TOLERANCE:
            yield Violation("start time", -duration, 0.0, pause.end.time)
        if not (speed <= GOAL_SPEED_TOLERANCE or (at_once and not inner)):
            yield Violation("speed at rest", speed, 0.0, pause.begin.time)
        allowed = rate * max(duration, 0.0) * (1.0 + END_TOLERANCE)
        if not abs(pause.turn) <= allowed + END_TOLERANCE:
            yield Violation("turn while standing", abs(pause.turn), allowed, pause.begin.time)
    leg = legs.legs[-1]
    position, _, speed = leg.state(leg.end)
    acceleration = 0.0 if last.time > leg.end else float(leg.trip.at(leg.end)[0].acceleration[0])
    state = EndState(last.time, position, last.heading, speed, acceleration)
    yield from goal_violations(ahead(scenario), state, first.time, backwards=False)


def _worst(several: Sequence[dict[str, LimitUse]]) -> dict[str, LimitUse]:
    """The use of each limit that comes nearest to it."""
    worst: dict[str, LimitUse] = {}
    for uses in several:
        for name, use in uses.items():
            if name not in worst or _share(use) > _share(worst[name]):
                worst[name] = use
    return worst


def _share(use: LimitUse) -> float:
    return abs(use.worst) if use.limit is None else use.worst / use.limit
