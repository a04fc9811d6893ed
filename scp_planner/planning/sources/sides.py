"""Homotopy classes over one guide as starts: before, after, left or right of each mover; arcs where there are none."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from math import inf, log2
from time import perf_counter

import numpy as np

from scp_planner.certificate.lower_bound import bound_among, goal_is_covered_for_good
from scp_planner.constraints.clearance import Clearance
from scp_planner.constraints.discs import DiscClearance
from scp_planner.planning.checked import QUALITY
from scp_planner.planning.loops import promise
from scp_planner.planning.runs import CheckedRuns, ScpRun
from scp_planner.planning.search import Source
from scp_planner.planning.starts import ROUTE, OverGuide, Start, TripSearch
from scp_planner.problem.guides import drive_along
from scp_planner.problem.problem import Problem
from scp_planner.scp.record import LoopStatus
from scp_planner.search.first_trips import FIT, arcs, trip_along
from scp_planner.search.grid import Fineness
from scp_planner.search.starts import coarsenesses
from scp_planner.search.ways import Way, WaySearch, WayTree
from scp_planner.trips.trajectory import Trajectory

logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class SideSettings:
    """Runs from homotopy classes, and when they are worth it."""

    touching: float = 0.02  # units of length; a converged trip is held up only by zones nearer than this
    # steps of the delay by which a class may turn out better than its estimate, where none did by more
    estimate_error: float = 3.2
    first_search: float = 0.7  # of the time there is, that the search for the first class may take
    far_from_bound: float = 1.1  # times the lower bound: trips above that are compared with those from arcs
    finer_effort: float = 2.0  # from this effort on finer grids are searched as well
    finer_grids: tuple[Fineness, Fineness] = (Fineness(stations=1.3, shrunk=0.8), Fineness(stations=1.8, shrunk=0.6))
    beside_route: int = 2  # classes round what stands beside a route, where a run along that failed
    mended: float = 0.02  # violation of a run along a guide, that stricter constraints may mend


SIDES = SideSettings()
CLASS, ARC = "way round", "arc"


class Sides(Source[Start, ScpRun]):
    """Homotopy classes on a grid of stations, offsets, slopes, speeds and delays; the fastest estimate first."""

    name = "sides"

    def __init__(self, search: TripSearch, estimate_error: float = SIDES.estimate_error) -> None:
        self.search, self.estimate_error = search, estimate_error

    def children(self, skeleton: Start, found: ScpRun | None) -> Iterator[tuple[float, Start]]:  # noqa: ARG002
        """Yield starts over a guide."""
        if skeleton.run is not None:
            return
        over = skeleton.over
        if over.is_route:
            moves = len(over.runs.problem.zones.moving) > 0
            yield from self._classes(over) if moves else self._along(over)
            yield from self._along(over) if moves else self._on_grid(over, 1.0, most=SIDES.beside_route)
        elif _goal_is_covered(over.runs):
            logger.info("the goal is covered for good")
            yield 0.0, Start(ARC, over, partial(self._single_arc, over, patient=True))
        else:
            yield from self._classes(over)
            yield from self._arcs(over)
            if over.runs.problem.profile is not None:
                yield from self._along(over)

    def _classes(self, over: OverGuide) -> Iterator[tuple[float, Start]]:
        """Yield classes of ever coarser delays until there is one; of finer grids, where more effort is asked for."""
        for coarseness in coarsenesses(over.runs.problem):
            if not (over.classes or over.certified or over.cut_off):
                yield from self._on_grid(over, coarseness)
        if self.search.task.settings.effort >= SIDES.finer_effort:
            for fineness in SIDES.finer_grids:
                if self._may_gain():
                    yield from self._on_grid(over, 1.0, fineness)

    def _on_grid(
        self, over: OverGuide, coarseness: float, fineness: Fineness | None = None, most: int | None = None
    ) -> Iterator[tuple[float, Start]]:
        search, settings, missed = self.search, self.search.task.settings, 0.0
        if most is not None and (over.certified or over.cut_off):
            return
        left, now = search.budget.left, perf_counter()
        until = now + (SIDES.first_search if fineness is None else 1.0) * left
        grid = WaySearch(over.runs.problem, coarseness, fineness, deadline=until)
        error = self.estimate_error * grid.grid.delay_step * (1.0 + log2(max(settings.effort, 1.0)))
        with search.log.timed("search"):
            tree = WayTree(grid, max(1, round(settings.searches * settings.effort)), search.cutoff + error)
            way = tree.next()
        grid.go_on_until(search.budget.deadline)
        for _ in range(over.runs.most_ways if most is None else most):
            if way is None:
                break
            run = _ClassRun(search, over, way)
            over.classes += 1
            yield max(way.travel_time - max(error, missed), 0.0), Start(CLASS, over, run)
            missed = max(missed, run.missed)
            with search.log.timed("search"):
                tree.branch(run.touched, search.cutoff + max(error, missed))
                way = tree.next()
        over.cut_off = not over.classes and perf_counter() > until

    def _may_gain(self) -> bool:
        """True unless it is proved that no trip is notably faster than the best."""
        search, task = self.search, self.search.task
        if search.best is None or not search.certified:
            return True
        known = search.best.travel_time
        with search.log.timed("search"):
            bound = bound_among(task.scenario, known, task.threat_zones, search.budget.deadline)
        search.lower_bound = max(search.lower_bound, bound)
        search.enough = max(search.enough, search.lower_bound * (1.0 + QUALITY.good_enough / task.settings.effort))
        logger.info("no trip is faster than %.4f units, the best takes %.4f", bound, known)
        return known > search.enough

    def _along(self, over: OverGuide) -> Iterator[tuple[float, Start]]:
        """Yield the guide, driven as fast as its bends allow; then as slowly everywhere as its tightest bend asks."""
        for steady in (False, True):
            if over.certified or (self.search.certified and not over.is_route):
                return
            yield 0.0, Start(ROUTE, over, partial(self._drive, over, steady))

    def _drive(self, over: OverGuide, steady: bool) -> ScpRun:
        problem = over.runs.problem
        profile = drive_along(problem.space.guide, problem, steady=steady)
        way = Way(float(profile.times[-1]), profile.stations, np.zeros(len(profile.stations)), profile.times)
        trip, loop = trip_along(problem, way), over.runs.careful_loop
        return over.runs.attempt(trip, self.search.cutoff, loop=loop, mended=SIDES.mended)

    def _arcs(self, over: OverGuide) -> Iterator[tuple[float, Start]]:
        """Yield arcs where there is no homotopy class, or none leads to a fast trip; the fastest cuts off others."""
        search, best = self.search, self.search.best
        task, few = search.task, search.log.tried.total() < over.runs.most_ways
        if search.rival is not None or (search.known < inf and not over.classes):
            return
        if best is not None and best.holds:
            # With more effort than usual: the search itself hardly ever needs them
            slow = best.travel_time > SIDES.far_from_bound * search.lower_bound
            due = slow and task.settings.effort >= SIDES.finer_effort
        else:
            stuck = best is not None and best.run.status is not LoopStatus.SOLVER_FAILED
            due = best is None or (stuck and task.thorough and few)
        if due and (search.out_of_time or over.cut_off):
            yield 0.0, Start(ARC, over, partial(self._single_arc, over))
        elif due:
            logger.info("starting from arcs")
            yield 0.0, Start(ARC, over, partial(self._race, over))

    def _single_arc(self, over: OverGuide, patient: bool = False) -> ScpRun:
        loop = over.runs.patient_loop if patient else None
        return over.runs.attempt(next(arcs(over.runs.problem)), self.search.cutoff, loop=loop)

    def _race(self, over: OverGuide) -> ScpRun | None:
        """Run from one arc after the other, then once more from the best, with what the samples missed."""
        search, best, cutoff = self.search, None, self.search.cutoff
        for start in arcs(over.runs.problem):
            if best is not None and search.out_of_time:
                break
            with search.log.timed("scp"):
                run = over.runs.quick(start, cutoff)
            search.log.tried[ARC] += 1
            if run.status is LoopStatus.CONVERGED:
                cutoff = min(cutoff, run.evaluation.trajectory.travel_time)
            best = run if best is None or promise(run) < promise(best) else best
        assert best is not None, "there is always an arc"
        if search.best is None or not search.best.holds or promise(best) < promise(search.best.run):
            return over.runs.attempt(best.evaluation.trajectory, search.cutoff)
        return None


class _ClassRun:
    """A run from a homotopy class, once more closer to it if that ends hardly infeasible, and what it shows."""

    def __init__(self, search: TripSearch, over: OverGuide, way: Way) -> None:
        self.search, self.over, self.way = search, over, way
        self.touched: tuple[tuple[int, int], ...] = ()  # zones that the run touched, and on which side of them it is
        self.missed = 0.0  # by how much the run was faster than the estimate, s, where that is one to go by

    def __call__(self) -> ScpRun:
        search, runs = self.search, self.over.runs
        first = trip_along(runs.problem, self.way)
        found = runs.attempt(first, search.cutoff, search.fastest)
        if found.hardly_fails and not search.out_of_time:
            closer = trip_along(runs.problem, self.way, FIT.close_smoothing)
            # Close to a straight class there is nothing to smooth
            if not (np.array_equal(first.theta, closer.theta) and np.array_equal(first.beta, closer.beta)):
                again = runs.attempt(closer, search.cutoff, search.fastest)
                found = again if again.better_than(found) else found
        if not search.out_of_time:
            self.touched = _touched(runs.problem, found.trajectory)
        self.over.failed |= not (found.run.feasible or search.certified or found.holds)
        if found.holds or found.hardly_fails:
            self.missed = self.way.travel_time - found.travel_time
        logger.debug("a class of about %.4f s led to %.4f s", self.way.travel_time, found.travel_time)
        return found


def _touched(problem: Problem, trip: Trajectory) -> tuple[tuple[int, int], ...]:
    """Zones that a trip touches or enters, the deepest first, and on which side of them it is."""
    found = dict[int, int]()
    for constraint in problem.constraints:
        if isinstance(constraint, Clearance | DiscClearance):
            found.update(constraint.touched(trip, SIDES.touching))
    return tuple(reversed(found.items()))


def _goal_is_covered(runs: CheckedRuns) -> bool:
    """True if it is proved that what stands there lets no trip arrive."""
    zones, task = runs.problem.zones, runs.task
    if len(zones.standing) == 0:
        return False
    goal = runs.problem.frame.to_frame(np.array([task.scenario.goal.position]))
    near = zones.distances(np.zeros(1), goal)[:, zones.standing]
    return bool(np.any(near < 0.0)) and goal_is_covered_for_good(task.scenario, task.threat_zones)
