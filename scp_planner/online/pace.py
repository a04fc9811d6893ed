"""Time that the stages of a replan take, and whether there is enough for one more."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from time import perf_counter


@dataclass(frozen=True)
class PaceParameters:
    kept: float = 0.8  # Share of what a stage took that is still expected of it the next time
    gaps: int = 20  # Last replans, whose longest gap is the period where none is given
    outliers: float = 0.1  # Share of these gaps that may be longer, such as by a pause
    starved: int = 10  # Times in a row that there was no time for a stage, of which the last begins it all the same


PACE = PaceParameters()


@dataclass
class Pace:
    """Remembers from replan to replan what stages took, s."""

    _took: dict[str, float] = field(default_factory=dict)
    _starved: dict[str, int] = field(default_factory=dict)

    def took(self, stage: str, lasted: float) -> None:
        self._took[stage] = max(PACE.kept * self._took.get(stage, 0.0), lasted)

    def of(self, *stages: str) -> float:
        """Time that stages are expected to take, s."""
        return sum(self._took.get(stage, 0.0) for stage in stages)

    def allows(self, deadline: float, part: str, *stages: str) -> bool:
        """True if there is time for a part's stages up to a deadline; one that there never is time for has its turn."""
        if math.isinf(deadline):
            return True
        fits, starved = perf_counter() + self.of(*stages) <= deadline, self._starved.get(part, 0) + 1
        self._starved[part] = 0 if fits or starved == PACE.starved else starved
        return fits or starved == PACE.starved
