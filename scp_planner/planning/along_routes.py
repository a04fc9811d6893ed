"""Routes as guides, in the order of a time that none of them can be driven in less than."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from dataclasses import dataclass
from math import cos, inf

import numpy as np

from scp_planner.arrays import Array
from scp_planner.errors import TooLargeError
from scp_planner.mathematics.frames import PlanningFrame
from scp_planner.mathematics.polylines import points_at
from scp_planner.pauses import OutOfTimeError
from scp_planner.planning.attempts import Attempt
from scp_planner.planning.runs import CheckedRuns, ScpRun
from scp_planner.planning.trip_search import TripSearch
from scp_planner.planning.ways_round import CloserWays, Ways
from scp_planner.problem.guides import STEEPEST, bend_radius, guide_over
from scp_planner.problem.problem import Problem
from scp_planner.problem.profile import SpeedProfile, fastest_profile
from scp_planner.routes.gaps import widest_gap
from scp_planner.routes.roadmap import Roadmap, Route
from scp_planner.scenario.limits import Limits
from scp_planner.scenario.models import Scenario
from scp_planner.scenario.places import Line
from scp_planner.scenario.units import NaturalUnits
from scp_planner.search.first_trips import trip_along
from scp_planner.search.starts import coarsenesses
from scp_planner.search.ways import Way
from scp_planner.settings.planning import SceneSettings
from scp_planner.trips.guide import Guide

logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class AlongRouteSettings:
    """Routes that need a guide of their own, and drives along them."""

    looks: float = 0.25  # units of length, between points of a route that are compared with a guide
    most_looks: int = 1000  # of these: on longer routes they are farther apart
    aside: float = 0.5  # of the largest offset: as far is a route from a curved guide that serves it
    mended: float = 0.02  # violation of a run along a route, that stricter constraints may mend
    ways: int = 2  # round what stands beside a route, where a run along that failed
    steepest: float = 1.28  # rad, of a route over the straight guide, if that serves it
    slow: float = 1.3  # least radii of the vehicle, of turns at ends where it stands
    wide: float = 8.0  # and of those at ends where it drives, at most
    least: float = 0.5  # units of length, of turns at ends: splines do not follow tighter ones
    rounded: float = 0.4  # least radii of the vehicle, over which bends that were widened are averaged
    spans: int = 100  # of a path over a route, that its bends may need at first
    to_a_span: float = 2.0  # radii of bends at top speed
    steady: float = 0.9  # of the speed in the tightest bend
    stations: int = 400  # of a drive along a guide


ALONG = AlongRouteSettings()


class Routes:
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
    def of(cls, problem: Problem, deadline: float) -> Routes | None:
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

        Where ways over the default guide failed, that serves none: what is steep over it may not be over another guide.
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
        guide = guide_over(points, scenario, limits, problem.settings, ALONG.spans, bend)
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
        try:
            gap, taken = widest_gap(self.roadmap), 2.0 * scenario.vehicle.radius
        except (OutOfTimeError, TooLargeError):
            return ". No route leads to the goal"
        if gap is None:
            return ". No route leads to the goal, however small the vehicle"
        between = " and ".join(gap.between)
        where = f" (past {between})" if between else ""
        missing = taken - gap.width * units.length
        return (
            f". No route leads to the goal: the widest passage{where} is {gap.width * units.length:.3g} m wide,"
            f" {missing:.3g} m less than the vehicle takes"
        )

    def _next(self) -> Route | None:
        try:
            route = next(self._routes, None)
        except (OutOfTimeError, TooLargeError):
            return None
        self.count += route is not None
        self.exhausted = route is None
        return route


def guide_on(scenario: Scenario, line: Array, settings: SceneSettings) -> Guide:
    """Return a guide on a route, (n, 2) m from start to goal, that the vehicle can follow."""
    limits = Limits.of(scenario, settings.limit_margin).rounded()
    frame = PlanningFrame.between(scenario.start.position, scenario.goal.position, scenario.start.time)
    points = frame.to_frame(line)
    length = float(np.hypot(*np.diff(points, axis=0).T).sum())
    spans = min(ALONG.spans, length / (ALONG.to_a_span * bend_radius(points, limits, limits.speed)))
    return guide_over(points, scenario, limits, settings, spans)


def serves(guide: Guide, points: Array, largest: float = 8.0) -> bool:
    """True if a polyline is an offset of a guide that is nowhere steep."""
    steps = np.diff(points, axis=0)
    lengths = np.hypot(steps[:, 0], steps[:, 1])
    along = np.concatenate([[0.0], np.cumsum(lengths)])
    at = np.linspace(0.0, along[-1], _looks(along[-1]) + 1)
    places = points_at(at, along, points)
    if guide.straight:
        least = cos(ALONG.steepest) * (at[1] - at[0])
        return bool(np.abs(places[:, 1]).max() <= largest and np.diff(places[:, 0]).min() >= least)
    least = cos(STEEPEST) * (at[1] - at[0])
    stations = np.linspace(0.0, guide.length, _looks(guide.length) + 1)
    line = Line(guide.frame(stations).position)
    far = line.distances(places).max() > ALONG.aside * largest
    return not far and bool(np.diff(line.nearest(places)).min() >= least)


def _looks(length: float) -> int:
    return max(2, round(min(length / ALONG.looks, ALONG.most_looks)))


class AlongGuide(Attempt[TripSearch, ScpRun]):
    """The guide itself, driven as fast as its bends allow; then as slowly everywhere as its tightest bend asks for."""

    what, most = "route", 2

    def due(self, search: TripSearch) -> bool:
        return not search.certified

    def runs(self, search: TripSearch) -> Iterator[ScpRun]:
        problem, loop = search.runs.problem, search.runs.careful_loop
        for steady in (False, True):
            profile = drive_along(problem.space.guide, problem, steady=steady)
            way = Way(float(profile.times[-1]), profile.stations, np.zeros(len(profile.stations)), profile.times)
            found = search.runs.attempt(trip_along(problem, way), search.cutoff, loop=loop, mended=ALONG.mended)
            yield found
            if found.holds:
                return


def drive_along(guide: Guide, problem: Problem, *, steady: bool = False) -> SpeedProfile:
    """Return the fastest drive along a guide within the limits at each bend, or everywhere at the tightest."""
    if problem.profile is not None and not steady:
        return problem.profile
    limits, stations = problem.limits, np.linspace(0.0, guide.length, ALONG.stations + 1)
    with np.errstate(divide="ignore"):
        allowed = np.minimum(limits.speed, np.sqrt(limits.lateral_acceleration / np.abs(guide.curvature(stations))))
    if steady:
        allowed = np.full(len(allowed), ALONG.steady * allowed.min())
    start, goal = problem.space.start_speed, problem.ends.goal_speed
    return fastest_profile(stations, allowed, start, goal, limits.acceleration, limits.deceleration)


class OtherRoutes(Attempt[TripSearch, ScpRun]):
    """Further routes, each as the guide, while they may be driven faster than the best trip."""

    what = "route"

    def __init__(self, routes: Routes, most: int) -> None:
        self.routes, self.most = routes, most

    def runs(self, search: TripSearch) -> Iterator[ScpRun]:
        while not search.task.out_of_time:
            best = search.best
            known = best.travel_time if best is not None and best.holds else inf
            with search.tally.timed("search"):
                route = self.routes.next(known, failed=bool(search.failed) or known == inf)
            if route is None:
                return
            with search.tally.timed("build"):
                guide = self.routes.take(route, search.runs.everything)
            runs = CheckedRuns(search.task, guide)
            over = TripSearch(runs, known)
            over.walk(along_a_guide(runs))
            found = over.found
            if found is not None:
                yield found


def along_a_guide(runs: CheckedRuns) -> list[Attempt[TripSearch, ScpRun]]:
    """Return the attempts along a route: the route itself, and ways round what is on it, if that moves before."""
    ways = [Ways(runs, coarseness) for coarseness in coarsenesses(runs.problem)]
    if len(runs.problem.zones.moving) > 0:
        return [*ways, AlongGuide(), CloserWays()]
    ways[0].most = ALONG.ways
    return [AlongGuide(), ways[0]]
