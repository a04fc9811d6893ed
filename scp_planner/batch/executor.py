"""Who does the work: the interface of executors, and what they answer."""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterable
from dataclasses import dataclass
from enum import StrEnum
from typing import Generic, Protocol, TypeVar

from scp_planner.errors import ScpPlannerError

T = TypeVar("T")
R = TypeVar("R")

ATTEMPTS = 3
"""How often an item is tried whose worker dies."""


class ExecutorError(ScpPlannerError):
    """No work can be done: workers do not start, or the cluster cannot be reached."""


class Fate(StrEnum):
    """What became of an item."""

    DONE = "done"
    """There is a result."""
    ERROR = "error"
    """The function raised."""
    LOST = "lost"
    """Every worker that tried it died."""


@dataclass(frozen=True)
class Answer(Generic[T, R]):
    """What came of one item.

    Attributes
    ----------
    item : T
    fate : Fate
    result : R or None
        Only if it is done.
    reason : str
        Why there is no result.
    """

    item: T
    fate: Fate
    result: R | None = None
    reason: str = ""


class Executor(Protocol):
    """Calls a function for many items, somewhere."""

    def run(self, function: Callable[[T], R], items: Iterable[T]) -> Generator[Answer[T, R], None, None]:
        """Call a function for every item.

        Parameters
        ----------
        function : callable
            Of a module that workers can import, since it is sent by name.
        items : iterable
            Taken as they are needed; each must be picklable.

        Yields
        ------
        Answer
            One for each item, in the order in which they come. Closing the iterator, as an interrupt does, ends the
            work and leaves no worker behind.

        Raises
        ------
        ExecutorError
            If no work can be done.
        """
        ...
