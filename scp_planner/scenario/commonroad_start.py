"""Whether a car of the benchmark stands where it may: if its own rectangle touches something, no trip is valid."""

from __future__ import annotations

from typing import Any

from scp_planner.scenario.commonroad_goals import polygons_of
from scp_planner.scenario.commonroad_lines import Point, rectangle
from scp_planner.scenario.commonroad_models import Car
from scp_planner.scenario.commonroad_roads import SEEN_GAP, road_in

NOTABLE = 1e-3
"""Widths of the car: what reaches less far over a border may be rounding."""


def touched_by(middle: Point, heading: float, car: Car, world: Any, time_step: int) -> str | None:
    """Say what the rectangle of a car touches where it starts.

    Parameters
    ----------
    middle : (float, float)
        Of the car, m.
    heading : float
        rad.
    car : Car
    world : commonroad.scenario.scenario.Scenario
    time_step : int
        Of the start.

    Returns
    -------
    str or None
        None if it touches nothing, as far as that is certain.
    """
    from shapely import Point as PointOf

    body, notable = rectangle(middle, heading, car.length, car.width), NOTABLE * car.width
    core = body.buffer(-notable)
    for obstacle in world.obstacles:
        occupancy = obstacle.occupancy_at_time(time_step)
        # In commonroad-io of 2024 an occupancy has a shape; later ones are one.
        shape = getattr(occupancy, "shape", occupancy)
        if shape is not None and any(polygon.intersects(core) for polygon in polygons_of(shape)):
            return f"meets obstacle {obstacle.obstacle_id}"
    if not world.lanelet_network.lanelets:
        return None
    road = road_in(world.lanelet_network, body, SEEN_GAP)
    if road.is_empty:
        return "stands beside the road"
    beyond = body.difference(road.buffer(notable))
    parts = [part for part in getattr(beyond, "geoms", [beyond]) if not part.is_empty]
    depth = max((road.distance(PointOf(corner)) for part in parts for corner in part.exterior.coords), default=0.0)
    return f"reaches {depth:.3g} m beyond the border of the road" if parts else None
