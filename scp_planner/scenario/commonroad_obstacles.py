"""Obstacles of CommonRoad files."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from scp_planner.errors import MISSING, Fault, ScenarioError
from scp_planner.scenario.commonroad_goals import polygons_of

STILL = 0.2
"""m of the file. What moves less than this in all of the recording stands."""


def obstacles_of(world: Any, step: float, name: str) -> list[dict[str, Any]]:
    """Read all obstacles of a scenario of commonroad-io, but for phantoms of which nothing is foretold.

    Parameters
    ----------
    world : commonroad.scenario.scenario.Scenario
    step : float
        s.
    name : str
        Of the file, for messages.

    Returns
    -------
    list of dict
        Fields of `scp_planner.Obstacle`.

    Raises
    ------
    ScenarioError
        As `obstacle_of`.
    """
    seen = [each for each in world.obstacles if hasattr(each, "initial_state") or _is_somewhere(each)]
    return [obstacle_of(each, step, name) for each in seen]


def _is_somewhere(obstacle: Any) -> bool:
    """Whether an obstacle without a state of its own stands, or is foretold."""
    return _ground_of(obstacle) is not None or getattr(obstacle, "prediction", None) is not None


def _ground_of(obstacle: Any) -> Any:
    """Where an obstacle without a state stands, such as a building; commonroad-io of 2024 calls that its shape."""
    return getattr(obstacle, "occupancy", None) or getattr(obstacle, "obstacle_shape", None)


def obstacle_of(obstacle: Any, step: float, name: str) -> dict[str, Any]:
    """Read an obstacle.

    Parameters
    ----------
    obstacle
        Of commonroad-io.
    step : float
        s.
    name : str
        Of the file, for messages.

    Returns
    -------
    dict
        Fields of `scp_planner.Obstacle`.

    Raises
    ------
    ScenarioError
        If its places are not known exactly, or it is foretold by something else than a trajectory or sets.
    """
    prediction = getattr(obstacle, "prediction", None)
    identity = {"id": str(obstacle.obstacle_id)}
    own = f"obstacle {obstacle.obstacle_id}"
    if prediction is not None and not hasattr(prediction, "trajectory"):
        sets = _sets_of(prediction)
        if not sets:
            text = "its prediction must be a trajectory or sets"
            raise ScenarioError(name, [Fault(own, MISSING, text)])
        return {**identity, **_foretold_by_sets(sets, step)}
    if not hasattr(obstacle, "initial_state"):
        return {**identity, **_foretold_by_sets([_Set(0, _ground_of(obstacle))], step)}
    initial = obstacle.initial_state
    states = [initial]
    if prediction is not None:
        states += [state for state in prediction.trajectory.state_list if state.time_step > initial.time_step]
    try:
        places = np.array([state.position for state in states], dtype=float)
    except (TypeError, ValueError):
        raise ScenarioError(name, [Fault(own, MISSING, "its positions must be known exactly")]) from None
    if np.ptp(places, axis=0).max() < STILL:
        still = {"position": tuple(places[0].tolist())}
        return {**identity, "shape": _shape(obstacle, float(initial.orientation)), "motion": still}
    course = {"time": [step * state.time_step for state in states], "position": places.tolist()}
    headings = [getattr(state, "orientation", None) for state in states]
    if all(heading is not None for heading in headings):
        course["heading"] = np.unwrap(np.array(headings, dtype=float)).tolist()
    return {**identity, "shape": _shape(obstacle, None), "motion": course}


@dataclass(frozen=True)
class _Set:
    """Where an obstacle may be at a step of time, or in an interval of steps."""

    time_step: Any
    shape: Any


def _sets_of(prediction: Any) -> list[_Set]:
    """Sets of a prediction, in the order of time; commonroad-io of 2024 has a list of them, later ones a mapping."""
    listed = getattr(prediction, "occupancy_set", None)
    if listed is not None:
        sets = [_Set(each.time_step, each.shape) for each in listed]
    else:
        sets = [_Set(time, shape) for time, shape in getattr(prediction, "occupancies", {}).items()]
    return sorted(sets, key=lambda each: _middle_step(each.time_step))


def _foretold_by_sets(sets: Sequence[_Set], step: float) -> dict[str, Any]:
    """A course of the middles of sets, and a shape that covers each of them."""
    from shapely import MultiPoint, union_all
    from shapely.affinity import translate

    covers = [union_all(polygons_of(each.shape)).convex_hull for each in sets]
    middles = [cover.centroid for cover in covers]
    whole = union_all(
        [translate(cover, -middle.x, -middle.y) for cover, middle in zip(covers, middles, strict=True)]
    ).convex_hull
    shape = {"polygon": [list(corner) for corner in MultiPoint(whole.exterior.coords).convex_hull.exterior.coords[:-1]]}
    times = [step * _middle_step(each.time_step) for each in sets]
    places = [[middle.x, middle.y] for middle in middles]
    if len(times) == 1:
        return {"shape": shape, "motion": {"position": places[0]}}
    return {"shape": shape, "motion": {"time": times, "position": places}}


def _middle_step(value: Any) -> float:
    return 0.5 * (float(getattr(value, "start", value)) + float(getattr(value, "end", value)))


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
