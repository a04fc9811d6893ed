"""Scenarios of CommonRoad, the benchmark collection of M. Althoff et al. (IV 2017), read from their XML files."""

from __future__ import annotations

import logging
import math
import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import islice
from os import PathLike
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np

from scp_planner.arrays import Array
from scp_planner.errors import MISSING, Fault, FaultyInputError, ScenarioError, TooLargeError, below
from scp_planner.files import LARGEST_COORDINATE, read_xml
from scp_planner.formats.commonroad import lines, roads
from scp_planner.formats.commonroad.cars import PLANNED, VehicleModel, car_named, centre_of, swerving, vehicle_of
from scp_planner.formats.commonroad.goals import GoalAim, GoalState, ahead_of, goal_states, seen_heading
from scp_planner.formats.commonroad.lines import point_ahead, rectangle
from scp_planner.formats.commonroad.obstacles import obstacles_of, touched_by
from scp_planner.formats.commonroad.roads import Point
from scp_planner.scenario.models import Scenario, Vehicle

CAR_LENGTH, CAR_WIDTH = 4.5, 1.8  # m, of the default vehicle
DISC_SPACING = 0.9  # m between the five discs that cover it
CAR = {
    "radius": math.hypot(0.5 * CAR_WIDTH, 0.5 * CAR_LENGTH - 2.0 * DISC_SPACING),
    "discs": tuple(DISC_SPACING * k for k in (-2, -1, 0, 1, 2)),
    "max_acceleration": 6.0,
    "max_deceleration": 8.0,
    "max_lateral_acceleration": 6.0,
    "max_curvature": 0.2,
}
"""The default vehicle. Some problems ask for hard driving; the models of CommonRoad's own cars reach 11.5 m/s2."""

SPEED_RESERVE, LEAST_TOP_SPEED = 1.5, 20.0
"""Its top speed: so many times the speed at the start, and no less than this, m/s."""


@dataclass(frozen=True)
class ReadingParameters:
    # That cover a car of the benchmark: more where fewer touch something at the start
    more_discs: tuple[int, ...] = (5, 9, 17, 33)
    slowest: float = 2.0  # m/s of the file, that a goal of time alone is planned with at least
    # s of the file, at the speed of the start, in which the line comes from the centre of the lane to the goal
    blend: float = 1.5
    beyond: float = 1.5  # Times the way to a goal of time alone, that the line goes on for at least
    unhurried: float = 0.7  # Of the speed at the start: a goal that may only be reached later is aimed at farther in
    rear_width: float = 1.3  # Widths of the vehicle: of the room behind it at the start for the discs that cover it
    # Lengths of the default vehicle, or a step if longer: so far ahead a goal around the start begins
    nearly: float = 0.1
    reach: float = 8.0  # Lengths of the vehicle around the guide in which the road is looked at


READING = ReadingParameters()


@dataclass(frozen=True)
class CommonRoadFile:
    """A file that has been read."""

    name: str
    world: Any  # scenario of commonroad-io
    problem: Any  # planning problem of commonroad-io
    step: float  # of time, s
    begin: float  # s
    middle: Point  # of the vehicle at the start, m
    heading: float  # at the start, rad
    speed: float  # at the start, m/s

    def goal_states(self) -> dict[int, GoalState]:
        """Return the goal's states that may be reached, by their numbers; ScenarioError if there is none."""
        return goal_states(self.problem, self.step, self.name)

    def refused(self, key: str, value: object, text: str) -> ScenarioError:
        """Return the error that names what cannot be planned with."""
        return ScenarioError(self.name, [Fault(key, value, text)])


@dataclass(frozen=True)
class _Vehicle:
    fields: Mapping[str, Any] | Vehicle
    width: float
    length: float
    centre: float

    def steering(self, speed: float) -> lines.SteeredCar:
        given = self.fields.max_curvature if isinstance(self.fields, Vehicle) else self.fields.get("max_curvature")
        bend = given if given is not None and math.isfinite(given) else 1.0 / self.length
        sight = max(lines.LINES.sight * self.length, lines.LINES.sight_time * speed)
        return lines.SteeredCar(self.length, self.centre, bend, sight)


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
    aim : scp_planner.formats.commonroad.goals.GoalAim, optional
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
    discs: int = PLANNED.fewest_discs,
) -> Scenario:
    """Make the scenario of a file that has been read, as `load_commonroad` does."""
    if vehicle is not None and model is not None:
        raise ValueError("vehicle: a model has its own car; give the one or the other")
    named = None if model is None else VehicleModel.named(model)
    if named is not None:
        car_named(car, named)  # raises what is not of the file
    with _naming(file.name):
        return _made(file, vehicle, guide, named, car, aim, borders, discs)


def _made(
    file: CommonRoadFile,
    vehicle: Vehicle | Mapping[str, Any] | None,
    guide: bool,
    model: VehicleModel | None,
    car: str | None,
    aim: GoalAim | None,
    borders: bool,
    discs: int,
) -> Scenario:
    """Make the scenario of a file."""
    states = file.goal_states()
    aim = aim or GoalAim(min(states))
    if aim.state not in states:
        raise file.refused("goalState", aim.state, f"must be one of {', '.join(map(str, states))}")
    gap = max(file.step * file.speed, READING.nearly * CAR_LENGTH)
    goal = ahead_of(states[aim.state], file.middle, file.heading, gap)
    reader = _Reader(file, goal, guide, borders, aim)
    if model is None:
        return reader.scenario(_default_vehicle(vehicle, file.speed), None)
    return _with_enough_discs(reader, model, car, discs)


def _with_enough_discs(reader: _Reader, model: VehicleModel, car: str | None, fewest: int) -> Scenario:
    """The scenario of a car of the benchmark, covered by as many discs as it takes to touch nothing at the start."""
    file, body = reader.file, car_named(car, model)
    if model is VehicleModel.PM and abs(file.heading) > math.pi:
        text = "the official checker compares headings as numbers, and those of a point mass are in [-pi, pi]"
        raise file.refused("initialState.orientation", file.heading, text)
    touched = touched_by(file.middle, file.heading, body, file.world, int(file.problem.initial_state.time_step))
    if touched is not None:
        text = f"no solution is valid: the car, {body.length:g} m by {body.width:g} m, {touched} where it starts"
        raise file.refused("initialState.position", file.middle, text)
    refused = ScenarioError(file.name, [])
    for discs in (count for count in READING.more_discs if count >= fewest):
        fields = vehicle_of(body, model, discs)
        if model is VehicleModel.PM:
            fields |= swerving(fields, file.step, file.speed)
        try:
            return reader.scenario(_Vehicle(fields, body.width, body.length, centre_of(body, model)), model)
        except ScenarioError as error:
            refused = error
            if any(fault.path != "start.position" for fault in error.faults):
                raise
    raise refused


def read_commonroad(path: str | PathLike[str], problem: int | None = None) -> CommonRoadFile:
    """Read a CommonRoad file with commonroad-io."""
    name = str(path)
    try:
        from commonroad.common.file_reader import CommonRoadFileReader
    except ImportError as error:
        raise ImportError("CommonRoad files need commonroad-io: pip install 'scp-planner[commonroad]'") from error

    faults = list(islice(_faults(read_xml(name, ScenarioError)), MOST_FAULTS))
    if faults:
        raise ScenarioError(name, faults)
    reader_log = logging.getLogger("commonroad")
    level = reader_log.level
    reader_log.setLevel(logging.ERROR)  # it warns of old formats, which it reads all the same
    try:
        world, problems = CommonRoadFileReader(name).open()
    except _UNFIT as error:
        raise ScenarioError(name, [Fault("", MISSING, f"not a CommonRoad file: {error}")]) from error
    finally:
        reader_log.setLevel(level)
    chosen = problems.planning_problem_dict
    if not chosen:
        raise ScenarioError(name, [Fault("planningProblem", MISSING, "there must be one")])
    if problem is not None and problem not in chosen:
        raise ScenarioError(name, [Fault("planningProblem", problem, f"must be one of {', '.join(map(str, chosen))}")])
    found = chosen[next(iter(chosen)) if problem is None else problem]
    kinds, start = {"position": (2,), "orientation": (), "velocity": ()}, found.initial_state
    unknown = [key for key, shape in kinds.items() if not _is_exact(getattr(start, key, None), shape)]
    if unknown:
        text = "must be known exactly"
        raise ScenarioError(name, [Fault(f"initialState.{key}", MISSING, text) for key in unknown])
    step, (x, y) = float(world.dt), map(float, start.position)
    begin, heading, speed = step * start.time_step, float(start.orientation), float(start.velocity)
    return CommonRoadFile(name, world, found, step, begin, (x, y), heading, speed)


@contextmanager
def _naming(name: str) -> Iterator[None]:
    """Raise a ScenarioError of a file for what it holds that no scenario can be made of."""
    from shapely.errors import ShapelyError

    try:
        yield
    except FaultyInputError as error:
        raise ScenarioError(name, error.faults) from None
    except (TooLargeError, ShapelyError) as error:
        raise ScenarioError(name, [Fault("", MISSING, f"cannot be planned with: {error}")]) from error


_UNFIT = (ArithmeticError, AssertionError, AttributeError, LookupError, TypeError, ValueError)
"""Errors of commonroad-io for elements that are missing or do not fit together."""

MOST_FAULTS = 20
"""Faults of elements that are listed."""

_NUMBERS = frozenset(("x", "y", "exact", "intervalStart", "intervalEnd", "length", "width", "radius", "orientation"))
_STATES = frozenset(("initialState", "state", "goalState", "occupancy"))
_POINTS = ("point", "center")
_VALUES, _PLACES = ("exact", "intervalStart and intervalEnd"), ("point", "rectangle", "circle", "polygon", "lanelet")


def _faults(root: ElementTree.Element) -> Iterator[Fault]:
    """Yield the faults of all elements, with the names of those that hold them."""
    level = [("", root)]
    while level:
        place, element = level.pop()
        yield from _element_faults(place, element)
        for child in element:
            of_id = f"[{child.get('id')}]" if child.get("id") else ""
            level.append((below(place, f"{child.tag}{of_id}"), child))


def _element_faults(place: str, element: ElementTree.Element) -> Iterator[Fault]:
    """Yield numbers that are none, or too large, empty intervals, points without coordinates, and odd lanes."""
    texts = {child.tag: child.text for child in element}
    if not texts and element.tag in _NUMBERS and not _is_coordinate(element.text):
        text = f"must be a number of at most {LARGEST_COORDINATE:g} in size"
        yield Fault(place, MISSING if element.text is None else element.text, text)
    ends = [texts.get(key) for key in ("intervalStart", "intervalEnd")]
    if all(map(_is_coordinate, ends)) and float(str(ends[0])) > float(str(ends[1])):
        yield Fault(place, ends, "must not end before it begins")
    if element.tag in _POINTS and not {"x", "y"} <= texts.keys():
        yield Fault(place, list(texts), "must have x and y")
    if element.tag == "lanelet" and element.get("ref") is None:
        bounds = [element.find(f"{side}Bound") for side in ("left", "right")]
        counts = [0 if bound is None else len(bound.findall("point")) for bound in bounds]
        if counts[0] != counts[1] or counts[0] < 2:
            yield Fault(place, counts, "must have as many points, two or more, to the left as to the right")
    if element.tag in _STATES:
        yield from _state_faults(place, element)


def _state_faults(place: str, state: ElementTree.Element) -> Iterator[Fault]:
    """Yield quantities of a state without a value, and times that are no steps."""
    for child in state:
        wanted, texts = _PLACES if child.tag == "position" else _VALUES, {part.tag: part.text for part in child}
        if child.tag != "shape" and not any(texts.keys() >= set(keys.split(" and ")) for keys in wanted):
            yield Fault(below(place, child.tag), MISSING, f"must have one of {', '.join(wanted)}")
        for key, text in texts.items() if child.tag == "time" else ():
            if not re.fullmatch(r"\s*[-+]?\d+\s*", text or ""):
                yield Fault(below(place, f"time.{key}"), text, "must be a whole number of steps")


def _is_coordinate(text: str | None) -> bool:
    try:
        return text is not None and abs(float(text)) <= LARGEST_COORDINATE
    except ValueError:
        return False


def _is_exact(value: Any, shape: tuple[int, ...]) -> bool:
    try:
        return np.asarray(value, dtype=float).shape == shape
    except (TypeError, ValueError):
        return False


def _straight_to(start: Point, place: Any) -> Array:
    """A line from a point through the middle of a polygon, and as far beyond that as it may reach, m."""
    middle = place.representative_point()
    turn = math.atan2(middle.y - start[1], middle.x - start[0])
    return np.array([start, point_ahead((middle.x, middle.y), turn, math.sqrt(place.area))])


def _default_vehicle(vehicle: Vehicle | Mapping[str, Any] | None, speed: float) -> _Vehicle:
    if vehicle is None:
        top = max(SPEED_RESERVE * speed, LEAST_TOP_SPEED)
        return _Vehicle({**CAR, "max_speed": top}, CAR_WIDTH, CAR_LENGTH, 0.0)
    fields = vehicle.model_dump() if isinstance(vehicle, Vehicle) else vehicle
    radius = float(fields.get("radius", 0.5 * CAR_WIDTH))
    offsets = fields.get("discs") or (0.0,)
    long = max(offsets) - min(offsets) + 2.0 * radius
    return _Vehicle(vehicle, 2.0 * radius, long, float(fields.get("centre", 0.0)))


@dataclass(frozen=True)
class _Reader:
    """Makes scenarios of a file, of one of its goals, with lanes as a guide and borders as walls, if wanted."""

    file: CommonRoadFile
    goal: GoalState
    guided: bool
    bordered: bool
    aim: GoalAim

    def scenario(self, vehicle: _Vehicle, model: VehicleModel | None) -> Scenario:
        """Make the scenario of a vehicle, which arrives on steps of time if it moves like a model."""
        file = self.file
        start, line = point_ahead(file.middle, file.heading, -vehicle.centre), self._line()
        drive = lines.driven(line, start, file.heading, vehicle.steering(file.speed))
        headings = self._headings(model, line)
        end = self._arrival(drive, headings, vehicle)
        if end.index == 0:
            text = "nothing that drives forward along the lanes comes nearer to it than where it starts"
            raise file.refused("goalState.position", MISSING, text)
        guide = (
            roads.spaced(drive.places[: end.index + 1], roads.ROADS.guide_step) if end.index > 1 else np.array([start])
        )
        gap = roads.ROADS.gap * vehicle.width if model is None else roads.ROADS.seen_gap
        goal = {
            "position": tuple(drive.places[end.index].tolist()),
            "region": [(float(x), float(y)) for x, y in end.place.exterior.coords[:-1]],
            "heading_range": headings,
            "arrival_step": None if model is None else file.step,
        }
        return Scenario(
            name=Path(file.name).stem,
            vehicle=vehicle.fields,
            start={"time": file.begin, "position": start, "heading": file.heading, "speed": file.speed},
            goal={**self.goal.fields(), **goal},
            guide=guide.tolist() if self.guided and len(guide) > 1 else None,
            walls=self._walls(guide, vehicle, gap) if self.bordered else [],
            lanes=roads.lane_borders(file.world.lanelet_network, guide, READING.reach * vehicle.length, vehicle.width),
            obstacles=obstacles_of(file.world, file.step, file.name),
        )

    def _line(self) -> Array:
        """The line of the route, (k, 2) m, as far as it may be wanted; a straight one where no lanes lead there."""
        network, places = self.file.world.lanelet_network, self.goal.places
        start, heading, speed = self.file.middle, self.file.heading, self.file.speed
        if places:
            route = roads.route_to(network, start, heading, places)
            if route is None:
                return _straight_to(start, places[0])
            last = route.lanes[-1].polygon.shapely_object
            at = max(places, key=lambda place: place.intersection(last).area).representative_point()
            line = np.vstack([route.line(start, (at.x, at.y)), route.beyond((at.x, at.y))[1:]])
            blend = max(READING.blend * speed, 2.0 * roads.ROADS.guide_step)
            return lines.led_through(line, places, blend) if len(line) > 1 else _straight_to(start, places[0])
        way = self._timed_way()
        route = roads.route_ahead(network, start, heading, READING.beyond * way)
        line = np.zeros((0, 2)) if route is None else route.line(start)
        return line if len(line) > 1 else np.array([start, point_ahead(start, heading, READING.beyond * way)])

    def _headings(self, model: VehicleModel | None, line: Array) -> tuple[float, float] | None:
        """The headings at the goal; for a point mass those that the official checker takes for them."""
        given = self.goal.heading
        if given is None or model is not VehicleModel.PM:
            return given
        seen = seen_heading(given, lines.heading_near(line, self.goal.places[0]) if self.goal.places else 0.0)
        if seen is None:
            text = (
                f"no point mass gets there: the official checker takes atan(sin h) for its heading h, which is never in"
                f" [{given[0]:g}, {given[1]:g}]; plan with model KS"
            )
            raise self.file.refused("goalState.orientation", MISSING, text)
        return seen

    def _timed_way(self) -> float:
        """Distance that the vehicle drives at the speed of its start until the goal's time, m."""
        time = (self.goal.earliest or self.goal.latest or self.file.begin) - self.file.begin
        return self.aim.timed_way * max(self.file.speed, READING.slowest) * max(time, self.file.step)

    def _arrival(
        self, drive: lines.DrivenLine, headings: tuple[float, float] | None, vehicle: _Vehicle
    ) -> lines.Arrival:
        if self.goal.places:
            turned = lines.turned_too_far(drive.headings, headings, self.aim.turn)
            time = max((self.goal.earliest or self.file.begin) - self.file.begin, 0.0)
            soonest = READING.unhurried * self.file.speed * time
            return lines.arrival(drive, self.goal.places, turned, soonest, self.aim.depth)
        index = min(int(np.searchsorted(drive.stations, self._timed_way())), len(drive.stations) - 1)
        middle = (float(drive.middles[index, 0]), float(drive.middles[index, 1]))
        # Not so long that it holds the start
        length = min(vehicle.length, float(drive.stations[index]))
        around = rectangle(middle, float(drive.headings[index]), length, 2.0 * vehicle.width)
        return lines.Arrival(index, around)

    def _walls(self, line: Array, vehicle: _Vehicle, gap: float) -> list[list[Point]]:
        """Walls beside the road around a line, in which gaps as narrow as given are filled, m."""
        file, width = self.file, vehicle.width
        if not file.world.lanelet_network.lanelets:
            return []
        area = roads.drivable(file.world.lanelet_network, line, READING.reach * vehicle.length, width, gap)
        # Discs reach beyond the rear of what they cover; the vehicle only moves away from there.
        rear = point_ahead(file.middle, file.heading, -0.5 * vehicle.length)
        area = area.union(rectangle(rear, file.heading, 2.0 * width, READING.rear_width * width))
        return roads.walls_around(area, rectangle(file.middle, file.heading, vehicle.length, width), width)
