"""Places to pass and targets to meet on the way to the goal."""

from __future__ import annotations

from collections.abc import Iterator
from enum import StrEnum
from typing import Any, ClassVar

from pydantic import Field

from scp_planner.scenario import goal_checks
from scp_planner.scenario.targets import OfTarget
from scp_planner.scenario.validation import Numbers, Objection, OfNumbers, Part, Rule, TakenAs, by_default
from scp_planner.scenario.values import Number, Positive, Vector


class Order(StrEnum):
    """Order in which the places of a scenario are passed."""

    GIVEN = "given"
    """One after the other, as they are listed."""
    FASTEST = "fastest"
    """In any order."""


def _targets_are_met_in_any_direction(one: Any) -> Iterator[Objection]:
    """A target on the way asks for no heading."""
    if one.target is not None and one.heading_range is not None:
        yield Objection(("heading_range",), one.heading_range, "must be null where a target is given")


class Passage(Part):
    """Place to pass, or target to meet, on the way to the goal, at any speed."""

    rules: ClassVar[tuple[Rule, ...]] = (
        goal_checks.arrival_is_possible,
        goal_checks.ranges_are_not_empty,
        goal_checks.target_leaves_the_rest_open,
        _targets_are_met_in_any_direction,
    )

    position: OfNumbers[Vector] = Field(description="[x, y], m; of a target left out: about where it can be met")
    radius: Positive | None = Field(
        default=None, description="how near to it the reference point comes, m; null: the vehicle's radius"
    )
    heading_range: TakenAs[tuple[Number, Number] | None, Numbers | None] = by_default(
        None, description="[least, largest] heading there, rad, to the left from the least one; null: any"
    )
    earliest_arrival: Number | None = Field(
        default=None, description="it is passed not before this time, s on the clock of start.time; null: any"
    )
    latest_arrival: Number | None = Field(
        default=None, description="and not after this time, s on the clock of start.time; null: any"
    )
    target: OfTarget = by_default(
        None, description="what moves and is to be met, as of the goal; null: the place stands"
    )
    offset: OfNumbers[Vector] = by_default((0.0, 0.0), description="place to meet, seen from the target, [x, y], m")

    def within(self, vehicle: Any) -> float:
        """Return how near to it a vehicle has to come, m."""
        near: float = vehicle.radius if self.radius is None else self.radius
        return near
