"""Polygons that stand, by the lines of their edges, against shapely."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest
from shapely import Polygon, distance, points
from shapely.geometry import MultiPoint

from scp_planner.mathematics.outlines import Outline, Outlines
from scp_planner.threat_zones.ground import Ground

if TYPE_CHECKING:
    from scp_planner.arrays import Array

pytestmark = pytest.mark.numerics


def some_polygons(rng: np.random.Generator, count: int) -> list[Polygon]:
    hulls = (MultiPoint(rng.normal(size=(rng.integers(3, 12), 2))).convex_hull for _ in range(count))
    return [Polygon(np.array(hull.exterior.coords)[:-1] + rng.uniform(-3.0, 3.0, 2)) for hull in hulls]


def ground_of(polygons: list[Polygon]) -> Ground:
    """The ground of polygons, each about a corner of its own."""
    corners = [np.array(polygon.exterior.coords)[:-1] for polygon in polygons]
    outlines = Outlines([Outline.polygon(one - one[0]) for one in corners])
    every = np.arange(len(polygons))
    return Ground.of(every, outlines, every, np.array([one[0] for one in corners]))


def signed(polygons: list[Polygon], places: Array) -> Array:
    """Distances of all places to all polygons, negative inside, (n, s)."""
    cloud = points(places)
    inside = np.stack([polygon.contains(cloud) for polygon in polygons], axis=1)
    to_border = np.stack([distance(polygon.exterior, cloud) for polygon in polygons], axis=1)
    return np.where(inside, -to_border, to_border)


def test_distances_are_what_shapely_says() -> None:
    rng = np.random.default_rng(3)
    polygons, places = some_polygons(rng, 9), rng.uniform(-6.0, 6.0, (700, 2))
    ground = ground_of(polygons)
    expected = signed(polygons, places)[:, ground.zones]
    np.testing.assert_allclose(ground.distances(places), expected, atol=1e-9)
    assert 0.01 < (expected < 0.0).mean() < 0.9


def test_least_heights_bound_the_distances_of_all_that_moves_so_far() -> None:
    rng = np.random.default_rng(4)
    polygons, places = some_polygons(rng, 6), rng.uniform(-5.0, 5.0, (80, 2))
    moves = rng.normal(size=places.shape) * 0.4
    ground = ground_of(polygons)
    least = ground.least_heights(places, moves)
    shares = np.linspace(-1.0, 1.0, 21)[:, None, None]
    along = [signed(polygons, there)[:, ground.zones] for there in places + shares * moves]
    assert np.all(least <= np.min(along, axis=0) + 1e-9)
    inside = signed(polygons, places)[:, ground.zones] < 0.0
    still = ground.least_heights(places, 0.0 * moves)
    np.testing.assert_allclose(still[inside], ground.distances(places)[inside], atol=1e-12)
