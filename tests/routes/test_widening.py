"""Bends of routes that are widened, against shapely and the curvature of the circle through three points."""

from __future__ import annotations

import numpy as np
import pytest
from shapely import LineString, MultiPolygon, Polygon

from scp_planner.mathematics.taut import ConvexPolygons, TautLines
from scp_planner.routes.widening import widened
from scp_planner.scenario.limits import Box

RADIUS = 0.5
OPEN = Box(np.zeros((0, 2)), np.zeros(0))


def wall(left: float, low: float, right: float, high: float) -> np.ndarray:
    return np.array([[left, low], [right, low], [right, high], [left, high]])


def comb(wide: float, thick: float = 0.6) -> list[np.ndarray]:
    """Walls from below and above in turn, inflated by a vehicle, and passages of a width for its centre."""
    walls, x = [wall(-1.0, -0.1, 14.0, 0.0), wall(-1.0, 4.0, 14.0, 4.1)], 1.0
    for k in range(4):
        walls.append(wall(x, 0.0, x + thick, 4.0 - wide) if k % 2 else wall(x, wide, x + thick, 4.0))
        x += thick + wide
    return walls


def tightest(points: np.ndarray) -> float:
    a, b, c = points[:-2], points[1:-1], points[2:]
    area = (b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]
    sides = [np.hypot(*(one - other).T) for one, other in ((a, b), (b, c), (a, c))]
    return float((2.0 * np.abs(area) / (sides[0] * sides[1] * sides[2])).max())


@pytest.mark.parametrize("wide", [0.5, 0.8, 1.2])
def test_bends_are_as_wide_as_the_vehicle_needs_and_keep_out_of_walls(wide: float) -> None:
    walls = comb(wide)
    start, goal = np.array([0.0, 2.0]), np.array([9.0, 2.0])
    line = next(iter(TautLines(walls, start, goal)))
    found = widened(line.points, ConvexPolygons(walls), OPEN, RADIUS, (1, 1))
    assert np.array_equal(found[[0, -1]], [start, goal])
    assert tightest(found) < 1.0 / RADIUS
    ground = MultiPolygon([Polygon(one) for one in walls])
    inside = LineString(found).intersection(ground.buffer(-0.1 * RADIUS))
    assert inside.is_empty


def test_a_straight_route_stays_and_a_bound_is_kept() -> None:
    line = np.array([[0.0, 0.0], [6.0, 0.0]])
    bent = np.array([[0.0, 0.0], [3.0, 1.0], [6.0, 0.0]])
    nothing = ConvexPolygons([])
    assert np.allclose(widened(line, nothing, OPEN, RADIUS, (1, 1))[:, 1], 0.0)
    below = Box(np.array([[0.0, -1.0]]), np.array([-0.2]))  # y >= 0.2 where there is room
    assert widened(bent, nothing, below, RADIUS, (1, 1))[5:-5, 1].min() > 0.1


def test_a_route_that_leaves_the_bounds_comes_back_no_faster_than_it_may_move() -> None:
    """It ends beyond a border that its end runs along, but for a millionth: there the border is far away sideways."""
    line = np.array([[0.0, 0.0], [3.0, 0.0], [3.0 + 1e-6, 6.0]])
    right = Box(np.array([[1.0, 0.0], [0.0, 1.0]]), np.array([2.0, 2.0]))
    found = widened(line, ConvexPolygons([]), right, RADIUS, (1, 1))
    assert np.abs(found).max() < 6.0 + 12 * 1.25 * RADIUS


def test_a_route_shorter_than_its_ends_stays() -> None:
    line = np.array([[0.0, 0.0], [0.2, 0.0]])
    assert widened(line, ConvexPolygons([]), OPEN, RADIUS, (2, 2)) is line


def test_a_route_that_cuts_through_a_wall_where_there_is_no_room_stays_finite() -> None:
    walls = [wall(1.0, -4.0, 1.6, 4.0), wall(-3.0, -4.6, 1.0, -4.0), wall(-3.0, 4.0, 1.0, 4.6)]
    line = np.array([[0.3204, 0.6828], [1.182, -0.3091], [1.4538, 3.5713], [1.0297, 4.4912], [8.0, 0.0]])
    found = widened(line, ConvexPolygons(walls), OPEN, 0.73, (2, 1))
    assert np.isfinite(found).all() and np.array_equal(found[[0, -1]], line[[0, -1]])
