"""A scenario that changes while its vehicle drives: where the vehicle is then is nobody's mistake."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, ClassVar

from scp_planner.scenario import checks, goal_checks
from scp_planner.scenario.models import Scenario
from scp_planner.scenario.validation import Objection, Rule

_OF_THE_START = (
    checks.guide_begins_at_start,
    checks.observations_are_past,
    goal_checks.arrival_is_after_start,
    goal_checks.goal_is_elsewhere,
    goal_checks.target_is_known,
)


def _but_for_the_start(rule: Rule) -> Rule:
    def asked(scenario: Any) -> Iterator[Objection]:
        yield from (objection for objection in rule(scenario) if objection.location[0] != "start")

    return asked


class Underway(Scenario):
    """A scenario without the rules of the place, the speed and the time at which the vehicle begins."""

    rules: ClassVar[tuple[Rule, ...]] = tuple(
        _but_for_the_start(rule) for rule in Scenario.rules if rule not in _OF_THE_START
    )
