"""Interface of executors, and their answers."""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterable
from dataclasses import dataclass
from enum import StrEnum
from typing import Generic, Protocol, TypeVar

from scp_planner.errors import ScpPlannerError

T = TypeVar("T")
R = TypeVar("R")


class ExecutorError(ScpPlannerError):
    """No work can be done: workers do not start, or the cluster cannot be reached."""


class Fate(StrEnum):
    DONE = "done"
    """There is a result."""
    ERROR = "error"
    """The function raised."""
    LOST = "lost"
    """Every worker that tried it died."""


@dataclass(frozen=True)
class Answer(Generic[T, R]):
    """Result of one item."""

    item: T
    fate: Fate
    result: R | None = None  # Only if it is done
    reason: str = ""  # Why there is no result


class Executor(Protocol):
    """Calls a function for many items, somewhere."""

    def run(self, function: Callable[[T], R], items: Iterable[T]) -> Generator[Answer[T, R], None, None]:
        """Call a function for every item."""
        ...
