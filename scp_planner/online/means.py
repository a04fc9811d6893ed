"""A replan under way: state and operations that several parts of a planner share."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from time import perf_counter
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from scp_planner.arrays import Array
from scp_planner.certificate.verdict import Certificate
from scp_planner.mathematics import corridor
from scp_planner.mathematics.frames import PlanningFrame
from scp_planner.online.arrival import Arrival
from scp_planner.online.following import Deviation, Following
from scp_planner.online.inbox import Inbox
from scp_planner.online.moving_goal import MovingGoal, but_for_touched
from scp_planner.online.pace import Pace
from scp_planner.online.places_ahead import PlacesAhead
from scp_planner.online.plan import AWAY, OnlinePlan, Outcome
from scp_planner.online.reasons import (
    Candidate,
    CandidateKind,
    Facts,
    Goes,
    Reason,
    ReasonCode,
    passes_after,
    reason_of,
)
from scp_planner.online.remaining import State, _guide_from, bounds_round, driven_at, path_ahead, remaining_trip
from scp_planner.online.safety_gate import SAFETY_GATE, Moment, Refusal, SafetyGate, Stop, Vetted
from scp_planner.online.stops import STOPS, Braking, braking_of, straight_stop, time_from_a_stand
from scp_planner.online.tolerances import OFF
from scp_planner.planning.explain import GETS_AWAY
from scp_planner.planning.plan import Plan, PlanStatus
from scp_planner.planning.plan_search import planned
from scp_planner.prediction.foresight import foreseen
from scp_planner.problem.build import build_problem
from scp_planner.problem.guides import default_guide, guide_on, guide_over
from scp_planner.problem.problem import Problem
from scp_planner.routes.over_map import MAPS
from scp_planner.scenario.limits import Limits, straight_trip_time
from scp_planner.scenario.models import Goal, Passage, Scenario, Start
from scp_planner.scenario.units import NaturalUnits, changed
from scp_planner.scp.loop import ScpLoop
from scp_planner.search.first_trips import arcs, trip_along
from scp_planner.search.ways import WaySearch, ways_in_parts
from scp_planner.settings.online import GiveWay, Safety, SceneOnlineSettings
from scp_planner.settings.planning import LONGEST_SPAN, SceneSettings
from scp_planner.solvers import QpSolver
from scp_planner.threat_zones.batch import ZoneBatch
from scp_planner.threat_zones.of_scenario import corridor_zones
from scp_planner.threat_zones.zone import ThreatZone
from scp_planner.trips.guide import Guide
from scp_planner.trips.trajectory import Trajectory
from scp_planner.trips.trip import Trip


@dataclass(frozen=True)
class ReplanParameters:
    route_gain: float = 0.1  # Units of time by which another way round must be faster for the vehicle to change over
    # Widths of the vehicle, by which trips keep farther away than they must where it gives way early
    spare_widths: float = 0.15
    # Widths of the vehicle: a stop stays clear for the time in which it drives these from there, unless that is set:
    # who comes nearer by then hits it
    clear_widths: float = 4.0
    # Share of the first span in which the slope of an acceleration that does not jump may change besides, as when
    # brakes are released
    soon: tuple[float, ...] = (0.125, 0.25, 0.5)
    spans: int = 250  # Of a path over a guide as long as the straight way; many more take too much memory
    # Share of a deadline that is kept back at most for replans that took longer than theirs
    most_kept_back: float = 0.5
    overrun_kept: float = 0.8  # Share of that which is still kept back at each replan after it


REPLAN = ReplanParameters()
IMPROVEMENT = "problem", "scp", "certificate"
"""Stages of an improvement of one step."""
_GOES = {Outcome.REPAIRED: Goes.SLOWER, Outcome.EVADING: Goes.ASIDE, Outcome.BRAKING: Goes.STOPS}


@dataclass
class Replan:
    """One call of `Planner.replan`."""

    moment: Moment  # With the newest observations
    began: float  # On the computer's clock, s
    deadline: float  # On the computer's clock, s
    last: OnlinePlan | None  # The last answer
    cycle: int  # Its number
    pace: Pace
    timings: dict[str, float] = field(default_factory=dict)  # Wall time of each stage, s
    clock: float = 0.0
    aimless: bool = False  # No plan so far leads to the goal
    improves: bool = True  # There is time to improve what is left of the last trip
    unrouted: Reason | None = None  # Why there is no route over the map
    candidates: dict[int, Candidate] = field(default_factory=dict)  # What was looked at so far, by the ids of trips

    @property
    def late(self) -> bool:
        """True if the deadline has passed."""
        return perf_counter() > self.deadline

    def lap(self, stage: str, steps: int = 1) -> None:
        """Count the time since the last lap to a stage, of so many steps."""
        clock = perf_counter()
        self.timings[stage] = self.timings.get(stage, 0.0) + clock - self.clock
        self.pace.took(stage, (clock - self.clock) / max(steps, 1))
        self.clock = clock

    def has_time(self, part: str, *stages: str) -> bool:
        """True if there is time for a part, of such stages, up to the deadline."""
        return self.pace.allows(self.deadline, part, *stages)

    def until_answer(self, *, overdue: bool) -> float:
        """Deadline of the loop on the computer's clock, s, before a certificate and an evasion; none if ``overdue``."""
        return math.inf if overdue else self.until("certificate", "evasion")

    def until(self, *stages: str) -> float:
        """Time on the computer's clock up to which there is time left for stages, s."""
        return self.deadline - self.pace.of(*stages)


class Means:
    def __init__(
        self,
        given: Scenario,
        settings: SceneSettings,
        online: SceneOnlineSettings,
        inbox: Inbox,
        following: Following,
        units: NaturalUnits,
        solver: QpSolver,
        onward: bool = False,
        routed: bool = False,
    ) -> None:
        self.onward = onward
        self.routed = routed  # The guide is a route that was found
        self.given, self.settings, self.online, self.inbox, self.units = given, settings, online, inbox, units
        self.solver, self.obstacles, self.following = solver, inbox.obstacles, following
        # Headings are those of driving: middle and discs are on the other side while the front is behind
        discs = tuple(-offset for offset in given.vehicle.discs)
        self._reversed = given.vehicle.model_copy(update={"centre": -given.vehicle.centre, "discs": discs})
        getting_away = time_from_a_stand(given.vehicle, REPLAN.clear_widths * 2.0 * given.vehicle.radius)
        self.wait = getting_away if online.stay_clear is None else online.stay_clear
        self.breakpoints = _breakpoints(settings.acceleration_spans, given.vehicle.max_jerk is not None)
        self.braking = braking_of(given.vehicle)
        stop_from = partial(straight_stop, braking=self.braking, settings=settings, breakpoints=self.breakpoints)
        self.safety_gate = SafetyGate(online.period, online.safety is Safety.STOP, following, self.wait, stop_from)
        self._ground = corridor_zones(given)
        self._grown: tuple[ThreatZone, ...] = ()
        if given.ground is not None:  # the corridor was grown: trips are planned in it, what is driven keeps off cells
            self._grown = tuple(one for one in self._ground if one.id == corridor.NAME)
            self._ground = tuple(one for one in self._ground if one.id != corridor.NAME)
        self._led: OnlinePlan | None = None  # the last plan that says when a target is met
        self.known: Plan | None = None  # A trip in these surroundings that was found with them
        self._missed: Start | None = None  # from which no trip along the route was found
        self.arrival = Arrival(given.goal, following, online)
        self.places = PlacesAhead(given)
        self.gives_way_late = True
        self.replans_every(online.period)

    def replans_every(self, period: float) -> None:
        """Allow for so much time until the next replan, s."""
        online, vehicle = self.online, self.given.vehicle
        self.period = period
        # A plan without jumps begins a reaction time later, and the first one is followed for so much longer.
        self.safety_gate.period = period + (0.0 if vehicle.max_jerk is None else online.reaction_time)
        stopping = braking_of(vehicle).time(vehicle.max_speed)
        # s, up to which zones grow for the trips that are planned among them
        self.foresight = period + online.reaction_time + stopping + 0.5 * SAFETY_GATE.commitment
        if online.foresight is not None:
            self.foresight = online.foresight

    def drop_passed(self, state: State, before: State | None, last: OnlinePlan | None) -> None:
        """Forget the places that have been passed, as reported or on the last plan since the last state."""
        given = self.given
        if not given.goals:
            return
        driven = None
        if last is not None and before is not None:
            off = Deviation.of(state, last.trip, given.vehicle).distance
            driven = last.trip if off <= self.following.largest + OFF else None
        left = self.places.drop(given, state, before, driven)
        if len(left) < len(given.goals):
            self.given = changed(given, goals=left)

    def moment(self, state: State, last: OnlinePlan | None) -> Moment:
        """Return a moment at a state, with all that has been observed, and the goal where the last plan may meet it."""
        self.inbox.take_in(replanning=True)
        self.inbox.forget(state.time)
        way = self.online.give_way
        self.gives_way_late = not self.obstacles.wander if way is None else way is GiveWay.LATE
        zones = self.obstacles.zones(state.time) + self._ground
        scenario, goal = self.scenario_at(state), self.given.goal
        if scenario.ground is not None:
            scenario = changed(scenario, corridor=None)
        passing: tuple[Passage, ...] = ()
        if not self.places.are_fixed:
            placed = self.places.placed(scenario, zones, last)
            if isinstance(placed, str):
                lost = Reason(ReasonCode.BLOCKED, placed)
                return Moment(state, changed(scenario, goals=()), zones, self.following.tube, lost=lost)
            spots = (one.position for one in placed.goals)
            scenario = changed(placed, guide=(state.position, *spots, goal.position))
            passing = self.places.passing
        zones = but_for_touched(zones, self.places.goals, self.given, self.obstacles.tracks)
        if goal.target is None:
            scenario = changed(scenario, goal=self._slow_enough(scenario.goal, state))
            return Moment(state, scenario, zones, self.following.tube, passing=passing, onward=self.onward)
        arrival = self.arrival
        moving = MovingGoal.of(goal, zones, arrival.near, arrival.speed, arrival.heading)
        if last is not None and last.outcome not in AWAY and last.status is not PlanStatus.INFEASIBLE:
            self._led = last  # a plan that is not finished arrives whenever
        time = math.inf if moving is None else moving.meeting(scenario, self._led)
        if moving is not None and time == math.inf and moving.target.covariances is not None:
            # Nobody accelerates for ever: it is another matter whether it gets away at the speed that it has.
            moving = replace(moving, target=moving.target.steady(state.time))
            time = moving.meeting(scenario, self._led)
        if moving is None or time == math.inf:
            standing = goal if moving is None else moving.planned(state.time)
            lost = Reason(ReasonCode.BLOCKED, "the target is not seen" if moving is None else GETS_AWAY)
            scenario = changed(scenario, goal=changed(standing, target=None))
            return Moment(state, scenario, zones, self.following.tube, lost=lost)
        zones = but_for_touched(zones, (goal,), self.given, self.obstacles.tracks)
        return Moment(
            state,
            changed(scenario, goal=self._slow_enough(moving.planned(time), state)),
            zones,
            self.following.tube,
            moving,
        )

    def _slow_enough(self, goal: Goal, state: State) -> Goal:
        """Return a goal that may be passed at speed, at one from which the vehicle can stop behind it.

        Trips from a stand may end in another heading than those that were refused.
        """
        if state.speed <= STOPS.standing:
            self.safety_gate.fastest_end = math.inf
        most = self.safety_gate.fastest_end
        free = goal.speed is None and goal.speed_range is None and most < math.inf
        return changed(goal, speed_range=(0.0, most)) if free else goal

    def scenario_at(self, state: State) -> Scenario:
        """Return what is left of the scenario, without obstacles."""
        start = Start.model_construct(
            time=state.time,
            position=state.position,
            heading=state.heading,
            speed=state.speed,
            acceleration=state.acceleration,
        )
        vehicle = self._reversed if state.backwards else self.given.vehicle
        changes: dict[str, Any] = {"start": start, "obstacles": (), "vehicle": vehicle}
        if self.given.bounds is not None:
            changes["bounds"] = bounds_round(self.given.bounds, vehicle, state)
        if self.given.guide is not None:
            changes["guide"] = _guide_from(self.given.guide, state.position)
        elif self.given.goals:
            places = (one.position for one in self.given.goals)
            changes["guide"] = (state.position, *places, self.given.goal.position)
        return self.given.model_copy(update=changes)

    def least_time(self, scenario: Scenario) -> float:
        """Return the time that a straight trip without obstacles takes within the limits of the plans, s."""
        return straight_trip_time(scenario, Limits.of(scenario, self.settings.limit_margin))

    def stays(self, before: State | Start | None, state: State | Start) -> bool:
        """True if a vehicle that stands is where it was, but for the speed at which it still counts as standing."""
        if before is None or (before.heading is None) != (state.heading is None):
            return False
        turned = abs(math.remainder((state.heading or 0.0) - (before.heading or 0.0), 2.0 * math.pi))
        apart = math.dist(before.position, state.position) - STOPS.standing * (state.time - before.time)
        return self.following.allows(Deviation(max(apart, 0.0), 0.0, turned))

    def foreseen(self, batch: ZoneBatch, clock: float = 0.0) -> ZoneBatch:
        """The zones that trips are planned among, of those on a clock that shows a time now."""
        if self.online.safety is Safety.TRIP:
            return batch
        return foreseen(batch, self.foresight, self.obstacles.learning(), clock)

    def problem(self, now: Replan) -> Problem:
        """Return the problem of a moment, among foreseen zones."""
        scenario, batch = now.moment.scenario, now.moment.batch
        if scenario.ground is not None:
            scenario = changed(scenario, corridor=self.given.corridor)
            batch = ZoneBatch.of(now.moment.zones + self._grown, now.moment.frame, scenario.vehicle.radius)
        if self.following.room > 0.0:  # from the border of the workspace too
            roomy = scenario.vehicle.model_copy(update={"radius": scenario.vehicle.radius + self.following.room})
            scenario = scenario.model_copy(update={"vehicle": roomy})
        settings = self._along(scenario.guide or (scenario.start.position, scenario.goal.position))
        guide = self._guide(now, scenario, settings)
        problem = build_problem(scenario, (), settings, self.breakpoints, guide)
        batch = self.foreseen(batch)
        spare = np.full(batch.size, self.settings.clearance_margin + self.following.room)
        if not self.gives_way_late:
            spare += self._to_spare(problem, batch)
        return problem.among(batch.inflated(spare))

    def _to_spare(self, problem: Problem, batch: ZoneBatch) -> Array:
        """Clearances (L,), m, to spare where the vehicle gives way early: at most half of what there is at the goal."""
        spare = REPLAN.spare_widths * 2.0 * self.given.vehicle.radius
        arrival = np.array([self.least_time(problem.scenario)])
        goal = problem.frame.to_frame(np.array([problem.scenario.goal.position]))
        (left,) = batch.distances(arrival, goal, 2.0 * spare)
        return np.where(left > 0.0, np.minimum(0.5 * left, spare), spare)

    def _guide(self, now: Replan, scenario: Scenario, settings: SceneSettings) -> Guide | None:
        """The guide of trips: where that turns about, along what is left of the last trip, led to the goal."""
        start, goal, last = scenario.start, scenario.goal, now.last
        if self.routed and scenario.guide is not None:
            return guide_on(scenario, np.array(scenario.guide), settings)
        given = scenario.guide is not None or scenario.corridor is not None
        if given or now.aimless or last is None or last.outcome in AWAY:
            return None
        frame = PlanningFrame.between(start.position, goal.position, start.time)
        limits = Limits.of(scenario, self.settings.limit_margin).rounded()
        guide, first = default_guide(scenario, frame, limits, settings), driven_at(last.trip, start.time)
        if guide.straight or first == 1.0:
            return guide
        # The shortest way about differs from replan to replan, and so do trips over it
        ahead = path_ahead(last.trip, first, frame, goal.position)
        ahead -= np.linspace(1.0, 0.0, len(ahead))[:, None] ** 2 * ahead[0]
        return guide_over(ahead, scenario, limits, self._along(ahead))

    def _along(self, line: ArrayLike) -> SceneSettings:
        """Settings with no more than the most spans of a path along a polyline, (n, 2) m."""
        span = float(np.hypot(*np.diff(np.asarray(line), axis=0).T).sum()) / REPLAN.spans
        return replace(self.settings, path_span=min(max(self.settings.path_span, span), LONGEST_SPAN))

    def vet(
        self,
        now: Replan,
        kind: CandidateKind,
        frame: PlanningFrame,
        trajectory: Trajectory,
        evaluation: Any = None,
        iterations: int = 0,
        branch: float | None = None,
    ) -> Vetted | Refusal:
        """Certify a trip, with the newest observations; a stop that leaves it at a time, s, first: as the last did."""
        if self.inbox:
            now.moment = self.moment(now.moment.state, now.last)
        if branch is None:
            branch = math.inf if now.last is None else now.last.branch_time
        vetted = self.safety_gate.vet(now.moment, frame, trajectory, evaluation, iterations, branch)
        now.lap("certificate")
        trip = vetted.trip if isinstance(vetted, Vetted) else Trip(frame, trajectory)
        self.consider(now, kind, trip, vetted)
        return vetted

    def consider(
        self,
        now: Replan,
        kind: CandidateKind,
        trip: Trip,
        found: Vetted | Certificate | Refusal | None,
        worth: float | None = None,
        severity: float | None = None,
    ) -> None:
        """Note a candidate, and what the safety gate found; of one that was noted before, the newest."""
        gate = found.why if isinstance(found, Refusal) else found.certificate if isinstance(found, Vetted) else found
        safe = isinstance(found, Vetted) or (isinstance(found, Certificate) and found.holds)
        noted = Candidate(kind, trip, safe, gate or "it no longer holds", self.units)
        before = now.candidates.pop(id(trip), noted)
        noted = noted if found is not None else replace(noted, gate=before.gate)
        worth = before.worth if worth is None else worth * self.units.length
        severity = before.severity if severity is None else severity
        now.candidates[id(trip)] = replace(noted, worth=worth, severity=severity)

    def kept(self, now: Replan, last: OnlinePlan) -> Vetted | None:
        """The last plan as it is, if it is certified to its end from now on."""
        kept = self.safety_gate.vet_kept(now.moment, last.trip)
        now.lap("certificate")
        self.consider(now, CandidateKind.LAST, last.trip, kept)
        return kept

    def starts(self, problem: Problem, cutoff: Callable[[], float], part: int) -> Iterator[Trip | Plan | None]:
        """Give trips along the ways to the goal that may be faster than a cutoff, s, or a plan in the ground."""
        over_map = any_way = problem.scenario.ground is not None
        start = problem.scenario.start
        if over_map and not self.stays(self._missed, start):
            found = self.planned_along(problem.scenario, any_way=not math.isfinite(cutoff()))
            self._missed = None if found.certified else start
            if found.certified:
                yield found
        search = WaySearch(problem)
        for way in ways_in_parts(search, self.settings.searches, lambda: cutoff() + REPLAN.route_gain, part):
            any_way = True
            yield None if way is None else Trip(problem.frame, trip_along(problem, way))
        if not any_way and not math.isfinite(cutoff()):
            for arc in arcs(problem):
                yield Trip(problem.frame, arc)

    def planned_along(self, scenario: Scenario, *, any_way: bool = True) -> Plan:
        """Plan a whole trip in the ground on a route, or else ``any_way`` in it, without obstacles that move."""
        within = changed(scenario, ground=None, guide=None)
        settings = replace(self.settings, clearance_margin=SceneSettings.clearance_margin)
        route = None if scenario.guide is None else np.array(scenario.guide)
        plan = partial(planned, within, settings, thorough=False, threat_zones=corridor_zones(within))
        found = plan(along=route)
        any_way &= route is not None and len(within.corridor or ()) <= MAPS.most_open
        return plan() if any_way and not found.certified else found

    def straight_stop(self, state: State, braking: Braking) -> Trip:
        """Return the stop straight ahead from a state, or standing there."""
        return straight_stop(state, braking, self.settings, self.breakpoints)

    def stopping(self, now: Replan, trip: Trip, reason: Reason | None) -> OnlinePlan:
        """Return the plan to stop, or to stand."""
        stop = Stop(trip, trip.frame.time)
        certificate = self.safety_gate.certify_stop(now.moment, stop, None)
        self.consider(now, CandidateKind.STOP, trip, certificate)
        vetted = Vetted(trip, certificate, stop if certificate.holds else None)
        return self.plan_of(vetted, now, Outcome.BRAKING, reason=reason)

    def plan_of(
        self, vetted: Vetted, now: Replan, outcome: Outcome, whom: str | None = None, reason: Reason | None = None
    ) -> OnlinePlan:
        """Return a plan of what is driven, for an obstacle, and for a reason if that is known."""
        if vetted.certified and outcome is not Outcome.BRAKING:
            status = PlanStatus.CERTIFIED
        else:
            status = PlanStatus.FEASIBLE if vetted.feasible else PlanStatus.INFEASIBLE
        safe = status is PlanStatus.CERTIFIED or vetted.stop is not None
        if reason is None or (not safe and (reason.code is not ReasonCode.ARRIVED or _moves(now))):
            reason = self._reason(vetted, now, outcome, whom, safe)
        return OnlinePlan(
            scenario=self.given.name,
            status=status,
            reason=reason.sentence,
            trip=vetted.trip,
            method="scp",
            solver=self.solver.name,
            iterations=vetted.iterations,
            wall_time=perf_counter() - now.began,
            clearance=vetted.certificate.clearance,
            limits=vetted.certificate.limits,
            timings=now.timings,
            outcome=outcome,
            stop=None if vetted.stop is None else vetted.stop.trip,
            branch_time=math.inf if vetted.stop is None else vetted.stop.branch,
            code=reason.code,
            obstacle=reason.obstacle,
            lasts=reason.lasts,
            candidates=tuple(
                replace(each, chosen=True) if each.inside is vetted.trip else each for each in now.candidates.values()
            ),
        )

    def _reason(self, vetted: Vetted, now: Replan, outcome: Outcome, whom: str | None, safe: bool) -> Reason:
        moment, unit = now.moment, self.units.time
        looked = any(each.kind in (CandidateKind.IMPROVED, CandidateKind.ROUTE) for each in now.candidates.values())
        if whom is None:
            near = vetted.certificate.clearance.obstacle if outcome is Outcome.REPAIRED else None
            whom = next((each.obstacle for each in vetted.certificate.violations if each.obstacle), near)
        passes = None if whom is None else passes_after(moment.batch, whom, self.given.vehicle.max_speed)
        return reason_of(
            Facts(
                safe,
                not _moves(now),
                _GOES.get(outcome, Goes.ON),
                whom,
                None if passes is None else passes * unit,
                (vetted.arrival - moment.state.time) * unit,
                looked or not now.late,
                "; ".join(str(each.outside(self.units)) for each in vetted.certificate.violations if each.is_of_limit),
            )
        )


def _moves(now: Replan) -> bool:
    return now.moment.state.speed > STOPS.standing


def _breakpoints(spans: int, ramped: bool) -> tuple[float, ...]:
    """Breakpoints of the acceleration of all trips, in normalised time."""
    breaks = np.linspace(0.0, 1.0, spans + 1)
    if ramped:
        breaks = np.insert(breaks, 1, np.array(REPLAN.soon) * breaks[1])
    return tuple(float(b) for b in breaks)


class Renewal:
    """The problem of a replan, and what is left of the last trip in it: made when they are asked for."""

    def __init__(self, means: Means, now: Replan, unfinished: Trip | None = None) -> None:
        self._means, self._now, self.unfinished = means, now, unfinished

    @cached_property
    def problem(self) -> Problem:
        """The problem from the present state to the goal."""
        problem = self._means.problem(self._now)
        self._now.lap("problem")
        return problem

    @cached_property
    def loop(self) -> ScpLoop:
        loop = ScpLoop(self.problem, self._means.solver)
        self._now.lap("problem")
        return loop

    @cached_property
    def ahead(self) -> Trajectory | None:
        return None if self._now.last is None else self.left_of(self._now.last.trip)

    def left_of(self, trip: Trip) -> Trajectory | None:
        """Return what is left of a trip in the problem; None where that does not lead on, as within a wide goal."""
        moment = self._now.moment
        left = remaining_trip(self.problem, trip, moment.state, led=moment.moving is not None)
        self._now.lap("problem")
        return left if 0.0 <= left.travel_time < math.inf else None
