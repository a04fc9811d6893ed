"""The search of ways round: runs from one way after the other, then from bows where that does not do."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from functools import partial
from math import log2
from time import perf_counter

import numpy as np

from scp_planner.certificate.lower_bound import bound_among, goal_is_covered_for_good
from scp_planner.constraints.clearance import Clearance
from scp_planner.constraints.discs import DiscClearance
from scp_planner.planning.attempts import GOOD_ENOUGH, HARDLY, Attempt, OuterSearch
from scp_planner.planning.runs import CheckedRuns, ScpAttempt, promise
from scp_planner.problem.problem import Problem
from scp_planner.scp.goal import to_beat
from scp_planner.scp.record import LoopRun, LoopStatus
from scp_planner.search.first_trips import CLOSE_SMOOTHING, SMOOTHING, bows, trip_along
from scp_planner.search.grid import Fineness
from scp_planner.search.starts import coarsenesses
from scp_planner.search.ways import WaySearch, WayTree
from scp_planner.trips.trajectory import Trajectory

logger = logging.getLogger(__name__)

OFF = 0.5  # largest violation of a run over another guide, after which a patient one is tried
TOUCHING = 0.02  # units of length; a converged trip is held up only by zones nearer than this
SECOND_THOUGHTS = 3  # ways that are started again, closer to them, where no run from any way was certified
ESTIMATE_ERROR = 3.2  # steps of the delay by which a way may turn out better than its estimate, where none did by more
FIRST_SEARCH = 0.7  # of the time there is, that the search for the first way may take
FAR_FROM_BOUND = 1.1  # times the lower bound: trips above that are compared with bows
FINER_EFFORT = 2.0  # from this effort on finer grids are searched as well
FINER_GRIDS = (Fineness(stations=1.3, shrunk=0.8), Fineness(stations=1.8, shrunk=0.6))


@dataclass
class Branch:
    """Starts, given how smooth, with the estimate of their travel time, and what the trip from one touched.

    Missed: by how much that trip was faster than the estimate, s, where that is one to go by. Exhausted: a run from the
    start closest to the way has ended for another reason than that there may be other ways.
    """

    estimate: float
    start: Callable[[float], Trajectory]
    touched: tuple[tuple[int, int], ...] = ()
    missed: float = 0.0
    exhausted: bool = False


class WaysRound(OuterSearch[Branch, LoopRun]):
    """Tries ways round, the fastest estimate first.

    Other ways than the one just tried differ in the side on which some obstacle is passed. Only obstacles that the
    trip touches can hold it up, so only their sides are closed in turn.

    Parameters
    ----------
    runs : CheckedRuns
    """

    def __init__(self, runs: CheckedRuns) -> None:
        self.runs, self.problem = runs, runs.problem
        self.settings, self.tally = runs.task.settings, runs.task.tally
        super().__init__(runs.lower_bound, self.settings.effort, runs.task.deadline, runs.task.arrival_step)
        self._failed: list[Branch] = []
        self._known = np.inf  # s; the travel time of a trip over another guide, that is to be beaten
        self._cut_off = False  # whether there was no time for even the first way
        self._near: ScpAttempt | None = None  # the one that fails by the least of those that may beat it

    def best(self) -> ScpAttempt:
        """Return the best attempt from any way, or from bows; one attempt where the goal is covered for good."""
        if self._goal_is_covered():
            logger.info("the goal is covered for good")
            self.tally.tried += 1
            return self.runs.attempt(next(bows(self.problem)), loop=self.runs.patient_loop)
        best = self.try_all(self._branches())
        broken = best is not None and best.run.status is LoopStatus.SOLVER_FAILED
        if best is None or not (best.holds or broken or self.out_of_time):
            for attempt in self._second_thoughts():
                best = attempt if attempt.better_than(best) else best
                if attempt.holds or self.out_of_time:
                    break
        elif best.holds and self._may_be_poor(best):
            attempt = self._from_bows(best)
            best = attempt if attempt.better_than(best) else best
        assert best is not None, "the first start is never cut off"
        return best

    def faster_than(self, known: float) -> ScpAttempt | None:
        """Return the best attempt that is faster than a travel time in s, or the one that fails to be by the least.

        Other than with :meth:`best`, nothing is tried where no way leads to one: runs that can hardly be so fast end.
        """
        self._known = known
        best = self.try_all(self._branches())
        if self.certified:
            return best
        near = self._near
        if near is None or self.out_of_time or near.run.evaluation.worst_violation >= OFF:
            return near
        self.tally.tried += 1
        patient = self.runs.attempt(self._failed[0].start(CLOSE_SMOOTHING), known, loop=self.runs.patient_loop)
        return patient if patient.holds else near

    def _goal_is_covered(self) -> bool:
        """Whether it is proved that what stands there lets no trip arrive."""
        zones, task = self.problem.zones, self.runs.task
        if len(zones.standing) == 0:
            return False
        goal = self.problem.frame.to_frame(np.array([task.scenario.goal.position]))
        near = zones.distances(np.zeros(1), goal)[:, zones.standing]
        return bool(np.any(near < 0.0)) and goal_is_covered_for_good(task.scenario, task.threat_zones)

    def tried(self, start: Branch) -> ScpAttempt:
        """Run the loop from a way, and closer to it once more if that ends hardly infeasible."""
        rival = self.incumbent if self.certified else None
        cutoff = self._cutoff(rival)
        self.tally.tried += 1
        first = start.start(SMOOTHING)
        attempt = self.runs.attempt(first, cutoff, rival)
        if _hardly_infeasible(attempt) and not self.out_of_time:
            closer = start.start(CLOSE_SMOOTHING)
            # Close to a straight way there is nothing to smooth.
            start.exhausted = bool(
                np.array_equal(first.theta, closer.theta) and np.array_equal(first.beta, closer.beta)
            )
            if not start.exhausted:
                self.tally.tried += 1
                again = self.runs.attempt(closer, cutoff, rival)
                start.exhausted = _hardly_infeasible(again)
                attempt = again if again.better_than(attempt) else attempt
        if not self.out_of_time:
            start.touched = _touched(self.problem, attempt.trajectory)
        if attempt.holds or _hardly_infeasible(attempt):
            start.missed = start.estimate - attempt.travel_time
        if attempt.travel_time < self._known < np.inf and not attempt.run.feasible:
            self._near = attempt if self._near is None or attempt.wrongs < self._near.wrongs else self._near
        if not (attempt.run.feasible or self.certified or attempt.holds):
            self._failed.append(start)
        logger.debug("a way of about %.4f s led to %.4f s", start.estimate, attempt.travel_time)
        return attempt

    def _second_thoughts(self) -> Iterator[ScpAttempt]:
        """Runs from starts that keep closer to the ways, then from bows: where nothing is certified yet."""
        for branch in [each for each in self._failed if not each.exhausted][:SECOND_THOUGHTS]:
            self.tally.tried += 1
            yield self.runs.attempt(branch.start(CLOSE_SMOOTHING), loop=self.runs.patient_loop)
        # Runs over another guide count as well: where no way was found over this one, nothing has been tried here.
        if self.incumbent is None or (self.runs.task.thorough and self.tally.tried < self._most_runs):
            yield self._from_bows()

    def _from_bows(self, rival: ScpAttempt | None = None) -> ScpAttempt:
        """Run the loop from bows, in a race, where the search finds no way, or leads to none that is fast."""
        logger.info("starting from bows")
        cutoff = self._cutoff(rival)
        if self.out_of_time or self._cut_off:
            self.tally.tried += 1
            return self.runs.attempt(next(bows(self.problem)), cutoff)
        with self.tally.timed("scp"):
            best = min(self._race(bows(self.problem), cutoff), key=promise)
        if rival is not None and promise(best) >= promise(rival.run):
            return Attempt(best, None)
        # Once more from where it ended, with what the samples missed
        return self.runs.attempt(best.evaluation.trajectory, cutoff)

    def _race(self, starts: Iterable[Trajectory], cutoff: float) -> Iterator[LoopRun]:
        """Runs from starts, one after the other: the fastest so far cuts off those that can hardly become faster."""
        for start in starts:
            run = self.runs.patient_loop.run(start, self.settings.max_iterations, cutoff, self.deadline)
            self.tally.iterations += len(run.record)
            self.tally.tried += 1
            if run.status is LoopStatus.CONVERGED:
                cutoff = min(cutoff, run.evaluation.trajectory.travel_time)
            yield run
            if self.out_of_time:
                break

    def _cutoff(self, rival: ScpAttempt | None) -> float:
        """What another trip has to be faster than, s."""
        return self._known if rival is None else to_beat(rival.travel_time, self.arrival_step)

    def _may_be_poor(self, best: ScpAttempt) -> bool:
        """Whether bows are worth a trial, with more effort than usual: the search itself hardly ever needs them."""
        far = best.travel_time > FAR_FROM_BOUND * self.runs.lower_bound
        return far and self.settings.effort >= FINER_EFFORT and not self.out_of_time

    @property
    def _most_runs(self) -> int:
        """How many ways of one grid are tried at most."""
        return max(1, round(self.settings.max_runs * self.settings.effort))

    def _within(self, search: WaySearch, missed: float) -> float:
        """Estimates above this, s, are of ways that hardly lead to a faster trip, as one missed by so much, s."""
        error = ESTIMATE_ERROR * search.grid.delay_step * (1.0 + log2(max(self.settings.effort, 1.0)))
        return self._cutoff(self.incumbent if self.certified else None) + max(error, missed)

    def _branches(self) -> Iterator[Branch]:
        """Ways round with starts for the loop."""
        now = perf_counter()
        # so that there is time to drive the first way, or what is none
        until = now + FIRST_SEARCH * max(self.deadline - now, 0.0)
        for coarseness in coarsenesses(self.problem):
            count = 0
            for branch in self._branches_on(WaySearch(self.problem, coarseness, deadline=until)):
                count += 1
                yield branch
            self._cut_off = not count and perf_counter() > until
            if count or self._cut_off:
                break
        if self.settings.effort >= FINER_EFFORT and not self._proven():
            for fineness in FINER_GRIDS:
                yield from self._branches_on(WaySearch(self.problem, fineness=fineness, deadline=self.deadline))

    def _proven(self) -> bool:
        """Whether it is proved that no trip is notably faster than the best so far; the bound is raised to what is."""
        if not self.certified or self.out_of_time:
            return False
        assert self.incumbent is not None
        known, task = self.incumbent.travel_time, self.runs.task
        with self.tally.timed("search"):
            bound = bound_among(task.scenario, known, task.threat_zones, self.deadline)
        self.runs.lower_bound = max(self.runs.lower_bound, bound)
        self.enough = max(self.enough, self.runs.lower_bound * (1.0 + GOOD_ENOUGH / self.settings.effort))
        logger.info("no trip is faster than %.4f units, the best takes %.4f", bound, known)
        return known <= self.enough

    def _branches_on(self, search: WaySearch) -> Iterator[Branch]:
        """Ways round on one grid."""
        effort, timed, missed = self.settings.effort, self.tally.timed, 0.0
        with timed("search"):
            tree = WayTree(search, max(1, round(self.settings.searches * effort)), self._within(search, missed))
            way = tree.next()
        search.go_on_until(self.deadline)
        for left in range(self._most_runs, 0, -1):
            if way is None or way.travel_time > self._within(search, missed):
                return
            branch = Branch(way.travel_time, partial(trip_along, self.problem, way))
            yield branch
            missed = max(missed, branch.missed)
            if left > 1:
                with timed("search"):
                    tree.branch(branch.touched, self._within(search, missed))
                    way = tree.next()


def _hardly_infeasible(attempt: ScpAttempt) -> bool:
    run = attempt.run
    return run.status is LoopStatus.INFEASIBLE and run.evaluation.worst_violation < HARDLY


def _touched(problem: Problem, trip: Trajectory) -> tuple[tuple[int, int], ...]:
    """Zones that a trip touches or enters, the deepest first, and on which side of them it is."""
    found = dict[int, int]()
    for constraint in problem.constraints:
        if isinstance(constraint, Clearance | DiscClearance):
            found.update(constraint.touched(trip, TOUCHING))
    return tuple(reversed(found.items()))
