"""Outlines against shapely, and against a dense search over directions."""

from __future__ import annotations

import math

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st
from shapely import Polygon, distance, points
from shapely.geometry import MultiPoint
from shapely.ops import unary_union

from scp_planner.arrays import cross
from scp_planner.mathematics import planar
from scp_planner.mathematics.convex_pieces import convex_pieces
from scp_planner.mathematics.ellipse import ellipse_contact, far_ellipse_contact, support
from scp_planner.mathematics.outlines import Outline, Outlines

pytestmark = pytest.mark.numerics

Array = np.ndarray
ANGLES = np.linspace(0.0, 2.0 * np.pi, 7201)[:-1]
DIRECTIONS = np.stack([np.cos(ANGLES), np.sin(ANGLES)], axis=1)


def random_polygon(rng: np.random.Generator, corners: int) -> Array:
    """A convex polygon, its vertices in random direction."""
    while True:
        cloud = rng.normal(size=(corners + 2, 2)) * rng.uniform(0.2, 3.0, 2) + rng.normal(size=2) * 0.3
        hull = MultiPoint(cloud).convex_hull
        vertices = np.array(hull.exterior.coords)[:-1]
        if hull.area > 0.05:
            return vertices[:: rng.choice([-1, 1])]


def random_matrices(rng: np.random.Generator, count: int) -> Array:
    root = rng.normal(size=(count, 2, 2)) * rng.choice([0.05, 0.4, 1.5], (count, 1, 1))
    full = root @ root.transpose(0, 2, 1) + 1e-5 * np.eye(2)
    return full[:, [0, 0, 1], [0, 1, 1]]


def separation(outline: Outline, covariance: Array | None, point: Array, directions: Array = DIRECTIONS) -> Array:
    value = directions @ point - outline.support(directions)
    return value if covariance is None else value - support(covariance, directions)


def densest(outline: Outline, covariance: Array | None, point: Array) -> float:
    """Largest separation over directions, refined about the best and among the edge normals."""
    rough = separation(outline, covariance, point)
    around = ANGLES[np.argsort(rough)[-3:]][:, None] + np.linspace(-1e-3, 1e-3, 4001)
    fine = np.stack([np.cos(around.ravel()), np.sin(around.ravel())], axis=1)
    best = max(rough.max(), separation(outline, covariance, point, fine).max())
    if outline.vertices is not None:
        edge = np.roll(outline.vertices, -1, axis=0) - outline.vertices
        normal = np.stack([edge[:, 1], -edge[:, 0]], axis=1) / np.hypot(*edge.T)[:, None]
        best = max(best, separation(outline, covariance, point, normal).max())
    return float(best)


def signed(polygon: Polygon, place: Array) -> Array:
    at = points(place)
    inside = np.array([polygon.contains(p) for p in at])
    return np.where(inside, -distance(polygon.exterior, at), distance(polygon, at))


def test_distances_to_10000_points_agree_with_shapely() -> None:
    rng = np.random.default_rng(0)
    polygons = [random_polygon(rng, int(rng.integers(1, 30))) for _ in range(100)]
    outlines = Outlines([Outline.polygon(vertices) for vertices in polygons])
    index = np.repeat(np.arange(100), 100)
    place = rng.normal(size=(10_000, 2)) * rng.choice([0.1, 1.0, 5.0], (10_000, 1))
    contact = outlines.contacts(index, place)
    expected = np.concatenate(
        [signed(Polygon(vertices), place[100 * k : 100 * k + 100]) for k, vertices in enumerate(polygons)]
    )
    np.testing.assert_allclose(contact.distance, expected, atol=1e-12)
    np.testing.assert_allclose(np.hypot(*contact.normal.T), 1.0, atol=1e-12)
    separations = np.einsum("ij,ij->i", place, contact.normal) - outlines.support(index, contact.normal)
    np.testing.assert_allclose(separations, expected, atol=1e-12)


@pytest.mark.parametrize("kind", ["polygon", "ellipse"])
def test_distances_to_sums_with_an_ellipse_are_the_largest_separation(kind: str) -> None:
    rng = np.random.default_rng(1)
    count = 400
    covariances = random_matrices(rng, count)
    if kind == "polygon":
        shapes = [Outline.polygon(random_polygon(rng, int(rng.integers(1, 9)))) for _ in range(count)]
    else:
        shapes = [Outline(matrix=matrix) for matrix in random_matrices(rng, count)]
    place = rng.normal(size=(count, 2)) * rng.choice([0.02, 0.5, 1.5, 6.0], (count, 1))
    contact = Outlines(shapes).contacts(np.arange(count), place, covariances)
    expected = [densest(*case) for case in zip(shapes, covariances, place, strict=True)]
    np.testing.assert_allclose(contact.distance, expected, atol=1e-7)
    assert np.sum(np.array(expected) < 0.0) > 50
    for shape, covariance, point, normal, value in zip(
        shapes, covariances, place, contact.normal, contact.distance, strict=True
    ):
        assert separation(shape, covariance, point, normal[None])[0] == pytest.approx(value, abs=1e-12)


def test_a_sum_with_a_tiny_ellipse_is_the_polygon() -> None:
    rng = np.random.default_rng(2)
    outlines = Outlines([Outline.polygon(random_polygon(rng, 8)) for _ in range(20)])
    index = rng.integers(0, 20, 2000)
    place = rng.normal(size=(2000, 2)) * 3.0
    alone = outlines.contacts(index, place).distance
    summed = outlines.contacts(index, place, np.tile([1e-16, 0.0, 1e-16], (2000, 1))).distance
    np.testing.assert_allclose(summed, alone, atol=2e-8)


def test_the_far_side_of_an_ellipse_is_the_other_local_maximum() -> None:
    rng = np.random.default_rng(4)
    matrices, place = random_matrices(rng, 300), rng.normal(size=(300, 2)) * 0.4
    near, far = ellipse_contact(place, matrices), far_ellipse_contact(place, matrices)
    angle = np.linspace(0.0, 2.0 * np.pi, 40_001)[:-1]
    dense = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    for k in range(300):
        values = dense @ place[k] - support(matrices[k], dense)
        peaks = np.sort(values[(values >= np.roll(values, 1)) & (values > np.roll(values, -1))])
        assert near.distance[k] == pytest.approx(peaks[-1], abs=1e-5)
        if len(peaks) == 2 and peaks[1] - peaks[0] > 1e-6:
            assert far.distance[k] == pytest.approx(peaks[0], abs=1e-5)
        elif len(peaks) == 1:
            assert far.distance[k] <= near.distance[k] + 1e-9
    assert np.isfinite(far.distance).sum() > 100


def test_headings_and_half_axes() -> None:
    car, egg = Outline.rectangle(4.0, 2.0, 0.5 * np.pi), Outline.ellipse(3.0, 1.0, 0.25 * np.pi)
    np.testing.assert_allclose(car.support(np.eye(2)), [1.0, 2.0], atol=1e-12)
    diagonal = np.array([[1.0, 1.0], [1.0, -1.0]]) / np.sqrt(2.0)
    np.testing.assert_allclose(egg.support(diagonal), [3.0, 1.0], atol=1e-12)
    assert car.reach == pytest.approx(np.sqrt(5.0))
    assert egg.reach == pytest.approx(3.0)
    assert Outline.rectangle(4.0, 2.0).turning and not car.turning


def test_vertices_in_line_are_left_out() -> None:
    vertices = Outline.polygon([[0, 0], [0, 1], [0, 2], [2, 2], [2, 1], [2, 0], [1, 0]]).vertices
    assert vertices is not None and len(vertices) == 4


# Concave polygons as unions of convex ones, against areas and distances of shapely


def some_star(rng: np.random.Generator, corners: int) -> Array:
    """A simple polygon, mostly concave."""
    angle = np.sort(rng.uniform(0.0, 2.0 * np.pi, corners))
    angle = angle + np.linspace(0.0, 1e-3, corners)
    return (rng.uniform(0.3, 2.0, corners) * np.stack([np.cos(angle), np.sin(angle)])).T


@given(st.integers(3, 40), st.integers(0, 10_000))
def test_convex_pieces_are_convex_and_make_up_the_polygon(corners: int, seed: int) -> None:
    vertices = some_star(np.random.default_rng(seed), corners)
    whole = Polygon(vertices)
    if not whole.is_valid:
        return
    pieces = convex_pieces(tuple(map(tuple, vertices)))
    parts = [Polygon(piece.vertices) for piece in pieces]
    assert all(part.convex_hull.area == pytest.approx(part.area, rel=1e-9) for part in parts)
    assert sum(part.area for part in parts) == pytest.approx(whole.area, rel=1e-9)
    assert unary_union([part.buffer(1e-9) for part in parts]).symmetric_difference(whole).area < 1e-6
    before, after = vertices - np.roll(vertices, 1, axis=0), np.roll(vertices, -1, axis=0) - vertices
    reflex = int(np.sum(before[:, 0] * after[:, 1] < before[:, 1] * after[:, 0]))
    assert len(pieces) <= 2 * reflex + 1


# Plane geometry in plain Python against shapely

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


# The product of vectors in the plane


def test_cross_product_is_the_determinant() -> None:
    one, two = np.random.default_rng(3).normal(size=(2, 4, 5, 2))
    assert np.allclose(cross(one, two), np.linalg.det(np.stack([one, two], axis=-1)), rtol=0.0, atol=1e-12)
    assert cross(np.array([1.0, 0.0]), np.array([0.0, 2.0])) == 2.0
