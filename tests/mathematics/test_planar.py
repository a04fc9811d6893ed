"""Plane geometry in plain Python against shapely."""

from __future__ import annotations

import math

import numpy as np
import pytest
import shapely

from scp_planner.mathematics import planar

SEEDS = range(12)


def star(seed: int) -> list[planar.Point]:
    """A simple polygon round some point far from the origin, with corners that point inwards."""
    rng = np.random.default_rng(seed)
    angle = np.sort(rng.uniform(0.0, 2.0 * np.pi, 9))
    reach = rng.uniform(0.5, 3.0, 9)
    return [(100.0 + r * math.cos(a), 50.0 + r * math.sin(a)) for r, a in zip(reach, angle, strict=True)]


def hull(seed: int) -> list[planar.Point]:
    return [(x, y) for x, y in shapely.MultiPoint(star(seed)).convex_hull.exterior.coords[:-1]]


@pytest.mark.parametrize("seed", SEEDS)
def test_areas_centres_and_distances(seed: int) -> None:
    polygon = star(seed)
    drawn = shapely.Polygon(polygon)
    assert abs(planar.area(polygon)) == pytest.approx(drawn.area, rel=1e-12)
    assert planar.area(planar.anticlockwise(polygon[::-1])) > 0.0
    assert planar.centroid(polygon) == pytest.approx((drawn.centroid.x, drawn.centroid.y), rel=1e-12)
    for x, y in np.random.default_rng(seed).uniform([95.0, 45.0], [105.0, 55.0], (40, 2)).tolist():
        assert planar.distance_to_polygon((x, y), polygon) == pytest.approx(drawn.distance(shapely.Point(x, y)))
        along = shapely.LineString(polygon).project(shapely.Point(x, y))
        assert planar.station((x, y), polygon) == pytest.approx(along, abs=1e-9)


@pytest.mark.parametrize("seed", SEEDS)
def test_what_is_simple_what_is_convex_and_what_overlaps(seed: int) -> None:
    polygon, convex = star(seed), hull(seed)
    shuffled = [polygon[k] for k in np.random.default_rng(seed).permutation(9)]
    for one in (polygon, shuffled):
        assert (planar.first_crossing(one) is None) == shapely.Polygon(one).is_valid
    assert planar.is_convex(convex)
    assert planar.is_convex(polygon) == (len(convex) == len(polygon))
    for shift in (0.5, 2.0, 3.5, 5.0, 8.0):
        moved = [(x + shift, y + 0.3 * shift) for x, y in hull(seed + 1)]
        common = shapely.Polygon(convex).intersection(shapely.Polygon(moved)).area
        assert planar.overlap(convex, moved) == (common > 1e-12)


def test_distances_to_an_ellipse() -> None:
    angle = np.linspace(0.0, 2.0 * np.pi, 40_001)
    border = np.stack([2.0 * np.cos(angle), 0.4 * np.sin(angle)], axis=1)
    for point in np.random.default_rng(0).uniform(-4.0, 4.0, (40, 2)):
        x, y = point.tolist()
        inside = (x / 2.0) ** 2 + (y / 0.4) ** 2 <= 1.0
        expected = 0.0 if inside else np.hypot(*(border - point).T).min()
        assert planar.distance_to_ellipse((x, y), 2.0, 0.4) == pytest.approx(expected, abs=1e-6)


def test_turns_are_anticlockwise() -> None:
    assert planar.turned((2.0, 0.0), math.pi / 2) == pytest.approx((0.0, 2.0), abs=1e-15)
