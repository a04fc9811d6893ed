"""Planning while driving: observe, refresh the zones, replan before a deadline, fall back if nothing better is safe."""

from __future__ import annotations

import logging
import math
from collections import deque
from collections.abc import Callable, Iterator
from copy import deepcopy
from dataclasses import replace
from os import PathLike
from time import perf_counter
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from scp_planner.mathematics.occupancy import NAME
from scp_planner.online.arguments import (
    _point,
    accelerating,
    against_gear,
    check_number,
    direction,
    own_ground,
    speeding,
)
from scp_planner.online.assumptions import Assumptions
from scp_planner.online.changeable import Changeable
from scp_planner.online.decision import Decision
from scp_planner.online.following import Deviation, Following, larger
from scp_planner.online.inbox import INBOX, Inbox
from scp_planner.online.legs import CANNOT_ROLL, ROLLS, LegsAhead, along
from scp_planner.online.means import REPLAN, Means, Replan
from scp_planner.online.pace import PACE, Pace
from scp_planner.online.places_ahead import PlacesAhead
from scp_planner.online.plan import OnlinePlan
from scp_planner.online.predictor import Predictor
from scp_planner.online.remaining import State
from scp_planner.online.route_ahead import MapRouteAhead, RouteAhead
from scp_planner.online.stops import STOPS
from scp_planner.online.tolerances import LATE, TIME
from scp_planner.outputs import output_named
from scp_planner.planning.plan import PlanStatus
from scp_planner.planning.task import may_back_up
from scp_planner.prediction.obstacle_tracks import ObstacleTracks
from scp_planner.scenario.models import Scenario, Steering
from scp_planner.scenario.places import anchored
from scp_planner.scenario.units import NaturalUnits, changed
from scp_planner.settings.online import OnlineSettings
from scp_planner.settings.planning import SceneSettings, Settings, for_scene, of_kind
from scp_planner.solvers import QpSolver, solver_named
from scp_planner.threat_zones.error_tube import TrackingTube
from scp_planner.threat_zones.target import tracked
from scp_planner.threat_zones.zone import ThreatZone

logger = logging.getLogger(__name__)

SETTINGS = SceneSettings(clearance_margin=0.01, limit_margin=0.005, samples=100, tolerance=2e-3)
"""Default settings of plans in the loop, where there is no time to make up for small violations between samples."""


class Planner(Changeable):
    """A planner that is called again and again while the vehicle drives.

    Parameters
    ----------
    scenario : Scenario
        Vehicle, goal, bounds, confidence, and what is known of obstacles so far. A latest arrival is not looked at:
        the plans are as fast as they may be, and their arrival time tells.
    settings : Settings, optional
        Of the loop. Accelerations are piecewise constant here, or straight in pieces where the jerk is limited.
    online : OnlineSettings, optional
    solver : str or QpSolver, optional
        Overrides ``settings.solver``: a name, or a solver of one's own.
    tube : TrackingTube, optional
        The tube round its plans that the vehicle stays in, as `fit_tracking_tube` calibrates it, in place of
        ``online.tracking_error``: so it need not keep as far away when it drives slowly, or stands.

    Attributes
    ----------
    plan : OnlinePlan or None
        The last answer.
    online : OnlineSettings
        With the period that the scene decides, if that was left open.
    doubts : deque of str
        Which assumptions of what was promised of the last plan did not hold, the newest last; clocks of sensors that
        are ahead of that of the replans, and speeds above the limit.
    predictor : Predictor or None
        Asked for the motions of obstacles at each replan.
    tube : TrackingTube or None
        What a vehicle that drives may be off besides; the vehicle of `scenario` is larger by what it may be off when it
        stands.

    Raises
    ------
    ValueError
        If no solver has that name, or there is a tube and a tracking error.
    EstimationError
        If the vehicle may drive or turn faster than the tube was recorded for.
    """

    def __init__(
        self,
        scenario: Scenario,
        settings: Settings | None = None,
        online: OnlineSettings | None = None,
        solver: str | QpSolver | None = None,
        tube: TrackingTube | None = None,
    ) -> None:
        units = NaturalUnits.of(scenario)
        settings = SETTINGS if settings is None else for_scene(settings, units)
        if isinstance(solver, str):
            settings, solver = replace(settings, solver=solver), None
        self.settings = replace(settings, acceleration_degree=0)
        online = OnlineSettings() if online is None else of_kind(online, OnlineSettings)
        self._online = online.for_scene(units)
        self._period = self._online.period
        self._gaps = deque[float](maxlen=PACE.gaps) if online.period is None else None
        self.online = replace(online, period=self._online.period * units.time)
        if tube is not None and online.tracking_error > 0.0:
            raise ValueError(f"tube, online.tracking_error: {online.tracking_error!r}; give one of them")
        self.tube = None if tube is None else replace(tube, standing=0.0)
        self._tube = None if tube is None else tube.inside(units)
        scenario = tracked(scenario)
        inside = units.scenario(scenario)
        margin = self._online.margin(inside.vehicle.max_speed)
        obstacles = ObstacleTracks(inside.confidence, margin, self._online)
        obstacles.add(*inside.obstacles)
        super().__init__(Inbox(obstacles, units, inside.start.time, self._online), units)
        self.plan: OnlinePlan | None = None
        self._last: OnlinePlan | None = None
        self._zones: tuple[ThreatZone, ...] = ()
        self.doubts = deque[str](maxlen=INBOX.most_notes)
        self._legs: LegsAhead | None = None
        kept = {"obstacles": (), "ground": own_ground(scenario.ground)}
        self._asked = anchored(scenario).model_copy(update=kept)  # in the user's units
        self._take_up(inside, solver or solver_named(settings.solver))
        self._assumptions = Assumptions(units)
        self._state: State | None = None
        self._clock: float | None = None
        self._cycle = 0
        self._oddities = frozenset[str]()  # of the reported speed, which have been told
        self.predictor: Predictor | None = None
        self._pace = Pace()
        self._overrun = 0.0  # s that replans take beyond where they are to end

    def _take_up(self, scenario: Scenario, solver: QpSolver) -> None:
        # Late or not, the vehicle drives on as fast as it may.
        in_time = scenario.goal.model_copy(update={"latest_arrival": None})
        passed = [
            one.model_copy(update={"radius": one.within(scenario.vehicle), "latest_arrival": None})
            for one in scenario.goals
        ]
        changes = {"vehicle": larger(scenario.vehicle, self._tube), "goal": in_time, "goals": tuple(passed)}
        given = anchored(scenario.model_copy(update=changes))
        backward = None if self._legs is None else self._legs.backward
        stand = given.goal.target is None and PlacesAhead(given).are_fixed
        self._legs = LegsAhead(given, backward) if stand and may_back_up(given) else None
        self._route: RouteAhead | None = None
        if self._legs is None and given.ground is None:
            self._route = RouteAhead(given)
        elif self._legs is None and stand and not given.goals:
            self._route = MapRouteAhead(given)
        self._set_out(given if self._legs is None else self._legs.scene, solver)

    def _set_out(self, given: Scenario, solver: QpSolver) -> None:
        """Plan in a scene from now on: for the leg under way, the ground along a route over the map, or all of it."""
        following = Following.of(given.vehicle, self._online, self._tube)
        onward = self._legs is not None and self._legs.onward
        routed = given.ground is not None or (self._route is not None and self._route.guides)
        self._means = Means(
            given, self.settings, self._online, self._inbox, following, self._units, solver, onward, routed
        )
        self._decision = Decision(self._means)

    @property
    def given(self) -> Scenario:
        """Return the scenario that is planned for, in units of the scene, with the places that are left to pass."""
        return self._means.given if self._legs is None else self._legs.asked

    def __getstate__(self) -> dict[str, Any]:
        """Copies and pickles have all but what listens."""
        return {**self.__dict__, "listeners": []}

    def __copy__(self) -> Planner:
        """Copy a planner that goes on by itself, such as to simulate ahead."""
        return deepcopy(self)

    @property
    def solver(self) -> QpSolver:
        """Solver of the subproblems."""
        return self._means.solver

    @solver.setter
    def solver(self, solver: QpSolver) -> None:
        self._means.solver = solver

    @property
    def backs_up(self) -> bool:
        """True if its trips may have several legs, ahead and backwards."""
        return self._legs is not None

    @property
    def zones(self) -> tuple[ThreatZone, ...]:
        """The zones that the last plan was made with: with the planner's margin."""
        return tuple(zone.outside(self._units) for zone in self._zones if zone.id != NAME)

    @property
    def scenario(self) -> Scenario:
        """Scenario of the last plan: the state, the observations so far, and the planner's margin.

        `scp_planner.certify` of this, of a plan that begins now and of ``tube`` says what the planner says.
        """
        made = self.given if self._state is None else self._left(self._state)
        made = made.model_copy(update={"obstacles": self.obstacles.as_obstacles()})
        made = self._units.inverse.scenario(made)
        if self._route is None or not self._route.guides:
            return made
        asked = self._route.asked  # the planner's own guide and corridor were not asked for
        corridor = None if asked.ground is not None else made.corridor
        return changed(made, corridor=corridor, guide=asked.guide and made.guide, ground=self._asked.ground)

    @property
    def _places_left(self) -> tuple[int, ...]:
        """Numbers of the places on the way that are left to pass, of those that were asked for last."""
        return self._means.places.left if self._legs is None else tuple(range(len(self.given.goals)))

    def _left(self, state: State) -> Scenario:
        if self._legs is None:
            return self._means.scenario_at(state)
        bounds = self._means.scenario_at(state).bounds
        return changed(self.given, start=self._legs.start(state), obstacles=(), bounds=bounds)

    # what to do

    def replan(
        self,
        time: float,
        position: ArrayLike,
        heading: float | None,
        speed: float,
        acceleration: float | None = None,
        deadline: float | None = None,
    ) -> OnlinePlan:
        """Plan anew from the present state.

        Parameters
        ----------
        time : float
            Absolute, s; not before that of the last call.
        position : (2,)
            m.
        heading : float or None
            Of the vehicle's front, rad; None: free.
        speed : float
            m/s, negative backwards; without a heading the sign says nothing. Above the vehicle's limit it is taken as
            it is, and told in ``doubts``. A vehicle that rolls against its gear stops first; without a reverse gear
            that is not safe. Below what the follower may be off, such a vehicle counts as standing.
        acceleration : float, optional
            Along the path, m/s2, with which the plan begins where the jerk is limited. One that the vehicle cannot have
            is told in ``doubts``: beyond its limits, or below 0 where it stands; the nearest one is taken. None: that
            of the last plan at this time; at first that of the scenario's start, or 0. Without such a limit it is not
            used: accelerations may jump.
        deadline : float, optional
            Wall time in s from now by which the answer is wanted. Without one the work is limited by steps only,
            and the same calls give the same plans.

        Returns
        -------
        OnlinePlan
            Where the jerk is limited and there is a reaction time, it begins so much later, where the last plan leads.

        Raises
        ------
        ValueError
            If a number is not finite or time goes backwards.
        """
        began = perf_counter()
        self._check_state(time, position, heading, speed, acceleration, deadline)
        if self.predictor is not None:
            self._ask(self.predictor, float(time), position)

        def reported() -> State:
            return self._when_followed(self._reported_state(time, position, heading, speed, acceleration))

        state = reported()
        if self._state is not None and self._rolls(state) != self._rolls(self._state):
            self._last = None  # it was of the other direction
        end = math.inf
        if deadline is not None:
            overrun = min(self._overrun, REPLAN.most_kept_back * deadline)  # of which the reserve is a part
            end = began + deadline - max(self._online.reserve, overrun)
        with self._inbox.work:
            self._inbox.stamps.tick(self._units.instant(float(time)))
            self._means.drop_passed(state, self._state, self._last)
            moment = self._means.moment(state, self._last)
            now = Replan(moment, began, end, self._last, self._cycle, self._pace, clock=began)
            now = self._on_leg(now, reported)
            for text in self._doubted(now, float(speed), acceleration):
                self.doubts.append(f"t = {time:.3f} s: {text}")
            self._keep_up(state.time)
            now.lap("zones")
            if self._rolls(now.moment.state):
                plan, whole = self._stop_first(now)
            elif self._legs is None:
                if self._route is not None:
                    self._on_route(now, self._route)
                whole = plan = self._decision.answer(now)
            else:
                now, plan = self._leg_by_leg(now, self._legs, reported)
                whole = self._legs.whole(now, self._means, plan)
        self._last, self._state, self._zones = plan, now.moment.state, now.moment.zones
        self._clock = float(time)
        self._cycle += 1
        self.plan = whole.outside(self._units)
        ended = perf_counter()
        self._overrun = max(REPLAN.overrun_kept * self._overrun, ended - max(end, began))
        for each in self.listeners:
            each.replanned(time, _point("position", position), heading, speed, ended - began)
        return self.plan

    def _rolls(self, state: State) -> bool:
        """True if a vehicle that cannot drive both ways drives against its gear."""
        return state.backwards and self.given.vehicle.steering is not Steering.BOTH_WAYS

    def _stop_first(self, now: Replan) -> tuple[OnlinePlan, OnlinePlan]:
        """Stop a vehicle that rolls against its gear; without a reverse gear nothing is certified."""
        means, gear = self._means, self._legs is not None and self._legs.backward
        plan = means.stopping(now, means.straight_stop(now.moment.state, means.braking), ROLLS)
        if not gear and self.given.vehicle.reverse is None:
            because = CANNOT_ROLL
            plan = replace(plan, status=PlanStatus.INFEASIBLE, stop=None, code=because.code, reason=because.sentence)
        return plan, along(plan, not gear)

    def _keep_up(self, time: float) -> None:
        """Adapt the period, if none is given, to the last gaps between replans, but for outliers."""
        if self._gaps is None or self._state is None:
            return
        self._gaps.append(time - self._state.time)
        longest = sorted(self._gaps)[-1 - int(PACE.outliers * len(self._gaps))]
        period = longest if longest > self._period * (1.0 + LATE) + TIME else self._period
        if period != self._online.period:
            self._online = replace(self._online, period=period)
            self._means.replans_every(period)

    def _leg_by_leg(self, now: Replan, legs: LegsAhead, reported: Callable[[], State]) -> tuple[Replan, OnlinePlan]:
        """Plan the leg under way, or the next one where the vehicle stands at the end of that."""
        while True:
            now = self._on_leg(now, reported)
            waits = legs.waits(now, self._means)
            if not legs.sets_out:
                now.moment = replace(now.moment, lost=waits)
                plan = self._decision.answer(now)
                turns = not plan.safe and legs.turns_about(now)
                if not (turns or legs.goes_on(now, plan)):
                    return now, plan

    def _on_leg(self, now: Replan, reported: Callable[[], State]) -> Replan:
        """Set out on a leg, if that is due."""
        legs = self._legs
        if legs is None or not legs.sets_out:
            return now
        legs.sets_out, self._last = False, None
        self._set_out(legs.scene, self.solver)
        now = replace(now, moment=self._means.moment(reported(), None))
        now.last = self._last = legs.first(now, self._means)
        return now

    def _on_route(self, now: Replan, route: RouteAhead) -> None:
        """Look for a route over the map, where that is due, and plan along it."""
        if route.renewed(now, self._means):
            self._set_out(route.scene, self.solver)
            now.moment = self._means.moment(now.moment.state, now.last)
        if route.plan is not None:
            self._means.known, route.plan = route.plan, None
        now.unrouted = route.none
        now.lap("route")

    def _ask(self, predictor: Predictor, now: float, position: ArrayLike) -> None:
        """Take in what a predictor says, for the time that the trip may take."""
        goal, units = self.given.goal.position, self._units
        straight = math.dist(units.place(_point("position", position)), goal) / self.given.vehicle.max_speed
        left = 0.0 if self.plan is None else self.plan.arrival_time - now
        for name, motion in predictor.predict(now, max(straight * units.time, left)).items():
            self.update_motion(name, motion)

    def record(self, path: str | PathLike[str], live: bool = False) -> Any:
        """Record what the planner is told and answers, until the context that this returns is left.

        Parameters
        ----------
        path : path
            .jsonl: a line a replan, written at once. `scp_planner.Run.load` reads it, also after a crash, for pictures,
            the viewer and exports.
        live : bool
            Serve each replan to Foxglove, too, at ws://127.0.0.1:8765.

        Returns
        -------
        scp_planner.simulation.recorder.Recorder
            To be used in a ``with`` statement.

        Raises
        ------
        ValueError
            If the suffix is another one.
        ImportError
            If it shall be live, and `foxglove-sdk` is not installed.
        """
        return output_named("planner record")(self, path, live)

    def _doubted(self, now: Replan, speed: float, acceleration: float | None) -> Iterator[str]:
        period, following = self._means.safety_gate.period, self._means.following
        yield from self._assumptions.broken(now.moment, self._last, following, self.given.bounds, period)
        yield from self._inbox.leads()
        found = {"speed": speeding(abs(speed), self._means.given.vehicle.max_speed * self._units.speed)}
        if acceleration is not None and now.moment.state.acceleration is not None:
            low, high = (one * self._units.acceleration for one in self._possible(now.moment.state.speed))
            found["acceleration"] = accelerating(float(acceleration), low, high)
        if self._rolls(now.moment.state):
            has_gear = self._legs is not None or self.given.vehicle.reverse is not None
            found["gear"] = against_gear(abs(speed), has_gear)
        new = {key: text for key, text in found.items() if text is not None}
        yield from (text for key, text in new.items() if key not in self._oddities)
        self._oddities = frozenset(new)

    def _check_state(
        self,
        time: float,
        position: ArrayLike,
        heading: float | None,
        speed: float,
        acceleration: float | None,
        deadline: float | None,
    ) -> None:
        check_number("time", time)
        if self._clock is not None and time < self._clock:
            raise ValueError(f"time: {time!r} is before {self._clock!r}, the time of the last replan")
        _point("position", position)
        check_number("speed", speed)
        for name, value in (("heading", heading), ("acceleration", acceleration)):
            if value is not None:
                check_number(name, value)
        if deadline is not None and not (isinstance(deadline, int | float | np.number) and deadline > 0.0):
            raise ValueError(f"deadline: {deadline!r} is not a positive number of seconds")

    def _reported_state(
        self, time: float, position: ArrayLike, heading: float | None, speed: float, acceleration: float | None
    ) -> State:
        """Return the reported state in the direction of driving; the front is behind against the gear."""
        units, given = self._units, self._means.given
        there, instant = units.place(_point("position", position)), units.instant(float(time))
        pace, either = float(speed) / units.speed, given.vehicle.steering is Steering.BOTH_WAYS
        if self._legs is not None:
            heading, pace = self._legs.reported(instant, heading, pace)
        stands = Deviation(0.0, abs(pace), 0.0)
        if pace < 0.0 and not either and (-pace <= STOPS.standing or self._means.following.allows(stands)):
            pace = 0.0  # the sensor of a vehicle that stands may show a speed below nothing
        ahead, front = heading, self._front(instant, heading) if either else None
        if pace < 0.0 and heading is not None:
            ahead = math.remainder(heading + math.pi, 2.0 * math.pi)
            front = front if either else heading
        pace = abs(pace)
        ahead = direction(given.vehicle, there, ahead, pace, given.goal.position)
        return State(instant, there, ahead, pace, self._present_acceleration(instant, acceleration, pace), front)

    def _front(self, time: float, heading: float | None) -> float | None:
        before, last = self._state, self._last
        if heading is None or before is None or before.front is None or last is None:
            return heading
        points, _ = last.trip.at(np.array([before.time, time]))
        was, now = np.arctan2(points.path.direction[:, 1], points.path.direction[:, 0]).tolist()
        return heading if math.cos(heading - before.front - (now - was)) >= 0.0 else heading + math.pi

    def _present_acceleration(self, time: float, given: float | None, pace: float) -> float | None:
        """The acceleration that a plan begins with, in units of the scene; None where it may jump."""
        vehicle, last = self._means.given.vehicle, self._last
        if vehicle.max_jerk is None:
            return None
        if given is not None:
            found = float(given) / self._units.acceleration
        elif self._state is None:
            found = self.given.start.acceleration or 0.0
        elif last is not None and time < last.arrival_time:
            found = float(last.trip.at(time)[0].acceleration[0])
        else:
            found = 0.0
        low, high = self._possible(pace)
        return min(max(found, low), high)

    def _possible(self, pace: float) -> tuple[float, float]:
        """Least and largest acceleration that the vehicle can have at a speed: none below nothing where it stands."""
        vehicle = self._means.given.vehicle
        return 0.0 if pace <= STOPS.standing else -vehicle.max_deceleration, vehicle.max_acceleration

    def _when_followed(self, state: State) -> State:
        """The state in which a new plan is begun: that of the present, or, without jumps, where the last one leads."""
        reaction, last = self._online.reaction_time, self._last
        if state.acceleration is None or last is None or reaction == 0.0:
            return state
        points, _ = last.trip.at(np.array([state.time, state.time + reaction]))
        (x, y), (after_x, after_y) = last.trip.frame.to_world(points.path.position).tolist()
        turned = np.arctan2(points.path.direction[:, 1], points.path.direction[:, 0])
        left = last.arrival_time > state.time + reaction
        return State(
            state.time + reaction,
            (state.position[0] + after_x - x, state.position[1] + after_y - y),
            None if state.heading is None else state.heading + float(turned[1] - turned[0]),
            max(state.speed + float(points.speed[1] - points.speed[0]), 0.0),
            state.acceleration + float(points.acceleration[1] - points.acceleration[0]) if left else 0.0,
            None if state.front is None else state.front + float(turned[1] - turned[0]),
        )

    def at_goal(self, position: ArrayLike) -> bool:
        """True if a position, (2,) m, is within the goal's radius and the tolerance of arrival.

        That is ``online.arrival_tolerance`` and the tracking error. False while a place is left to pass.
        ``plan.arrived`` says whether speed and heading are those of the goal, too.
        """
        if self._legs is not None and not self._legs.at_end:
            return False
        there = self._decision.arrival.is_there(self._units.place(_point("position", position)))
        return there and not self.given.goals
