"""Goals that are regions, against shapely."""

from __future__ import annotations

import math

import numpy as np
import pytest
import shapely
import shapely.affinity
from hypothesis import given, settings
from hypothesis import strategies as st

import scp_planner as sp
from scp_planner.mathematics import planar
from scp_planner.mathematics.frames import PlanningFrame
from scp_planner.scenario.goal_sides import GoalSides
from scp_planner.scenario.goals import aim_at, convex_parts, distance_outside, with_aim
from scp_planner.scenario.shapes import Disc, Ellipse, PolygonShape, Rectangle

ELL = ((0.0, 0.0), (4.0, 0.0), (4.0, 1.0), (1.0, 1.0), (1.0, 3.0), (0.0, 3.0))


def test_the_aim_lies_inside_where_the_region_is_nearest() -> None:
    polygon = shapely.Polygon(ELL)
    for x, y in np.random.default_rng(1).uniform(-6.0, 9.0, (40, 2)).tolist():
        point = shapely.Point(x, y)
        assert distance_outside(ELL, (x, y)) == pytest.approx(polygon.distance(point), abs=1e-9)
        if polygon.contains(point):
            continue
        aim = shapely.Point(aim_at(ELL, (x, y)))
        assert polygon.contains(aim) and 0.0 < polygon.exterior.distance(aim) < 0.01
        assert aim.distance(point) == pytest.approx(polygon.distance(point), abs=0.01)


def test_convex_parts_are_the_region() -> None:
    parts = [shapely.Polygon(part) for part in convex_parts(ELL)]
    assert all(part.equals(part.convex_hull) for part in parts) and len(parts) > 1
    assert sum(part.area for part in parts) == pytest.approx(shapely.Polygon(ELL).area)
    assert shapely.union_all(parts).symmetric_difference(shapely.Polygon(ELL)).area == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize(
    "goal", [{"position": [1.0, 2.0], "region": ELL}, {"position": [1.0, 2.0]}, {"region": ELL[:2]}, {"region": "odd"}]
)
def test_data_without_a_region_to_aim_at_is_left_as_it_is(goal: dict[str, object]) -> None:
    data = {"start": {"position": [9.0, 9.0]}, "goal": goal}
    assert with_aim(data) is data


def test_sides_cut_a_line_where_the_part_does() -> None:
    """A line of the planning frame through the part that is aimed at, with a margin from each side."""
    margin, origin, angle = 0.1, (-3.0, -2.0), 0.6
    scenario = sp.Scenario.model_validate(
        {
            "name": "parking",
            "vehicle": {"radius": 0.3, "max_speed": 3.0, "max_acceleration": 1.5, "max_deceleration": 2.0},
            "start": {"time": 0.0, "position": origin, "speed": 0.0},
            "goal": {"region": ELL},
        }
    )
    frame = PlanningFrame(origin, angle, 0.0)
    sides = GoalSides.of(scenario, frame, margin)
    assert sides is not None
    aim = scenario.goal.position
    part = min((shapely.Polygon(each) for each in convex_parts(ELL)), key=lambda one: one.distance(shapely.Point(aim)))
    inner = part.buffer(-margin, join_style="mitre")
    for direction in np.random.default_rng(2).uniform(0.0, math.pi, 20).tolist():
        through = np.array([inner.centroid.x, inner.centroid.y])
        ahead = np.array([math.cos(direction), math.sin(direction)])
        cut = inner.intersection(shapely.LineString([through - 50.0 * ahead, through + 50.0 * ahead]))
        first, last = sides.along(frame.to_frame(through[None])[0], frame.rotation.T @ ahead)
        assert last - first == pytest.approx(cut.length, abs=1e-9) and first < 0.0 < last
    first, last = sides.along(np.array([0.0, 1e3]), np.array([1.0, 0.0]))
    assert first > last


@pytest.mark.parametrize("size", [1e-6, 1.0, 1e5])
def test_a_position_may_be_beside_its_region_by_as_much_as_the_middle_is_ahead(size: float) -> None:
    """The tip of a triangle is nearest to points straight ahead of it: so their distances are plain."""
    region = [[18.0 * size, -size], [20.0 * size, 0.0], [18.0 * size, size]]
    for centre, away, is_refused in ((0.3, 0.3, False), (-0.3, 0.3, False), (0.3, 0.3003, True), (0.0, 3e-4, True)):
        vehicle = {"radius": 0.1 * size, "max_speed": size, "max_acceleration": size, "max_deceleration": size}
        data = {
            "vehicle": {**vehicle, "centre": centre * size},
            "start": {"time": 0.0, "position": [0.0, 0.0], "speed": 0.0},
            "goal": {"position": [(20.0 + away) * size, 0.0], "region": region},
        }
        if is_refused:
            with pytest.raises(sp.ScenarioError, match=r"must be in goal\.region"):
                sp.Scenario(**data)
        else:
            assert sp.Scenario(**data).goal.position[0] > region[1][0]


def test_a_guide_may_have_points_as_close_as_its_size_asks_for() -> None:
    """A trip of 2 micrometres, whose first leg is of half a nanometre: 1 m is no unit of it."""
    guide = ((0.0, 0.0), (4e-10, 3e-10), (2e-6, 0.0))
    vehicle = {"radius": 1e-8, "max_speed": 1e-6, "max_acceleration": 1e-6, "max_deceleration": 1e-6}
    start = {"time": 0.0, "position": [0.0, 0.0], "speed": 0.0}
    given = sp.Scenario(vehicle=vehicle, start=start, goal={"position": [2e-6, 0.0]}, guide=guide)
    assert given.guide == guide


# Geometry of shapes, against shapely


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
