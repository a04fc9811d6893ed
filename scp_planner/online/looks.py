"""Looks at other ways round."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from scp_planner.scp.linearisation import TrustRegion
from scp_planner.trips.trip import Trip

LOOK_TRUST = TrustRegion(theta=0.7, beta=2.0, rho=0.2)
LOOK_GAIN, LOOK_GAIN_TIME = 0.02, 0.1
"""Another way round must be faster by this share, and by so many units of time, for the vehicle to change over."""
LOOK_SOONER = 2
"""Without a plan that keeps clear of foreseen zones, looks at other ways round come so many times as often."""
FIRST_LOOK_TIME, LOOK_TIME_DECAY = 0.02, 0.8
"""Seconds of wall time, that a look is expected to take before one has been timed; and how soon it is forgotten."""
LOOK_RUNS = 2
"""Ways that are looked at in turn while there is a plan."""
FEWEST_LOOK_STEPS = 2
"""Steps of the loop from another way before a feasible trip is good enough to be driven, and improved on the way."""
SPARED = 1
"""Steps fewer of a look are taken in a replan while there is a plan to drive."""
HOPELESS = 0.05
"""Relative excess over a limit, or units of length outside of the workspace, from which on no way is begun."""


@dataclass
class _Look:
    """A look at other ways round, which goes on from replan to replan.

    Attributes
    ----------
    starts : iterator of Trip
        What is left to start from.
    runs : int
        How many more of them are to be tried.
    trip : Trip or None
        What has come of the one that is being tried...
    steps : int
        ...after so many steps of the loop.
    """

    starts: Iterator[Trip]
    runs: int
    trip: Trip | None = None
    steps: int = 0

    def begin_next(self) -> bool:
        """Go on to the next start, if there is one."""
        self.trip = next(self.starts, None) if self.runs > 0 else None
        self.runs, self.steps = self.runs - 1, 0
        return self.trip is not None
