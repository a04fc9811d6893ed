"""Goals of CommonRoad: what of a goal state becomes what of a scenario's goal."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

from scp_planner.errors import MISSING, Fault, ScenarioError


@dataclass(frozen=True)
class GoalAim:
    state: int = 0
    timed_way: float = 1.0
    depth: float = 0.0
    turn: float = 0.9  # With which headings the guide may end there


@dataclass(frozen=True)
class GoalState:
    """One of the states that end a problem."""

    places: tuple[Any, ...]  # shapely polygons, m; none where the goal is of time alone
    earliest: float | None  # absolute, s; None before the start
    latest: float | None  # absolute, s; None before the start
    speed: tuple[float, float] | None  # least and largest, m/s
    heading: tuple[float, float] | None  # least and largest, rad

    def fields(self) -> dict[str, Any]:
        """Fields of a scenario's goal, but for where it is."""
        times = {"earliest_arrival": self.earliest, "latest_arrival": self.latest}
        return {**times, "speed_range": self.speed, "heading_range": self.heading}


def goal_states(problem: Any, step: float, name: str) -> dict[int, GoalState]:
    """Read the goal states of a planning problem that may be reached, by their numbers; ScenarioError without any."""
    states = problem.goal.state_list
    if not states:
        number = problem.planning_problem_id
        raise ScenarioError(name, [Fault("goalState", MISSING, f"problem {number} has no goal: nothing to plan")])
    begin, faults, found = float(problem.initial_state.time_step), list[Fault](), dict[int, GoalState]()
    for number, state in enumerate(states):
        last, speed = ends_of(state.time_step)[1], getattr(state, "velocity", None)
        if last <= begin:
            faults.append(Fault(f"goalState[{number}].time", last, f"must end after the start, at step {begin:g}"))
        elif speed is not None and ends_of(speed)[1] < 0.0:
            faults.append(Fault(f"goalState[{number}].velocity", ends_of(speed)[1], "must not be backwards"))
        else:
            found[number] = _goal_state(state, step * begin, step)
    if not found:
        raise ScenarioError(name, faults)
    return found


def ahead_of(state: GoalState, start: tuple[float, float], heading: float, gap: float) -> GoalState:
    """Return a goal state without what of its places is behind a place that they hold: there is nothing to drive."""
    from shapely import Point, Polygon

    left: list[Any] = []
    for place in state.places:
        if not place.contains(Point(start)):
            left.append(place)
            continue
        low_x, low_y, high_x, high_y = place.bounds
        reach = gap + math.hypot(high_x - low_x, high_y - low_y)
        c, s = math.cos(heading), math.sin(heading)
        corners = [(gap, -reach), (reach, -reach), (reach, reach), (gap, reach)]
        ahead = place.intersection(Polygon([(start[0] + c * x - s * y, start[1] + s * x + c * y) for x, y in corners]))
        left += [part for part in getattr(ahead, "geoms", [ahead]) if part.area > 0.0]
    return replace(state, places=tuple(left)) if left else state


def _goal_state(state: Any, begin: float, step: float) -> GoalState:
    first, last = ends_of(state.time_step)
    speed, heading = (getattr(state, key, None) for key in ("velocity", "orientation"))
    place = getattr(state, "position", None)
    low, high = (0.0, 0.0) if speed is None else ends_of(speed)
    return GoalState(
        places=() if place is None else tuple(polygons_of(place)),
        earliest=step * first if step * first > begin else None,
        latest=step * last if step * last > begin else None,
        speed=None if speed is None else (max(low, 0.0), max(high, 0.0)),
        heading=None if heading is None else ends_of(heading),
    )


def ends_of(value: Any) -> tuple[float, float]:
    """Give the ends of an interval, or of a value as of one."""
    return float(getattr(value, "start", value)), float(getattr(value, "end", value))


def polygons_of(shape: Any) -> list[Any]:
    """Give a shape of commonroad-io, in any version, as polygons of shapely."""
    for group in ("shapes", "occupancies"):
        parts: Sequence[Any] | None = getattr(shape, group, None)
        if parts is not None:
            return [polygon for part in parts for polygon in polygons_of(part)]
    radius = getattr(shape, "radius", None)
    if radius is not None:
        from shapely import Point

        return [Point(shape.center).buffer(float(radius), quad_segs=16)]
    from shapely import set_precision

    # Files repeat corners, to all digits or nearly so, and outlines of lanes cross themselves.
    tidy = set_precision(shape.shapely_object.buffer(0.0), 1e-6)
    return [part for part in getattr(tidy, "geoms", [tidy]) if part.area > 0.0]


def seen_heading(heading: tuple[float, float], near: float) -> tuple[float, float] | None:
    """Return the headings of a point mass that the official checker takes for ones of a range."""
    low, high = (math.tan(max(min(end, 0.25 * math.pi), -0.25 * math.pi)) for end in _about_zero(heading))
    if low >= high:
        return None
    first, last = math.asin(max(low, -1.0)), math.asin(min(high, 1.0))
    ranges = [(first, last), (math.pi - last, math.pi - first)]
    return min(ranges, key=lambda one: abs(math.remainder(0.5 * (one[0] + one[1]) - near, 2.0 * math.pi)))


def _about_zero(heading: tuple[float, float]) -> tuple[float, float]:
    """A range of headings moved by full turns, so that its middle is in [-pi, pi]."""
    middle, half = 0.5 * (heading[0] + heading[1]), 0.5 * (heading[1] - heading[0])
    middle = math.remainder(middle, 2.0 * math.pi)
    return middle - half, middle + half
