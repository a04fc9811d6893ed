"""Taut polylines among convex polygons, against a visibility graph of all corners, by shapely."""

from __future__ import annotations

from itertools import combinations, islice

import numpy as np
import pytest
from scipy.sparse.csgraph import dijkstra
from shapely import LineString, Point, Polygon, unary_union

from scp_planner.mathematics.taut import TautLines

Array = np.ndarray


def box(x: float, y: float, width: float, height: float) -> Array:
    return np.array([x, y]) + 0.5 * np.array([[-width, -height], [width, -height], [width, height], [-width, height]])


def random_polygons(seed: int, count: int) -> list[Array]:
    rng = np.random.default_rng(seed)
    found = []
    for _ in range(count):
        middle, size = rng.uniform([2.0, -6.0], [18.0, 6.0]), rng.uniform(0.4, 2.5)
        angles = np.sort(rng.uniform(0.0, 2.0 * np.pi, 7))
        if np.diff(np.append(angles, angles[0] + 2.0 * np.pi)).max() < np.pi:
            found.append(middle + size * np.stack([np.cos(angles), np.sin(angles)], axis=1))
    return found


def shortest(polygons: list[Array], start: Array, goal: Array) -> float:
    """Length of the shortest way by Dijkstra over all pairs of corners that see each other."""
    ground = unary_union([Polygon(one) for one in polygons]).buffer(-1e-9)
    corners = np.concatenate([start[None], goal[None], *polygons])
    costs = np.zeros((len(corners), len(corners)))
    for i, j in combinations(range(len(corners)), 2):
        if not LineString(corners[[i, j]]).intersects(ground):
            costs[i, j] = costs[j, i] = np.hypot(*(corners[j] - corners[i]))
    return float(dijkstra(costs, indices=0)[1])


@pytest.mark.parametrize("seed", range(25))
def test_the_first_is_the_shortest_way(seed: int) -> None:
    polygons, start, goal = random_polygons(seed, 12), np.zeros(2), np.array([20.0, 0.3])
    if any(Polygon(one).intersects(Point(end)) for one in polygons for end in (start, goal)):
        polygons = [one for one in polygons if Polygon(one).distance(Point(start)) * Polygon(one).distance(Point(goal))]
    line = next(iter(TautLines(polygons, start, goal)))
    assert line.length == pytest.approx(shortest(polygons, start, goal), abs=1e-5)
    assert line.length == pytest.approx(float(np.hypot(*np.diff(line.points, axis=0).T).sum()), abs=1e-7)
    assert line.points[[0, -1]] == pytest.approx(np.stack([start, goal]))


def test_there_is_one_for_each_side_of_each_polygon_in_the_order_of_their_lengths() -> None:
    """Past n boxes in a row there are 2 ** n: each is passed above or below."""
    row = [box(x, y, 1.0, 2.0) for x, y in ((4.0, 0.1), (9.0, -0.2), (15.0, 0.3))]
    start, goal = np.zeros(2), np.array([20.0, 0.0])
    lines = list(islice(iter(TautLines(row, start, goal)), 8))
    lengths = [line.length for line in lines]
    assert lengths == sorted(lengths)
    sides = {
        tuple(float(np.interp(one[0, 0] + 0.5, *line.points.T)) > 0.5 * one[:, 1].sum() / 2 for one in row)
        for line in lines
    }
    assert len(sides) == len(lines) == 8
    forced = [shortest([*row, *walls], start, goal) for walls in _forcing(row)]
    assert lengths == pytest.approx(sorted(forced), abs=1e-5)


def _forcing(row: list[Array]) -> list[list[Array]]:
    """Walls that leave one way past each box open, for all choices of sides."""
    found = []
    for choice in range(2 ** len(row)):
        walls = []
        for k, one in enumerate(row):
            x, y = one.mean(axis=0)
            above = bool(choice >> k & 1)
            walls.append(box(x, y - 50.0 if above else y + 50.0, 0.5, 100.0))
        found.append(walls)
    return found


def test_there_is_none_out_of_a_ring() -> None:
    ring = [box(0.0, 3.0, 7.0, 1.0), box(0.0, -3.0, 7.0, 1.0), box(3.0, 0.0, 1.0, 7.0), box(-3.0, 0.0, 1.0, 7.0)]
    assert list(TautLines(ring, np.zeros(2), np.array([20.0, 0.0]))) == []
    gap = [*ring[:2], box(3.0, 0.0, 1.0, 4.5), ring[3]]
    assert len(list(islice(iter(TautLines(gap, np.zeros(2), np.array([20.0, 0.0]))), 2))) == 2


def test_half_planes_keep_them_inside() -> None:
    wall, inside = box(10.0, 0.0, 1.0, 8.0), [(np.array([0.0, 1.0]), 5.0), (np.array([0.0, -1.0]), 3.0)]
    lines = list(TautLines([wall], np.zeros(2), np.array([20.0, 0.0]), inside))
    assert [bool(line.points[:, 1].max() > 3.9) for line in lines] == [True]
