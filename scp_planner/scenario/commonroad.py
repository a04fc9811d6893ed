"""Scenarios of CommonRoad, the benchmark collection of M. Althoff et al. (IV 2017), read from their XML files.

What becomes what:

- each obstacle's recorded states: a course, ``motion: {time, position}``; one that hardly moves stands where it begins;
- rectangles and discs: the same; other shapes: the convex polygon around them, as they lie at first;
- the planning problem: start; goal in the middle of its region, with the largest radius that fits in; the window of
  arrival; of an interval of speeds the one nearest to that at the start; the heading if its interval is narrow;
- the lanes from start to goal: the guide, along their centre lines.

Not taken over: the borders of lanes and the rules of traffic (the plan keeps clear of obstacles, and is free to leave
the road). Predictions that are sets and not trajectories are refused. After its last state an obstacle goes straight
on.

Needs the package commonroad-io (the extra `commonroad`).
"""

from __future__ import annotations

import heapq
import logging
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from scp_planner.arrays import Array
from scp_planner.errors import MISSING, Fault, ScenarioError
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

STANDING = 0.2
"""m. What moves less than this in all of the recording stands."""

NARROW_HEADING = 0.1
"""rad. The heading at the goal is asked for if it may differ from the middle of its interval by no more than this."""

GUIDE_STEP = 3.0
"""m between points of the guide, which would else show the kinks of the centre lines."""

CHANGE_COST = 30.0
"""m of way that a change of lanes is worth."""

CHANGE_MARGIN = 0.2
"""Part of a lane, before it is left and after it is reached, in which the guide is on its way to the next one."""


def load_commonroad(
    path: str | PathLike[str],
    vehicle: Vehicle | Mapping[str, Any] | None = None,
    *,
    problem: int | None = None,
    guide: bool = True,
) -> Scenario:
    """Read a CommonRoad file.

    Parameters
    ----------
    path : path
        XML file, of version 2018b or 2020a.
    vehicle : Vehicle or mapping, optional
        Default: `CAR`, with a top speed somewhat above the speed at the start.
    problem : int, optional
        Id of the planning problem; default: the first one.
    guide : bool
        Whether the path is to be an offset of the centre line of the lanes from start to goal, if there are such lanes;
        else of the straight line.

    Returns
    -------
    Scenario

    Raises
    ------
    ScenarioError
        If the file is none of CommonRoad, or holds something that cannot be planned with.
    ImportError
        If commonroad-io is not installed.
    OSError
        If the file cannot be read.
    """
    name = str(path)
    world, problems = _read(name)
    chosen = _chosen(problems, problem, name)
    state, step = chosen.initial_state, float(world.dt)
    start = tuple(float(x) for x in state.position)
    goal, region = _goal(chosen, step, name)
    if vehicle is None:
        top = max(SPEED_RESERVE * float(state.velocity), LEAST_TOP_SPEED, goal.get("speed") or 0.0)
        vehicle = {**CAR, "max_speed": top}
    line = _guide(world.lanelet_network, start, goal["position"], region) if guide else None
    return Scenario(
        name=Path(name).stem,
        vehicle=vehicle,
        start={
            "time": step * state.time_step,
            "position": start,
            "heading": float(state.orientation),
            "speed": float(state.velocity),
        },
        goal=goal,
        guide=line,
        obstacles=[_obstacle(obstacle, step, name) for obstacle in world.obstacles],
    )


def _read(name: str) -> tuple[Any, dict[int, Any]]:
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
    return world, problems.planning_problem_dict


def _chosen(problems: dict[int, Any], wanted: int | None, name: str) -> Any:
    if not problems:
        raise ScenarioError(name, [Fault("planningProblem", MISSING, "there must be one")])
    if wanted is None:
        return next(iter(problems.values()))
    if wanted not in problems:
        ids = ", ".join(str(each) for each in problems)
        raise ScenarioError(name, [Fault("planningProblem", wanted, f"must be one of {ids}")])
    return problems[wanted]


# The goal


def _goal(problem: Any, step: float, name: str) -> tuple[dict[str, Any], Any]:
    """Give the goal of the scenario, and the region that it lies in."""
    state = problem.goal.state_list[0]
    if getattr(state, "position", None) is None:
        raise ScenarioError(
            name, [Fault("goalState.position", MISSING, "a goal without a place cannot be planned for")]
        )
    region = state.position.shapely_object
    if not region.contains(region.centroid) or region.geom_type != "Polygon":
        region = region.convex_hull
    middle = region.centroid
    # 1e-6: a radius that touches the border to rounding would be outside it.
    radius = (1.0 - 1e-6) * float(region.exterior.distance(middle))
    goal: dict[str, Any] = {"position": (float(middle.x), float(middle.y)), "radius": radius}
    earliest, latest = (step * float(end) for end in _interval(state.time_step))
    begin = step * problem.initial_state.time_step
    goal["latest_arrival"] = latest if latest > begin else None
    goal["earliest_arrival"] = earliest if earliest > begin else None
    if getattr(state, "velocity", None) is not None:
        low, high = _interval(state.velocity)
        goal["speed"] = max(min(max(float(problem.initial_state.velocity), low), high), 0.0)
    if getattr(state, "orientation", None) is not None:
        low, high = _interval(state.orientation)
        if high - low <= 2.0 * NARROW_HEADING:
            goal["heading"] = 0.5 * (low + high)
    return goal, region


def _interval(value: Any) -> tuple[float, float]:
    """Give the ends of an interval, or of a value as of one."""
    return float(getattr(value, "start", value)), float(getattr(value, "end", value))


# Obstacles


def _obstacle(obstacle: Any, step: float, name: str) -> dict[str, Any]:
    own = f"obstacle {obstacle.obstacle_id}"
    initial = obstacle.initial_state
    states = [initial]
    prediction = getattr(obstacle, "prediction", None)
    if prediction is not None:
        if not hasattr(prediction, "trajectory"):
            raise ScenarioError(name, [Fault(own, MISSING, "its prediction must be a trajectory, not a set")])
        states += [state for state in prediction.trajectory.state_list if state.time_step > initial.time_step]
    places = np.array([state.position for state in states], dtype=float)
    identity = {"id": str(obstacle.obstacle_id)}
    if np.ptp(places, axis=0).max() < STANDING:
        heading = float(initial.orientation)
        still = {"position": tuple(places[0].tolist())}
        return {**identity, "shape": _shape(obstacle, heading), "motion": still}
    course = {"time": [step * state.time_step for state in states], "position": places.tolist()}
    return {**identity, "shape": _shape(obstacle, None), "motion": course}


def _shape(obstacle: Any, heading: float | None) -> dict[str, Any]:
    """Give a shape; its heading in rad, None: along its motion."""
    shape = obstacle.obstacle_shape
    length, width = getattr(shape, "length", None), getattr(shape, "width", None)
    shift = float(getattr(shape, "origin_x_shift", 0.0) or 0.0)
    if length is not None and width is not None:
        # One whose origin is not in its middle is made longer, to cover it from there.
        rectangle = {"rectangle": (float(length) + 2.0 * abs(shift), float(width))}
        return rectangle if heading is None else {**rectangle, "heading": heading}
    if getattr(shape, "radius", None) is not None:
        return {"disc": float(shape.radius)}
    state = obstacle.initial_state
    around = shape.compute_occupancy_for_state(state).shapely_object.convex_hull
    vertices = np.array(around.exterior.coords)[:-1] - np.asarray(state.position, dtype=float)
    return {"polygon": vertices.tolist()}


# The guide


@dataclass(frozen=True)
class _Row:
    """Lanes side by side that are changed between, in order."""

    lanes: tuple[Any, ...]


def _guide(network: Any, start: Sequence[float], goal: Sequence[float], region: Any) -> list[list[float]] | None:
    """Lay a line along the lanes from start to goal; None where no lanes lead there, or it is not far."""
    route = _route(network, start, goal, region)
    if route is None:
        return None
    rows = list(_rows(route))
    begin, end = _station(route[0], start), _station(route[-1], goal)
    points: list[Array] = []
    for k, row in enumerate(rows):
        first, last = begin if k == 0 else 0.0, end if k == len(rows) - 1 else 1.0
        if last > first:
            points += _along(row, first, last)
    ends = np.array([start, goal], dtype=float)
    # Close to the ends the line would have to jump to them.
    inner = [point for point in points if np.linalg.norm(ends - point, axis=1).min() > 2.0 * GUIDE_STEP]
    if not inner:
        return None
    return _spaced(np.vstack([ends[0], *inner, ends[1]])).tolist()


def _route(network: Any, start: Sequence[float], goal: Sequence[float], region: Any) -> list[Any] | None:
    """Find the shortest way along lanes and changes between them."""
    lanes = {lane.lanelet_id: lane for lane in network.lanelets}
    (first,) = network.find_lanelet_by_position([np.array(start, dtype=float)])
    (at_goal,) = network.find_lanelet_by_position([np.array(goal, dtype=float)])
    ends = set(at_goal) or {key for key, lane in lanes.items() if lane.polygon.shapely_object.intersects(region)}
    queue: list[tuple[float, int, tuple[int, ...]]] = [(0.0, key, (key,)) for key in first]
    heapq.heapify(queue)
    done: set[int] = set()
    while queue:
        cost, key, way = heapq.heappop(queue)
        if key in ends:
            return [lanes[each] for each in way]
        if key in done:
            continue
        done.add(key)
        lane = lanes[key]
        length = float(np.linalg.norm(np.diff(lane.center_vertices, axis=0), axis=1).sum())
        steps = [(length, each) for each in lane.successor]
        steps += [(CHANGE_COST, each) for each in _neighbours(lane)]
        for more, each in steps:
            if each in lanes and each not in done:
                heapq.heappush(queue, (cost + more, each, (*way, each)))
    return None


def _neighbours(lane: Any) -> Iterator[int]:
    if lane.adj_left is not None and lane.adj_left_same_direction:
        yield lane.adj_left
    if lane.adj_right is not None and lane.adj_right_same_direction:
        yield lane.adj_right


def _rows(route: list[Any]) -> Iterator[_Row]:
    row = [route[0]]
    for lane in route[1:]:
        if lane.lanelet_id in row[-1].successor:
            yield _Row(tuple(row))
            row = []
        row.append(lane)
    yield _Row(tuple(row))


def _along(row: _Row, first: float, last: float) -> list[Array]:
    """Points along lanes that are changed between from one part of their length to another."""
    share = (last - first) / len(row.lanes)
    points: list[Array] = []
    for k, lane in enumerate(row.lanes):
        low = first + share * (k + (CHANGE_MARGIN if k else 0.0))
        high = first + share * (k + 1.0 - (CHANGE_MARGIN if k < len(row.lanes) - 1 else 0.0))
        line, stations = _measured(lane)
        count = max(2, math.ceil((high - low) * stations[-1] / GUIDE_STEP) + 1)
        wanted = np.linspace(low, high, count) * stations[-1]
        points += list(np.stack([np.interp(wanted, stations, line[:, axis]) for axis in (0, 1)], axis=-1))
    return points


def _station(lane: Any, point: Sequence[float]) -> float:
    """Part of a lane's length at which a point lies beside it."""
    line, stations = _measured(lane)
    fine = np.linspace(0.0, stations[-1], 400)
    places = np.stack([np.interp(fine, stations, line[:, axis]) for axis in (0, 1)], axis=-1)
    nearest = int(np.linalg.norm(places - np.asarray(point, dtype=float), axis=1).argmin())
    return float(fine[nearest] / stations[-1])


def _measured(lane: Any) -> tuple[Array, Array]:
    line = np.asarray(lane.center_vertices, dtype=float)
    return line, np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1))])


def _spaced(points: Array) -> Array:
    """Points at equal distances along a polyline, ends included."""
    stations = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    wanted = np.linspace(0.0, stations[-1], max(2, math.ceil(stations[-1] / GUIDE_STEP)) + 1)
    spaced = np.stack([np.interp(wanted, stations, points[:, axis]) for axis in (0, 1)], axis=-1)
    spaced[0], spaced[-1] = points[0], points[-1]
    return spaced
