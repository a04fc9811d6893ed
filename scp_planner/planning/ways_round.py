"""Attempts over one guide: from one way round after the other, then from arcs where these do not do."""

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
from scp_planner.planning.attempts import ATTEMPTS, Attempt
from scp_planner.planning.runs import CheckedRuns, ScpRun, promise
from scp_planner.planning.trip_search import Start, TripSearch
from scp_planner.problem.problem import Problem
from scp_planner.scp.record import LoopRun, LoopStatus
from scp_planner.search.first_trips import FIT, arcs, trip_along
from scp_planner.search.grid import Fineness
from scp_planner.search.starts import coarsenesses
from scp_planner.search.ways import WaySearch, WayTree
from scp_planner.trips.trajectory import Trajectory

logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class WayRuns:
    """Runs from ways, and when they are worth it."""

    off: float = 0.5  # largest violation of a run over another guide, after which a patient one is tried
    touching: float = 0.02  # units of length; a converged trip is held up only by zones nearer than this
    second_thoughts: int = 3  # ways that are started again, closer to them, where no run from any way was certified
    # steps of the delay by which a way may turn out better than its estimate, where none did by more
    estimate_error: float = 3.2
    first_search: float = 0.7  # of the time there is, that the search for the first way may take
    far_from_bound: float = 1.1  # times the lower bound: trips above that are compared with those from arcs
    finer_effort: float = 2.0  # from this effort on finer grids are searched as well
    finer_grids: tuple[Fineness, Fineness] = (Fineness(stations=1.3, shrunk=0.8), Fineness(stations=1.8, shrunk=0.6))


RUNS = WayRuns()


def ways_round(runs: CheckedRuns) -> list[Attempt[TripSearch, ScpRun]]:
    """Return the attempts over one guide; a single arc where it is proved that no trip arrives."""
    if _goal_is_covered(runs):
        logger.info("the goal is covered for good")
        return [Arcs(runs, covered=True)]
    grids = RUNS.finer_grids if runs.task.settings.effort >= RUNS.finer_effort else ()
    return [
        *(Ways(runs, coarseness) for coarseness in coarsenesses(runs.problem)),
        *(FinerWays(runs, fineness=fineness) for fineness in grids),
        CloserWays(),
        Arcs(runs),
    ]


class Ways(Attempt[TripSearch, ScpRun]):
    """Ways round on one grid, the fastest estimate first; coarser delays where there is no way with shorter ones."""

    what = "way round"
    search_share = RUNS.first_search  # so that there is time to drive the first way, or an arc
    estimate_error = RUNS.estimate_error

    def __init__(self, runs: CheckedRuns, coarseness: float = 1.0, fineness: Fineness | None = None) -> None:
        self.coarseness, self.fineness = coarseness, fineness
        self.most = runs.most_ways

    def due(self, search: TripSearch) -> bool:
        return not (search.from_ways or search.certified or search.cut_off)

    def runs(self, search: TripSearch) -> Iterator[ScpRun]:
        settings, timed, missed = search.task.settings, search.tally.timed, 0.0
        now = perf_counter()
        until = now + self.search_share * max(search.deadline - now, 0.0)
        grid = WaySearch(search.runs.problem, self.coarseness, self.fineness, deadline=until)
        with timed("search"):
            tree = WayTree(grid, max(1, round(settings.searches * settings.effort)), self._within(search, grid, missed))
            way = tree.next()
        grid.go_on_until(search.deadline)
        while way is not None and way.travel_time <= self._within(search, grid, missed) and not search.over:
            start = Start(way.travel_time, partial(trip_along, search.runs.problem, way))
            search.from_ways += 1
            yield _run_from(search, start)
            missed = max(missed, start.missed)
            with timed("search"):
                tree.branch(start.touched, self._within(search, grid, missed))
                way = tree.next()
        search.cut_off = not search.from_ways and perf_counter() > until

    def _within(self, search: TripSearch, grid: WaySearch, missed: float) -> float:
        """Estimates above this, s, are of ways that hardly lead to a faster trip, as one missed by so much, s."""
        error = self.estimate_error * grid.grid.delay_step * (1.0 + log2(max(search.task.settings.effort, 1.0)))
        return search.cutoff + max(error, missed)


class FinerWays(Ways):
    """Ways round on a finer grid, unless it is proved that no trip is notably faster than the best."""

    search_share = 1.0

    def due(self, search: TripSearch) -> bool:
        if search.best is None or not search.certified:
            return True
        known, task = search.best.travel_time, search.task
        with search.tally.timed("search"):
            bound = bound_among(task.scenario, known, task.threat_zones, search.deadline)
        search.lower_bound = max(search.lower_bound, bound)
        search.enough = max(search.enough, search.lower_bound * (1.0 + ATTEMPTS.good_enough / task.settings.effort))
        logger.info("no trip is faster than %.4f units, the best takes %.4f", bound, known)
        return known > search.enough


class CloserWays(Attempt[TripSearch, ScpRun]):
    """Patient runs from starts that keep closer to the ways: where nothing is certified yet."""

    what = "way round once more"
    most = RUNS.second_thoughts

    def due(self, search: TripSearch) -> bool:
        if search.known < inf:
            return (
                not search.certified
                and search.near is not None
                and search.near.run.evaluation.worst_violation < RUNS.off
            )
        return _failing(search)

    def runs(self, search: TripSearch) -> Iterator[ScpRun]:
        ways = search.failed[:1] if search.known < inf else [each for each in search.failed if not each.exhausted]
        for start in ways:
            yield search.runs.attempt(start.trip(FIT.close_smoothing), search.known, loop=search.runs.patient_loop)
            if search.certified:
                return


class Arcs(Attempt[TripSearch, ScpRun]):
    """Runs from arcs, where the search finds no way, or leads to no fast trip; the fastest run cuts off others."""

    what = "arc"

    def __init__(self, runs: CheckedRuns, covered: bool = False) -> None:
        self.most_ways, self.covered = runs.most_ways, covered

    def due(self, search: TripSearch) -> bool:
        task, best = search.task, search.best
        if search.known < inf:
            return False
        if best is not None and best.holds:
            # With more effort than usual: the search itself hardly ever needs them.
            return (
                task.settings.effort >= RUNS.finer_effort
                and best.travel_time > RUNS.far_from_bound * search.lower_bound
            )
        # Runs over another guide count as well: where no way was found over this one, nothing has been tried here.
        return best is None or (_failing(search) and task.thorough and search.tally.tried.total() < self.most_ways)

    def runs(self, search: TripSearch) -> Iterator[ScpRun]:
        runs, cutoff = search.runs, search.cutoff
        if self.covered or search.out_of_time or search.cut_off:
            loop = runs.patient_loop if self.covered else None
            yield runs.attempt(next(arcs(runs.problem)), cutoff, loop=loop)
            return
        logger.info("starting from arcs")
        best = self._race(search)
        if search.best is None or not search.best.holds or promise(best) < promise(search.best.run):
            # Once more from where it ended, with what the samples missed
            yield runs.attempt(best.evaluation.trajectory, cutoff)

    def _race(self, search: TripSearch) -> LoopRun:
        """Run from one arc after the other; the fastest so far cuts off those that can hardly become faster."""
        best, cutoff = None, search.cutoff
        for start in arcs(search.runs.problem):
            if best is not None and search.out_of_time:
                break
            with search.tally.timed("scp"):
                run = search.runs.patient_loop.run(start, search.task.settings.max_iterations, cutoff, search.deadline)
            search.tally.iterations += len(run.record)
            search.tally.tried[self.what] += 1
            if run.status is LoopStatus.CONVERGED:
                cutoff = min(cutoff, run.evaluation.trajectory.travel_time)
            best = run if best is None or promise(run) < promise(best) else best
        assert best is not None, "there is always an arc"
        return best


def _failing(search: TripSearch) -> bool:
    """True if there is no certified trip, and the solver is not the reason."""
    best = search.best
    return best is not None and not best.holds and best.run.status is not LoopStatus.SOLVER_FAILED


def _goal_is_covered(runs: CheckedRuns) -> bool:
    """True if it is proved that what stands there lets no trip arrive."""
    zones, task = runs.problem.zones, runs.task
    if len(zones.standing) == 0:
        return False
    goal = runs.problem.frame.to_frame(np.array([task.scenario.goal.position]))
    near = zones.distances(np.zeros(1), goal)[:, zones.standing]
    return bool(np.any(near < 0.0)) and goal_is_covered_for_good(task.scenario, task.threat_zones)


def _run_from(search: TripSearch, start: Start) -> ScpRun:
    """Run the loop from a way, and closer to it once more if that ends hardly infeasible."""
    runs, cutoff = search.runs, search.cutoff
    rival = search.best if search.certified else search.rival
    first = start.trip(FIT.smoothing)
    found = runs.attempt(first, cutoff, rival)
    if found.hardly_fails and not search.out_of_time:
        closer = start.trip(FIT.close_smoothing)
        # Close to a straight way there is nothing to smooth.
        start.exhausted = bool(np.array_equal(first.theta, closer.theta) and np.array_equal(first.beta, closer.beta))
        if not start.exhausted:
            search.tally.tried[CloserWays.what] += 1
            again = runs.attempt(closer, cutoff, rival)
            start.exhausted = again.hardly_fails
            found = again if again.better_than(found) else found
    if not search.out_of_time:
        start.touched = _touched(runs.problem, found.trajectory)
    if found.holds or found.hardly_fails:
        start.missed = start.estimate - found.travel_time
    if found.hardly_fails:
        search.nearly = min(search.nearly or found, found, key=lambda run: run.travel_time)
    if found.travel_time < search.known < inf and not found.run.feasible:
        search.near = found if search.near is None or found.wrongs < search.near.wrongs else search.near
    if not (found.run.feasible or search.certified or found.holds):
        search.failed.append(start)
    logger.debug("a way of about %.4f s led to %.4f s", start.estimate, found.travel_time)
    return found


def _touched(problem: Problem, trip: Trajectory) -> tuple[tuple[int, int], ...]:
    """Zones that a trip touches or enters, the deepest first, and on which side of them it is."""
    found = dict[int, int]()
    for constraint in problem.constraints:
        if isinstance(constraint, Clearance | DiscClearance):
            found.update(constraint.touched(trip, RUNS.touching))
    return tuple(reversed(found.items()))
