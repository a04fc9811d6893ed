"""Contents of run files and recordings: models that name every fault, and what is made of them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from itertools import pairwise
from typing import Annotated, Any, ClassVar, TypeVar

import numpy as np
from pydantic import Field, ValidationError

from scp_planner.arrays import Array
from scp_planner.errors import Fault, PlanError
from scp_planner.mathematics.outlines import Outline
from scp_planner.mathematics.polynomials import PiecewisePolynomials
from scp_planner.online.plan import OnlinePlan, Outcome
from scp_planner.online.reasons import ReasonCode
from scp_planner.planning.plan import Plan
from scp_planner.scenario.models import Scenario
from scp_planner.scenario.process_model import version_is_known
from scp_planner.scenario.shapes import Shape
from scp_planner.scenario.underway import Underway
from scp_planner.scenario.validation import Location, Objection, Part, Row, Rule, by_default, faults_of
from scp_planner.scenario.values import NotNegative, Number, RateNumber, Text, Vector
from scp_planner.simulation.cycle import Cycle, infinite
from scp_planner.simulation.sensors import Observation
from scp_planner.threat_zones.zone import ThreatZone

Flag = Annotated[bool, Field(strict=True)]
Count = Annotated[int, Field(strict=True, ge=0)]
Name = Annotated[str, Field(strict=True)]
Three = tuple[RateNumber, RateNumber, RateNumber]
Times = Annotated[Row[Number | None], Field(min_length=2)]
AnyPart = TypeVar("AnyPart", bound=Part)


class SeenPart(Part):
    """An observation."""

    obstacle: Text
    time: Number
    arrival: Number
    position: Vector
    deviation: NotNegative


def is_one_shape(outline: Any) -> Iterator[Objection]:
    """An outline is a polygon or an ellipse."""
    if (outline.vertices is None) == (outline.matrix is None):
        yield Objection((), outline, "must have vertices or a matrix, and null for the other")


class OutlinePart(Part):
    """An outline of a zone."""

    rules: ClassVar[tuple[Rule, ...]] = (is_one_shape,)

    vertices: Annotated[Row[Vector], Field(min_length=3)] | None
    matrix: Three | None
    turning: Flag


def pieces_fit(zone: Any) -> Iterator[Objection]:
    """Breakpoints increase, and there is a polynomial between two of them, all of as many coefficients."""
    for key, times in (("center", "breakpoints"), ("covariance", "covariance_breakpoints")):
        breakpoints, pieces = getattr(zone, times), getattr(zone, key)
        if breakpoints is None or pieces is None:
            if breakpoints is not pieces:
                yield Objection((times,), breakpoints, f"must be null where {key} is, and only there")
            continue
        if any(a >= b for a, b in pairwise(map(infinite, breakpoints))):
            yield Objection((times,), breakpoints, "must increase; null is the end of time")
        if len(pieces) != len(breakpoints) - 1 or not pieces[0] or len(set(map(len, pieces))) > 1:
            text = f"must be as many polynomials as there are spaces in {times}, of equally many coefficients"
            yield Objection((key,), pieces, text)


class ZonePart(Part):
    """A threat zone: coefficients (S, P, 2) of its centre and (S, P, 3) of its covariance."""

    rules: ClassVar[tuple[Rule, ...]] = (pieces_fit,)

    id: Text
    radius: NotNegative
    breakpoints: Times
    center: Row[Row[tuple[RateNumber, RateNumber]]]
    covariance_breakpoints: Times | None
    covariance: Row[Row[Three]] | None
    outlines: Row[OutlinePart] = ()

    def zone(self) -> ThreatZone:
        """Make the zone."""
        spread = self.covariance
        outlines = (Outline(_array(o.vertices), _array(o.matrix), o.turning) for o in self.outlines)
        return ThreatZone(
            self.id,
            self.radius,
            _polynomials(self.breakpoints, self.center),
            None if spread is None else _polynomials(self.covariance_breakpoints, spread),
            tuple(outlines),
        )


def _polynomials(breakpoints: Any, coefficients: Any) -> PiecewisePolynomials:
    return PiecewisePolynomials(np.array([[*map(infinite, breakpoints)]]), np.array([coefficients], dtype=float))


def _array(values: Any) -> Array | None:
    return None if values is None else np.array(values, dtype=float)


class CyclePart(Part):
    """A cycle of a closed loop."""

    time: Number
    position: Vector
    heading: Number
    speed: Number
    wall_time: NotNegative = 0.0
    outcome: Name
    status: Name
    certified: Flag
    safe: Flag
    reason: Name
    arrival_time: Number
    iterations: Count
    observations: Row[SeenPart]
    zones: Row[ZonePart]
    truth: dict[Name, Vector]
    clearance: RateNumber | None
    code: Name = ""
    obstacle: Name | None = None
    lasts: NotNegative | None = None
    candidates: Row[Name] = ()

    def cycle(self, **changes: Any) -> Cycle:
        """Make the cycle, with some fields changed."""
        made = {
            "observations": tuple(Observation(**dict(seen)) for seen in self.observations),
            "zones": tuple(zone.zone() for zone in self.zones),
            "truth": tuple(self.truth.items()),
            "clearance": infinite(self.clearance),
        }
        return Cycle(**{**dict(self), **made, **changes})


def lengths_are_equal(course: Any) -> Iterator[Objection]:
    """There are as many states, and places of each obstacle, as times, which do not decrease."""
    count = len(course.time)
    if any(a > b for a, b in pairwise(course.time)):
        yield Objection(("time",), course.time, "must not decrease")
    columns: dict[Location, Any] = {(key,): getattr(course, key) for key in ("position", "heading", "speed")}
    columns |= {("obstacles", key): each for key, each in course.obstacles.items()}
    for place, column in columns.items():
        if len(column) != count:
            yield Objection(place, column, f"must have as many entries as time, {count}, not {len(column)}")


class CoursePart(Part):
    """The course of the vehicle and of the obstacles."""

    rules: ClassVar[tuple[Rule, ...]] = (lengths_are_equal,)

    time: Annotated[Row[Number], Field(min_length=1)]
    position: Row[Vector]
    heading: Row[Number]
    speed: Row[Number]
    obstacles: dict[Name, Row[Vector | None]]


def plans_are_of_cycles(run: Any) -> Iterator[Objection]:
    """There is a plan for each record."""
    if len(run.plans) != len(run.records):
        text = f"must be as many as records, {len(run.records)}, not {len(run.plans)}"
        yield Objection(("plans",), run.plans, text)


class RunPart(Part):
    """A run file."""

    rules: ClassVar[tuple[Rule, ...]] = (version_is_known, plans_are_of_cycles)

    schema_: Annotated[int, Field(strict=True)] = Field(default=1, validation_alias="schema")
    scenario: Scenario
    seed: Annotated[int, Field(strict=True)]
    arrived: Flag
    contact: Flag
    contact_standing: Flag
    travel_time: NotNegative
    least_clearance: RateNumber | None
    outcomes: dict[Name, Count] = by_default({})
    course: CoursePart
    records: Row[CyclePart]
    plans: Row[dict[Name, Any]]
    shapes: dict[Name, Shape]
    changes: Row[Underway] = ()


class FirstLine(Part):
    """First line of a recording."""

    rules: ClassVar[tuple[Rule, ...]] = (version_is_known,)

    schema_: Annotated[int, Field(strict=True)] = Field(default=1, validation_alias="schema")
    scenario: Scenario


class ReplanLine(Part):
    """A replan in a recording."""

    cycle: CyclePart
    plan: dict[Name, Any]
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


class _AnswerPart(Part):
    """Fields of an online plan besides those of a plan."""

    outcome: Outcome
    code: ReasonCode = ReasonCode.DRIVING
    obstacle: Name | None = None
    lasts: NotNegative | None = None


def read_part(kind: type[AnyPart], data: Any, source: str, place: str = "") -> AnyPart:
    """Check data at a place of a file; raise a PlanError with all faults."""
    try:
        return kind.model_validate(data)
    except ValidationError as error:
        raise PlanError(source, _below(place, faults_of(error))) from None


def read_plan(data: Mapping[str, Any], source: str, place: str) -> Plan:
    """Read a plan at a place of a file."""
    try:
        plan = Plan.from_dict(dict(data), source)
    except PlanError as error:
        raise PlanError(source, _below(place, error.faults)) from None
    if "outcome" not in data:
        return plan
    told = {key: data[key] for key in _AnswerPart.model_fields if key in data}
    answer = read_part(_AnswerPart, told, source, place)
    fields = {key: getattr(plan, key) for key in Plan.__dataclass_fields__}
    return OnlinePlan(**{**fields, **{key: getattr(answer, key) for key in told}, "code": answer.code})


def _below(place: str, faults: Any) -> list[Fault]:
    return [Fault(".".join(filter(None, (place, fault.path))), fault.value, fault.message) for fault in faults]
