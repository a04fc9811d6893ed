"""Routes while driving: round what stands, and over a map, in whose local ground along the route trips are planned.

Routes are looked for in a share of the time of each replan. A route is the guide of trips where the straight guide does
not do. Over a map the ground is a corridor for trips; manoeuvres and the safety gate ask the cells. There the last plan
is driven, as long as it can be left for a certified stop, until there is a route.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from itertools import compress
from typing import Any

import numpy as np

from scp_planner.arrays import Array
from scp_planner.certificate.verdict import Ends
from scp_planner.errors import TooLargeError
from scp_planner.mathematics import corridor
from scp_planner.mathematics.frames import PlanningFrame
from scp_planner.mathematics.occupancy import NAME, OccupancyMap
from scp_planner.mathematics.polylines import lengths_along
from scp_planner.mathematics.polynomials import PiecewisePolynomials
from scp_planner.online.arrival import Waiting
from scp_planner.online.means import Means, Replan
from scp_planner.online.plan import AWAY
from scp_planner.online.reasons import Reason, ReasonCode
from scp_planner.online.remaining import State
from scp_planner.online.stops import STOPS
from scp_planner.pauses import Coroutine, pause
from scp_planner.planning.plan import Plan
from scp_planner.planning.plan_search import planned
from scp_planner.routes.ground import GROUND, ground_along, leads_through, least_time_along, with_ground
from scp_planner.routes.outlines import standing_shapes
from scp_planner.routes.over_map import MapRoutes, straightened
from scp_planner.routes.roadmap import Roadmap
from scp_planner.routes.visits import fixed
from scp_planner.scenario.checks import room_on_map
from scp_planner.scenario.limits import Box, Limits
from scp_planner.scenario.models import Scenario, Start
from scp_planner.scenario.units import changed
from scp_planner.settings.planning import SceneSettings
from scp_planner.threat_zones.batch import ZoneBatch
from scp_planner.threat_zones.of_scenario import corridor_zones
from scp_planner.threat_zones.zone import ThreatZone
from scp_planner.trips.trip import Trip


@dataclass(frozen=True)
class RouteAheadParameters:
    # Units of time without a trip to the goal, in which it comes no nearer, until another route is looked for
    patience: float = 3.0
    gain: float = 0.02  # Share by which another route must be shorter than what is left, for the vehicle to change over
    share: float = 0.5  # Of the time up to a deadline, for the search


ROUTE_AHEAD = RouteAheadParameters()
SOUGHT = Reason(ReasonCode.OUT_OF_TIME, "A route to the goal is being looked for.")
NO_ROUTE = Reason(ReasonCode.BLOCKED, "No way over the map to the goal is found.", NAME)
ON_CELLS = Reason(ReasonCode.BLOCKED, "The vehicle is on occupied cells of the map.", NAME)
GOAL_ON_CELLS = Reason(ReasonCode.BLOCKED, "The goal is on occupied cells of the map.", NAME)


@dataclass(frozen=True)
class FoundRoutes:
    """Routes to the goal, (n, 2) m each, the best to follow first, and the ground along them."""

    lines: list[Array]
    ground: list[Array]
    plan: Plan | None = None  # A trip along the first among what stands


class RouteAhead:
    """The route under way round all that stands, if the straight guide does not serve it, and the search for it."""

    def __init__(self, asked: Scenario) -> None:
        """Take a scenario in units of the scene."""
        self.asked, self.scene = asked, asked
        # Else only a trip is looked for, where there is none
        self.guides = asked.guide is None and not asked.goals and asked.goal.target is None
        self._blocked: Reason | None = None  # Why there is no route, where nothing is driven without one
        self.plan: Plan | None = None  # A trip that was found with the route, and is not driven yet
        self._due = self.guides
        self._stuck = False  # There was no trip to the goal for long
        self._search: Coroutine[FoundRoutes | Reason | None] | None = None
        self._from: State | None = None  # Where the search began
        self._waiting = Waiting()

    def __getstate__(self) -> dict[str, Any]:
        """Copies and pickles begin a search under way anew."""
        return {**self.__dict__, "_search": None}

    @property
    def none(self) -> Reason | None:
        """Why no route is under way, where the vehicle is to stand until there is one."""
        return SOUGHT if self._due else None

    def renewed(self, now: Replan, means: Means) -> bool:
        """Look for a route for a share of the time, where that is due; return True if there is another scene."""
        if now.moment.lost is not None:
            return False
        state, scene, leads = now.moment.state, now.moment.scenario, self._leads(now, means)
        way = np.array(scene.guide or (state.position, scene.goal.position))
        waited = self._waiting.waited(state.time, float(lengths_along(way)[-1]))
        if leads:
            self._waiting = Waiting()
            self._due &= self.guides
        elif waited >= ROUTE_AHEAD.patience and not means.arrival.is_there(state.position):
            self._waiting = Waiting()
            self._due = self._stuck = True
        return self._due and self._searched(now, means, leads)

    @staticmethod
    def _leads(now: Replan, means: Means) -> bool:
        """True if the last plan leads to the goal."""
        if now.last is None or now.last.outcome in AWAY:
            return False
        return now.moment.moving is not None or means.arrival.is_end_of(now.last.trip)

    def _searched(self, now: Replan, means: Means, leads: bool) -> bool:
        state = now.moment.state
        if self._search is None or (state.speed <= STOPS.standing and not means.stays(self._from, state)):
            self._from = state
            left = now.last.arrival_time - state.time if now.last is not None and leads else np.inf
            within = (left if self._blocked is None else np.inf) * (1.0 - ROUTE_AHEAD.gain)
            self._search = Coroutine(self._searching(now, means, within))
        waits = self.none is not None and state.speed <= STOPS.standing
        until = now.until("certificate") if waits else now.clock + ROUTE_AHEAD.share * (now.deadline - now.clock)
        if not self._search.resume(until):
            return False
        found, self._search, self._due = self._search.result, None, False
        self._waiting = Waiting()
        return self._take(found, now, means)

    def _searching(self, now: Replan, means: Means, within: float) -> Callable[[], FoundRoutes | Reason | None]:
        """Return the search for a route that takes so long at most, s."""
        scene = now.moment.scenario
        zones = (*_that_stand(now, means), *corridor_zones(self.asked))
        if not self.guides:
            scene = changed(fixed(scene), guide=self.asked.guide and scene.guide)
            return partial(_planned_on, scene, zones, thorough=True)
        scene = changed(scene, guide=None)
        return partial(_route_round, scene, zones, means.settings, within, self._stuck)

    def _take(self, found: FoundRoutes | Reason | None, now: Replan, means: Means) -> bool:  # noqa: ARG002
        """Plan along a route that was found from now on; return True if that changes the scene."""
        if not isinstance(found, FoundRoutes):
            return False
        self.plan = found.plan
        before, line = self.scene.guide, found.lines[0] if found.lines else None
        guide = None if line is None else tuple((x, y) for x, y in line.tolist())
        self.scene = changed(self.asked, guide=guide)
        return guide != before


class MapRouteAhead(RouteAhead):
    """The route under way over a map, and the ground along it."""

    def __init__(self, asked: Scenario) -> None:
        """Take a scenario with a map, in units of the scene."""
        super().__init__(asked)
        assert asked.ground is not None
        self.map, self._blocked = asked.ground.map, SOUGHT
        self.guides = self._due = True
        self._ground: list[Array] = []
        self._grown = False

    @property
    def none(self) -> Reason | None:
        return self._blocked or (SOUGHT if self._due and self._stuck else None)

    def renewed(self, now: Replan, means: Means) -> bool:
        """Look for a route for a share of the time, where that is due; return True if the ground is another one."""
        if self._grown:
            return super().renewed(now, means)
        # Another map or goal: what is driven may still be as good as any
        state, last, leads = now.moment.state, now.last, self._leads(now, means)
        alone = replace(now.moment, zones=())
        if leads and last is not None and alone.certify(last.trip, since=state.time, ends=Ends.GOAL).holds:
            self._blocked = None
        self._grow(now, means, FoundRoutes([], []))
        self._searched(now, means, leads)
        return True

    def _searching(self, now: Replan, means: Means, within: float) -> Callable[[], FoundRoutes | Reason | None]:
        scene = self._scene_at(now.moment.state, means)
        plan = means.planned_along if self._stuck else None
        return partial(_routes, scene, self.map, _that_stand(now, means), within, plan, _driven(now))

    def _take(self, found: FoundRoutes | Reason | None, now: Replan, means: Means) -> bool:
        if not isinstance(found, FoundRoutes):
            self._blocked = self._blocked and (found or NO_ROUTE)
            return False
        self.plan = found.plan
        if self._blocked is None and leads_through(self._ground, found.lines[0], self.asked.vehicle.radius):
            return False
        self._blocked = None
        self._grow(now, means, found)
        return True

    def _grow(self, now: Replan, means: Means, found: FoundRoutes) -> None:
        """Take the ground along routes from here to the goal, and grow it along what is driven."""
        state, lines = now.moment.state, _driven(now)
        if not found.lines:
            lines = [np.array([state.position] * 2) if now.last is None else _ahead(now.last.trip, state)]
        elif all(leads_through(found.ground, line, self.asked.vehicle.radius) for line in lines):
            lines = []
        routes = MapRoutes(self._scene_at(state, means), self.map)
        pieces = self._ground = [*found.ground, *ground_along(routes, lines)]
        guide = self.asked.guide
        if guide is None and self._blocked is None:
            guide = _guide_along((found.lines or lines)[0], self.asked)
        grown = with_ground(self.asked, pieces) if pieces else self.asked
        self.scene, self._grown = changed(grown, ground=self.asked.ground, guide=guide), True

    def _scene_at(self, state: State, means: Means) -> Scenario:
        """Return what is left of the scenario over the map."""
        asked, radius = self.asked, means.given.vehicle.radius + means.following.room
        scene = means.scenario_at(state)
        guide, vehicle = asked.guide and scene.guide, changed(scene.vehicle, radius=radius)
        return changed(scene, corridor=None, guide=guide, vehicle=vehicle)


def _route_round(
    scene: Scenario,
    zones: tuple[ThreatZone, ...],
    settings: SceneSettings,
    within: float,
    stuck: bool,
) -> FoundRoutes | None:
    """Find the fastest way round what stands, if the straight guide does not do; None if it takes longer, s.

    A trip is planned along it; if the vehicle is stuck along the straight guide, too.
    """
    frame = PlanningFrame.between(scene.start.position, scene.goal.position, scene.start.time)
    limits = Limits.of(scene, settings.limit_margin).rounded()
    batch = ZoneBatch.of(zones, frame, scene.vehicle.radius + settings.clearance_margin).rounded()
    roadmap, route = Roadmap(scene, frame, limits, batch, Box.of(scene, frame, settings.box_margin)), None
    if len(batch.standing) > 0 and not roadmap.has_to_loop:
        with suppress(TooLargeError):
            route = next(roadmap.routes(), None)
    if route is None or route.straight:
        return _planned_on(scene, zones, thorough=True) if stuck else FoundRoutes([], [])
    pause()
    if route.least_time > within:
        return None
    found = _planned_on(scene, zones, thorough=stuck)
    if found.plan is None or (found.plan.trip.trajectory.space.guide.straight and not stuck):
        return found
    return replace(found, lines=[np.array(_guide_along(_ahead(found.plan.trip, scene.start), scene))])


def _planned_on(scene: Scenario, zones: tuple[ThreatZone, ...], thorough: bool) -> FoundRoutes:
    """Plan a whole trip among what stands."""
    plan = planned(scene, thorough=thorough, threat_zones=zones)
    return FoundRoutes([], [], plan if plan.certified else None)


def _routes(
    scene: Scenario,
    ground: OccupancyMap,
    standing: tuple[ThreatZone, ...],
    within: float,
    plan: Callable[[Scenario], Plan] | None,
    driven: list[Array],
) -> FoundRoutes | Reason | None:
    """Find routes among what stands, or over the map alone, the best to follow first; None if none takes so long, s.

    A trip along the first is planned in the ground along them and what is driven, if that is asked for.
    """
    while True:
        shapes = (*standing, *corridor_zones(changed(scene, corridor=None)))
        batch = ZoneBatch.of(shapes, PlanningFrame((0.0, 0.0), 0.0, 0.0), 0.0)
        routes = MapRoutes(scene, ground, standing_shapes(batch))
        line = routes.route()
        pause()
        if line is not None or not standing:
            break
        standing = ()
    if line is None:
        places = ((scene.start, ON_CELLS), (scene.goal, GOAL_ON_CELLS))
        return next((why for place, why in places if room_on_map(scene, place) < scene.vehicle.radius), NO_ROUTE)
    if least_time_along(scene, line) > within:
        return None
    lines = [line] if routes.drivable is None else [routes.drivable, line]
    lines = [np.concatenate([[scene.start.position], each[1:-1], [scene.goal.position]]) for each in lines]
    found = FoundRoutes(lines, ground_along(routes, [*lines, *driven]))
    within_ground = with_ground(scene, found.ground)
    if within_ground.corridor:
        corridor.known_outside(within_ground.corridor)  # here, where there are pauses
    if plan is None:
        return found
    pause()
    trip = plan(changed(within_ground, guide=_guide_along(lines[0], scene)))
    return replace(found, plan=trip if trip.certified else None)


def _guide_along(line: Array, scene: Scenario) -> tuple[tuple[float, float], ...]:
    """Return a guide to the goal near to a polyline, (n, 2) m."""
    straight = straightened(line, GROUND.straight * scene.vehicle.radius)[:-1].tolist()
    return (*((x, y) for x, y in straight), scene.goal.position)


def _ahead(trip: Trip, state: State | Start) -> Array:
    """Return places (n, 2) m on what is left of a trip, from a state on."""
    times = np.linspace(state.time, trip.frame.time + trip.trajectory.travel_time, GROUND.places)
    return np.concatenate([[state.position], trip.frame.to_world(trip.positions_at(times[1:]))])


def _driven(now: Replan) -> list[Array]:
    """Return what is left of the last trip, (n, 2) m, if the vehicle moves."""
    state, last = now.moment.state, now.last
    return [] if last is None or state.speed <= STOPS.standing else [_ahead(last.trip, state)]


def _that_stand(now: Replan, means: Means) -> tuple[ThreatZone, ...]:
    """Return the zones of obstacles that stand, or hardly move, where they are now, of the size that is foreseen."""
    time, found = now.moment.state.time, list[ThreatZone]()
    grown = np.array([time + means.foresight])
    standing = {*compress(now.moment.batch.ids, now.moment.stands)} - {NAME, corridor.WALLS}
    for zone in now.moment.zones:
        if zone.id in standing:
            at = PiecewisePolynomials.single(0.0, zone.center(time)[None])
            spread = zone.covariances and PiecewisePolynomials.single(0.0, zone.covariances.grid(grown)[0])
            found.append(replace(zone, centers=at, covariances=spread))
    return tuple(found)
