"""Result of a replan."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from enum import StrEnum

from scp_planner.certificate.verdict import uses_outside
from scp_planner.online.reasons import Candidate, ReasonCode
from scp_planner.planning.plan import Plan
from scp_planner.scenario.units import NaturalUnits
from scp_planner.trips.trip import Trip


class Outcome(StrEnum):
    """Result of a replan."""

    IMPROVED = "improved"
    """A new plan."""
    KEPT = "kept"
    """The last plan, whose certificate holds with the refreshed zones; or, where nothing is safe, with smaller ones."""
    REPAIRED = "repaired"
    """The path of the last plan, driven slower."""
    EVADING = "evading"
    """Out of the way: a short trip to where the vehicle can stand; or, if that is not safe, what does least harm,
    or keeps clear of the zones of a lower level."""
    BRAKING = "braking"
    """Standing, or a stop along the path."""


AWAY = (Outcome.BRAKING, Outcome.EVADING)
"""Outcomes that do not lead to the goal."""


@dataclass(frozen=True, eq=False, repr=False)
class OnlinePlan(Plan):
    """A plan of :class:`Planner`. ``reason`` is one sentence, for an operator.

    Attributes
    ----------
    outcome : Outcome
    stop : Trip or None
        The certified stop that the vehicle can leave the plan for, which stays clear for a while after it stands; the
        trip itself where that is such a stop.
    branch_time : float
        Absolute time up to which the stop is driven like the plan, s.
    code : ReasonCode
        Kind of the reason.
    obstacle : str or None
        Id of the obstacle that it is for.
    lasts : float or None
        For how long it is likely to hold, s; None if that is not known.
    candidates : tuple of Candidate
        What was looked at in this replan, in this order; not saved.
    """

    outcome: Outcome = Outcome.IMPROVED
    stop: Trip | None = None
    branch_time: float = math.inf
    code: ReasonCode = ReasonCode.DRIVING
    obstacle: str | None = None
    lasts: float | None = None
    candidates: tuple[Candidate, ...] = field(default=(), repr=False)

    @property
    def arrived(self) -> bool:
        """True if the vehicle is at its goal, so that there is nothing left to drive."""
        return self.code is ReasonCode.ARRIVED

    @property
    def explanation(self) -> str:
        """The reason, and a line for each candidate."""
        return "\n".join([self.reason or "", *map(str, self.candidates)])

    def outside(self, units: NaturalUnits) -> OnlinePlan:
        """Return a plan in the units of its scene in SI units."""
        if units.are_those_of_the_user:
            return self
        trip, stop = self.trip.outside(units), self.stop
        if stop is not None:
            stop = trip if stop is self.trip else stop.outside(units)
        return replace(
            self,
            trip=trip,
            clearance=self.clearance.outside(units),
            limits=uses_outside(self.limits, units),
            stop=stop,
            branch_time=units.absolute(self.branch_time),
            legs=None if self.legs is None else self.legs.outside(units),
        )

    @property
    def _verdict(self) -> str:
        return f"{self.outcome}, {'safe' if self.safe else 'not safe'}"

    @property
    def safe(self) -> bool:
        """True if the vehicle can set off: the trip is certified to its end, or a stop from it is."""
        return self.certified or self.stop is not None
