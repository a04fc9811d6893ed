"""Scenarios of CommonRoad, the benchmark collection of M. Althoff et al. (IV 2017), read from their XML files.

What becomes what:

- each obstacle's recorded states: a course, ``motion: {time, position, heading}``; one that hardly moves stands where
  it begins; a prediction by sets: a course of their middles, with a shape that covers each of them;
- rectangles and discs: the same; other shapes: the convex polygon around them, as they lie at first;
- the planning problem: start, and a goal with its region, where the route comes to it, and its ranges of headings,
  speeds and times; a goal of time alone is a place so far ahead on the lane;
- the lanes from start to goal: the guide, along their centre lines;
- the borders of the road: walls; those of lanes: lines in pictures;
- for a model of the benchmark's: its car, as the official checker looks at it.

Not taken over: the rules of traffic. After its last state an obstacle goes straight on.

Needs the package commonroad-io (the extra `commonroad`), of 2024 or newer.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Mapping
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from scp_planner.arrays import Array
from scp_planner.errors import MISSING, Fault, ScenarioError
from scp_planner.scenario.commonroad_goals import GoalAim, GoalState, ahead_of, goal_states, seen_heading
from scp_planner.scenario.commonroad_lines import (
    SIGHT,
    SIGHT_TIME,
    Arrival,
    DrivenLine,
    Point,
    SteeredCar,
    arrival,
    driven,
    heading_near,
    led_through,
    point_ahead,
    rectangle,
    turned_too_far,
)
from scp_planner.scenario.commonroad_models import (
    FEWEST_DISCS,
    VehicleModel,
    car_named,
    centre_of,
    default_car,
    swerving,
    vehicle_of,
)
from scp_planner.scenario.commonroad_obstacles import obstacles_of
from scp_planner.scenario.commonroad_roads import (
    GAP,
    GUIDE_STEP,
    SEEN_GAP,
    drivable,
    lane_borders,
    route_ahead,
    route_to,
    spaced,
    walls_around,
)
from scp_planner.scenario.commonroad_start import touched_by
from scp_planner.scenario.models import Scenario, Vehicle

LENGTH, WIDTH = 4.5, 1.8
"""m, of the default vehicle."""

DISC_SPACING = 0.9
"""m between the five discs that cover it."""

CAR = {
    "radius": math.hypot(0.5 * WIDTH, 0.5 * LENGTH - 2.0 * DISC_SPACING),
    "discs": tuple(DISC_SPACING * k for k in (-2, -1, 0, 1, 2)),
    "max_acceleration": 6.0,
    "max_deceleration": 8.0,
    "max_lateral_acceleration": 6.0,
    "max_curvature": 0.2,
}
"""The default vehicle. Some problems ask for hard driving; the models of CommonRoad's own cars reach 11.5 m/s2."""

SPEED_RESERVE, LEAST_TOP_SPEED = 1.5, 20.0
"""Its top speed: so many times the speed at the start, and no less than this, m/s."""

MORE_DISCS = (5, 9, 17, 33)
"""That cover a car of the benchmark: more where it stands so close to something that fewer touch it at the start."""

SLOWEST = 2.0
"""m/s of the file, that a goal of time alone is planned with at least."""

BLEND = 1.5
"""s of the file, at the speed of the start, in which the line comes from the centre of the lane to the goal."""

BEYOND = 1.5
"""Times the way to a goal of time alone, that the line goes on for at least."""

UNHURRIED = 0.7
"""Of the speed at the start; a goal that may only be reached later than so is reached where it goes on that long."""

REAR_WIDTH = 1.3
"""Widths of the vehicle: of the room behind it at the start for the discs that cover it."""

NEARLY = 0.1
"""Lengths of the default vehicle: so far ahead a goal begins that holds the vehicle at the start, or one step ahead."""

REACH = 8.0
"""Lengths of the vehicle around the guide in which the road is looked at."""


@dataclass(frozen=True)
class CommonRoadFile:
    """A file that has been read.

    Attributes
    ----------
    name : str
        Of the file.
    world : commonroad.scenario.scenario.Scenario
    problem : commonroad.planning.planning_problem.PlanningProblem
    """

    name: str
    world: Any
    problem: Any

    def goal_states(self) -> list[GoalState]:
        """Return the goal's states; ScenarioError if there is none."""
        return goal_states(self.problem, float(self.world.dt), self.name)


@dataclass(frozen=True)
class _Vehicle:
    """What is planned with: fields of the vehicle, its length and width in m, and how far ahead its middle is, m."""

    fields: Mapping[str, Any] | Vehicle
    width: float
    length: float
    centre: float

    def steering(self, speed: float) -> SteeredCar:
        """How it is steered along a line from a speed on, m/s."""
        given = self.fields.max_curvature if isinstance(self.fields, Vehicle) else self.fields.get("max_curvature")
        bend = given if given is not None and math.isfinite(given) else 1.0 / self.length
        return SteeredCar(self.length, self.centre, bend, max(SIGHT * self.length, SIGHT_TIME * speed))


def load_commonroad(
    path: str | PathLike[str],
    vehicle: Vehicle | Mapping[str, Any] | None = None,
    *,
    problem: int | None = None,
    guide: bool = True,
    model: str | None = None,
    car: str | None = None,
    aim: GoalAim | None = None,
    borders: bool = True,
) -> Scenario:
    """Read a CommonRoad file.

    Parameters
    ----------
    path : path
        XML file, of version 2018b or 2020a.
    vehicle : Vehicle or mapping, optional
        Default: the car of the model, or without a model `CAR`, with a top speed somewhat above the speed at the start.
    problem : int, optional
        Id of the planning problem; default: the first one.
    guide : bool
        Whether the path is an offset of the centre line of the lanes to the goal, if there are any; else of a straight.
    model : str, optional
        PM, KS or KST: plan for this model of the benchmark, arriving on a step of the file, as
        `export_commonroad_solution` writes it.
    car : str, optional
        The benchmark's car for the model; default: the BMW 320i, for KST the truck.
    aim : scp_planner.scenario.commonroad_goals.GoalAim, optional
        Which of the goal's states to plan for, and where on the lane if it is one of time alone; default: the first,
        as far as the speed of the start leads.
    borders : bool
        Whether the borders of the road are walls.

    Returns
    -------
    Scenario

    Raises
    ------
    ScenarioError
        If the file is none of CommonRoad, or holds something that cannot be planned with.
    ValueError
        If there is no such model or car.
    ImportError, OSError
        If commonroad-io is not installed; if the file cannot be read.
    """
    return scenario_of(
        read_commonroad(path, problem), vehicle, guide=guide, model=model, car=car, aim=aim, borders=borders
    )


def scenario_of(
    file: CommonRoadFile,
    vehicle: Vehicle | Mapping[str, Any] | None = None,
    *,
    guide: bool = True,
    model: str | None = None,
    car: str | None = None,
    aim: GoalAim | None = None,
    borders: bool = True,
    discs: int = FEWEST_DISCS,
) -> Scenario:
    """Make the scenario of a file that has been read, as `load_commonroad` does.

    Parameters
    ----------
    file : CommonRoadFile
    vehicle, guide, model, car, aim, borders
        As in `load_commonroad`.
    discs : int
        How many cover a model's car at least: one of `MORE_DISCS`. The more, the less they stick out of it.

    Returns
    -------
    Scenario

    Raises
    ------
    ScenarioError, ValueError
        As `load_commonroad`.
    """
    if vehicle is not None and model is not None:
        raise ValueError("vehicle: a model has its own car; give the one or the other")
    aim = aim or GoalAim()
    states = file.goal_states()
    if not 0 <= aim.state < len(states):
        raise ScenarioError(file.name, [Fault("goalState", aim.state, f"must be less than {len(states)}")])
    start, step = file.problem.initial_state, float(file.world.dt)
    gap = max(step * float(start.velocity), NEARLY * LENGTH)
    middle = (float(start.position[0]), float(start.position[1]))
    goal = ahead_of(states[aim.state], middle, float(start.orientation), gap)
    reader = _Reader(file.name, file.world, file.problem, goal, guide, borders, aim)
    if model is None:
        return reader.scenario(_default_vehicle(vehicle, start), None, None)
    return _with_enough_discs(reader, _model_named(model), car, discs)


def _with_enough_discs(reader: _Reader, model: VehicleModel, car: str | None, fewest: int) -> Scenario:
    """The scenario of a car of the benchmark, covered by as many discs as it takes to touch nothing at the start."""
    body = car_named(car or default_car(model), model)
    step, start = float(reader.world.dt), reader.problem.initial_state
    if model is VehicleModel.PM and abs(float(start.orientation)) > math.pi:
        text = "the official checker compares headings as numbers, and those of a point mass are in [-pi, pi]"
        raise ScenarioError(reader.name, [Fault("initialState.orientation", float(start.orientation), text)])
    middle = (float(start.position[0]), float(start.position[1]))
    touched = touched_by(middle, float(start.orientation), body, reader.world, int(start.time_step))
    if touched is not None:
        text = f"no solution is valid: the car, {body.length:g} m by {body.width:g} m, {touched} where it starts"
        raise ScenarioError(reader.name, [Fault("initialState.position", middle, text)])
    refused = ScenarioError(reader.name, [])
    for discs in (count for count in MORE_DISCS if count >= fewest):
        fields = vehicle_of(body, model, discs)
        if model is VehicleModel.PM:
            fields |= swerving(fields, step, float(start.velocity))
        own = _Vehicle(fields, body.width, body.length, centre_of(body, model))
        try:
            return reader.scenario(own, step, model)
        except ScenarioError as error:
            refused = error
            if any(fault.path != "start.position" for fault in error.faults):
                raise
    raise refused


def _model_named(name: str) -> VehicleModel:
    try:
        return VehicleModel(name)
    except ValueError:
        raise ValueError(f"model: must be one of {', '.join(VehicleModel)}, not {name!r}") from None


def read_commonroad(path: str | PathLike[str], problem: int | None = None) -> CommonRoadFile:
    """Read a CommonRoad file with commonroad-io.

    Parameters
    ----------
    path : path
        XML file, of version 2018b or 2020a.
    problem : int, optional
        Id of the planning problem; default: the first one.

    Returns
    -------
    CommonRoadFile

    Raises
    ------
    ScenarioError
        If the file is none of CommonRoad, or has no such problem.
    ImportError
        If commonroad-io is not installed.
    OSError
        If the file cannot be read.
    """
    name = str(path)
    try:
        from commonroad.common.file_reader import CommonRoadFileReader
    except ImportError as error:
        raise ImportError("CommonRoad files need commonroad-io: pip install 'scp-planner[commonroad]'") from error

    Path(name).open("rb").close()  # what cannot be opened is an OSError, whatever the reader makes of it
    reader_log = logging.getLogger("commonroad")
    level = reader_log.level
    reader_log.setLevel(logging.ERROR)  # it warns of old formats, which it reads all the same
    try:
        world, problems = CommonRoadFileReader(name).open()
    except Exception as error:  # of many kinds: of the parser, of the reader's assertions, of what it calls
        raise ScenarioError(name, [Fault("", MISSING, f"not a CommonRoad file: {error}")]) from error
    finally:
        reader_log.setLevel(level)
    chosen = _chosen(problems.planning_problem_dict, problem, name)
    _check_start(chosen.initial_state, name)
    return CommonRoadFile(name, world, chosen)


def _check_start(start: Any, name: str) -> None:
    """Refuse a start that is known as a set alone."""
    kinds = {"position": (2,), "orientation": (), "velocity": ()}
    text = "must be known exactly"
    unknown = [key for key, shape in kinds.items() if not _is_exact(getattr(start, key, None), shape)]
    if unknown:
        raise ScenarioError(name, [Fault(f"initialState.{key}", MISSING, text) for key in unknown])


def _is_exact(value: Any, shape: tuple[int, ...]) -> bool:
    try:
        return np.asarray(value, dtype=float).shape == shape
    except (TypeError, ValueError):
        return False


def _chosen(problems: dict[int, Any], wanted: int | None, name: str) -> Any:
    if not problems:
        raise ScenarioError(name, [Fault("planningProblem", MISSING, "there must be one")])
    if wanted is None:
        return next(iter(problems.values()))
    if wanted not in problems:
        ids = ", ".join(str(each) for each in problems)
        raise ScenarioError(name, [Fault("planningProblem", wanted, f"must be one of {ids}")])
    return problems[wanted]


def _straight_to(start: Point, place: Any) -> Array:
    """A line from a point through the middle of a polygon, and as far beyond that as it may reach, m."""
    middle = place.representative_point()
    turn = math.atan2(middle.y - start[1], middle.x - start[0])
    return np.array([start, point_ahead((middle.x, middle.y), turn, math.sqrt(place.area))])


def _default_vehicle(vehicle: Vehicle | Mapping[str, Any] | None, start: Any) -> _Vehicle:
    if vehicle is None:
        top = max(SPEED_RESERVE * float(start.velocity), LEAST_TOP_SPEED)
        return _Vehicle({**CAR, "max_speed": top}, WIDTH, LENGTH, 0.0)
    fields = vehicle.model_dump() if isinstance(vehicle, Vehicle) else vehicle
    radius = float(fields.get("radius", 0.5 * WIDTH))
    offsets = fields.get("discs") or (0.0,)
    long = max(offsets) - min(offsets) + 2.0 * radius
    return _Vehicle(vehicle, 2.0 * radius, long, float(fields.get("centre", 0.0)))


@dataclass(frozen=True)
class _Reader:
    """What a scenario is made of.

    Attributes
    ----------
    name : str
        Of the file.
    world, problem
        Objects of commonroad-io.
    goal : GoalState
    guided, bordered : bool
        Whether lanes make a guide, and borders walls.
    aim : GoalAim
    """

    name: str
    world: Any
    problem: Any
    goal: GoalState
    guided: bool
    bordered: bool
    aim: GoalAim

    def scenario(self, vehicle: _Vehicle, arrival_step: float | None, model: VehicleModel | None) -> Scenario:
        """Make the scenario of a vehicle, which arrives on steps of time, s, if given, and moves like a model."""
        state, step = self.problem.initial_state, float(self.world.dt)
        middle: Point = (float(state.position[0]), float(state.position[1]))
        heading, speed = float(state.orientation), float(state.velocity)
        start = point_ahead(middle, heading, -vehicle.centre)
        line = self._line(middle, heading, speed)
        drive = driven(line, start, heading, vehicle.steering(speed))
        headings = self._headings(model, line)
        end = self._arrival(drive, headings, vehicle)
        if end.index == 0:
            text = "nothing that drives forward along the lanes comes nearer to it than where it starts"
            raise ScenarioError(self.name, [Fault("goalState.position", MISSING, text)])
        guide = spaced(drive.places[: end.index + 1], GUIDE_STEP) if end.index > 1 else np.array([start])
        walls = self._walls(guide, middle, heading, vehicle, judged=model is not None) if self.bordered else []
        goal = {
            "position": tuple(drive.places[end.index].tolist()),
            "region": [(float(x), float(y)) for x, y in end.place.exterior.coords[:-1]],
            "heading_range": headings,
            "arrival_step": arrival_step,
        }
        return Scenario(
            name=Path(self.name).stem,
            vehicle=vehicle.fields,
            start={"time": step * state.time_step, "position": start, "heading": heading, "speed": speed},
            goal={**self.goal.fields(), **goal},
            guide=guide.tolist() if self.guided and len(guide) > 1 else None,
            walls=walls,
            lanes=lane_borders(self.world.lanelet_network, guide, REACH * vehicle.length, vehicle.width),
            obstacles=obstacles_of(self.world, step, self.name),
        )

    def _line(self, start: Point, heading: float, speed: float) -> Array:
        """The line of the route, (k, 2) m, as far as it may be wanted; a straight one where no lanes lead there."""
        network, places = self.world.lanelet_network, self.goal.places
        if places:
            route = route_to(network, start, heading, places)
            if route is None:
                return _straight_to(start, places[0])
            last = route.lanes[-1].polygon.shapely_object
            at = max(places, key=lambda place: place.intersection(last).area).representative_point()
            line = np.vstack([route.line(start, (at.x, at.y)), route.beyond((at.x, at.y))[1:]])
            return led_through(line, places, max(BLEND * speed, 2.0 * GUIDE_STEP)) if len(line) > 1 else line
        way = self._timed_way(speed)
        route = route_ahead(network, start, heading, BEYOND * way)
        line = np.zeros((0, 2)) if route is None else route.line(start)
        return line if len(line) > 1 else np.array([start, point_ahead(start, heading, BEYOND * way)])

    def _headings(self, model: VehicleModel | None, line: Array) -> tuple[float, float] | None:
        """The headings at the goal; for a point mass those that the official checker takes for them."""
        given = self.goal.heading
        if given is None or model is not VehicleModel.PM:
            return given
        seen = seen_heading(given, heading_near(line, self.goal.places[0]) if self.goal.places else 0.0)
        if seen is None:
            text = (
                f"no point mass gets there: the official checker takes atan(sin h) for its heading h, which is never in"
                f" [{given[0]:g}, {given[1]:g}]; plan with model KS"
            )
            raise ScenarioError(self.name, [Fault("goalState.orientation", MISSING, text)])
        return seen

    def _soonest(self) -> float:
        """How far the vehicle drives, a little slower than it starts, until it may arrive, m."""
        begin = float(self.world.dt) * self.problem.initial_state.time_step
        time = max((self.goal.earliest or begin) - begin, 0.0)
        return UNHURRIED * float(self.problem.initial_state.velocity) * time

    def _timed_way(self, speed: float) -> float:
        """How far the vehicle drives at the speed of its start until the goal's time, m."""
        begin = float(self.world.dt) * self.problem.initial_state.time_step
        time = (self.goal.earliest or self.goal.latest or begin) - begin
        return self.aim.timed_way * max(speed, SLOWEST) * max(time, float(self.world.dt))

    def _arrival(self, drive: DrivenLine, headings: tuple[float, float] | None, vehicle: _Vehicle) -> Arrival:
        """Where on a drive the goal is."""
        if self.goal.places:
            turned = turned_too_far(drive.headings, headings, self.aim.turn)
            return arrival(drive, self.goal.places, turned, self._soonest(), self.aim.depth)
        way = self._timed_way(float(self.problem.initial_state.velocity))
        index = min(int(np.searchsorted(drive.stations, way)), len(drive.stations) - 1)
        middle = (float(drive.middles[index, 0]), float(drive.middles[index, 1]))
        return Arrival(index, rectangle(middle, float(drive.headings[index]), vehicle.length, 2.0 * vehicle.width))

    def _walls(
        self, line: Array, middle: Point, heading: float, vehicle: _Vehicle, *, judged: bool
    ) -> list[list[Point]]:
        """Walls beside the road; as the official checker sees it, where it will judge the trip."""
        if not self.world.lanelet_network.lanelets:
            return []
        gap = SEEN_GAP if judged else GAP * vehicle.width
        area = drivable(self.world.lanelet_network, line, REACH * vehicle.length, vehicle.width, gap)
        # Discs reach beyond the rear of what they cover; the vehicle only moves away from there.
        rear = point_ahead(middle, heading, -0.5 * vehicle.length)
        area = area.union(rectangle(rear, heading, 2.0 * vehicle.width, REAR_WIDTH * vehicle.width))
        return walls_around(area, rectangle(middle, heading, vehicle.length, vehicle.width), vehicle.width)
