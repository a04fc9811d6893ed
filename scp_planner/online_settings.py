"""Settings and outcomes of planning while driving."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from enum import StrEnum

import numpy as np

from scp_planner.refresh import GATE_PROBABILITY, Newcomers


class Outcome(StrEnum):
    """What a replan came to."""

    IMPROVED = "improved"
    """A new plan."""
    KEPT = "kept"
    """The last plan, whose certificate holds with the refreshed zones."""
    REPAIRED = "repaired"
    """The path of the last plan, driven slower."""
    BRAKING = "braking"
    """A stop along the path."""


class Safety(StrEnum):
    """What must be certified before a plan is driven."""

    STOP = "stop"
    """The trip up to a moment at or after the next replan, and a stop from there."""
    TRIP = "trip"
    """The trip up to the goal."""


@dataclass(frozen=True)
class OnlineSettings:
    """Settings of :class:`scp_planner.Planner`.

    Attributes
    ----------
    period : float
        Longest time between two replans, s.
    tracking_error : float
        Largest distance between the vehicle and where its plan has it, m. Zones are larger by this.
    reaction_time : float
        Time between a replan and the moment from which the vehicle follows it, s. At its top speed the vehicle drives
        on by ``reaction_time * max_speed`` before it begins to brake, and zones are larger by that too.
    safety : Safety
    foresight : float or None
        See `scp_planner.refresh`, s. None: the time to react, to the next replan and to stop, and somewhat more, since
        a stop need not begin at once.
    iterations : int
        Steps of the loop in one replan, at most.
    look_every : int
        Replans from one look at other ways round to the next.
    look_iterations : int
        Steps of the loop from another way, at most.
    first_runs : int
        Ways that a first plan is started from, at most.
    reserve : float
        Wall time before the deadline that is kept for what is left to do when nothing better has been found, s.
    newcomers : Newcomers
    gate_probability : float
        An observation less probable than this is left out, see `scp_planner.refresh`.
    forget_after : float
        An obstacle that has not been seen for so long has gone, s.
    """

    period: float = 0.1
    tracking_error: float = 0.0
    reaction_time: float = 0.0
    safety: Safety = Safety.STOP
    foresight: float | None = None
    iterations: int = 3
    look_every: int = 10
    look_iterations: int = 12
    first_runs: int = 4
    reserve: float = 5e-3
    newcomers: Newcomers = field(default_factory=Newcomers)
    gate_probability: float = GATE_PROBABILITY
    forget_after: float = math.inf

    def __post_init__(self) -> None:
        for name in ("tracking_error", "reaction_time", "reserve"):
            check_number(name, getattr(self, name), 0.0)
        check_number("period", self.period, 1e-3)
        if self.foresight is not None:
            check_number("foresight", self.foresight, 0.0)
        for name in ("iterations", "look_every", "look_iterations", "first_runs"):
            value = getattr(self, name)
            if isinstance(value, bool) or not isinstance(value, int) or value < 1:
                raise ValueError(f"{name}: {value!r} must be a whole number of at least 1")

    def margin(self, max_speed: float) -> float:
        """What is added to zones, m: tracking error, and what the vehicle drives in its reaction time."""
        return self.tracking_error + self.reaction_time * max_speed


def check_number(name: str, value: float, least: float = -math.inf) -> None:
    """Refuse what is no finite number, or too small.

    Raises
    ------
    ValueError
        Naming the value.
    """
    if isinstance(value, bool) or not isinstance(value, int | float | np.number) or not math.isfinite(value):
        raise ValueError(f"{name}: {value!r} is not a finite number")
    if value < least:
        raise ValueError(f"{name}: {value!r} is less than {least:g}")
