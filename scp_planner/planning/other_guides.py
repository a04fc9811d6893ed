"""Another guide than the scenario's, where that makes a detour: the loop only finds what is near the guide."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from dataclasses import dataclass
from math import cos, sin
from typing import TypeAlias

import numpy as np

from scp_planner.arrays import Array
from scp_planner.planning.attempts import HARDLY
from scp_planner.planning.refinements import NOTABLE
from scp_planner.planning.runs import CheckedRuns, ScpAttempt
from scp_planner.planning.ways_round import WaysRound
from scp_planner.problem.build import slow_stretches
from scp_planner.problem.guides import guide_over
from scp_planner.problem.problem import Problem
from scp_planner.problem.shortcuts import fastest_way
from scp_planner.scp.goal import to_beat
from scp_planner.search.grid import fastest_times

logger = logging.getLogger(__name__)

DETOUR = 1.02  # times the fastest drive along another guide: slower trips are compared with those over it
RUN_UP = 0.05  # of the way: a guide leads so far along the heading at an end that a straight leg would miss
BESIDE = 0.5  # steps of the grid, by which a guide keeps away from slow places
ASKEW = 0.7  # rad; by which it misses that


Candidates: TypeAlias = list[tuple[CheckedRuns, ScpAttempt]]
"""Attempts, each with the runs that it is one of."""


@dataclass(frozen=True)
class _GuideRuns:
    """Runs over a guide, and how long the fastest drive along it takes, s."""

    runs: CheckedRuns
    estimate: float


def with_the_fastest_way(runs: CheckedRuns, best: ScpAttempt) -> Candidates:
    """Look for trips along the fastest way on the ground, where the best trip is slower than that may be driven.

    Parameters
    ----------
    runs : CheckedRuns
        Over the guide of the scenario.
    best : ScpAttempt
        The best of these.

    Returns
    -------
    list of (runs, attempt)
        What is worth going on from: the same, that over the other guide if it is notably better, or both if that is
        faster and fails by little.
    """
    problem, task = runs.everything, runs.task
    if task.out_of_time or not _may_make_a_detour(problem) or best.travel_time <= DETOUR * runs.lower_bound:
        return [(runs, best)]
    drive = min(_drives(runs), key=lambda one: one.estimate, default=None)
    if drive is None or task.out_of_time:
        return [(runs, best)]
    again = drive.runs
    if best.holds:
        straight = again.problem.space.guide.straight and problem.space.guide.straight
        if best.travel_time <= DETOUR * drive.estimate or straight:
            return [(runs, best)]
        # Trips that are the same but for rounding, or for less than a step of time, are not chosen between by that.
        known = min(best.travel_time * (1.0 - NOTABLE), to_beat(best.travel_time, task.arrival_step))
        other = WaysRound(again).faster_than(known)
    else:
        other = WaysRound(again).best()
    if other is None:
        return [(runs, best)]
    logger.info("over the fastest way: %.4f units of time after %.4f", other.travel_time, best.travel_time)
    if other.better_than(best):
        return [(again, other)]
    hopeful = not other.holds and other.run.evaluation.worst_violation < HARDLY
    if hopeful and other.travel_time * DETOUR < best.travel_time:
        return [(again, other), (runs, best)]
    return [(runs, best)]


def _drives(runs: CheckedRuns) -> Iterator[_GuideRuns]:
    """Drives along the fastest way on the ground, and along that which keeps away from slow places."""
    problem, task = runs.everything, runs.task
    slow = slow_stretches(problem.scenario, problem.frame, problem.settings)
    for beside in (0.0, BESIDE) if slow else (0.0,):
        with task.tally.timed("search"):
            points = fastest_way(problem, slow, beside, task.deadline)
        if points is not None and not task.out_of_time:
            guide = guide_over(with_headings(points, problem), problem.scenario, problem.limits, problem.settings)
            again = CheckedRuns(task, guide)
            yield _GuideRuns(again, float(fastest_times(again.problem, np.array([0.0, guide.length]))[-1]))


def _may_make_a_detour(problem: Problem) -> bool:
    """Whether the guide may be longer than it has to be, or lead through what can be driven round.

    One that follows the lanes of a corridor has no other way.
    """
    scenario = problem.scenario
    if scenario.corridor is not None:
        return False
    return scenario.guide is not None or bool(scenario.speed_limits) or len(problem.zones.standing) > 0


def with_headings(points: Array, problem: Problem) -> Array:
    """A polyline, (n, 2) m, that begins and ends along the headings of the scenario, if it would miss them by far."""
    scenario, points = problem.scenario, points.copy()
    run_up = RUN_UP * float(np.hypot(*np.diff(points, axis=0).T).sum())
    for heading, place, side in ((scenario.goal.heading, -1, -1.0), (scenario.start.heading, 0, 1.0)):
        if heading is None:
            continue
        along = np.array([cos(heading - problem.frame.heading), sin(heading - problem.frame.heading)])
        leg = side * (points[place + int(side)] - points[place])
        if leg @ along < cos(ASKEW) * float(np.hypot(*leg)):
            points = np.insert(points, 1 if side > 0.0 else len(points) - 1, points[place] + side * run_up * along, 0)
    return points
