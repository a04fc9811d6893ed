"""One list of attempts at the fastest certified trip, and the search that goes through it."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import islice
from math import inf
from time import perf_counter
from typing import Any, Generic, Protocol, TypeVar

from scp_planner.certificate.lower_bound import kinematic_bound
from scp_planner.certificate.verdict import Certificate
from scp_planner.problem.near_zones import LONGEST_TRIP, without_far_zones
from scp_planner.problem.problem import Problem
from scp_planner.scp.evaluation import Evaluation
from scp_planner.scp.goal import to_beat
from scp_planner.trips.trajectory import Trajectory


@dataclass(frozen=True)
class AttemptSettings:
    """Runs that hardly fail, and trips that are fast enough."""

    hardly: float = 0.15  # largest violation of a run that hardly fails: another one may mend it
    good_enough: float = 1e-3  # relative distance to the lower bound at which no other way is looked for


ATTEMPTS = AttemptSettings()


class MethodRun(Protocol):
    """A run of any method."""

    @property
    def evaluation(self) -> Evaluation:
        """The trip that it ended with, evaluated."""
        ...


RunT = TypeVar("RunT", bound=MethodRun)


@dataclass(frozen=True)
class CheckedRun(Generic[RunT]):
    """A run and its certificate; None if the run was cut off."""

    run: RunT
    certificate: Certificate | None

    @property
    def trajectory(self) -> Trajectory:
        """The trip that the run ended with."""
        return self.run.evaluation.trajectory

    @property
    def travel_time(self) -> float:
        """Travel time of that trip, s."""
        return self.trajectory.travel_time

    @property
    def holds(self) -> bool:
        """True if it is certified."""
        return self.certificate is not None and self.certificate.holds

    @property
    def late(self) -> bool:
        """True if it is certified but for its arrival, which is too late."""
        return self.certificate is not None and self.certificate.late

    @property
    def verdict(self) -> Certificate:
        """The certificate of a run that was not cut off."""
        assert self.certificate is not None
        return self.certificate

    @property
    def wrongs(self) -> tuple[float, int, float]:
        """Worst violation, to a tenth of a micrometre; number of violations; travel time, s."""
        wrong = 0 if self.certificate is None else len(self.certificate.violations)
        return round(self.run.evaluation.worst_violation, 7), wrong, self.travel_time

    def better_than(self, other: CheckedRun[RunT] | None) -> bool:
        """Certified before not certified, then faster; without certificates the lesser violation."""
        if self.certificate is None and not self.holds:
            return False
        if other is None:
            return True
        if self.holds != other.holds:
            return self.holds
        if self.holds or (other.late and self.late):
            return self.travel_time < other.travel_time
        return self.wrongs < other.wrongs


class Tally:
    """Work of one call so far: wall times of its parts, s, iterations, and runs by the attempt that made them."""

    def __init__(self, *parts: str) -> None:
        self.timings = dict.fromkeys(parts, 0.0)
        self.iterations = 0
        self.tried: Counter[str] = Counter()

    @contextmanager
    def timed(self, part: str) -> Iterator[None]:
        """Add the wall time of a block to a part."""
        clock = perf_counter()
        try:
            yield
        finally:
            self.timings[part] += perf_counter() - clock


CheckedT = TypeVar("CheckedT", bound=CheckedRun[Any])
SearchT = TypeVar("SearchT", bound="Search[Any]")


class Attempt(ABC, Generic[SearchT, CheckedT]):
    """One entry of the list: what it tries, what it may cost, when it is due."""

    what: str
    most: int = 1  # runs
    iterations: float = inf  # of the whole task, after which it ends
    gained = 0.0  # by its last run over the best before, relative; inf if that is the first that is certified

    def due(self, search: SearchT) -> bool:  # noqa: ARG002 - most attempts need no condition
        """True if the attempt is worth its cost after all before it."""
        return True

    @abstractmethod
    def runs(self, search: SearchT) -> Iterator[CheckedT]:
        """Yield runs, one after the other, while another one is worth its cost."""


class Search(Generic[CheckedT]):
    """Goes through a list of attempts, and keeps the best run."""

    def __init__(
        self, tally: Tally, deadline: float, lower_bound: float, enough: float = 0.0, arrival_step: float | None = None
    ) -> None:
        self.tally, self.deadline, self.arrival_step = tally, deadline, arrival_step
        self.lower_bound = lower_bound  # s; no trip is faster
        self.enough = enough  # travel time of a certified trip that ends the search, s
        self.best: CheckedT | None = None
        self.count = 0

    @property
    def certified(self) -> bool:
        """True if there is a certified trip."""
        return self.best is not None and self.best.holds

    @property
    def out_of_time(self) -> bool:
        """True if the deadline has passed."""
        return perf_counter() > self.deadline

    @property
    def over(self) -> bool:
        """True if the time is up after the first run, or if no trip can be notably faster than the best."""
        best = self.best
        if best is not None and best.holds:
            if best.travel_time <= self.enough or to_beat(best.travel_time, self.arrival_step) < self.lower_bound:
                return True
        return self.count > 0 and self.out_of_time

    def walk(self, attempts: Iterable[Attempt[Any, CheckedT]]) -> None:
        """Make the attempts that are due, in order, until the search is over."""
        for attempt in attempts:
            if self.over:
                return
            if self.tally.iterations > attempt.iterations or not attempt.due(self):
                continue
            for run in islice(attempt.runs(self), attempt.most):
                self.tally.tried[attempt.what] += 1
                attempt.gained = self._gain(run)
                if self.over or self.tally.iterations > attempt.iterations:
                    break

    def _gain(self, run: CheckedT) -> float:
        """Keep a run that is better than the best before; return its gain."""
        before = self.best
        self.count += 1
        if not run.better_than(before):
            return 0.0
        self.best = run
        if not run.holds:
            return 0.0
        return before.travel_time / run.travel_time - 1.0 if before is not None and before.holds else inf


@dataclass(frozen=True)
class ReadyProblem:
    """A problem as it is searched: with all obstacles, and without those too far away to matter to a fast trip."""

    everything: Problem
    near: Problem
    lower_bound: float  # No trip is faster, s

    @classmethod
    def of(cls, everything: Problem, least: float = 0.0) -> ReadyProblem:
        """Return a problem, and its near part, if there is memory for it; no trip takes less than ``least``, s."""
        least = max(least, kinematic_bound(everything.scenario))
        near = without_far_zones(everything, LONGEST_TRIP * least)
        near.check_memory()
        return cls(everything, near, least)


def met_what_was_left_out(problem: Problem, certificate: Certificate) -> bool:
    """True if a trip, longer than expected, met an obstacle that its problem took for too far away to matter."""
    return any(v.obstacle is not None and v.obstacle not in problem.zones.ids for v in certificate.violations)
