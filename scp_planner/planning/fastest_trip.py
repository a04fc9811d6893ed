"""The fastest trip of a task: its guide, its sources, and the search over them."""

from __future__ import annotations

from math import inf

from scp_planner.arrays import Array
from scp_planner.planning.retries import StricterLimits
from scp_planner.planning.runs import CheckedRuns, ScpRun
from scp_planner.planning.sources.refinements import Refinements, with_short_spans
from scp_planner.planning.sources.routes import RouteChoice, RoutesRound
from scp_planner.planning.sources.sides import Sides
from scp_planner.planning.starts import SCENE, OverGuide, Start, TripSearch
from scp_planner.planning.task import Task
from scp_planner.problem.guides import guide_on
from scp_planner.routes.roadmap import Route
from scp_planner.settings.planning import for_scene
from scp_planner.trips.trajectory import Trajectory

Prepared = tuple[CheckedRuns, RouteChoice | None, Route | None]


def prepare(task: Task, *, beside: bool = True) -> Prepared:
    """Return the runs of a task, its routes, and the shortest one: ``beside`` the guide, if that does not serve it."""
    runs = CheckedRuns(task)
    routes = None if task.given is not None else RouteChoice.of(runs.everything, task.budget.deadline)
    if routes is None:
        return runs, None, None
    return runs, routes, routes.first_beside(runs.everything.space.guide) if beside else routes.next()


def fastest_trip(
    runs: CheckedRuns,
    routes: RouteChoice | None,
    first: Route | None = None,
    known: float = inf,
    rival: ScpRun | None = None,
) -> TripSearch:
    """Search for the fastest trip that takes less than a known time, s, at first along a route, if there is one."""
    if first is not None and routes is not None:
        runs = CheckedRuns(runs.task, routes.take(first, runs.everything))
    search = TripSearch(runs, known, rival)
    search.sources = [Sides(search), StricterLimits(search), Refinements(search)]
    if routes is not None:
        search.sources.insert(1, RoutesRound(search, routes))
    search.explore(Start(SCENE, OverGuide(runs, is_route=first is not None)))
    return search


def fastest_of(task: Task, rival: ScpRun | None) -> ScpRun | None:
    """Return the fastest trip of a task, in the units that it is in; None if none is faster than the known one."""
    runs, routes, first = prepare(task)
    if first is None:
        runs = with_short_spans(runs, bends=routes is not None and routes.bends)
    return fastest_trip(runs, routes, first, inf if rival is None else rival.travel_time, rival).best


def from_trip(task: Task, trip: Trajectory) -> TripSearch:
    """Refine a trip: run the loop from it over its own guide, and go on from there."""
    runs = CheckedRuns.over(task, trip.space)
    theta = runs.problem.ends.around(trip.theta[runs.problem.ends.free])
    begin = Trajectory.of(runs.problem.space, theta, trip.beta, trip.travel_time)
    search = TripSearch(runs)
    search.sources = [Refinements(search)]
    search.best = runs.attempt(begin, loop=runs.patient_loop)
    task.log.tried["given trip"] += 1
    search.explore(Start(SCENE, OverGuide(runs)))
    return search


def on_line(task: Task, line: Array) -> TripSearch:
    """Search over a guide along a line, (n, 2) m from start to goal in the units of the scene."""
    search = TripSearch(CheckedRuns(task, guide_on(task.scenario, line, for_scene(task.settings))))
    search.sources = [Sides(search), StricterLimits(search), Refinements(search)]
    search.explore(Start(SCENE, OverGuide(search.runs)))
    return search
