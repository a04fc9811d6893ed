"""Looks at the clock during long work: by what has a deadline, or by rooms that know none and ask whether to go on.

Work that goes on between replans runs on a thread of its own, in turns with who asks for it, never beside it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator
from contextvars import copy_context
from threading import Semaphore, Thread, current_thread
from time import perf_counter
from typing import Any, Generic, TypeAlias, TypeVar

GoOn: TypeAlias = Callable[[], None]
"""Raises an error to end it all."""

IN_A_ROW = 16  # of many things, until it is asked whether to go on: work on fewer of them is never ended

T = TypeVar("T")


class OutOfTimeError(Exception):
    """The deadline passed before the work was done."""


def look_at_the_clock(deadline: float) -> None:
    """Give up work that is late; let others have their turn, if this is work in turns."""
    pause()
    if perf_counter() > deadline:
        raise OutOfTimeError


class InTurns(Generic[T]):
    """Work that goes on for a while whenever it is asked to: it is left where it calls `pause`, and comes back there.

    Parameters
    ----------
    work : callable
        Returns what comes of it. It ends where it is once nobody holds this object.
    """

    def __init__(self, work: Callable[[], T]) -> None:
        self._worker = _Worker(work)

    def go_on(self, until: float) -> bool:
        """Go on up to a pause after a wall time; return True if the work is done."""
        return self._worker.go_on(until)

    @property
    def found(self) -> T:
        """Result of the work that is done; raise the error that ended it."""
        if self._worker.error is not None:
            raise self._worker.error
        found: T = self._worker.found
        return found

    def __del__(self) -> None:
        """End the work."""
        self._worker.leave()


def pause() -> None:
    """Let others have their turn, where this is work in turns and its own has passed."""
    thread = current_thread()
    if isinstance(thread, _Worker):
        thread.pause()


class _LeftError(BaseException):
    """Nobody wants to know any more."""


class _Worker(Thread):
    def __init__(self, work: Callable[[], Any]) -> None:
        super().__init__(daemon=True)
        self._work, self._context = work, copy_context()
        self._own, self._others = Semaphore(0), Semaphore(0)
        self._until, self._left, self._done = math.inf, False, False
        self.found: Any = None
        self.error: BaseException | None = None

    def go_on(self, until: float) -> bool:
        self._until = until
        if self.ident is None:
            self.start()
        self._own.release()
        try:
            self._others.acquire()
        except BaseException:  # an interrupt: the work must not go on beside who asked for it
            self.leave()
            raise
        return self._done

    def pause(self) -> None:
        if perf_counter() > self._until and not self._left:
            self._others.release()
            self._own.acquire()
        if self._left:
            raise _LeftError

    def leave(self) -> None:
        self._left = True
        self._own.release()

    def run(self) -> None:
        self._own.acquire()
        try:
            if not self._left:
                self.found = self._context.run(self._work)
        except _LeftError:
            self.found = None
        except BaseException as error:
            self.error = error
        self._done = True
        self._others.release()


def with_pauses(things: Iterable[T], go_on: GoOn | None) -> Iterator[T]:
    """Give things one after the other, and ask now and then whether to go on."""
    for number, thing in enumerate(things):
        if go_on is not None and number % IN_A_ROW == IN_A_ROW - 1:
            go_on()
        yield thing
