"""Goals that are regions: their convex parts, and where to aim at in one."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from scp_planner.mathematics import planar
from scp_planner.scenario.targets import about_where


def aim_at(region: Sequence[planar.Point], point: planar.Point) -> planar.Point:
    """Return a point just inside a region, where it is nearest to a point."""
    part = min(convex_parts(region), key=lambda one: planar.distance_to_polygon(point, one))
    nearest = min((_nearest_on(point, a, b) for a, b in planar.edges(part)), key=lambda spot: math.dist(point, spot))
    middle = planar.centroid(part)
    return (nearest[0] + 1e-3 * (middle[0] - nearest[0]), nearest[1] + 1e-3 * (middle[1] - nearest[1]))


def with_aim(data: Any) -> Any:
    """Return the data of a scenario with the positions that its goals are aimed at: by its region, or by a target."""
    if not isinstance(data, Mapping):
        return data
    goal, start, places = (data.get(key) for key in ("goal", "start", "goals"))
    if isinstance(places, Sequence) and not isinstance(places, str):
        aimed = [_by_target(one, data) for one in places]
        if any(one is not given for one, given in zip(aimed, places, strict=True)):
            data = {**data, "goals": aimed}
    if not isinstance(goal, Mapping) or goal.get("position") is not None:
        return data
    if goal.get("target") is not None:
        return {**data, "goal": _by_target(goal, data)}
    if goal.get("region") is None:
        return data
    begin = start.get("position") if isinstance(start, Mapping) else getattr(start, "position", None)
    try:
        x, y = (float(value) for value in begin)  # type: ignore[union-attr]
        region = tuple((float(x), float(y)) for x, y in goal["region"])
    except (TypeError, ValueError):
        return data
    if len(region) < 3 or planar.area(region) == 0.0 or planar.first_crossing(region) is not None:
        return data
    return {**data, "goal": {**goal, "position": aim_at(region, (x, y))}}


def _by_target(goal: Any, data: Mapping[str, Any]) -> Any:
    """A goal, or a place to pass, with the position of its target about where that can be met."""
    if not isinstance(goal, Mapping) or goal.get("position") is not None or goal.get("target") is None:
        return goal
    vehicle = data.get("vehicle")
    speed = vehicle.get("max_speed") if isinstance(vehicle, Mapping) else getattr(vehicle, "max_speed", None)
    place = about_where(goal["target"], data.get("obstacles"), data.get("start"), speed)
    return goal if place is None else {**goal, "position": place}


def distance_outside(region: Sequence[planar.Point], point: planar.Point) -> float:
    """Return how far a point is outside a region, m; 0 in it."""
    return planar.distance_to_polygon(point, region)


def convex_parts(region: Sequence[planar.Point]) -> list[tuple[planar.Point, ...]]:
    """Cut a region into convex parts."""
    from scp_planner.mathematics.convex_pieces import convex_pieces

    rings = [piece.vertices for piece in convex_pieces(tuple((float(x), float(y)) for x, y in region))]
    return [tuple((float(x), float(y)) for x, y in ring) for ring in rings if ring is not None]


def _nearest_on(point: planar.Point, a: planar.Point, b: planar.Point) -> planar.Point:
    """The nearest point of a segment."""
    leg = (b[0] - a[0], b[1] - a[1])
    share = ((point[0] - a[0]) * leg[0] + (point[1] - a[1]) * leg[1]) / (leg[0] * leg[0] + leg[1] * leg[1])
    share = min(max(share, 0.0), 1.0)
    return (a[0] + share * leg[0], a[1] + share * leg[1])
