"""Outlines against shapely, and against a dense search over directions."""

from __future__ import annotations

import numpy as np
import pytest
from shapely import Polygon, distance, points
from shapely.geometry import MultiPoint

from scp_planner.mathematics.ellipse import ellipse_contact, far_ellipse_contact, support
from scp_planner.mathematics.outlines import Outline, Outlines, two_ellipses_contact

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


def test_vertices_edges_and_the_middle_of_a_square() -> None:
    square = Outlines([Outline.rectangle(2.0, 2.0, 0.0)])
    place = np.array([[1.0, 1.0], [1.0, 0.2], [2.0, 1.0], [0.0, 0.0], [4.0, 5.0]])
    contact = square.contacts(np.zeros(5, dtype=int), place)
    np.testing.assert_allclose(contact.distance, [0.0, 0.0, 1.0, -1.0, 5.0], atol=1e-15)
    np.testing.assert_allclose(contact.normal[[1, 2, 4]], np.array([[1.0, 0.0], [1.0, 0.0], [0.6, 0.8]]), atol=1e-15)


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


def test_a_circle_and_an_ellipse_add_up() -> None:
    rng = np.random.default_rng(3)
    matrices, place = random_matrices(rng, 300), rng.normal(size=(300, 2)) * 2.0
    both = two_ellipses_contact(place, matrices, np.tile([0.25, 0.0, 0.25], (300, 1)))
    np.testing.assert_allclose(both.distance, ellipse_contact(place, matrices).distance - 0.5, atol=1e-9)


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
