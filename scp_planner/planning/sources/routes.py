"""Routes as guides: taut lines round what stands, and lines over a map in convex ground without occupied cells."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from math import inf

import numpy as np

from scp_planner.arrays import Array
from scp_planner.errors import TooLargeError
from scp_planner.pauses import OutOfTimeError
from scp_planner.planning.plan import Plan
from scp_planner.planning.runs import CheckedRuns, ScpRun
from scp_planner.planning.search import Search, Source
from scp_planner.planning.starts import ROUTE, SCENE, OverGuide, Start, TripSearch
from scp_planner.planning.task import Skeleton, may_have_legs
from scp_planner.problem.guides import ROUTE_GUIDES, guide_over, serves
from scp_planner.problem.problem import Problem
from scp_planner.routes.gaps import describe_gap
from scp_planner.routes.ground import GROUND, MapLines, ground_along, leads_through, least_time_along, with_ground
from scp_planner.routes.roadmap import Roadmap, Route
from scp_planner.scenario.models import Scenario
from scp_planner.scenario.places import anchored
from scp_planner.scenario.units import NaturalUnits, changed
from scp_planner.trips.guide import Guide


@dataclass(frozen=True)
class GuideSettings:
    """Turns and bends of guides along routes."""

    slow: float = 1.3  # least radii of the vehicle, of turns at ends where it stands
    wide: float = 8.0  # and of those at ends where it drives, at most
    least: float = 0.5  # units of length, of turns at ends: splines do not follow tighter ones
    rounded: float = 0.4  # least radii of the vehicle, over which bends that were widened are averaged


ALONG = GuideSettings()


class RouteChoice:
    """Routes of a problem one after the other, and the guides that serve some of them."""

    def __init__(self, roadmap: Roadmap) -> None:
        self.roadmap = roadmap
        self.tried = self.count = 0  # routes with a guide of their own, and all that were looked at
        self.exhausted = False
        self._routes = roadmap.routes()
        self._waiting: Route | None = None
        self._own: list[Guide] = []
        self._default: Guide | None = None
        self._served: list[Route] = []  # by the default guide alone

    @classmethod
    def of(cls, problem: Problem, deadline: float) -> RouteChoice | None:
        """Return the routes of a problem, if there is more to choose from than its guide."""
        scenario = problem.scenario
        if scenario.guide is not None:
            return None
        roadmap = Roadmap(scenario, problem.frame, problem.limits, problem.zones, problem.box, deadline)
        if len(problem.zones.standing) == 0 and not roadmap.has_to_loop:
            return None
        return cls(roadmap)

    def first_beside(self, guide: Guide) -> Route | None:
        """Return the shortest route, unless a guide serves it: then that is the guide of all that it serves."""
        route = self._next()
        if route is None:
            return None
        if self.roadmap.has_to_loop or not serves(guide, route.points):
            self._waiting = route
            return route
        self._default = guide
        self._served.append(route)
        return None

    @property
    def bends(self) -> bool:
        """True if the default guide serves the shortest route, which is not straight."""
        return bool(self._served) and not self._served[0].straight

    def next(self, within: float = inf, *, failed: bool = True) -> Route | None:
        """Return the next route, if it may be driven in less than a time, s, and no guide so far serves it.

        Where classes over the default guide failed, that serves none: a route that is steep over it may not be over
        another guide.
        """
        if failed and self._served and self._served[0].least_time < within:
            return self._served.pop(0)
        while True:
            route = self._waiting or self._next()
            self._waiting = None
            if route is None:
                return None
            if route.least_time >= within:
                self._waiting = route
                return None
            if any(serves(guide, route.points) for guide in self._own):
                continue
            if self._default is None or not serves(self._default, route.points):
                return route
            if failed:
                return route
            self._served.append(route)

    def take(self, route: Route, problem: Problem) -> Guide:
        """Return a guide along a route, from now on one of those that serve routes."""
        scenario, limits, radius = problem.scenario, problem.limits, self.roadmap.radius
        speeds = (scenario.start.speed, limits.speed if scenario.goal.speed is None else scenario.goal.speed)
        least, most = max(ALONG.slow * radius, ALONG.least), ALONG.wide * radius or inf
        wanted = (max(least, min(speed**2 / limits.lateral_acceleration, most)) for speed in speeds)
        points = self.roadmap.turned(route, *wanted)
        bend = None
        if self.roadmap.radius > 0.0 and not route.loop:
            points, bend = self.roadmap.widened(points), ALONG.rounded * self.roadmap.radius
        guide = guide_over(points, scenario, limits, problem.settings, ROUTE_GUIDES.spans, bend)
        self._own.append(guide)
        self.tried += 1
        return guide

    def told(self, scenario: Scenario, units: NaturalUnits) -> str:
        """Say how many routes there are, if all were looked at, and which passage is too narrow where there is none."""
        if not self.exhausted:
            return ""
        if self.count:
            return f". {self.count} route{'' if self.count == 1 else 's'} round what stands, all tried"
        if not self.roadmap.clear(self.roadmap.ends[1:]):  # as is said of what covers it
            return ""
        return describe_gap(self.roadmap, scenario.vehicle.radius, units.length)

    def _next(self) -> Route | None:
        try:
            route = next(self._routes, None)
        except (OutOfTimeError, TooLargeError):
            return None
        self.count += route is not None
        self.exhausted = route is None
        return route


class RoutesRound(Source[Start, ScpRun]):
    """Routes round what stands that no guide so far serves, each as a guide, while they may be driven faster."""

    name, rank = "routes", 1

    def __init__(self, search: TripSearch, routes: RouteChoice) -> None:
        self.search, self.routes = search, routes

    def children(self, skeleton: Start, found: ScpRun | None) -> Iterator[tuple[float, Start]]:  # noqa: ARG002
        """Yield guides along further routes, the shortest first."""
        search, over = self.search, skeleton.over
        if skeleton.what != SCENE:
            return
        for _ in range(over.runs.most_ways):
            known = search.best.travel_time if search.best is not None and search.certified else inf
            with search.log.timed("search"):
                route = self.routes.next(known, failed=over.failed or known == inf)
            if route is None or search.out_of_time:
                return
            with search.log.timed("build"):
                guide = self.routes.take(route, over.runs.everything)
            yield route.least_time, Start(ROUTE, OverGuide(CheckedRuns(search.task, guide), is_route=True))


class WithoutGuide(Source[Skeleton, Plan]):
    """The straight line in place of a guide over which no trip is certified: its bends may be too tight to follow."""

    name, rank = "without the guide", 1

    def children(self, skeleton: Skeleton, found: Plan | None) -> Iterator[tuple[float, Skeleton]]:
        """Yield the scene without its guide, where no corridor and no place to pass holds it to that."""
        scenario = skeleton.scenario
        held = scenario.guide is None or scenario.corridor is not None or bool(scenario.goals)
        if not (held or skeleton.decided or found is None or found.certified):
            yield 0.0, skeleton.after(self.name, changed(anchored(scenario), guide=None), exact=False)


class RoutesOverMap(Source[Skeleton, Plan]):
    """Corridors along routes over a map, then along the best trip, while it gets faster."""

    name = "map"

    def __init__(self, search: Search[Skeleton, Plan]) -> None:
        self.search = search
        self.why_none = ""  # no route leads to the goal
        self._corridors: dict[tuple[str, ...], tuple[MapLines, Skeleton, float]] = {}
        self._best: tuple[float, list[Array]] = (inf, [])  # of certified plans: time, s, and ground

    def decides(self, skeleton: Skeleton) -> bool:
        """True if the ground is a map."""
        return skeleton.planned is None and skeleton.scenario.ground is not None

    def children(self, skeleton: Skeleton, found: Plan | None) -> Iterator[tuple[float, Skeleton]]:
        """Yield corridors along routes; along a certified trip in one of them."""
        if self.search.due(skeleton) == self.name:
            yield from self._routes(skeleton)
        elif found is not None and found.certified and skeleton.decided in self._corridors:
            yield from self._regrown(skeleton, found)

    def _routes(self, skeleton: Skeleton) -> Iterator[tuple[float, Skeleton]]:
        scenario = skeleton.scenario
        routes = MapLines(scenario, self.search.budget)
        if scenario.goals and scenario.guide is not None:  # which leads over them
            yield 0.0, self._within(routes, skeleton, [np.array(scenario.guide)], "corridor along the guide")
            return
        shortest, drivable = routes.lines()
        if shortest is None:
            self.why_none = self.why_none or routes.why_none()
            yield 0.0, skeleton.after("no route over the map", changed(scenario, ground=None), exact=False)
            return
        lines = [line for line in (drivable, shortest) if line is not None]
        if scenario.guide is not None or may_have_legs(scenario):  # which find guides of their own
            lines += [] if scenario.guide is None else [routes.with_ends(np.array(scenario.guide))]
            yield 0.0, self._within(routes, skeleton, lines, "corridor along all routes")
            return
        for number, line in enumerate(lines, 1):
            time, ground = self._best
            if not leads_through(ground, line, scenario.vehicle.radius):
                least = least_time_along(scenario, line)
                if least < time:
                    yield least, self._within(routes, skeleton, [line], f"corridor along route {number}", line)
        if self._best[0] == inf and routes.may_be_open(shortest):
            yield 0.0, self._within(routes, skeleton, lines, "corridor along all routes")

    def _within(
        self, routes: MapLines, skeleton: Skeleton, lines: Sequence[Array], what: str, line: Array | None = None
    ) -> Skeleton:
        """Return the skeleton in the ground along some lines, at first along one of them."""
        ground = ground_along(routes.routes, lines)
        within = skeleton.after(what, with_ground(skeleton.scenario, ground), exact=False)
        if line is None:
            return within
        self._corridors[within.decided] = routes, skeleton, inf
        return replace(within, line=routes.with_ends(line))

    def _regrown(self, skeleton: Skeleton, found: Plan) -> Iterator[tuple[float, Skeleton]]:
        routes, bare, before = self._corridors[skeleton.decided]
        time, rounds = found.travel_time, sum(what == "along the trip" for what in skeleton.decided)
        if time < self._best[0]:
            self._best = time, [np.array(piece) for piece in skeleton.scenario.corridor or ()]
        if rounds >= GROUND.grown or time >= before * (1.0 - GROUND.gain) or time > self._best[0]:
            return
        line = found.position(found.start_time + np.linspace(0.0, time, GROUND.places))
        within = self._within(routes, bare, [line], "", line)
        again = replace(within, decided=(*skeleton.decided, "along the trip"))
        self._corridors[again.decided] = routes, bare, time
        yield time * (1.0 - GROUND.gain), again
