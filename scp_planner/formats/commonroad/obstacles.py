"""Obstacles of CommonRoad files, and what a car touches where it starts: then no trip is valid."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from scp_planner.errors import MISSING, Fault, ScenarioError
from scp_planner.formats.commonroad.cars import Car
from scp_planner.formats.commonroad.goals import ends_of, polygons_of
from scp_planner.formats.commonroad.lines import rectangle
from scp_planner.formats.commonroad.roads import ROADS, Point, road_in


@dataclass(frozen=True)
class RecordedObstacles:
    notable: float = 1e-3  # Widths of the car: what reaches less far over a border at the start may be rounding
    still: float = 0.2  # m of the file. What moves less than this in all of the recording stands


RECORDED = RecordedObstacles()


def obstacles_of(world: Any, step: float, name: str) -> list[dict[str, Any]]:
    """Read all obstacles of a scenario of commonroad-io, but for phantoms of which nothing is predicted."""
    seen = [each for each in world.obstacles if hasattr(each, "initial_state") or _is_somewhere(each)]
    return [obstacle_of(each, step, name) for each in seen]


def _is_somewhere(obstacle: Any) -> bool:
    """True if an obstacle without a state of its own stands, or is predicted."""
    return _ground_of(obstacle) is not None or getattr(obstacle, "prediction", None) is not None


def _ground_of(obstacle: Any) -> Any:
    # Where an obstacle without a state stands, such as a building; commonroad-io of 2024 calls that its shape.
    return getattr(obstacle, "occupancy", None) or getattr(obstacle, "obstacle_shape", None)


def obstacle_of(obstacle: Any, step: float, name: str) -> dict[str, Any]:
    """Read an obstacle."""
    prediction = getattr(obstacle, "prediction", None)
    identity = {"id": str(obstacle.obstacle_id)}
    own = f"obstacle {obstacle.obstacle_id}"
    if prediction is not None and not hasattr(prediction, "trajectory"):
        sets = _sets_of(prediction)
        if not sets:
            text = "its prediction must be a trajectory or sets"
            raise ScenarioError(name, [Fault(own, MISSING, text)])
        return {**identity, **_predicted_by_sets(sets, step)}
    if not hasattr(obstacle, "initial_state"):
        return {**identity, **_predicted_by_sets([(0.0, _ground_of(obstacle))], step)}
    initial = obstacle.initial_state
    states = [initial]
    if prediction is not None:
        states += [state for state in prediction.trajectory.state_list if state.time_step > initial.time_step]
    try:
        places = np.array([state.position for state in states], dtype=float)
    except (TypeError, ValueError):
        raise ScenarioError(name, [Fault(own, MISSING, "its positions must be known exactly")]) from None
    if np.ptp(places, axis=0).max() < RECORDED.still:
        still = {"position": tuple(places[0].tolist())}
        return {**identity, "shape": _shape(obstacle, float(initial.orientation)), "motion": still}
    course = {"time": [step * state.time_step for state in states], "position": places.tolist()}
    headings = [getattr(state, "orientation", None) for state in states]
    if all(heading is not None for heading in headings):
        course["heading"] = np.unwrap(np.array(headings, dtype=float)).tolist()
    return {**identity, "shape": _shape(obstacle, None), "motion": course}


def _sets_of(prediction: Any) -> list[tuple[float, Any]]:
    """Times, in steps, and sets of a prediction; commonroad-io of 2024 has a list of them, later ones a mapping."""
    listed = getattr(prediction, "occupancy_set", None)
    sets = (
        getattr(prediction, "occupancies", {}).items() if listed is None else [(s.time_step, s.shape) for s in listed]
    )
    return sorted(((0.5 * sum(ends_of(time)), shape) for time, shape in sets), key=lambda each: each[0])


def _predicted_by_sets(sets: Sequence[tuple[float, Any]], step: float) -> dict[str, Any]:
    """A course of the middles of sets, and a shape that covers each of them."""
    from shapely import MultiPoint, union_all
    from shapely.affinity import translate

    covers = [union_all(polygons_of(shape)).convex_hull for _, shape in sets]
    middles = [cover.centroid for cover in covers]
    whole = union_all(
        [translate(cover, -middle.x, -middle.y) for cover, middle in zip(covers, middles, strict=True)]
    ).convex_hull
    shape = {"polygon": [list(corner) for corner in MultiPoint(whole.exterior.coords).convex_hull.exterior.coords[:-1]]}
    places = [[middle.x, middle.y] for middle in middles]
    if len(sets) == 1:
        return {"shape": shape, "motion": {"position": places[0]}}
    return {"shape": shape, "motion": {"time": [step * time for time, _ in sets], "position": places}}


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
    from shapely import union_all

    state = obstacle.initial_state
    if hasattr(shape, "compute_occupancy_for_state"):
        placed = shape.compute_occupancy_for_state(state)
    else:  # commonroad-io of 2024
        placed = shape.rotate_translate_local(np.asarray(state.position, dtype=float), float(state.orientation))
    around = union_all(polygons_of(placed)).convex_hull
    vertices = np.array(around.exterior.coords)[:-1] - np.asarray(state.position, dtype=float)
    return {"polygon": vertices.tolist()}


def touched_by(middle: Point, heading: float, car: Car, world: Any, time_step: int) -> str | None:
    """Say what the rectangle of a car touches where it starts."""
    from shapely import Point as PointOf

    body, notable = rectangle(middle, heading, car.length, car.width), RECORDED.notable * car.width
    core = body.buffer(-notable)
    for obstacle in world.obstacles:
        occupancy = obstacle.occupancy_at_time(time_step)
        # In commonroad-io of 2024 an occupancy has a shape; later ones are one.
        shape = getattr(occupancy, "shape", occupancy)
        if shape is not None and any(polygon.intersects(core) for polygon in polygons_of(shape)):
            return f"meets obstacle {obstacle.obstacle_id}"
    if not world.lanelet_network.lanelets:
        return None
    road = road_in(world.lanelet_network, body, ROADS.seen_gap)
    if road.is_empty:
        return "stands beside the road"
    beyond = body.difference(road.buffer(notable))
    parts = [part for part in getattr(beyond, "geoms", [beyond]) if not part.is_empty]
    depth = max((road.distance(PointOf(corner)) for part in parts for corner in part.exterior.coords), default=0.0)
    return f"reaches {depth:.3g} m beyond the border of the road" if parts else None
