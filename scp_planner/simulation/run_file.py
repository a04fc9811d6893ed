"""Contents of run files and recordings: how the fields of runs are held, and what must fit together in them."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, Any, ClassVar

import numpy as np
from pydantic import Field

from scp_planner.arrays import Array
from scp_planner.online.plan import OnlinePlan, Outcome
from scp_planner.online.reasons import ReasonCode
from scp_planner.planning.plan import Plan
from scp_planner.planning.plan_file import PlanPart
from scp_planner.scenario.models import Scenario
from scp_planner.scenario.process_model import version_is_known
from scp_planner.scenario.shapes import Shape
from scp_planner.scenario.underway import Underway
from scp_planner.scenario.validation import FiledAs, Location, Objection, Part, Row, Rule, by_default
from scp_planner.scenario.values import Count, Flag, Name, NotNegative, Number, Vector, Whole
from scp_planner.simulation.cycle import Cycle


class AnswerPart(PlanPart):
    """A plan, and what it answers to a replan if it is of one."""

    outcome: Outcome | None = None
    code: ReasonCode = ReasonCode.DRIVING
    obstacle: Name | None = None
    lasts: NotNegative | None = None

    def answer(self) -> Plan:
        if self.outcome is None:
            return self.plan(Plan)
        more = {"code": self.code, "obstacle": self.obstacle, "lasts": self.lasts}
        return self.plan(OnlinePlan, outcome=self.outcome, **more)


def _written(plan: Plan) -> dict[str, Any]:
    """Return a plan of a run, as small as it may be."""
    data = plan.to_dict(samples=21)
    data["wall_time"] = 0.0  # not the same in two runs
    if isinstance(plan, OnlinePlan):
        data.update(outcome=str(plan.outcome), code=str(plan.code), obstacle=plan.obstacle, lasts=plan.lasts)
    return data


def _places(center: Any) -> Array:
    return np.array([(np.nan, np.nan) if place is None else place for place in center]).reshape(-1, 2)


def _places_written(center: Array) -> list[Any]:
    return [None if np.isnan(place[0]) else place for place in center.tolist()]


FiledPlan = Annotated[Plan, FiledAs(AnswerPart, AnswerPart.answer, _written)]
FiledScenario = Annotated[Scenario, FiledAs(Scenario, lambda scenario: scenario, Scenario.to_dict)]
FiledChange = Annotated[Scenario, FiledAs(Underway, lambda scenario: scenario, Scenario.to_dict)]
Column = Annotated[Array, FiledAs(Annotated[Row[Number], Field(min_length=1)], np.array, np.ndarray.tolist)]
Places = Annotated[Array, FiledAs(Row[Vector], _places, np.ndarray.tolist)]
PlacesThere = Annotated[Array, FiledAs(Row[Vector | None], _places, _places_written)]


def lengths_are_equal(course: Any) -> Iterator[Objection]:
    """There are as many states, and places of each obstacle, as times, which do not decrease."""
    count = len(course.time)
    if np.any(np.diff(course.time) < 0.0):
        yield Objection(("time",), course.time.tolist(), "must not decrease")
    columns: dict[Location, Any] = {(key,): getattr(course, key) for key in ("position", "heading", "speed")}
    columns |= {("obstacles", key): each for key, each in course.obstacles.items()}
    for place, column in columns.items():
        if len(column) != count:
            text = f"must have as many entries as time, {count}, not {len(column)}"
            yield Objection(place, column.tolist(), text)


class AnyCourse(Part):
    """The course of the vehicle and of the obstacles, whose fields are those of a run."""

    rules: ClassVar[tuple[Rule, ...]] = (lengths_are_equal,)


def plans_are_of_cycles(run: Any) -> Iterator[Objection]:
    """There is a plan for each record."""
    if len(run.plans) != len(run.records):
        text = f"must be as many as records, {len(run.records)}, not {len(run.plans)}"
        yield Objection(("plans",), run.plans, text)


class FirstLine(Part):
    """First line of a recording."""

    rules: ClassVar[tuple[Rule, ...]] = (version_is_known,)

    schema_: Whole = Field(default=1, validation_alias="schema")
    scenario: Scenario


class AnyRun(Part):
    """A run file, whose other fields are those of a run."""

    rules: ClassVar[tuple[Rule, ...]] = (version_is_known, plans_are_of_cycles)

    schema_: Whole = Field(default=1, validation_alias="schema")
    outcomes: dict[Name, Count] = by_default({})


class ReplanLine(Part):
    """A replan in a recording."""

    cycle: Cycle
    plan: FiledPlan
    arrived: Flag
    wall_time: NotNegative
    timings: dict[Name, Any] = by_default({})


class ShapeLine(Part):
    """An obstacle that was added in a recording."""

    obstacle: Name
    shape: Shape


class ChangeLine(Part):
    """Another goal, ground or limits in a recording."""

    changed: Underway
