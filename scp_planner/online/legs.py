"""Trips of several legs while driving: the trip of the planner is the leg under way, and the others follow it.

Backwards, a leg is planned in the scene in which the vehicle is mirrored (`scp_planner.scenario.reversing`): its state,
its plans and its stops are those of a vehicle that drives ahead. Manoeuvres are looked for where the vehicle stands.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from scp_planner.certificate.check import certify_trip
from scp_planner.certificate.checked_trip import Scope
from scp_planner.mathematics.frames import PlanningFrame
from scp_planner.mathematics.polynomials import PiecewisePolynomials
from scp_planner.online.means import Means, Replan
from scp_planner.online.plan import AWAY, OnlinePlan, Outcome
from scp_planner.online.reasons import Reason, ReasonCode
from scp_planner.online.remaining import State
from scp_planner.online.safety_gate import Moment, Vetted
from scp_planner.online.stops import STOPS, standing_trip
from scp_planner.online.tolerances import OFF
from scp_planner.pauses import Coroutine
from scp_planner.planning.plan import Plan, PlanStatus
from scp_planner.planning.plan_search import plan_of_legs, planned
from scp_planner.planning.sources.gears import GEARS
from scp_planner.scenario.models import Goal, Scenario, Start
from scp_planner.scenario.reversing import ahead, backwards, with_lines
from scp_planner.scenario.units import changed
from scp_planner.settings.planning import SceneSettings
from scp_planner.threat_zones.batch import ZoneBatch
from scp_planner.threat_zones.zone import ThreatZone
from scp_planner.trips.legs import Leg, Legs, Stand
from scp_planner.trips.trip import Trip


@dataclass(frozen=True)
class OnlineLegParameters:
    patience: float = 3.0  # Units of time that the vehicle stands in vain, until manoeuvres are looked for once more
    growth: float = 2.0  # Factor of that from one time to the next
    facing: float = 0.02  # rad, by which a vehicle that turns on the spot may miss the heading of its leg


ONLINE_LEGS = OnlineLegParameters()
SEARCHING = Reason(ReasonCode.OUT_OF_TIME, "The vehicle stands while manoeuvres are looked for.")
TURNS = Reason(ReasonCode.DRIVING, "The vehicle turns on the spot.")
ROLLS = Reason(ReasonCode.DRIVING, "The vehicle rolls against its gear; it stops first.")
CANNOT_ROLL = Reason(ReasonCode.NOTHING_SAFE, "The vehicle rolls backwards without a reverse gear; it stops.")
STOPS_AT_END = Reason(ReasonCode.DRIVING, "The vehicle stops at the end of its leg.")


class LegsAhead:
    """The leg under way, those that follow, and the search for them."""

    def __init__(self, asked: Scenario, backward: bool | None = None) -> None:
        """Begin without a manoeuvre, in the gear under way; None: the first state that is reported decides it."""
        self.asked, self._in_gear = with_lines(asked), backward is not None
        self.backward = bool(backward) and asked.vehicle.reverse is not None
        self.legs: tuple[Leg, ...] = ()
        self.sets_out = False  # on a leg that plans are to be made for
        self._next: Leg | None = None  # as the last plan has it, where that is certified up to the goal
        self.at_end = False  # the vehicle is at its goal, and as fast and heads as it is to
        self._trip: Trip | None = None  # of the leg under way, as it was found
        self._turns_to: float | None = None  # the heading of the vehicle with which the leg under way begins
        self._search: Coroutine[Plan] | None = None
        self._from: State | None = None  # where the search begins
        self._ended = -1  # The replan in which a search came to its end
        self._about = -1  # The replan in which the vehicle last changed between ahead and backwards
        self._lasts = ONLINE_LEGS.patience  # Units of time, until a search begins anew
        self._due, self._again, self._patience = True, -math.inf, ONLINE_LEGS.patience

    def __getstate__(self) -> dict[str, Any]:
        """Copies and pickles begin a search under way anew."""
        return {**self.__dict__, "_search": None}

    @property
    def onward(self) -> bool:
        return len(self.legs) > 1

    @property
    def scene(self) -> Scenario:
        scene = self.asked
        if self.legs:
            trip = self.legs[0].trip
            at = np.linspace(0.0, 1.0, 2 if trip.trajectory.space.guide.straight else GEARS.corners + 1)
            places = trip.frame.to_world(trip.trajectory.path.points(at).position).tolist()
            scene = changed(scene, guide=tuple((x, y) for x, y in places))
        if self.onward:
            position, heading, _ = self.legs[0].state(self.legs[0].end)
            facing = None if self._may_turn_to(self.legs[1].backward) else heading
            scene = changed(scene, goal=Goal.model_construct(position=position, heading=facing, speed=0.0))
        return backwards(scene) if self.backward else ahead(scene)

    def reported(self, time: float, heading: float | None, speed: float) -> tuple[float | None, float]:
        """Return a heading and a signed speed along the leg under way; at first they decide its direction."""
        backward = speed < 0.0 and self.asked.vehicle.reverse is not None
        if abs(speed) > STOPS.standing:
            if not self._in_gear and backward != self.backward:
                self.backward, self.sets_out = backward, True
            elif self._next is not None and time > self._next.begin and backward == self._next.backward:
                self._begin(self.legs[1:], self._next.trip)
        self._in_gear = True
        if not self.backward:
            return heading, speed
        return None if heading is None else math.remainder(heading + math.pi, 2.0 * math.pi), -speed

    def start(self, state: State) -> Start:
        """Return the start of what is left at a state of the leg under way."""
        heading = state.front if state.backwards else state.heading
        if self.backward and heading is not None:
            heading = math.remainder(heading + math.pi, 2.0 * math.pi)
        return changed(
            self.asked.start,
            time=state.time,
            position=state.position,
            heading=heading,
            speed=state.speed,
            acceleration=state.acceleration,
        )

    # what to do

    def waits(self, now: Replan, means: Means) -> Reason | None:
        """Say why the vehicle stands for now, if it is to; manoeuvres are looked for up to the deadline."""
        state = now.moment.state
        if state.speed > STOPS.standing or state.heading is None:
            return None
        if self._due and not self._searched(now, means):
            return SEARCHING
        if self._turn(state):
            return TURNS
        if self._turns_to is not None:
            self._turns_to = None
            self.sets_out = True
        return None

    def first(self, now: Replan, means: Means) -> OnlinePlan | None:
        """Return the plan of the leg under way as it was found, to begin now."""
        if self._trip is None:
            return None
        state = now.moment.state
        trip = self._trip if state.speed > STOPS.standing else _at(self._trip, state.time)
        vetted = means.safety_gate.vet_on(now.moment, trip, means.foreseen, math.inf, True)
        vetted = vetted or Vetted(trip, now.moment.certify(trip), None)
        return means.plan_of(vetted, now, Outcome.IMPROVED)

    def goes_on(self, now: Replan, plan: OnlinePlan) -> bool:
        """Take note of a plan; return True if there is another leg to be driven now."""
        state = now.moment.state
        self.at_end = plan.arrived and not self.onward
        if state.speed > STOPS.standing:
            if plan.outcome not in AWAY:
                self._again, self._patience = -math.inf, ONLINE_LEGS.patience
            return False
        if not plan.arrived:
            if plan.outcome in AWAY and not now.moment.lost and state.time >= self._again and self._ended != now.cycle:
                self._due, self._again = True, state.time + self._patience
                self._patience *= ONLINE_LEGS.growth
                return True
            return False
        if self.onward:
            self._begin(self.legs[1:], self.legs[1].trip)
            return True
        return False

    def turns_about(self, now: Replan) -> bool:
        """Change between ahead and backwards, if the vehicle stands and has a reverse gear; once a replan."""
        if self.asked.vehicle.reverse is None or now.moment.state.speed > STOPS.standing or self._about == now.cycle:
            return False
        self._about, self._due = now.cycle, self._ended != now.cycle
        self.legs, self._trip, self._next, self._turns_to = (), None, None, None
        self.backward, self.sets_out = not self.backward, True
        return True

    def _turn(self, state: State) -> float:
        """Angle by which the vehicle is to turn where it stands, rad."""
        if self._turns_to is None or state.heading is None:
            return 0.0
        turn = math.remainder(self._turns_to - state.heading, 2.0 * math.pi)
        return turn if abs(turn) > ONLINE_LEGS.facing else 0.0

    def _may_turn_to(self, backward: bool) -> bool:
        """True if the vehicle may turn on the spot to where a leg begins."""
        return self.asked.vehicle.max_turn_rate is not None and not backward

    def _begin(self, legs: tuple[Leg, ...], trip: Trip) -> None:
        self.legs, self._trip, self._next = legs, trip, None
        self.backward = bool(legs) and legs[0].backward
        self._turns_to = Leg(trip).state(trip.frame.time)[1] if self._may_turn_to(self.backward) else None
        self.sets_out = True

    # the search

    def _searched(self, now: Replan, means: Means) -> bool:
        """Look for manoeuvres until the deadline; return True when that has come to an end.

        A search that lasts for long begins anew among obstacles that have moved on, and may last longer.
        """
        state = now.moment.state
        begun = math.inf if self._search is None or self._from is None else self._from.time
        lasted = state.time - begun >= self._lasts and not now.moment.stands.all()
        if self._search is None or lasted or not means.stays(self._from, state):
            self._lasts *= ONLINE_LEGS.growth if lasted else 1.0
            zones = _zones(now.moment, means)

            def one(scene: Scenario, left: float | None, thorough: bool) -> Plan:
                settings = replace(means.settings, clearance_margin=SceneSettings.clearance_margin)
                return planned(scene, settings, None, left, thorough=thorough, threat_zones=zones)

            vehicle, start = self.asked.vehicle, changed(self.start(state), speed=0.0)
            roomy = changed(vehicle, radius=vehicle.radius + means.following.room)
            scene = changed(self.asked, vehicle=roomy, start=start, obstacles=())
            self._search = Coroutine(lambda: plan_of_legs(scene, one, zones))
            self._from = state
        if self._search.resume(now.deadline):
            self._ended = now.cycle
            self._take(self._search.result)
        return not self._due

    def _take(self, found: Plan) -> None:
        """Drive the legs that were found from now on; where there are none, go on as before, or ahead."""
        self._search, self._due, self._lasts = None, False, ONLINE_LEGS.patience
        if not found.certified:
            if not self.legs:
                self.backward = False
            return
        legs = () if found.legs is None else found.legs.legs
        if found.legs is not None and abs(found.legs.pauses[-1].turn) > ONLINE_LEGS.facing:
            position, last = legs[-1].state(legs[-1].end)[0], found.legs.last
            turned = PlanningFrame(position, last.heading, last.time)
            legs += (Leg(standing_trip(found.trip, turned, OFF)),)
        self._begin(legs if len(legs) > 1 or any(leg.backward for leg in legs) else (), found.trip)

    # what it comes to

    def whole(self, now: Replan, means: Means, plan: OnlinePlan) -> OnlinePlan:
        """Return a plan of the leg under way with those that follow."""
        state = now.moment.state
        self._next = None
        if plan.arrived and not self.at_end:
            plan = replace(plan, code=STOPS_AT_END.code, reason=STOPS_AT_END.sentence)
        turn = self._turn(state) if plan.outcome is Outcome.BRAKING else 0.0
        follow = plan.outcome not in AWAY and self.onward
        if not (self.backward or turn or follow):
            return plan
        if turn:
            assert self.asked.vehicle.max_turn_rate is not None and state.heading is not None
            until = state.time + abs(turn) / self.asked.vehicle.max_turn_rate
            frame = PlanningFrame(state.position, state.heading + turn, until)
            stands = Trip(frame, plan.trip.trajectory)
            legs = Legs((Leg(stands),), Stand(state.time, state.heading), _end(Leg(stands)))
            return replace(plan, trip=stands, legs=legs)
        first = Leg(plan.trip, self.backward)
        rest = self._rest(first, first.end) if follow else ()
        if rest and plan.certified and self._certified(rest, _end(first), now):
            self._next = rest[0]
        elif rest:  # It can be driven up to where the vehicle stands at the next replan at the latest
            rest = self._rest(first, max(first.end, means.safety_gate.unseen_until(now.moment)))
            if plan.certified:
                plan = replace(plan, status=PlanStatus.FEASIBLE, stop=plan.trip, branch_time=first.end)
        legs = Legs((first, *rest), Stand(first.begin, first.state(first.begin)[1]), _end([first, *rest][-1]))
        return replace(plan, legs=legs)

    def _rest(self, before: Leg, time: float) -> tuple[Leg, ...]:
        """Return the legs that follow that under way, from a time on, s, and turns on the spot."""
        rest, rate = list[Leg](), self.asked.vehicle.max_turn_rate or math.inf
        for leg in self.legs[1:]:
            turn = math.remainder(leg.state(leg.begin)[1] - before.state(before.end)[1], 2.0 * math.pi)
            before = Leg(_at(leg.trip, time + abs(turn) / rate), leg.backward)
            rest.append(before)
            time = before.end
        return tuple(rest)

    def _certified(self, follow: tuple[Leg, ...], begin: Stand, now: Replan) -> bool:
        """True if the legs that follow a stand are certified among the zones of now."""
        moment = now.moment
        position, _, _ = follow[0].state(follow[0].begin)
        start = changed(self.asked.start, time=begin.time, position=position, heading=begin.heading, speed=0.0)

        scene = changed(self.asked, start=changed(start, acceleration=None))
        scope = Scope(precision=math.inf, tube=moment.tube)
        return certify_trip(scene, Legs(follow, begin, _end(follow[-1])), moment.zones, scope).holds


def _at(trip: Trip, time: float) -> Trip:
    return Trip(replace(trip.frame, time=time), trip.trajectory)


def along(plan: OnlinePlan, backward: bool) -> OnlinePlan:
    """Return a plan of one leg with the direction in which the vehicle drives."""
    if not backward:
        return plan
    leg = Leg(plan.trip, backward)
    return replace(plan, legs=Legs((leg,), Stand(leg.begin, leg.state(leg.begin)[1]), _end(leg)))


def _end(leg: Leg) -> Stand:
    return Stand(leg.end, leg.state(leg.end)[1])


def _zones(now: Moment, means: Means) -> list[ThreatZone]:
    frame, found = PlanningFrame((0.0, 0.0), 0.0, 0.0), list[ThreatZone]()
    for zone in now.zones:
        if zone.covariances is not None:
            seen = means.foreseen(ZoneBatch.of((zone,), frame, 0.0), now.state.time)
            assert seen.covariances is not None
            spread = PiecewisePolynomials(seen.covariances.breakpoints[:1], seen.covariances.coefficients[:1])
            zone = replace(zone, covariances=spread)
        found.append(zone)
    return found
