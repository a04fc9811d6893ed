"""Looks at the clock during long work: by what has a deadline, or by rooms that know none and ask whether to go on.

A search that goes on between replans is a coroutine on a thread of its own, which never runs beside its owner.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator
from contextvars import copy_context
from dataclasses import dataclass, field
from threading import Semaphore, Thread, current_thread
from time import perf_counter
from typing import Any, Generic, TypeAlias, TypeVar

GoOn: TypeAlias = Callable[[], None]
"""Raises an error to end it all."""

SEARCH_BYTES = 165_000_000  # that a search takes at most; all else of a plan has a bound of its own
PREPARING, LEAST_PREPARING = 0.85, 0.01  # of the time limit, and s: after that the rest is too little to plan in
CHECKING, LEAST_CHECKING = 0.05, 0.01  # of the time limit, and s, by which the last certificate may go over it
BEFORE_CHECK = 0.9  # of the time that is left, for a trip whose certificate among more follows
IN_A_ROW = 16  # of many things, until it is asked whether to go on: work on fewer of them is never ended

T = TypeVar("T")


class OutOfTimeError(Exception):
    """The deadline passed, or all steps were taken, before the work was done."""


@dataclass
class Budget:
    """Time, steps and memory that a search may take: one clock for all that a call does.

    Parameters
    ----------
    deadline : float
        Value of :func:`time.perf_counter` at which the search is given up, s.
    steps : float
        Number of its steps, such as trips of legs, that may still be taken.
    size : float
        Memory that may still be taken, bytes.
    begun : float, optional
        Value of :func:`time.perf_counter` at which it began, s; default: now.
    """

    deadline: float = math.inf
    steps: float = math.inf
    size: float = SEARCH_BYTES
    begun: float = field(default_factory=perf_counter)

    @classmethod
    def within(cls, limit: float | None) -> Budget:
        """Return a budget that begins now; a wall time of None has no end, s."""
        begun = perf_counter()
        return cls(math.inf if limit is None else begun + limit, begun=begun)

    @property
    def is_over(self) -> bool:
        """True if the deadline has passed."""
        return perf_counter() > self.deadline

    @property
    def left(self) -> float:
        """Wall time that is left, s."""
        return max(self.deadline - perf_counter(), 0.0) if self.deadline < math.inf else math.inf

    @property
    def spent(self) -> float:
        """Wall time since it began, s."""
        return perf_counter() - self.begun

    @property
    def last_check(self) -> float:
        """Value of :func:`time.perf_counter` at which the last certificate is given up, s."""
        return self.deadline + CHECKING * (self.deadline - self.begun) + LEAST_CHECKING

    @property
    def go_on(self) -> GoOn | None:
        """Asked while a scene is made ready: raises an error where too little time would be left to plan in."""
        if self.deadline == math.inf:
            return None
        limit = self.deadline - self.begun
        until = self.begun + PREPARING * limit + LEAST_PREPARING

        def go_on() -> None:
            if perf_counter() > until:
                raise OutOfTimeError(
                    f"time_limit: most of {limit:.3g} s is over before all obstacles are ready to be looked at, and"
                    " without them no trip is safe: with more time, fewer observations of each, fewer corners of"
                    " polygons, or without obstacles that are never met, it can be planned"
                )

        return go_on

    def part(self, share: float = 1.0, limit: float = math.inf) -> Budget:
        """Return a budget that begins now: a share of the time that is left, or a wall time, s, if that is less."""
        now = perf_counter()
        left = max(self.deadline - now, 0.0)
        return Budget(now + min(share * left, limit), size=self.size, begun=now)

    def check(self) -> None:
        """Give up work that is late; suspend a coroutine whose slice has ended."""
        look_at_the_clock(self.deadline)

    def step(self) -> None:
        """Take a step; give up work that is late, or has taken all its steps."""
        self.steps -= 1
        if self.steps < 0:
            raise OutOfTimeError
        self.check()


def look_at_the_clock(deadline: float) -> None:
    """Give up work that is late; suspend a coroutine whose slice has ended."""
    pause()
    if perf_counter() > deadline:
        raise OutOfTimeError


class Coroutine(Generic[T]):
    """A function that runs in slices: it is suspended where it calls `pause`, and resumed there.

    Parameters
    ----------
    work : callable
        Must not hold this object, which ends the work when it is deleted. After an interrupt or an error the work
        begins anew.
    """

    def __init__(self, work: Callable[[], T]) -> None:
        self._work = work
        self._worker = _Worker(work)

    def resume(self, until: float) -> bool:
        """Run up to the first pause after a wall time; return True if the work is done, or raise its error."""
        try:
            return self._worker.resume(until)
        except BaseException:  # the work must not go on beside its owner
            self._worker.leave()
            self._worker = _Worker(self._work)
            raise

    @property
    def result(self) -> T:
        """Result of the work that is done."""
        result: T = self._worker.result
        return result

    def __del__(self) -> None:
        """End the work."""
        self._worker.leave()


def pause() -> None:
    """Suspend a coroutine whose slice has ended; do nothing elsewhere."""
    thread = current_thread()
    if isinstance(thread, _Worker):
        thread.pause()


class _LeftError(BaseException):
    """The owner of a coroutine is gone."""


class _Worker(Thread):
    def __init__(self, work: Callable[[], Any]) -> None:
        super().__init__(daemon=True)
        self._work, self._context = work, copy_context()
        self._own, self._owners = Semaphore(0), Semaphore(0)
        self._until, self._left, self._done = math.inf, False, False
        self.result: Any = None
        self.error: BaseException | None = None

    def resume(self, until: float) -> bool:
        self._until = until
        if self.ident is None:
            self.start()
        if not self._done:
            self._own.release()
            self._owners.acquire()
        if self.error is not None:
            raise self.error
        return self._done

    def pause(self) -> None:
        if perf_counter() > self._until and not self._left:
            self._owners.release()
            self._own.acquire()
        if self._left:
            raise _LeftError

    def leave(self) -> None:
        self._left = True
        self._own.release()

    def run(self) -> None:
        self._own.acquire()
        try:
            self.result = self._context.run(self._work)
        except BaseException as error:
            self.error = error
        self._done = True
        self._owners.release()


def with_pauses(things: Iterable[T], go_on: GoOn | None) -> Iterator[T]:
    """Give things one after the other, and ask now and then whether to go on."""
    for number, thing in enumerate(things):
        if go_on is not None and number % IN_A_ROW == IN_A_ROW - 1:
            go_on()
        yield thing
