"""The exceptions of the package: misuse and bad input. What a solver finds is a status, not an exception."""

from __future__ import annotations

import difflib
import re
import reprlib
from collections.abc import Iterable
from dataclasses import dataclass, replace
from enum import Enum


def nearest(key: object, known: Iterable[str]) -> str | None:
    """Find the known key that `key` may be a misspelling of."""
    near = difflib.get_close_matches(str(key).lower(), list(known), n=1)
    return near[0] if near else None


class Missing(Enum):
    """The type of `MISSING`: what stands for the value of a key that is not there."""

    MISSING = "missing"

    def __repr__(self) -> str:
        return self.value


MISSING = Missing.MISSING
"""The value of a fault whose key is absent; `None` would mean that the file says `null`."""


class _Shortener(reprlib.Repr):
    """Shows a value as its file has it, bounded in depth and width."""

    def __init__(self) -> None:
        super().__init__()
        self.maxlevel = 3
        self.maxlist = self.maxdict = 4
        self.maxstring = self.maxlong = self.maxother = 60

    def repr_tuple(self, value: tuple[object, ...], level: int) -> str:
        return self.repr_list(list(value), level)

    def repr_bool(self, value: bool, level: int) -> str:  # noqa: ARG002 - as reprlib calls it
        return "true" if value else "false"

    def repr_NoneType(self, value: None, level: int) -> str:  # noqa: ARG002 - as reprlib calls it
        return "null"


_shortener = _Shortener()


def below(place: str, key: str) -> str:
    """Give the path of a key below a place; either may be empty."""
    return f"{place}.{key}" if place and key else place or key


@dataclass(frozen=True)
class Fault:
    """One thing that is wrong with an input."""

    path: str
    value: object
    message: str

    def below(self, place: str) -> Fault:
        """Give the same fault where its path begins below a place."""
        return replace(self, path=below(place, self.path))

    def __str__(self) -> str:
        where = self.path or "(the whole file)"
        if self.value is MISSING:
            return f"{where}: {self.message}"
        return f"{where} = {_shortener.repr(self.value)}: {self.message}"


def _told_once(faults: Iterable[Fault]) -> list[str]:
    """Say each fault; of more than `3` that many obstacles have alike the first, and where else it is."""
    alike: dict[tuple[str, str], list[Fault]] = {}
    for number, fault in enumerate(faults):
        obstacle = _OBSTACLE.match(fault.path)
        key = str(number) if obstacle is None else f"{fault.path[obstacle.end() :]}"
        alike.setdefault((key, fault.message), []).append(fault)
    lines = []
    for same in alike.values():
        if len(same) <= 3:
            lines += [str(fault) for fault in same]
            continue
        places = [match[0] for fault in same[1:] if (match := _OBSTACLE.match(fault.path))]
        named = ", ".join(places[:3]) + (", ..." if len(places) > 3 else "")
        lines.append(f"{same[0]} (and so in {len(places)} more: {named})")
    return lines


_OBSTACLE = re.compile(r"obstacles\[\d+\]")


class ScpPlannerError(Exception):
    """Base of every exception raised on purpose by this package."""


class FaultyInputError(ScpPlannerError, ValueError):
    """An input with all that is wrong with it."""

    def __init__(self, source: str, faults: Iterable[Fault]) -> None:
        self.source = source
        self.faults = tuple(faults)
        # Both arguments go to the base, so that the exception survives pickling, out of a worker process.
        super().__init__(source, self.faults)

    def __str__(self) -> str:
        count = "1 fault" if len(self.faults) == 1 else f"{len(self.faults)} faults"
        return "\n".join([f"{self.source}: {count}", *(f"  {line}" for line in _told_once(self.faults))])


class ScenarioError(FaultyInputError):
    """A scenario is refused. `faults` holds everything that is wrong with it, `source` the file's name."""


class PlanError(FaultyInputError):
    """A plan file is refused. `faults` holds everything that is wrong with it, `source` the file's name."""


class SamplesError(FaultyInputError):
    """Samples of a trip are refused. `faults` names every row and column, `source` the file's name."""


class MotionModelError(FaultyInputError):
    """A file of a fitted motion model is refused."""


class TracksError(FaultyInputError):
    """Recorded tracks are refused."""


class SettingsError(FaultyInputError):
    """Settings are refused."""


class TooLargeError(ScpPlannerError, ValueError):
    """The input would take more memory than is allowed, or all of the time; raised before any of it is taken."""


class EstimationError(ScpPlannerError, ValueError):
    """Observations cannot be turned into an estimate: too few, out of order, or not finite."""


class StudyError(ScpPlannerError):
    """A folder holds results that a study cannot go on from."""
