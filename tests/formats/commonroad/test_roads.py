"""Walls beside roads, against shapely: they cover the border, leave the road free, and are few."""

from __future__ import annotations

import math

import numpy as np
import pytest

pytest.importorskip("shapely", reason="comes with commonroad-io, which is not installed")

from shapely import LineString, Polygon, box, union_all

from scp_planner.formats.commonroad.roads import walls_around
from scp_planner.mathematics import planar

WIDTH = 1.8
TURN = np.linspace(0.0, 1.2 * math.pi, 40)
BEND = np.concatenate([[[-20.0, 0.0]], 15.0 * np.stack([np.sin(TURN), 1.0 - np.cos(TURN)], axis=1)])
ROADS = {
    "bend": LineString(BEND).buffer(4.0, cap_style="flat"),
    "crossing": union_all([box(-30.0, -4.0, 30.0, 4.0), box(-4.0, -30.0, 4.0, 30.0)]),
    "island": box(-25.0, -12.0, 25.0, 12.0) - LineString([(-5.0, 0.0), (5.0, 0.0)]).buffer(3.0),
}


@pytest.mark.parametrize("name", ROADS)
def test_walls_cover_the_border_and_leave_the_road_free(name: str) -> None:
    road = ROADS[name]
    start = box(-18.0, -1.0, -14.0, 1.0)
    walls = walls_around(road, start, WIDTH)
    assert all(planar.is_convex(wall) for wall in walls)
    covered = union_all([Polygon(wall) for wall in walls])
    assert road.boundary.difference(covered.buffer(1e-9)).length < 1e-6
    assert road.intersection(covered).area < 1e-4 * road.area
    # It is not crossed behind them either: a vehicle is as long as they are thick, but where they meet.
    beside = road.buffer(0.5 * WIDTH, join_style="mitre") - road
    assert beside.difference(covered).area < 0.1 * beside.area


def test_where_the_border_turns_away_one_wall_serves() -> None:
    corners = np.array(ROADS["bend"].exterior.coords)
    legs = np.diff(corners, axis=0)
    after = np.roll(legs, -1, axis=0)
    away = legs[:, 0] * after[:, 1] < legs[:, 1] * after[:, 0]  # shapely's rings run clockwise or not
    turns = [int(np.count_nonzero(each)) for each in (away, ~away)]
    walls = walls_around(ROADS["bend"], box(-18.0, -1.0, -14.0, 1.0), WIDTH)
    # Round the outside each edge has its own; to the inside one serves for a right angle.
    assert len(walls) <= max(turns) + 4
    assert min(turns) > 30
    assert max(len(wall) for wall in walls) > 10
