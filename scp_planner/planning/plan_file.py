"""Contents of a plan file: its fields, what must fit together in them, and the plan that they make."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cached_property
from math import isfinite, pi
from typing import Annotated, Any, ClassVar, Literal, TypeVar

import numpy as np
from pydantic import Field

from scp_planner.arrays import Array
from scp_planner.certificate.verdict import Clearance, LimitUse
from scp_planner.errors import MISSING, PlanError, TooLargeError
from scp_planner.mathematics.frames import PlanningFrame
from scp_planner.mathematics.splines import clamped_knots
from scp_planner.planning.plan import Plan, PlanStatus
from scp_planner.planning.tolerances import SAMPLE_ROUNDING, SAMPLES_TOLERANCE, TRIP_ROUNDING
from scp_planner.scenario.process_model import version_is_known
from scp_planner.scenario.validation import Objection, Part, Row, Rule, part_of_file
from scp_planner.scenario.values import Count, Finite, Flag, Name, Number, Vector
from scp_planner.trips.guide import CurvedGuide, Guide, StraightGuide
from scp_planner.trips.legs import Leg, Legs, Stand
from scp_planner.trips.space import TripSpace
from scp_planner.trips.tolerances import SAME_TIME
from scp_planner.trips.trajectory import Trajectory
from scp_planner.trips.trip import Trip

AnyPlan = TypeVar("AnyPlan", bound=Plan)
Span = Annotated[Number, Field(gt=0)]
_ROUNDING = 1e-9  # relative to the length of the guide


def read_plan(kind: type[AnyPlan], data: Any, source: str) -> AnyPlan:
    """Make a plan of the contents of a file; raise a PlanError with all faults."""
    return part_of_file(PlanPart, source, data, PlanError).plan(kind)


def is_straight_or_curved(guide: Any) -> Iterator[Objection]:
    """A curved guide has headings, a straight one has none."""
    if (guide.kind == "curved") != (guide.headings is not None):
        yield Objection(("headings",), guide.headings, "must be there for a curved guide, and only there")


class GuidePart(Part):
    rules: ClassVar[tuple[Rule, ...]] = (is_straight_or_curved,)

    kind: Literal["straight", "curved"]
    length: Span
    headings: Annotated[Row[Number], Field(min_length=4)] | None = None
    origin: Vector
    heading: Number

    @cached_property
    def guide(self) -> Guide:
        if self.headings is None:
            return StraightGuide(self.length)
        return CurvedGuide(self.length, np.array(self.headings))


def knots_are_clamped(spline: Any) -> Iterator[Objection]:
    """Knots increase but for those at the ends, of which there are one more than the degree."""
    breaks = spline.breaks
    fits = len(breaks) > 1 and np.all(np.diff(breaks) > 0.0)
    if not fits or not np.array_equal(clamped_knots(spline.degree, breaks), spline.knots):
        text = f"must be the clamped knots of degree {spline.degree}, increasing inside"
        yield Objection(("knots",), spline.knots, text)


class SplinePart(Part):
    rules: ClassVar[tuple[Rule, ...]] = (knots_are_clamped,)

    degree: int
    knots: Row[Number]

    @cached_property
    def breaks(self) -> Array:
        return np.array(self.knots[self.degree : len(self.knots) - self.degree])


class PathPart(SplinePart):
    degree: Annotated[int, Field(strict=True, ge=3, le=5)]
    offsets: Row[Number]
    guide: GuidePart


class DrivePart(SplinePart):
    degree: Annotated[int, Field(strict=True, ge=0, le=2)]
    coefficients: Row[Number]
    start_speed: Annotated[Number, Field(ge=0)]


def trip_is_what_is_said(part: Any) -> Iterator[Objection]:
    """Path and acceleration are of one trip, which takes the travel time."""
    path, drive = part.path, part.acceleration
    length, breaks = path.guide.guide.length, path.breaks
    equal = np.linspace(0.0, length, len(breaks))
    if breaks[0] != 0.0 or np.abs(breaks - equal).max() > _ROUNDING * length:
        yield Objection(("path", "knots"), path.knots, f"must be equidistant from 0 to the guide's length, {length!r}")
        return
    if (drive.breaks[0], drive.breaks[-1]) != (0.0, 1.0):
        yield Objection(("acceleration", "knots"), drive.knots, "must be from 0 to 1")
        return
    try:
        space = part.space
    except TooLargeError as error:
        yield Objection(("path", "knots"), path.knots, f"must be fewer: {error}")
        return
    columns = {
        ("path", "offsets"): (path.offsets, space.path_size),
        ("acceleration", "coefficients"): (drive.coefficients, space.acceleration_size),
    }
    wrong = {place: column for place, column in columns.items() if len(column[0]) != column[1]}
    for place, (given, size) in wrong.items():
        yield Objection(place, given, f"must be {size} numbers")
    if not wrong:
        yield from _travel_time_is_that_of(part)


def _travel_time_is_that_of(part: TripPart) -> Iterator[Objection]:
    trip, said = part.trajectory, part.travel_time
    if not isfinite(trip.path.arc_length):
        yield Objection(("path", "offsets"), part.path.offsets, "must be those of a path of finite length")
    elif not part.stops and not abs(trip.travel_time - said) <= TRIP_ROUNDING * said:
        text = f"must be {trip.travel_time!r}, which is what path and acceleration give"
        yield Objection(("travel_time",), said, text)


class Timed(Part):
    start_time: Number
    travel_time: Span
    stops: Flag = False


class TripPart(Timed):
    """A trip by its path and its acceleration."""

    rules: ClassVar[tuple[Rule, ...]] = (trip_is_what_is_said,)

    path: PathPart
    acceleration: DrivePart

    @cached_property
    def space(self) -> TripSpace:
        path, drive = self.path, self.acceleration
        breaks = tuple(drive.breaks.tolist())
        return TripSpace(path.guide.guide, drive.start_speed, path.degree, len(path.breaks) - 1, drive.degree, breaks)

    @cached_property
    def trajectory(self) -> Trajectory:
        beta = np.array(self.acceleration.coefficients)
        found = Trajectory.of(self.space, np.array(self.path.offsets), beta, self.travel_time).settled()
        return Trajectory(found.path, beta, self.travel_time) if self.stops else found

    @cached_property
    def trip(self) -> Trip:
        guide = self.path.guide
        return Trip(PlanningFrame(guide.origin, guide.heading, self.start_time), self.trajectory)


class LegPart(TripPart):
    backward: Flag


class AimPart(Part):
    """Model of CommonRoad that a plan is for; models and cars are known to those who plan for them."""

    model: Name
    car: Name
    problem: Count
    state: Count
    discs: Count
    timed_way: Finite
    depth: Finite
    turn: Finite | None


class SamplesPart(Part):
    """Columns of equally many samples."""

    time: Annotated[Row[Number], Field(min_length=2)]
    position: Row[Vector] | None = None
    velocity: Row[Vector] | None = None
    heading: Row[Number] | None = None
    speed: Row[Number] | None = None
    acceleration: Row[Number] | None = None
    curvature: Row[Number] | None = None
    backward: Row[Flag] | None = None


def legs_or_one_trip(plan: Any) -> Iterator[Objection]:
    """There is a path with its acceleration, or legs one after the other between two headings."""
    needed = ("path", "acceleration") if plan.legs is None else ("first_heading", "last_heading")
    missing = [key for key in needed if getattr(plan, key) is None]
    for key in missing:
        yield Objection((key,), MISSING, "missing; it is required")
    found = [] if missing else list(_trips_fit(plan))
    yield from found
    if not missing and not found and plan.samples is not None:
        yield from samples_are_of_plan(plan.samples, plan.plan(Plan))


def _trips_fit(plan: Any) -> Iterator[Objection]:
    if plan.legs is None:
        yield from trip_is_what_is_said(plan.alone)
        return
    ends = [leg.start_time + leg.trip.trajectory.travel_time for leg in plan.legs]
    for number, (end, leg) in enumerate(zip(ends, plan.legs[1:], strict=False), 1):
        if leg.start_time < end - SAME_TIME * max(1.0, abs(end)):
            text = f"must be at least {end!r}, the end of the leg before it"
            yield Objection(("legs", number, "start_time"), leg.start_time, text)
    last = plan.start_time + plan.travel_time
    if plan.start_time > plan.legs[0].start_time or last < ends[-1] - SAME_TIME * max(1.0, abs(ends[-1])):
        yield Objection(("travel_time",), plan.travel_time, "must be that of all the legs")


class PlanPart(Timed):
    """A plan file."""

    rules: ClassVar[tuple[Rule, ...]] = (version_is_known, legs_or_one_trip)

    schema_: Annotated[int, Field(strict=True)] = Field(validation_alias="schema")
    scenario: Name
    status: Literal["certified", "feasible", "infeasible", "failed"]
    reason: Name | None
    arrival_time: Finite | None = None
    lower_bound: Finite = 0.0
    converged: Flag | None = None
    method: Name
    solver: Name
    iterations: Count
    wall_time: Finite
    commonroad: AimPart | None = None
    path: PathPart | None = None
    acceleration: DrivePart | None = None
    legs: Annotated[Row[LegPart], Field(min_length=1)] | None = None
    first_heading: Number | None = None
    last_heading: Number | None = None
    clearance: Clearance
    limits: dict[Name, LimitUse]
    samples: SamplesPart | None = None

    @cached_property
    def alone(self) -> TripPart:
        return TripPart.model_construct(**{key: getattr(self, key) for key in TripPart.model_fields})

    def plan(self, kind: type[AnyPlan], **more: Any) -> AnyPlan:
        """Make the plan, which nobody has certified yet."""
        same = ("scenario", "reason", "method", "solver", "iterations", "wall_time", "clearance", "limits")
        return kind(
            **{key: getattr(self, key) for key in (*same, "lower_bound", "converged")},
            status=PlanStatus.UNVERIFIED,
            stated_status=PlanStatus(self.status),
            trip=self.alone.trip if self.legs is None else self.legs[0].trip,
            legs=None if self.legs is None else self._legs(self.legs),
            commonroad=None if self.commonroad is None else dict(self.commonroad),
            **more,
        )

    def _legs(self, legs: Row[LegPart]) -> Legs:
        assert self.first_heading is not None and self.last_heading is not None
        begin, end = self.start_time, self.start_time + self.travel_time
        each = tuple(Leg(leg.trip, leg.backward) for leg in legs)
        return Legs(each, Stand(begin, self.first_heading), Stand(end, self.last_heading))


def samples_are_of_plan(samples: SamplesPart, plan: Plan) -> Iterator[Objection]:
    """Samples of a plan file are what its path and its acceleration give."""
    times, first, lasts = np.array(samples.time), plan.start_time, plan.travel_time
    last = first + lasts
    slack = SAMPLES_TOLERANCE * lasts + SAMPLE_ROUNDING * max(abs(first), abs(last))
    if np.any(np.diff(times) < 0.0) or times[0] < first - slack or times[-1] > last + slack:
        yield Objection(("samples", "time"), samples.time, f"must be in order, from {first!r} to {last!r}")
        return
    length = plan.trip.trajectory.path.arc_length if plan.legs is None else plan.legs.length
    fastest = max(length / lasts, float(plan.speed(times).max()))
    # A trip without curvature has values of rounding alone: there is a least scale
    scales = {
        "position": length,
        "velocity": fastest,
        "heading": 1.0,
        "speed": fastest,
        "acceleration": max(fastest / lasts, float(np.abs(plan.acceleration(times)).max())),
        "curvature": max(1.0 / length, float(np.abs(plan.curvature(times)).max())),
        "backward": 0.0,
    }
    for name, scale in scales.items():
        column = getattr(samples, name)
        if column is None:
            continue
        if len(column) != len(times):
            yield Objection(("samples", name), column, f"must have as many entries as time, {len(times)}")
            continue
        given, told = np.array(column, dtype=float), getattr(plan, name)
        # Times are rounded too, and where an acceleration jumps it has two values
        off = np.min([_apart(name, given, told(times + later)) for later in (-slack, 0.0, slack)], axis=0)
        allowed, worst = SAMPLES_TOLERANCE * scale + SAMPLE_ROUNDING * float(np.abs(given).max()), int(np.argmax(off))
        if not off[worst] <= allowed:
            text = f"must be {told(times)[worst].tolist()!r} to {allowed:.2g}, which is what path and acceleration give"
            yield Objection(("samples", name, worst), column[worst], text)


def _apart(name: str, given: Array, found: Array) -> Array:
    difference = given - found
    if name == "heading":
        difference = np.remainder(difference + pi, 2.0 * pi) - pi
    apart: Array = np.abs(difference) if difference.ndim == 1 else np.hypot(*difference.T)
    return apart
