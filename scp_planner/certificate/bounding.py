"""Upper bounds of what is limited, by cutting the pieces of time on which they do not decide."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from scp_planner.arrays import Array
from scp_planner.certificate.checked_trip import PIECES, Checked, EnclosedT
from scp_planner.certificate.enclosures import Pieces


@dataclass(frozen=True)
class Bounded:
    """A quantity on pieces."""

    value: Array  # (n,) In the middles
    bound: Array  # (n,) Upper bounds on the whole intervals


@dataclass(frozen=True)
class Most:
    """The largest value that was seen."""

    value: float
    when: float  # on the clock of what is checked
    kept: bool  # True if it is proved that none is larger than allowed


def largest(
    checked: Checked[EnclosedT],
    pieces: Pieces,
    enclosed: EnclosedT,
    allowed: float,
    quantity: Callable[[EnclosedT], Bounded],
    parts: int,
) -> Most:
    """Bound a quantity; pieces that do not decide are cut into so many parts: rounds cost most, and then all pieces."""
    best, when, kept = -np.inf, checked.first, False
    for _ in range(2 * PIECES.max_halvings // parts):
        found = quantity(enclosed)
        worst = int(np.argmax(found.value))
        if found.value[worst] > best:
            best, when = float(found.value[worst]), float(pieces.middle[worst])
        undecided = np.nan_to_num(found.bound, nan=np.inf, posinf=np.inf, neginf=-np.inf) > allowed
        kept = not best > allowed and not undecided.any()
        if best > allowed or kept:
            break
        pieces = pieces.cut(undecided, parts)
        enclosed = checked.enclosed(pieces)
    return Most(best, when, kept)
