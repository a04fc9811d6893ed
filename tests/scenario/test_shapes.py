"""Geometry of shapes, against shapely."""

from __future__ import annotations

import pytest
import shapely
import shapely.affinity
from hypothesis import given, settings
from hypothesis import strategies as st

from scp_planner.mathematics import planar
from scp_planner.scenario.shapes import Disc, Ellipse, PolygonShape, Rectangle


@given(
    point=st.tuples(st.floats(-5, 5), st.floats(-5, 5)),
    size=st.tuples(st.floats(0.2, 3), st.floats(0.2, 3)),
    heading=st.floats(-4, 4),
)
def test_distance_to_shapes(point: tuple[float, float], size: tuple[float, float], heading: float) -> None:
    def turned(shape: shapely.Geometry) -> shapely.Geometry:
        return shapely.affinity.rotate(shape, heading, origin=(0, 0), use_radians=True)

    place = shapely.Point(point)
    circle = shapely.Point(0, 0).buffer(1.0, quad_segs=2000)
    box = shapely.box(-size[0] / 2, -size[1] / 2, size[0] / 2, size[1] / 2)
    vertices = ((-size[0], 0.0), (size[0], -1.0), (0.3, 0.2), (0.0, size[1]))  # concave
    assert Disc(disc=size[0]).distance(point, heading) == pytest.approx(
        shapely.affinity.scale(circle, size[0], size[0]).distance(place), abs=1e-5
    )
    assert Rectangle(rectangle=size).distance(point, heading) == pytest.approx(turned(box).distance(place), abs=1e-9)
    assert Ellipse(ellipse=size).distance(point, heading) == pytest.approx(
        turned(shapely.affinity.scale(circle, *size)).distance(place), abs=1e-5
    )
    assert PolygonShape(polygon=vertices).distance(point, heading) == pytest.approx(
        shapely.Polygon(vertices).distance(place), abs=1e-9
    )


@given(vertices=st.lists(st.tuples(st.integers(0, 6), st.integers(0, 6)), min_size=3, max_size=8, unique=True))
@settings(max_examples=80)
def test_a_polygon_is_accepted_where_it_is_simple(vertices: list[tuple[int, int]]) -> None:
    expected = shapely.Polygon(vertices)
    is_simple = planar.first_crossing([(float(x), float(y)) for x, y in vertices]) is None
    assert is_simple == expected.is_valid
    if is_simple:
        assert abs(planar.area(vertices)) == pytest.approx(expected.area)
