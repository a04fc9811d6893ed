"""What every outer search has: tries from one start after the other, each with its certificate, and which is better."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from time import perf_counter
from typing import Generic, Protocol, TypeVar

from scp_planner.certificate.lower_bound import kinematic_bound
from scp_planner.certificate.verdict import Certificate
from scp_planner.problem.near_zones import LONGEST_TRIP, without_far_zones
from scp_planner.problem.problem import Problem
from scp_planner.scp.evaluation import Evaluation
from scp_planner.scp.goal import to_beat
from scp_planner.trips.trajectory import Trajectory

HARDLY = 0.15  # largest violation of a run that hardly fails: another one may mend it
GOOD_ENOUGH = 1e-3  # relative distance to the lower bound at which no other way is looked for


class MethodRun(Protocol):
    """A run of any method."""

    @property
    def evaluation(self) -> Evaluation:
        """The trip that it ended with, looked at."""
        ...


class RunStart(Protocol):
    """Something to start a run from."""

    @property
    def estimate(self) -> float:
        """About the travel time that it leads to, s."""
        ...


RunT = TypeVar("RunT", bound=MethodRun)
StartT = TypeVar("StartT", bound=RunStart)


@dataclass(frozen=True)
class Attempt(Generic[RunT]):
    """A run and what its certificate says.

    Attributes
    ----------
    run : MethodRun
    certificate : Certificate or None
        None if the run was cut off.
    """

    run: RunT
    certificate: Certificate | None

    @property
    def trajectory(self) -> Trajectory:
        """The trip that the run ended with."""
        return self.run.evaluation.trajectory

    @property
    def travel_time(self) -> float:
        """Of that trip, s."""
        return self.trajectory.travel_time

    @property
    def holds(self) -> bool:
        """Whether it is certified."""
        return self.certificate is not None and self.certificate.holds

    @property
    def late(self) -> bool:
        """Whether it is certified but for its arrival, which is too late."""
        return self.certificate is not None and self.certificate.late

    @property
    def verdict(self) -> Certificate:
        """The certificate of a run that was not cut off."""
        assert self.certificate is not None
        return self.certificate

    @property
    def wrongs(self) -> tuple[float, int, float]:
        """What is worst, to a tenth of a micrometre; how much is wrong; the travel time."""
        wrong = 0 if self.certificate is None else len(self.certificate.violations)
        return round(self.run.evaluation.worst_violation, 7), wrong, self.travel_time

    def better_than(self, other: Attempt[RunT] | None) -> bool:
        """Certified before not certified, then faster; without certificates the lesser violation."""
        if self.certificate is None:
            return False
        if other is None:
            return True
        if self.holds != other.holds:
            return self.holds
        if self.holds or (other.late and self.late):
            return self.travel_time < other.travel_time
        return self.wrongs < other.wrongs


class Tally:
    """What one call has done so far.

    Attributes
    ----------
    timings : dict of str to float
        Wall times of its parts, s.
    iterations : int
    tried : int
        Runs from starts.
    """

    def __init__(self, *parts: str) -> None:
        self.timings = dict.fromkeys(parts, 0.0)
        self.iterations = 0
        self.tried = 0

    @contextmanager
    def timed(self, part: str) -> Iterator[None]:
        """Add the wall time of a block to a part."""
        clock = perf_counter()
        try:
            yield
        finally:
            self.timings[part] += perf_counter() - clock


@dataclass(frozen=True)
class ReadyProblem:
    """A problem as it is searched.

    Attributes
    ----------
    everything : Problem
        With all obstacles.
    near : Problem
        Without those that are too far away to matter to a trip that is not much slower than it may be.
    lower_bound : float
        No trip is faster, s.
    """

    everything: Problem
    near: Problem
    lower_bound: float

    @classmethod
    def of(cls, everything: Problem) -> ReadyProblem:
        """Return a problem, and what is near of it, if there is the memory to plan with that."""
        least = kinematic_bound(everything.scenario)
        near = without_far_zones(everything, LONGEST_TRIP * least)
        near.check_memory()
        return cls(everything, near, least)


def met_what_was_left_out(problem: Problem, certificate: Certificate) -> bool:
    """Whether a trip, longer than expected, met an obstacle that its problem took for too far away to matter."""
    return any(v.obstacle is not None and v.obstacle not in problem.zones.ids for v in certificate.violations)


class OuterSearch(ABC, Generic[StartT, RunT]):
    """Tries starts, the fastest estimate first, until no other can be expected to be better.

    Parameters
    ----------
    lower_bound : float
        No trip is faster, s.
    effort : float
        1 as usual; with more the search goes on nearer to the bound.
    deadline : float
        Value of :func:`time.perf_counter` at which it ends.
    arrival_step : float, optional
        s; the trip is to arrive on one of these: a gain within one is none.

    Attributes
    ----------
    incumbent : Attempt or None
        The best so far.
    estimate : float
        Of the start of that, s.
    """

    def __init__(self, lower_bound: float, effort: float, deadline: float, arrival_step: float | None = None) -> None:
        self.lower_bound, self.deadline, self.arrival_step = lower_bound, deadline, arrival_step
        self.enough = lower_bound * (1.0 + GOOD_ENOUGH / effort)
        self.incumbent: Attempt[RunT] | None = None
        self.estimate = 0.0

    @abstractmethod
    def tried(self, start: StartT) -> Attempt[RunT]:
        """Return what a start led to."""

    @property
    def certified(self) -> bool:
        """Whether there is a certified trip."""
        return self.incumbent is not None and self.incumbent.holds

    @property
    def out_of_time(self) -> bool:
        """Whether the deadline has passed."""
        return perf_counter() > self.deadline

    def _good_enough(self) -> bool:
        best = self.incumbent
        if best is None or not best.holds:
            return False
        return best.travel_time <= self.enough or to_beat(best.travel_time, self.arrival_step) < self.lower_bound

    def try_all(self, starts: Iterable[StartT]) -> Attempt[RunT] | None:
        """Try starts until one is good enough; return the best attempt.

        Parameters
        ----------
        starts : iterable
            They end where none that is left can be expected to lead to a faster trip than the incumbent.

        Returns
        -------
        Attempt or None
            None if there are no starts.
        """
        for start in starts:
            if self.incumbent is not None and self.out_of_time:
                break
            attempt = self.tried(start)
            if attempt.better_than(self.incumbent):
                self.incumbent, self.estimate = attempt, start.estimate
            if self.out_of_time or self._good_enough():
                break
        return self.incumbent
