"""Reading a trip from a plan's file."""

from __future__ import annotations

import sys
from typing import Any

import numpy as np

from scp_planner.arrays import Array
from scp_planner.errors import MISSING, Fault, PlanError
from scp_planner.files import LARGEST_COORDINATE
from scp_planner.mathematics.splines import clamped_knots
from scp_planner.planning.plan import _is_number


class _Reader:
    """Reads keys of a plan file with errors that name the file, the key and the value."""

    def __init__(self, data: dict[str, Any], file: str, path: str = "") -> None:
        self.data = data
        self._file = file
        self._path = path

    def fault(self, key: str, value: object, allowed: str) -> PlanError:
        """Return the error that names the file, the key's path, the value and what is allowed."""
        return PlanError(self._file, [Fault(self._where(key), value, f"expected {allowed}")])

    def _where(self, key: str) -> str:
        return ".".join(part for part in (self._path, key) if part)

    def get(self, key: str) -> Any:
        if key not in self.data:
            raise self.fault(key, MISSING, "a value")
        return self.data[key]

    def part(self, key: str) -> _Reader:
        value = self.get(key)
        if not isinstance(value, dict):
            raise self.fault(key, value, "an object")
        return _Reader(value, self._file, self._where(key))

    def number(self, key: str) -> float:
        value = self.get(key)
        if not _is_number(value, sys.float_info.max):
            raise self.fault(key, value, "a finite number")
        return float(value)

    def coordinate(self, key: str) -> float:
        """Return a length, a time, a speed or the like: what scenarios may hold."""
        value = self.get(key)
        if not _is_number(value, LARGEST_COORDINATE):
            raise self.fault(key, value, f"a number from {-LARGEST_COORDINATE:g} to {LARGEST_COORDINATE:g}")
        return float(value)

    def integer(self, key: str, least: int, most: int | None) -> int:
        value = self.get(key)
        if (
            isinstance(value, bool)
            or not isinstance(value, int)
            or value < least
            or (most is not None and value > most)
        ):
            raise self.fault(
                key,
                value,
                f"an integer from {least} to {most}" if most is not None else f"an integer >= {least}",
            )
        return value

    def vector(self, key: str, size: int | None) -> Array:
        value = self.get(key)
        good = isinstance(value, list) and all(_is_number(each, LARGEST_COORDINATE) for each in value)
        if not good or (size is not None and len(value) != size):
            wanted = f"numbers from {-LARGEST_COORDINATE:g} to {LARGEST_COORDINATE:g}"
            raise self.fault(key, value, wanted if size is None else f"{size} {wanted}")
        return np.array(value, dtype=float)

    def breakpoints(self, key: str, degree: int) -> Array:
        knots = self.vector(key, None)
        breaks = knots[degree : len(knots) - degree]
        if len(breaks) < 2 or np.any(np.diff(breaks) <= 0.0) or np.any(clamped_knots(degree, breaks) != knots):
            raise self.fault(key, knots.tolist(), f"the clamped knots of degree {degree}, increasing inside")
        return breaks
