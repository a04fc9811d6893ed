"""Ground along lines over a map: convex polygons without occupied cells, and what they hold."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from time import perf_counter

import numpy as np

from scp_planner.arrays import Array
from scp_planner.mathematics.convex_pieces import in_convex
from scp_planner.mathematics.frames import PlanningFrame
from scp_planner.mathematics.polylines import lengths_along, points_at
from scp_planner.pauses import Budget, OutOfTimeError
from scp_planner.routes.outlines import standing_shapes
from scp_planner.routes.over_map import MAPS, MapRoutes, straightened
from scp_planner.scenario.limits import Limits, straight_travel_time
from scp_planner.scenario.models import Scenario
from scp_planner.scenario.units import changed
from scp_planner.threat_zones.batch import ZoneBatch
from scp_planner.threat_zones.of_scenario import zones


@dataclass(frozen=True)
class GroundSettings:
    """Corridors along routes and trips, and how long the widest passage is looked for."""

    steps: int = 7  # of bisection for the widest passage, at most
    looking: float = 1.0  # s of wall time, after which it is not looked for any closer
    straight: float = 0.05  # radii, by which legs round which ground is grown are off their route
    places: int = 400  # of a trip that ground is grown along
    grown: int = 6  # times, at most
    gain: float = 1e-3  # relative, that is worth growing it again


GROUND = GroundSettings()


def ground_along(routes: MapRoutes, lines: Sequence[Array]) -> list[Array]:
    """Return convex polygons, (k, 2) m each, without occupied cells along polylines, (n, 2) m each."""
    off = GROUND.straight * routes.scenario.vehicle.radius
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


class MapLines:
    """Lines over the map of a scenario, from its start over its places to pass to its goal."""

    def __init__(self, scenario: Scenario, budget: Budget) -> None:
        assert scenario.ground is not None
        self.scenario, self.map, self.budget = scenario, scenario.ground.map, budget
        bare = changed(scenario, ground=None)
        found = zones(bare) if bare.obstacles or bare.walls else ()
        self.standing = standing_shapes(ZoneBatch.of(found, PlanningFrame((0.0, 0.0), 0.0, 0.0), 0.0))
        self.routes = MapRoutes(scenario, self.map, self.standing, budget)

    def lines(self) -> tuple[Array | None, Array | None]:
        """Return the shortest line and one that the vehicle can follow, (n, 2) m each; None where there is none."""
        shortest = self.routes.route()
        return shortest, self.routes.drivable

    def pieces(self) -> list[Array] | None:
        """Return the shortest line to each place to pass and to the goal, (n, 2) m each; None where one is missing."""
        start, goal, vehicle = self.scenario.start, self.scenario.goal, self.scenario.vehicle
        ends = [changed(goal, position=one.position, radius=one.within(vehicle)) for one in self.scenario.goals]
        found, begin = list[Array](), start
        for end in (*ends, goal):
            piece = MapRoutes(
                changed(self.scenario, start=begin, goal=end), self.map, self.standing, self.budget
            ).route()
            if piece is None:
                return None
            found.append(np.concatenate([[begin.position], piece[1:-1], [end.position]]))
            begin = changed(start, position=end.position, heading=None)
        return found

    def with_ends(self, line: Array) -> Array:
        """Return a line with its ends at the start and the goal, (n, 2) m."""
        return np.concatenate([[self.scenario.start.position], line[1:-1], [self.scenario.goal.position]])

    def may_be_open(self, line: Array) -> bool:
        """True if the ground along a line has few enough pieces for a trip to find its own guide."""
        return len(self.routes.along(line)) <= MAPS.most_open

    def why_none(self) -> str:
        """Say how wide the widest passage to the goal is."""
        radius, until = self.scenario.vehicle.radius, min(perf_counter() + GROUND.looking, self.budget.last_check)
        fits, too_large = 0.0, radius
        for _ in range(GROUND.steps):
            if perf_counter() > until:
                break
            middle = 0.5 * (fits + too_large)
            smaller = changed(self.scenario, vehicle=changed(self.scenario.vehicle, radius=middle))
            try:
                found = MapRoutes(smaller, self.map, self.standing, self.budget).route()
            except OutOfTimeError:
                break
            if found is None:
                too_large = middle
            else:
                fits = middle
        told = f"no route over the map leads to the goal for a vehicle with a radius of {radius:g} m"
        if fits == 0.0:
            return told
        wide, less = 2.0 * fits, 2.0 * (radius - fits)
        return f"{told}: the widest passage is about {wide:.2g} m wide, {less:.2g} m less than it takes"
