"""A trip over a map: planned in convex ground along routes over its free cells, certified against the cells."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from time import perf_counter
from typing import Protocol

import numpy as np

from scp_planner.arrays import Array
from scp_planner.certificate.check import certify
from scp_planner.certificate.lower_bound import kinematic_bound
from scp_planner.mathematics.convex_pieces import in_convex
from scp_planner.mathematics.frames import PlanningFrame
from scp_planner.mathematics.occupancy import OccupancyMap
from scp_planner.mathematics.polylines import lengths_along, points_at
from scp_planner.planning.legs import may_have_legs
from scp_planner.planning.plan import Plan, PlanStatus, judged_by
from scp_planner.problem.preparation import last_check, left_before_check
from scp_planner.routes.outlines import StandingShape, standing_shapes
from scp_planner.routes.over_map import MAPS, MapRoutes, straightened
from scp_planner.scenario.limits import Limits, straight_travel_time
from scp_planner.scenario.models import Scenario
from scp_planner.scenario.units import changed
from scp_planner.threat_zones.batch import ZoneBatch
from scp_planner.threat_zones.of_scenario import zones


class PlanWithin(Protocol):
    """Plans without a map within a wall time, s, at first along a route, (n, 2) m, if there is one."""

    def __call__(self, scenario: Scenario, left: float | None, along: Array | None = None, /) -> Plan: ...


@dataclass(frozen=True)
class OverMapSettings:
    """Corridors along routes and trips, and how long the widest passage is looked for."""

    steps: int = 7  # of bisection for the widest passage, at most
    looking: float = 1.0  # s of wall time, after which it is not looked for any closer
    straight: float = 0.05  # radii, by which legs round which ground is grown are off their route
    places: int = 400  # of a trip that ground is grown along
    grown: int = 6  # times, at most
    gain: float = 1e-3  # relative, that is worth growing it again


OVER_MAP = OverMapSettings()


def plan_over_map(scenario: Scenario, plan: PlanWithin, time_limit: float | None) -> Plan:
    """Plan a trip by ``plan(scenario without a map, time limit)``."""
    ground, began = scenario.ground, perf_counter()
    assert ground is not None
    bare = changed(scenario, ground=None)
    standing = ZoneBatch.of(
        zones(bare) if bare.obstacles or bare.walls else (), PlanningFrame((0.0, 0.0), 0.0, 0.0), 0.0
    )
    routes = MapRoutes(scenario, ground.map, standing_shapes(standing))
    route = routes.route()
    if route is None:
        found = plan(bare, left_before_check(time_limit, began))
        found = _certified(scenario, found, last_check(time_limit, began))
        if found.certified:
            return found
        until = min(perf_counter() + OVER_MAP.looking, last_check(time_limit, began))
        reason = _no_route(scenario, ground.map, routes.standing, until)
        return replace(found, status=PlanStatus.INFEASIBLE, reason=reason)
    search = CorridorSearch(scenario, plan, routes, began, time_limit)
    return replace(search.run(route), wall_time=perf_counter() - began)


def ground_along(routes: MapRoutes, lines: Sequence[Array]) -> list[Array]:
    """Return convex polygons, (k, 2) m each, without occupied cells along polylines, (n, 2) m each."""
    off = OVER_MAP.straight * routes.scenario.vehicle.radius
    return [piece for line in lines for piece in routes.along(straightened(line, off))]


def least_time_along(scenario: Scenario, line: Array) -> float:
    """Return the least time along a polyline, (n, 2) m, as if it had no bends, s."""
    start, goal = scenario.start, scenario.goal
    length = float(np.hypot(*np.diff(line, axis=0).T).sum()) - goal.radius
    return straight_travel_time(max(length, 0.0), start.speed, Limits.of(scenario), goal.speed)[0]


def leads_through(ground: Sequence[Array], line: Array, apart: float) -> bool:
    """True if convex polygons hold the places of a polyline, (n, 2) m, that are so far apart, m."""
    along = lengths_along(line)
    places = points_at(np.arange(0.0, along[-1], apart), along, line)
    return bool(np.any([in_convex(piece, places) for piece in ground], axis=0).all())


def with_ground(scenario: Scenario, grown: Sequence[Array]) -> Scenario:
    """Return a scenario in some ground, in place of its map."""
    pieces = tuple(tuple((float(x), float(y)) for x, y in piece) for piece in grown)
    return changed(scenario, ground=None, corridor=pieces)


class CorridorSearch:
    """Plans in corridors along routes, then along the best trip, while it gets faster."""

    def __init__(
        self, scenario: Scenario, plan: PlanWithin, routes: MapRoutes, began: float, time_limit: float | None = None
    ) -> None:
        """Take when it began, and the time that it may take, s."""
        self.scenario, self.plan, self.routes, self.last = scenario, plan, routes, last_check(time_limit, began)
        self.left = partial(left_before_check, time_limit, began)
        self.iterations = 0
        self.grown: list[Array] = []
        self.best: Plan | None = None

    def run(self, shortest: Array) -> Plan:
        """Find the fastest certified trip, or else the best attempt."""
        lines = [shortest] if self.routes.drivable is None else [self.routes.drivable, shortest]
        if self.scenario.guide is not None or may_have_legs(self.scenario):  # which find guides of their own
            if self.scenario.guide is not None:
                ends = self.scenario.start.position, self.scenario.goal.position
                lines.append(np.array([ends[0], *self.scenario.guide, ends[1]]))
            self._along(lines)
        else:
            for line in lines:
                known = self._certified and leads_through(self.grown, line, self.scenario.vehicle.radius)
                if not known and least_time_along(self.scenario, line) < self._time:
                    self._along([line], line)
            if not self._certified and len(self.routes.along(shortest)) <= MAPS.most_open:
                self._along(lines)
            for _ in range(OVER_MAP.grown):
                if not self._certified or self._over or not self._regrown():
                    break
        assert self.best is not None
        return replace(self.best, iterations=self.iterations)

    @property
    def _certified(self) -> bool:
        return self.best is not None and self.best.certified

    @property
    def _time(self) -> float:
        return np.inf if self.best is None else self.best.travel_time

    @property
    def _over(self) -> bool:
        return self.left() == 0.0

    def _regrown(self) -> bool:
        """Plan in ground grown along the best trip; return True if it is worth doing again."""
        before = self.best
        assert before is not None
        line = before.position(before.start_time + np.linspace(0.0, before.travel_time, OVER_MAP.places))
        self._along([line], line)
        assert self.best is not None
        return self.best.travel_time < before.travel_time * (1.0 - OVER_MAP.gain)

    def _along(self, lines: Sequence[Array], along: Array | None = None) -> None:
        """Plan in the ground along some polylines, at first along one of them, and keep the better plan."""
        if self.best is not None and self._over:
            return
        self.grown = ground_along(self.routes, lines)
        within = with_ground(self.scenario, self.grown)
        if along is not None:
            along = np.concatenate([[self.scenario.start.position], along[1:-1], [self.scenario.goal.position]])
        found = _certified(self.scenario, self.plan(within, self.left(), along), self.last)
        self.iterations += found.iterations
        best = self.best
        if best is None or found.certified > best.certified:
            self.best = found
        elif found.certified and found.travel_time < best.travel_time:
            self.best = found


def _no_route(scenario: Scenario, ground: OccupancyMap, standing: Sequence[StandingShape], until: float) -> str:
    """Say how wide the widest passage to the goal is, which is looked for until then."""
    radius = scenario.vehicle.radius
    fits, too_large = 0.0, radius
    for _ in range(OVER_MAP.steps):
        if perf_counter() > until:
            break
        middle = 0.5 * (fits + too_large)
        smaller = changed(scenario, vehicle=changed(scenario.vehicle, radius=middle))
        if MapRoutes(smaller, ground, standing).route() is None:
            too_large = middle
        else:
            fits = middle
    told = f"no route over the map leads to the goal for a vehicle with a radius of {radius:g} m"
    if fits == 0.0:
        return told
    return (
        f"{told}: the widest passage is about {2.0 * fits:.2g} m wide, {2.0 * (radius - fits):.2g} m less than it takes"
    )


def _certified(scenario: Scenario, found: Plan, deadline: float) -> Plan:
    """Return a plan with what holds of it over the map."""
    checked = certify(scenario, found, deadline=deadline)
    return replace(judged_by(found, scenario, checked), lower_bound=kinematic_bound(scenario))
