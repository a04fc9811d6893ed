"""What may come of a case."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import StrEnum

from benchmarks.hostile.features import Data


class Fault(StrEnum):
    """What may never happen."""

    TRACEBACK = "traceback"
    """An exception other than those that are documented."""
    HANG = "hang"
    MEMORY = "memory"
    REFUSED = "refused by the dense check"
    EXIT_CODE = "exit code"
    DIED = "died"


@dataclass(frozen=True)
class Outcome:
    """What came of a case.

    ``result`` is a word, such as ``certified`` or ``bad input``; ``warned`` the warnings on the way; ``checked`` how
    many certified plans were looked at; ``plan`` one that was refused: how far a search gets is hardly the same again.
    """

    result: str
    fault: Fault | None = None
    detail: str = ""
    warned: tuple[str, ...] = field(default=())
    checked: int = 0
    plan: Data | None = None


def judged(result: str, refused: str, checked: int = 1, plan: Data | None = None) -> Outcome:
    """Return what came of a case in which an independent check refused something, or nothing if that is empty."""
    fault = Fault.REFUSED if refused else None
    return Outcome(result, fault, refused, checked=checked, plan=plan if refused else None)
