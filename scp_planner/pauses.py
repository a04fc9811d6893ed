"""Looks at the clock during long work: by what has a deadline, or by rooms that know none and ask whether to go on."""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterable, Iterator
from time import perf_counter
from typing import TypeAlias, TypeVar

GoOn: TypeAlias = Callable[[], None]
"""Raises an error to end it all."""

IN_A_ROW = 16  # of many things, until it is asked whether to go on: work on fewer of them is never ended

T = TypeVar("T")
Steps: TypeAlias = Generator[None, None, T]
"""Work in small pieces, and what comes of it."""


class OutOfTimeError(Exception):
    """The deadline passed before the work was done."""


def look_at_the_clock(deadline: float) -> None:
    """Give up work that is late."""
    if perf_counter() > deadline:
        raise OutOfTimeError


def all_at_once(steps: Steps[T]) -> T:
    """Do all of some work; return what comes of it."""
    while True:
        try:
            next(steps)
        except StopIteration as end:
            found: T = end.value
            return found


def with_pauses(things: Iterable[T], go_on: GoOn | None) -> Iterator[T]:
    """Give things one after the other, and ask now and then whether to go on."""
    for number, thing in enumerate(things):
        if go_on is not None and number % IN_A_ROW == IN_A_ROW - 1:
            go_on()
        yield thing
