"""What work takes of memory."""

from __future__ import annotations

import tracemalloc
from collections.abc import Callable
from typing import TypeVar

MEGABYTE = 1_000_000

T = TypeVar("T")


def traced(work: Callable[[], T]) -> tuple[T, int]:
    """Result of work, and the most bytes that it takes at once, allocation by allocation."""
    tracemalloc.start()
    try:
        result = work()
        return result, tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
