"""Best-first search over skeletons: decisions about a trip, with a bound of its time, before SCP runs."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from heapq import heappop, heappush
from itertools import count
from math import inf
from time import perf_counter
from typing import Any, Generic, Protocol, TypeVar

from scp_planner.pauses import Budget, OutOfTimeError
from scp_planner.scp.goal import to_beat


class Result(Protocol):
    """A trip that came of a skeleton."""

    @property
    def travel_time(self) -> float:
        """Travel time, s."""
        ...


@dataclass(frozen=True)
class Tried:
    """One skeleton that a search tried, and its result.

    Attributes
    ----------
    what : str
        Decisions of the skeleton.
    bound : float
        Lower bound, or estimate, of its travel time, s; 0 where there is none.
    result : str
        ``certified``, ``violated`` or ``nothing faster``.
    travel_time : float
        Of the trip that came of it, s.
    wall_time : float
        Spent on it and on finding it, s.
    """

    what: str
    bound: float
    result: str
    travel_time: float
    wall_time: float

    def __str__(self) -> str:
        bound = f", at least {self.bound:.4g} s" if self.bound > 0.0 else ""
        took = f", {self.travel_time:.4g} s" if self.travel_time < inf else ""
        return f"{self.what}: {self.result}{took}{bound}; {1e3 * self.wall_time:.3g} ms"

    def outside(self, unit: float, *decided: str) -> Tried:
        """Return the same after some decisions, with times in s.

        Parameters
        ----------
        unit : float
            Unit of its times, s.
        decided : str
            Decisions before.

        Returns
        -------
        Tried
        """
        what = ", ".join([*decided, self.what])
        return replace(self, what=what, bound=self.bound * unit, travel_time=self.travel_time * unit)


class SearchLog:
    """Work of one call: wall times of its parts, s, iterations, skeletons, and runs by what they try."""

    def __init__(self, *parts: str) -> None:
        self.timings = dict.fromkeys(parts, 0.0)
        self.iterations = 0
        self.tried: Counter[str] = Counter()
        self.skeletons: list[Tried] = []

    @contextmanager
    def timed(self, part: str) -> Iterator[None]:
        """Add the wall time of a block to a part."""
        clock = perf_counter()
        try:
            yield
        finally:
            self.timings[part] += perf_counter() - clock

    def add(self, timings: Mapping[str, float], iterations: int, skeletons: Iterable[Tried]) -> None:
        """Add the work of a part of the call."""
        for part, spent in timings.items():
            self.timings[part] = self.timings.get(part, 0.0) + spent
        self.iterations += iterations
        self.skeletons.extend(skeletons)


SkeletonT = TypeVar("SkeletonT")
ResultT = TypeVar("ResultT", bound=Result)


class Source(ABC, Generic[SkeletonT, ResultT]):
    """Proposes skeletons of one kind: one decision more than their parent has.

    Attributes
    ----------
    name : str
    rank : int
        Skeletons of a higher rank wait until none of a lower rank is left.
    """

    name: str
    rank: int = 0

    def decides(self, skeleton: SkeletonT) -> bool:  # noqa: ARG002 - most only add skeletons
        """Return True if no trip is planned for a skeleton before this source has decided about it.

        Parameters
        ----------
        skeleton : Skeleton

        Returns
        -------
        bool
        """
        return False

    @abstractmethod
    def children(self, skeleton: SkeletonT, found: ResultT | None) -> Iterable[tuple[float, SkeletonT]]:
        """Yield skeletons, each with a lower bound, or an estimate, of its travel time, s, the least first.

        The next one is asked for when the last one was tried, or dropped.

        Parameters
        ----------
        skeleton : Skeleton
        found : Plan, optional
            What came of it; None if it leaves decisions open.

        Returns
        -------
        iterable of (float, Skeleton)
            Bounds, s, and skeletons.
        """


@dataclass(order=True)
class _Stream:
    """Children of one skeleton by one source; the bound of the next one, or else of the last."""

    rank: int
    bound: float
    number: int
    children: Iterator[tuple[float, Any]] = field(compare=False)
    pending: Any = field(default=None, compare=False)


class Search(ABC, Generic[SkeletonT, ResultT]):
    """Tries skeletons, the least bound first, and keeps the best result.

    Parameters
    ----------
    log : SearchLog
    budget : Budget
        After the first result the search ends with it.
    sources : sequence of Source
    least : float
        No trip takes less, s.
    enough : float
        Travel time of a certified trip that ends the search, s.
    step : float, optional
        Arrivals count in steps of this time, s.
    """

    def __init__(
        self,
        log: SearchLog,
        budget: Budget,
        sources: Sequence[Source[Any, Any]] = (),
        *,
        least: float = 0.0,
        enough: float = 0.0,
        step: float | None = None,
    ) -> None:
        self.log, self.budget, self.sources = log, budget, list(sources)
        self.lower_bound, self.enough, self.arrival_step = least, enough, step
        self.best: ResultT | None = None
        self.count = 0
        self._clock = budget.begun

    @abstractmethod
    def complete(self, skeleton: SkeletonT) -> ResultT | None:
        """Find the trip of a skeleton that leaves no decision open; None if nothing came of it."""

    @abstractmethod
    def describe(self, skeleton: SkeletonT) -> str:
        """Name the decisions of a skeleton."""

    @abstractmethod
    def accepts(self, result: ResultT) -> bool:
        """True if a result is certified."""

    @abstractmethod
    def is_better(self, result: ResultT, other: ResultT) -> bool:
        """True if a result takes the place of another one."""

    @property
    def certified(self) -> bool:
        """True if there is a certified trip."""
        return self.best is not None and self.accepts(self.best)

    @property
    def cutoff(self) -> float:
        """Travel time that another trip has to beat, s."""
        if self.best is None or not self.accepts(self.best):
            return inf
        return to_beat(self.best.travel_time, self.arrival_step)

    def due(self, skeleton: SkeletonT) -> str | None:
        """Name the source that has to decide about a skeleton next, before a trip is planned; None: there is none."""
        return next((source.name for source in self.sources if source.decides(skeleton)), None)

    def is_open(self, skeleton: SkeletonT) -> bool:
        """True if a skeleton leaves decisions open."""
        return self.due(skeleton) is not None

    @property
    def out_of_time(self) -> bool:
        """True if the deadline has passed."""
        return self.budget.is_over

    @property
    def over(self) -> bool:
        """True if the time is up after the first run, or if no trip can be notably faster than the best."""
        best = self.best
        if best is not None and self.accepts(best):
            if best.travel_time <= self.enough or self.cutoff < self.lower_bound:
                return True
        return self.count > 0 and self.out_of_time

    def explore(self, root: SkeletonT) -> ResultT | None:
        """Return the best result of a skeleton and all that sources propose from it on."""
        waiting, numbers = list[_Stream](), count()
        self._expand(root, self._try(root, 0.0), 0.0, waiting, numbers)
        while waiting and not self.over:
            stream = heappop(waiting)
            if stream.pending is None:
                proposed = self._next(stream.children)
                if proposed is not None:
                    stream.bound, stream.pending = proposed
                    heappush(waiting, stream)
                continue
            skeleton, stream.pending = stream.pending, None
            if stream.bound >= self.cutoff:
                continue
            found = self._try(skeleton, stream.bound)
            self._expand(skeleton, found, stream.bound, waiting, numbers)
            heappush(waiting, stream)
        return self.best

    def _next(self, children: Iterator[tuple[float, SkeletonT]]) -> tuple[float, SkeletonT] | None:
        """Return the next skeleton of a source; none if the time is up before it is found."""
        try:
            return next(children, None)
        except OutOfTimeError:
            return None

    def _expand(
        self, skeleton: SkeletonT, found: ResultT | None, bound: float, waiting: list[_Stream], numbers: Iterator[int]
    ) -> None:
        # Of equal bounds the latest comes first: descendants before siblings
        for source in reversed(self.sources):
            heappush(waiting, _Stream(source.rank, bound, -next(numbers), iter(source.children(skeleton, found))))

    def _try(self, skeleton: SkeletonT, bound: float) -> ResultT | None:
        if self.is_open(skeleton):
            return None
        before = self.best
        found = self.complete(skeleton)
        now = perf_counter()
        spent, self._clock = now - self._clock, now
        if found is None:
            self.log.skeletons.append(Tried(self.describe(skeleton), bound, "nothing faster", inf, spent))
            return None
        self.count += 1
        if before is None or self.is_better(found, before):
            self.best = found
        result = "certified" if self.accepts(found) else "violated"
        self.log.skeletons.append(Tried(self.describe(skeleton), bound, result, found.travel_time, spent))
        return found
