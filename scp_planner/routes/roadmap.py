"""Routes from start to goal round all that stands, the shortest first."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from math import inf, pi, remainder

import numpy as np

from scp_planner.arrays import Array
from scp_planner.mathematics.dubins import Pose
from scp_planner.mathematics.frames import PlanningFrame
from scp_planner.mathematics.taut import TautLines
from scp_planner.mathematics.tolerances import ANGLE_DECIMALS
from scp_planner.routes.outlines import polygons_around, standing_shapes
from scp_planner.routes.turns import loops, out_of_reach, radii, turned_into
from scp_planner.routes.widening import widened
from scp_planner.scenario.limits import Box, Limits, straight_travel_time
from scp_planner.scenario.models import Scenario
from scp_planner.threat_zones.batch import ZoneBatch


@dataclass(frozen=True)
class RouteSettings:
    """Routes that are looked at."""

    farthest: float = 4.0  # times the shortest: longer ones are not looked at
    cut: float = 0.5  # of the vehicle's radius, by which turns may cut into what stands: the path keeps out of it


ROUTES = RouteSettings()


@dataclass(frozen=True)
class Route:
    """A polyline over the ground, (n, 2) m, its length, m, and a time that it takes at least, s."""

    points: Array
    length: float
    least_time: float
    loop: bool = False

    @property
    def straight(self) -> bool:
        """True if it is one leg."""
        return len(self.points) == 2


class Roadmap:
    """Routes of a scenario in the planning frame, among zones that are inflated by the vehicle's radius."""

    def __init__(
        self,
        scenario: Scenario,
        frame: PlanningFrame,
        limits: Limits,
        zones: ZoneBatch,
        box: Box,
        deadline: float = inf,
    ) -> None:
        self.scenario, self.limits, self.frame, self.deadline = scenario, limits, frame, deadline
        self.zones, self.box = zones, box
        self.ends = frame.to_frame(np.array([scenario.start.position, scenario.goal.position]))
        self.headings = [
            None if heading is None else round(remainder(heading - frame.heading, 2.0 * pi), ANGLE_DECIMALS)
            for heading in (scenario.start.heading, scenario.goal.heading)
        ]
        self.radius = 1.0 / limits.curvature if np.isfinite(limits.curvature) else 0.0

    @cached_property
    def taut(self) -> TautLines:
        """Taut polylines among all that stands."""
        polygons = polygons_around(standing_shapes(self.zones), self.ends)
        inside = list(zip(self.box.normals, self.box.offsets.tolist(), strict=True))
        return TautLines(polygons, self.ends[0], self.ends[1], inside, self.deadline)

    @property
    def has_to_loop(self) -> bool:
        """True if the goal lies beside the vehicle, nearer than it can turn."""
        (start, goal), (first, last) = self.ends, self.headings
        near, back = self.scenario.goal.radius, None if last is None else last + pi
        return any(out_of_reach(*end, near, self.radius) for end in ((start, first, goal), (goal, back, start)))

    def clear(self, points: Array) -> bool:
        """True if a polyline, (n, 2) m, cuts into nothing that stands, nor leaves the workspace, by more than a bit."""
        deeper = ROUTES.cut * self.scenario.vehicle.radius
        return bool(self.box.room(points).min() >= -deeper) and not len(self.taut.met(points, deeper))

    def routes(self) -> Iterator[Route]:
        """Yield routes, the shortest first."""
        if self.has_to_loop:
            ends = zip(self.ends.tolist(), self.headings, strict=True)
            first, last = (Pose((x, y), heading) for (x, y), heading in ends)
            for length, points in loops(first, last, radii(0.0, self.radius), self.clear):
                yield self._route(points, length, loop=True)
            return
        shortest = inf
        for line in self.taut:
            shortest = min(shortest, line.length)
            if line.length > ROUTES.farthest * shortest:
                return
            yield self._route(line.points, line.length)

    def turned(self, route: Route, first: float, last: float) -> Array:
        """Return the points of a route that begins and ends along the headings, in arcs of at most some radii, m."""
        if route.loop:
            return route.points
        ends = [
            (heading, radii(wanted, self.radius)) for heading, wanted in zip(self.headings, (first, last), strict=True)
        ]
        return turned_into(route.points, ends, self.clear)

    def widened(self, points: Array) -> Array:
        """Return a route, (n, 2) m, with bends as wide as the vehicle needs where there is room for that."""
        first, last = (1 if heading is None else 2 for heading in self.headings)
        return widened(points, self.taut.all, self.box, self.radius, (first, last))

    def _route(self, points: Array, length: float, loop: bool = False) -> Route:
        start, goal = self.scenario.start, self.scenario.goal
        driven = max(length - goal.radius, 0.0)
        least = 0.0 if driven == 0.0 else straight_travel_time(driven, start.speed, self.limits, goal.speed)[0]
        return Route(points, length, least, loop)
