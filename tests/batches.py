"""Shared by tests of batches: an executor that does the work here and now, and odd names of files."""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterable
from contextlib import closing
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeVar

from scp_planner.batch.executor import Answer, Fate

T = TypeVar("T")
R = TypeVar("R")


def results_of(executor: Any, function: Callable[[T], R], items: Iterable[T]) -> dict[T, Answer[T, R]]:
    with closing(executor.run(function, items)) as answers:
        return {answer.item: answer for answer in answers}


@dataclass
class Here:
    """Does all items in this process, the last first, and notes them."""

    fate: Fate = Fate.DONE
    done: list[str] = field(default_factory=list)
    most: int = 1000

    def run(self, function: Callable[[T], R], items: Iterable[T]) -> Generator[Answer[T, R], None, None]:
        for item in list(items)[::-1]:
            if len(self.done) >= self.most:
                raise KeyboardInterrupt
            self.done.append(getattr(item, "file", ""))
            if self.fate is Fate.DONE:
                yield Answer(item, Fate.DONE, function(item))
            else:
                yield Answer(item, self.fate, None, "a reason,\nof two lines")


STRANGE_NAMES = (
    b"two  blanks.yaml",
    b" before.yaml",
    b"a new\nline.yaml",
    b"a new\\nline.yaml",
    b"no\xffUTF-8.yaml",
    b"no\\udcffUTF-8.yaml",
    "gr\u00f6\u00dfe\u2028.yaml".encode(),
    b'"quoted", and more.yaml',
)


def rows_in(table: Path) -> int:
    return len(table.read_text().splitlines()) - 1 if table.exists() else 0
