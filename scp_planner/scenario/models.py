"""Scenario models: the vehicle, its start and goal, the obstacles and their observations."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from enum import StrEnum
from os import PathLike
from os.path import relpath
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Self

from pydantic import (
    BeforeValidator,
    ConfigDict,
    Field,
    ValidationInfo,
    field_validator,
    model_validator,
)

from scp_planner import files
from scp_planner.errors import MISSING, Fault, ScenarioError
from scp_planner.mathematics.corridor import SIZE
from scp_planner.outputs import output_named, picture_or_text
from scp_planner.scenario import checks, goal_checks
from scp_planner.scenario.goals import with_aim
from scp_planner.scenario.ground import Ground as Ground
from scp_planner.scenario.ground import read_ground
from scp_planner.scenario.motions import all_timed
from scp_planner.scenario.obstacle_checks import WHEREABOUTS
from scp_planner.scenario.obstacles import Model as Model
from scp_planner.scenario.obstacles import Observations as Observations
from scp_planner.scenario.obstacles import Obstacle as Obstacle
from scp_planner.scenario.obstacles import Prior as Prior
from scp_planner.scenario.passages import Order as Order
from scp_planner.scenario.passages import Passage as Passage
from scp_planner.scenario.process_model import read_processes, version_is_known
from scp_planner.scenario.targets import OfTarget, target_timed
from scp_planner.scenario.validation import (
    Numbers,
    OfNumbers,
    OfParts,
    Part,
    Row,
    Rule,
    TakenAs,
    by_default,
    part_of_file,
)
from scp_planner.scenario.values import NotNegative, Number, Polygon, Polyline, Positive, RateNumber, Text, Vector

if TYPE_CHECKING:
    from matplotlib.figure import Figure

MOST_OBSTACLES = 20_000
"""In a file."""

_SHAPE = b"shape"


class Steering(StrEnum):
    """In which directions a vehicle can set out, when it drives in closed loop."""

    AHEAD = "ahead"
    """Along its heading."""
    BOTH_WAYS = "both_ways"
    """From a stand: along its heading or against it; it drives backwards as well as forwards. Else as it drives."""
    ON_THE_SPOT = "on_the_spot"
    """From a stand: in any direction, after a turn on the spot. Else along its heading."""
    ANY = "any"
    """In any direction, at any time."""


class Reverse(Part):
    """Limits of the vehicle while it drives backwards, beside those that hold in both directions."""

    max_speed: Positive = Field(description="m/s")
    max_acceleration: Positive | None = Field(
        default=None, description="when it speeds up backwards, m/s2; null: that of the vehicle"
    )


class Vehicle(Part):
    """Shape of the vehicle and its limits."""

    rules: ClassVar[tuple[Rule, ...]] = (
        checks.discs_have_a_reference,
        checks.long_vehicles_steer_ahead,
        checks.turns_on_the_spot,
        checks.backwards_is_no_faster,
    )

    radius: Positive = Field(description="disc that covers the vehicle, or one of several that do, m")
    max_speed: Positive = Field(description="m/s")
    max_acceleration: Positive = Field(description="along the path, m/s2")
    max_deceleration: Positive = Field(description="along the path, a positive number, m/s2")
    max_lateral_acceleration: Positive | None = Field(default=None, description="m/s2; null: unbounded")
    max_curvature: Positive | None = Field(default=None, description="1/m; null: unbounded")
    max_jerk: Positive | None = Field(
        default=None, description="how fast the acceleration along the path may change, m/s3; null: it may jump"
    )
    max_curvature_rate: Positive | None = Field(
        default=None,
        description="how fast the curvature may change while driving, as by a steering rate, 1/(m s); null: unbounded",
    )
    max_total_acceleration: Positive | None = Field(
        default=None, description="along and across the path together, as by friction, m/s2; null: only each by itself"
    )
    max_power: Positive | None = Field(
        default=None,
        description="acceleration along the path times speed, as of a motor by the mass, m2/s3; null: unbounded",
    )
    steering: TakenAs[Steering, Steering | str] = by_default(
        Steering.AHEAD,
        description="online, in which directions it can set out: ahead, along its heading; both_ways, from a stand also"
        " backwards; on_the_spot, from a stand in any direction; any, at any time in any direction",
    )
    reverse: OfParts[Reverse | None] = by_default(
        None,
        description="limits while it drives backwards: plans may then have legs in both directions, with stops"
        " between them; null: plans lead ahead",
    )
    max_turn_rate: Positive | None = Field(
        default=None,
        description="of a vehicle that turns on the spot, rad/s: plans may turn it at their start and goal; null: plans"
        " do not",
    )
    centre: Number = Field(
        default=0.0,
        description="how far the middle of the vehicle is ahead of the reference point, towards its front also while it"
        " drives backwards, m; goal.region holds it",
    )
    discs: OfNumbers[Annotated[Row[Number], Field(min_length=1)]] = by_default(
        (0.0,),
        description="where the centres of the discs that cover a long vehicle are on its axis, m ahead of the reference"
        " point, which follows the path; one of them at 0",
    )


class Start(Part):
    """Place and time at which the trip begins."""

    rules: ClassVar[tuple[Rule, ...]] = (checks.heading_is_in_radians,)

    time: Number = Field(description="s, on the clock of the obstacles")
    position: OfNumbers[Vector] = Field(description="[x, y], m")
    heading: Number | None = Field(default=None, description="rad; null: free")
    speed: NotNegative = Field(description="m/s")
    acceleration: RateNumber | None = Field(default=None, description="along the path, m/s2; null: free")


class Goal(Part):
    """Place and time at which the trip ends."""

    rules: ClassVar[tuple[Rule, ...]] = (
        goal_checks.arrival_is_possible,
        checks.heading_is_in_radians,
        goal_checks.region_is_simple,
        goal_checks.goal_is_told_once,
        goal_checks.ranges_are_not_empty,
        goal_checks.target_leaves_the_rest_open,
    )

    position: OfNumbers[Vector] = Field(
        description="[x, y], m; in a region, if one is given, or beside it by vehicle.centre; or left out: then just"
        " inside it, where it is nearest; of a target left out: about where it can be met"
    )
    heading: Number | None = Field(default=None, description="rad; null: free")
    speed: NotNegative | None = Field(default=None, description="m/s; null: free")
    radius: NotNegative = Field(default=0.0, description="anywhere this near to the position will do, m")
    region: TakenAs[Polygon | None, Numbers | None] = by_default(
        None,
        description="polygon [[x, y], ...], m, in place of a radius: the middle of the vehicle may be anywhere in that"
        " convex part of it that is nearest to the position; null: none",
    )
    heading_range: TakenAs[tuple[Number, Number] | None, Numbers | None] = by_default(
        None, description="[least, largest] heading, rad, to the left from the least one; null: any"
    )
    speed_range: TakenAs[tuple[NotNegative, NotNegative] | None, Numbers | None] = by_default(
        None, description="[least, largest] speed, m/s; null: any"
    )
    arrival_step: Positive | None = Field(
        default=None,
        description="arrival a multiple of so many s after start.time, to a hundredth of that; null: any time",
    )
    earliest_arrival: Number | None = Field(
        default=None,
        description="not before this time, to 1e-7 of the travel time, s on the clock of start.time; null: any",
    )
    latest_arrival: Number | None = Field(
        default=None,
        description="not after this time, to 1e-7 of the travel time, s on the clock of start.time; null: any",
    )
    target: OfTarget = by_default(
        None,
        description="what moves and is to be met: {motion: ...}, {course: ...}, {observations: ...} or"
        " {estimate: ...}, as of an obstacle, or the id of one; null: the goal stands",
    )
    offset: OfNumbers[Vector] = by_default((0.0, 0.0), description="place to meet, seen from the target, [x, y], m")
    approach: TakenAs[tuple[Number, Number] | None, Numbers | None] = by_default(
        None,
        description="[least, largest] heading on arrival, rad, to the left from the target's direction of motion, 0:"
        " from behind; of a target that stands then, from the x axis; null: any",
    )
    match_velocity: Annotated[bool, Field(strict=True)] = Field(
        default=False, description="arrive with the velocity of the target"
    )


class Bounds(Part):
    """The box, along the axes, that the vehicle's disc stays inside."""

    rules: ClassVar[tuple[Rule, ...]] = (checks.box_is_not_empty,)

    min: OfNumbers[Vector] = Field(description="lower left corner [x, y], m")
    max: OfNumbers[Vector] = Field(description="upper right corner [x, y], m")


class SpeedLimit(Part):
    """Largest speed of the vehicle along a stretch of a line.

    It holds wherever the point of the line that is nearest to the vehicle's reference point lies in the stretch: the
    borders run across the line. Where a line crosses itself, the vehicle stays on the part of it that it came by: each
    pass over the place keeps its own limits.
    """

    rules: ClassVar[tuple[Rule, ...]] = (checks.stretch_is_not_empty, checks.line_moves_on)

    from_: NotNegative = Field(
        validation_alias="from", serialization_alias="from", description="where it begins, m along the line"
    )
    to: Positive | None = Field(default=None, description="where it ends, m along the line; null: with the line")
    speed: Positive = Field(description="m/s")
    line: TakenAs[Polyline | None, Numbers | None] = by_default(
        None, description="polyline [[x, y], ...], m; null: the guide, or the straight line from start to goal"
    )


class ConfidenceLevel(StrEnum):
    """Event that the probability is the probability of."""

    PER_TIME = "per_time"
    """One obstacle is in its zone at one time."""
    PER_OBSTACLE = "per_obstacle"
    """One obstacle is in its zone at all times of the trip."""
    JOINT = "joint"
    """All obstacles are in their zones at all times of the trip."""


class Confidence(Part):
    """Probability with which the zones of the estimated obstacles hold them."""

    probability: Annotated[float, Field(strict=True, gt=0, lt=1)] = Field(
        default=0.95, description="greater than 0 and less than 1"
    )
    level: TakenAs[ConfidenceLevel, ConfidenceLevel | str] = by_default(ConfidenceLevel.JOINT)


def _check_count(path: str | PathLike[str]) -> None:
    """Refuse a file of far more obstacles than a trip can be planned among, before it is parsed."""
    if Path(path).stat().st_size < MOST_OBSTACLES * len(_SHAPE):
        return
    count = files.read_bytes(path).count(_SHAPE)
    if count > MOST_OBSTACLES:
        text = f"too many: about {count}; a file may have at most {MOST_OBSTACLES}"
        raise ScenarioError(str(path), [Fault("obstacles", MISSING, text)])


def _sampled(guide: Any) -> Any:
    """Points of a guide that is given as a curve, a callable of [0, 1] that returns [x, y] in m; others as they are."""
    if not callable(guide):
        return guide
    return tuple(tuple(float(value) for value in guide(k / 40)) for k in range(41))


class Scenario(Part):
    """A trip to plan: `Scenario.load(path)`, or from its parts, each a model or a dictionary.

    Raises
    ------
    ScenarioError
        With every fault: the key's path, the value, and what is allowed.
    """

    model_config = ConfigDict(title="scp_planner scenario")
    rules: ClassVar[tuple[Rule, ...]] = (
        version_is_known,
        goal_checks.goal_is_elsewhere,
        goal_checks.target_is_known,
        goal_checks.goal_position_is_at_its_region,
        checks.start_speed_is_allowed,
        goal_checks.goal_speed_is_allowed,
        goal_checks.arrival_is_after_start,
        checks.start_acceleration_is_allowed,
        checks.ends_are_in_bounds,
        goal_checks.places_can_be_passed,
        goal_checks.places_are_in_time,
        checks.guide_begins_at_start,
        checks.guide_leads_to_goal,
        checks.corridor_is_of_convex_polygons,
        checks.corridor_leads_from_start_to_goal,
        checks.ends_are_in_corridor,
        checks.corridor_has_its_name,
        checks.walls_are_convex,
        checks.start_is_clear_of_walls,
        checks.ends_are_clear_of_cells,
        checks.stretches_begin_on_their_lines,
        checks.speeds_keep_to_places,
        checks.ids_are_unique,
        checks.start_is_free,
        checks.observations_are_past,
    )

    schema_: Annotated[int, Field(strict=True)] = Field(
        default=1,
        validation_alias="schema",
        serialization_alias="schema",
        description="version of this format: 1",
        json_schema_extra={"const": 1},
    )
    name: Text = Field(default="unnamed", description="text")
    vehicle: OfParts[Vehicle]
    start: OfParts[Start]
    goal: OfParts[Goal]
    goals: TakenAs[Row[Passage], Sequence[Passage | Mapping[str, Any]]] = by_default(
        (),
        description="places to pass, or targets to meet, on the way to the goal; without a guide the path leads over"
        " them",
    )
    goals_order: TakenAs[Order, Order | str] = by_default(
        Order.GIVEN,
        description="given: the places are passed in the order in which they are listed; fastest: in that which is"
        f" fastest, of {goal_checks.MOST_IN_ANY_ORDER} places at most",
    )
    guide: TakenAs[
        Annotated[Polyline | None, BeforeValidator(_sampled)], Numbers | Callable[[float], Numbers] | None
    ] = by_default(
        None,
        description="polyline [[x, y], ...], m, from start to goal that the path is an offset of; null: straight",
    )
    bounds: OfParts[Bounds | None] = by_default(
        None, description="box that the vehicle's disc stays inside; null: none"
    )
    corridor: TakenAs[Annotated[Row[Polygon], Field(min_length=1)] | None, Sequence[Numbers] | None] = by_default(
        None,
        description=f"convex polygons [[[x, y], ...], ...] of at most {SIZE.most_corners} corners that overlap; the"
        " vehicle's disc stays inside their union; null: none",
    )
    walls: TakenAs[Row[Polygon], Sequence[Numbers]] = by_default(
        (),
        description="convex polygons [[[x, y], ...], ...] that stand and that no disc of the vehicle enters, such as"
        " what lies beside a road",
    )
    ground: OfParts[Ground | None] = by_default(
        None, description="map whose occupied cells no disc of the vehicle touches; null: none"
    )
    lanes: TakenAs[Row[Polyline], Sequence[Numbers]] = by_default(
        (),
        description="polylines [[[x, y], ...], ...], m, that pictures show, such as the borders of lanes; nothing is"
        " planned with them",
    )
    speed_limits: TakenAs[Row[SpeedLimit], Sequence[SpeedLimit | Mapping[str, Any]]] = by_default(
        (), description="speed limits by place, besides the vehicle's own"
    )
    confidence: OfParts[Confidence] = by_default(Confidence())
    obstacles: TakenAs[Row[Obstacle], Sequence[Obstacle | Mapping[str, Any]]] = by_default(())

    @model_validator(mode="before")
    @classmethod
    def _aimed(cls, data: Any) -> Any:
        """Fill in where a goal that is a region is aimed at; what is faulty is left to the checks."""
        return with_aim(data)

    @field_validator("goal")
    @classmethod
    def _target_timed(cls, goal: Goal, info: ValidationInfo) -> Goal:
        """A target whose motion does not say when it holds, is there at the start."""
        start = info.data.get("start")
        return goal if start is None else target_timed(goal, start.time)

    @field_validator("goals")
    @classmethod
    def _targets_timed(cls, goals: Row[Passage], info: ValidationInfo) -> Row[Passage]:
        start = info.data.get("start")
        return goals if start is None else tuple(target_timed(one, start.time) for one in goals)

    @field_validator("obstacles")
    @classmethod
    def _timed(cls, obstacles: Row[Obstacle], info: ValidationInfo) -> Row[Obstacle]:
        """Motions that do not say when they hold, hold at the start; without a start that is left to the checks."""
        start = info.data.get("start")
        return obstacles if start is None else all_timed(obstacles, start.time)

    def model_copy(self, *, update: Mapping[str, Any] | None = None, deep: bool = False) -> Self:
        """Copy with some fields changed, as of any part; new motions without a time hold at the start of the copy."""
        made = super().model_copy(update=update, deep=deep)
        if update is None or "obstacles" not in update:
            return made
        return super(Scenario, made).model_copy(update={"obstacles": all_timed(made.obstacles, made.start.time)})

    def __repr__(self) -> str:
        away = math.dist(self.start.position, self.goal.position)
        count = len(self.obstacles)
        return f"Scenario({self.name!r}, {away:.4g} m, {count} obstacle{'' if count == 1 else 's'})"

    def _repr_html_(self) -> str:
        """For notebooks: vehicle, goal, ground, and where the obstacles are and go."""
        return picture_or_text(self.sketch, repr(self))

    def sketch(self) -> Figure:
        """Draw vehicle, goal and ground, and where the obstacles are at the start and go, as notebooks show it.

        Returns
        -------
        matplotlib.figure.Figure
        """
        return output_named("scenario sketch")(self)

    @classmethod
    def load(cls, path: str | PathLike[str]) -> Self:
        """Read a scenario from a YAML or JSON file.

        Parameters
        ----------
        path
            A file whose name ends in .yaml, .yml or .json.

        Returns
        -------
        Scenario

        Raises
        ------
        ScenarioError
            With every fault of the file.
        OSError
            If the file cannot be read.
        """
        if Path(path).suffix.lower() == ".xml":
            reader = "scp_planner.formats.commonroad.load_commonroad"
            raise ScenarioError(str(path), [Fault("", MISSING, f"XML files of CommonRoad are read by {reader}")])
        _check_count(path)
        data, faults = files.read(path)
        if "travel_time" in data:
            raise ScenarioError(str(path), [Fault("", MISSING, "this is a plan or a run, not a scenario")])
        folder = Path(path).parent
        faults = [*faults, *read_processes(data, folder), *read_ground(data, folder)]
        return part_of_file(cls, path, data, ScenarioError, faults=faults)

    def save(self, path: str | PathLike[str]) -> None:
        """Write the scenario so that `load` gives an equal one: floats keep every bit.

        Parameters
        ----------
        path
            A file whose name ends in .yaml, .yml or .json. It is replaced as a whole or not at all.
        """
        data = self.to_dict()
        if self.ground is not None:
            data["ground"]["map"] = relpath(data["ground"]["map"], Path(path).parent)
        files.write(path, data)

    def to_dict(self) -> dict[str, Any]:
        """Give the contents of the scenario's file: dictionaries, lists, text, numbers and None."""
        if self.ground is not None:
            self.ground.check_file()
        data = self.model_dump(mode="json", by_alias=True)
        for obstacle in data["obstacles"]:
            # An obstacle has one of these; the file need not say that the others are null.
            for key in WHEREABOUTS:
                if obstacle[key] is None:
                    del obstacle[key]
        return data

    @classmethod
    def json_schema(cls) -> dict[str, Any]:
        """Give the JSON schema (draft 2020-12) of the scenario file."""
        schema = cls.model_json_schema(by_alias=True, mode="validation")
        return {"$schema": "https://json-schema.org/draft/2020-12/schema", **schema}
