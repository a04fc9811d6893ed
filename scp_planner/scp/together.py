"""Runs of the loop in step with each other, so that they share the cost of looking at their trips.

A run is a generator: it yields what it wishes to have evaluated or linearised, and is sent that.
"""

# NUMPY-CALLS: shaped by the cost of numpy calls alone

from __future__ import annotations

from collections.abc import Generator, Sequence
from dataclasses import dataclass

from scp_planner.problem.problem import Problem
from scp_planner.scp.evaluation import Evaluation, evaluate_trips
from scp_planner.scp.linearisation import TrustRegion, linearise_trips
from scp_planner.scp.record import LoopRun
from scp_planner.scp.rows.base import Rows
from scp_planner.threat_zones.nearness import NEAR
from scp_planner.trips.trajectory import Trajectory


@dataclass(frozen=True)
class Around:
    """A trip that a run wishes to have linearised, and how far around it."""

    base: Evaluation
    trust: TrustRegion


@dataclass(frozen=True)
class Linearised:
    """A trip, linearised, and how far around it no row is missing."""

    base: Evaluation
    trust: TrustRegion
    rows: Rows

    def serves(self, base: Evaluation, trust: TrustRegion) -> bool:
        """Whether its rows are all that are wanted of a trip so far around it."""
        mine = self.trust
        inside = trust.theta <= mine.theta and trust.beta <= mine.beta and trust.rho <= mine.rho
        return base is self.base and inside


Wish = Trajectory | Around
RunInStep = Generator[Wish, Evaluation | Rows, LoopRun]


def evaluated(trip: Trajectory) -> Generator[Wish, Evaluation | Rows, Evaluation]:
    """Wish for the evaluation of a trip."""
    evaluation = yield trip
    assert isinstance(evaluation, Evaluation)
    return evaluation


def linearised(base: Evaluation, trust: TrustRegion) -> Generator[Wish, Evaluation | Rows, Rows]:
    """Wish for the rows of a trip."""
    rows = yield Around(base, trust)
    assert isinstance(rows, Rows)
    return rows


def run_together(problem: Problem, runs: Sequence[RunInStep]) -> list[LoopRun]:
    """Return what each of the runs comes to.

    Parameters
    ----------
    problem : Problem
    runs : sequence of RunInStep
        Not yet begun.

    Returns
    -------
    list of LoopRun
    """
    wishes: dict[int, Wish] = {number: next(run) for number, run in enumerate(runs)}
    ended: dict[int, LoopRun] = {}

    def hand(number: int, answer: Evaluation | Rows) -> None:
        try:
            wishes[number] = runs[number].send(answer)
        except StopIteration as end:
            ended[number] = end.value
            del wishes[number]

    while wishes:
        trips = {k: wish for k, wish in wishes.items() if isinstance(wish, Trajectory)}
        if trips:
            evaluations = evaluate_trips(problem, list(trips.values()), NEAR)
            for number, evaluation in zip(trips, evaluations, strict=True):
                hand(number, evaluation)
        places = {k: wish for k, wish in wishes.items() if isinstance(wish, Around)}
        if places:
            bases, trusts = [place.base for place in places.values()], [place.trust for place in places.values()]
            for number, rows in zip(places, linearise_trips(problem, bases, trusts, NEAR), strict=True):
                hand(number, rows)
    return [ended[number] for number in range(len(runs))]
