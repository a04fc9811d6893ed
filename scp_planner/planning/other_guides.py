"""Another guide than the scenario's, where that makes a detour: the loop only finds what is near the guide."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from dataclasses import dataclass
from math import cos, inf, sin

import numpy as np

from scp_planner.arrays import Array
from scp_planner.planning.attempts import ATTEMPTS, Attempt
from scp_planner.planning.refinements import REFINEMENT, refinements
from scp_planner.planning.runs import CheckedRuns, ScpRun
from scp_planner.planning.trip_search import TripSearch
from scp_planner.planning.ways_round import ways_round
from scp_planner.problem.build import slow_stretches
from scp_planner.problem.guides import guide_over
from scp_planner.problem.problem import Problem
from scp_planner.problem.shortcuts import fastest_way
from scp_planner.scp.goal import to_beat
from scp_planner.search.grid import fastest_times

logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class GuideSettings:
    """Guides that lead past slow places, and when they are tried."""

    detour: float = 1.02  # times the fastest drive along another guide: slower trips are compared with those over it
    run_up: float = 0.05  # of the way: a guide leads so far along the heading at an end that a straight leg would miss
    beside: float = 0.5  # steps of the grid, by which a guide keeps away from slow places
    askew: float = 0.7  # rad; by which it misses that


GUIDES = GuideSettings()


@dataclass(frozen=True)
class _GuideRuns:
    runs: CheckedRuns
    estimate: float  # fastest drive along the guide, s


class FastestGuide(Attempt[TripSearch, ScpRun]):
    """The fastest way on the ground as guide, where the best trip is slower than that may be driven."""

    what = "guide along the fastest way"

    def due(self, search: TripSearch) -> bool:
        assert search.best is not None
        detour = search.best.travel_time > GUIDES.detour * search.lower_bound
        return detour and _may_make_a_detour(search.runs.everything)

    def runs(self, search: TripSearch) -> Iterator[ScpRun]:
        best, task, everything = search.best, search.task, search.runs.everything
        drive = min(_drives(search.runs), key=lambda one: one.estimate, default=None)
        if best is None or drive is None or task.out_of_time:
            return
        known = inf
        if best.holds:
            straight = drive.runs.problem.space.guide.straight and everything.space.guide.straight
            if best.travel_time <= GUIDES.detour * drive.estimate or straight:
                return
            # Trips that are the same but for rounding, or for less than a step of time, are not chosen between by that.
            known = min(best.travel_time * (1.0 - REFINEMENT.notable), to_beat(best.travel_time, task.arrival_step))
        over = TripSearch(drive.runs, known)
        over.walk(ways_round(drive.runs))
        other = over.found
        if other is None:
            return
        logger.info("over the fastest way: %.4f units of time after %.4f", other.travel_time, best.travel_time)
        hopeful = not other.holds and other.run.evaluation.worst_violation < ATTEMPTS.hardly
        if hopeful and not other.better_than(best) and other.travel_time * GUIDES.detour < best.travel_time:
            further = TripSearch(other.runs)
            further.best = other
            further.walk(refinements(task))
            other = further.best
        yield other


def _drives(runs: CheckedRuns) -> Iterator[_GuideRuns]:
    """Drives along the fastest way on the ground, and along that which keeps away from slow places."""
    problem, task = runs.everything, runs.task
    slow = slow_stretches(problem.scenario, problem.frame, problem.settings)
    for beside in (0.0, GUIDES.beside) if slow else (0.0,):
        with task.tally.timed("search"):
            points = fastest_way(problem, slow, beside, task.deadline)
        if points is not None and not task.out_of_time:
            guide = guide_over(with_headings(points, problem), problem.scenario, problem.limits, problem.settings)
            again = CheckedRuns(task, guide)
            yield _GuideRuns(again, float(fastest_times(again.problem, np.array([0.0, guide.length]))[-1]))


def _may_make_a_detour(problem: Problem) -> bool:
    """True if the guide may be longer than it has to be, or lead through what can be driven round."""
    scenario = problem.scenario
    if scenario.corridor is not None:
        return False
    return scenario.guide is not None or bool(scenario.speed_limits) or len(problem.zones.standing) > 0


def with_headings(points: Array, problem: Problem) -> Array:
    """A polyline, (n, 2) m, that begins and ends along the headings of the scenario, if it would miss them by far."""
    scenario, points = problem.scenario, points.copy()
    run_up = GUIDES.run_up * float(np.hypot(*np.diff(points, axis=0).T).sum())
    for heading, place, side in ((scenario.goal.heading, -1, -1.0), (scenario.start.heading, 0, 1.0)):
        if heading is None:
            continue
        along = np.array([cos(heading - problem.frame.heading), sin(heading - problem.frame.heading)])
        leg = side * (points[place + int(side)] - points[place])
        if leg @ along < cos(GUIDES.askew) * float(np.hypot(*leg)):
            points = np.insert(points, 1 if side > 0.0 else len(points) - 1, points[place] + side * run_up * along, 0)
    return points
