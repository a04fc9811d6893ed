"""Corridors: what lies outside them, ways through them, and plans that stay in them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest
from scenes import disc, scene
from shapely import contains, contains_xy, distance, points, unary_union
from shapely.geometry import LineString, Point, Polygon, box

import scp_planner as sp
from scp_planner.arrays import Array
from scp_planner.mathematics import corridor, planar
from scp_planner.mathematics.outlines import Outline
from scp_planner.mathematics.tolerances import COORDINATE_ROUNDING
from verification.dense_check import check_trip

pytestmark = pytest.mark.numerics

Ring = list[list[float]]


def rectangle(left: float, low: float, right: float, high: float) -> Ring:
    return [[left, low], [right, low], [right, high], [left, high]]


def convex(rng: np.random.Generator) -> tuple[planar.Point, ...]:
    """A random convex polygon of three to seven corners, in a random direction."""
    angles = np.sort(rng.uniform(0.0, 2.0 * np.pi, rng.integers(3, 8)))
    corners = rng.uniform(-4.0, 4.0, 2) + rng.uniform(1.0, 4.0) * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    return tuple(map(tuple, corners[:: rng.choice([1, -1])].tolist()))


@pytest.mark.parametrize("seed", range(20))
def test_the_outside_is_what_shapely_says(seed: int) -> None:
    rng = np.random.default_rng(seed)
    polygons = [convex(rng) for _ in range(rng.integers(1, 7))]
    walls = corridor.outside(polygons, wall=2.0)
    inside = unary_union([Polygon(polygon) for polygon in polygons])
    low_x, low_y, high_x, high_y = inside.bounds
    around = box(low_x - 2.0, low_y - 2.0, high_x + 2.0, high_y + 2.0)
    assert unary_union([Polygon(wall) for wall in walls]).symmetric_difference(around - inside).area < 1e-6
    for wall in walls:
        assert planar.is_convex(wall)
        assert planar.area(wall) > 0.0
    assert len(walls) <= 12 * len(polygons)


def joined(count: int, size: float, turned: float) -> list[list[planar.Point]]:
    """A road of quadrilaterals that share their ends, bent to the left in its middle third."""
    share = np.linspace(0.0, 1.0, 60 * count + 1)
    headings = turned + 0.5 * np.pi * np.clip(3.0 * share - 1.0, 0.0, 1.0)
    steps = size / (60.0 * count) * np.stack([np.cos(headings[1:]), np.sin(headings[1:])], axis=1)
    middle = np.vstack([np.zeros(2), np.cumsum(steps, axis=0)])[::60]
    aside = size / 32.0 * np.stack([-np.sin(headings[::60]), np.cos(headings[::60])], axis=1)
    left, right = ([(x, y) for x, y in side.tolist()] for side in (middle + aside, middle - aside))
    return [[right[k], right[k + 1], left[k + 1], left[k]] for k in range(count)]


@pytest.mark.parametrize("seed", range(6))
def test_no_wall_lies_in_a_road_of_parts_that_share_their_ends(seed: int) -> None:
    """Lines of many parts meet in a point, so edges of walls are as short as rounding, in any direction."""
    rng = np.random.default_rng(seed)
    for _ in range(10):
        polygons = joined(int(rng.integers(20, 60)), float(rng.uniform(10.0, 40.0)), float(rng.uniform(0.0, 6.0)))
        road = unary_union([Polygon(polygon) for polygon in polygons])
        walls = corridor.outside(polygons)
        assert max(Polygon(wall).intersection(road).area for wall in walls) < 1e-6 * road.area
        outside = road.buffer(0.5 * corridor.SIZE.wall).difference(unary_union([Polygon(wall) for wall in walls]))
        assert outside.area == pytest.approx(road.area, rel=1e-5)


def any_convex(rng: np.random.Generator, size: float) -> Array:
    """A convex polygon of three to seven corners, round or a sliver."""
    angles = np.sort(rng.uniform(0.0, 2.0 * np.pi, rng.integers(3, 8)))
    flat = np.array([1.0, 10.0 ** rng.uniform(-7.0, 0.0) if rng.random() < 0.4 else 1.0])
    corners = flat * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    return rng.uniform(-size, size, 2) + size * 10.0 ** rng.uniform(-1.5, 0.0) * corners @ turned(rng).T


def turned(rng: np.random.Generator) -> Array:
    """A rotation, or none."""
    angle = rng.uniform(0.0, 2.0 * np.pi) if rng.random() < 0.6 else 0.0
    return np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])


def round_a_hole(rng: np.random.Generator, size: float) -> tuple[list[Array], Array]:
    """Four rectangles round a hole as small as a billionth of them, and points in it."""
    wide, high = size * 10.0 ** rng.uniform(-9.0, -1.0) * np.array([1.0, 10.0 ** rng.uniform(-3.0, 1.0)])
    turn, middle, out = turned(rng), rng.uniform(-0.5, 0.5, 2) * size, size * rng.uniform(0.05, 0.5)
    sides = [(-out, -out, -wide, out), (wide, -out, out, out), (-out, high, out, out), (-out, -out, out, -high)]
    inside = rng.uniform(-0.9, 0.9, (20, 2)) * [wide, high]
    return [np.array(rectangle(*side)) @ turn.T + middle for side in sides], inside @ turn.T + middle


def near_crossings(rng: np.random.Generator, polygons: Sequence[corridor.Polygon], size: float) -> Array:
    """Points at all distances from where the lines of edges cross."""
    ends = np.array([edge for polygon in polygons for edge in planar.edges(polygon)])
    one, other = np.triu_indices(len(ends), 1)
    begin, along, to, aside = (part for some in (one, other) for part in (ends[some, 0], ends[some, 1] - ends[some, 0]))
    turn = along[:, 0] * aside[:, 1] - along[:, 1] * aside[:, 0]
    crossing = turn != 0.0
    share = (to - begin)[crossing, 0] * aside[crossing, 1] - (to - begin)[crossing, 1] * aside[crossing, 0]
    share /= turn[crossing]
    found = (begin[crossing] + share[:, None] * along[crossing])[np.abs(share - 0.5) < 0.6]
    found = np.repeat(found, 6, axis=0)
    return found + rng.normal(size=found.shape) * size * 10.0 ** rng.uniform(-10.0, -0.5, (len(found), 1))


@pytest.mark.parametrize("seed", range(60))
def test_no_place_outside_a_union_is_called_inside_at_any_scale(seed: int) -> None:
    """Nor is one inside called outside. By distances of points to each polygon, relative to the largest coordinate."""
    rng = np.random.default_rng(seed)
    size = 10.0 ** rng.uniform(-3.0, 6.0)
    polygons, probes = [any_convex(rng, size) for _ in range(rng.integers(1, 6))], []
    for _ in range(rng.integers(0, 3)):
        sides, inside = round_a_hole(rng, size)
        polygons += sides
        probes.append(inside)
    away = rng.uniform(-1e6, 1e6, 2) if rng.random() < 0.3 else np.zeros(2)
    rings = [tuple(map(tuple, (polygons[k] + away).tolist())) for k in rng.permutation(len(polygons))]
    rings = [ring for ring in rings if planar.area(ring) and planar.is_convex(ring) and not planar.first_crossing(ring)]
    walls = corridor.outside(rings, wall=0.3 * size)
    corners = np.concatenate([np.array(ring) for ring in rings])
    low, high = corners.min(axis=0) - 0.3 * size, corners.max(axis=0) + 0.3 * size
    place = np.concatenate([*(probe + away for probe in probes), near_crossings(rng, rings, size)])
    place = np.concatenate([place, rng.uniform(low, high, (200, 2))])
    place = points(place[np.all((place > low) & (place < high), axis=1)])
    rounding = 1e-11 * np.abs([low, high]).max()
    beyond = np.min([distance(Polygon(ring), place) for ring in rings], axis=0)
    to_wall = np.min([distance(Polygon(wall), place) for wall in walls], axis=0)
    assert np.all(to_wall[beyond > rounding] <= rounding)
    union = unary_union([Polygon(ring) for ring in rings])
    depth = np.where(contains(union, place), distance(union.boundary, place), 0.0)
    assert np.all(to_wall >= depth - 100.0 * rounding)


@pytest.mark.parametrize("half", [1e-4, 1e-2, 0.1])
def test_a_pillar_that_a_road_of_5_km_leaves_out_is_outside(half: float) -> None:
    sides = [(-20.0, -4.0, 2500.0 - half, 4.0), (2500.0 + half, -4.0, 5020.0, 4.0)]
    sides += [(2490.0, half, 2510.0, 4.0), (2490.0, -4.0, 2510.0, -half)]
    scenario = scene(goal={"position": [5000.0, 0.0]}, corridor=[rectangle(*side) for side in sides])
    (zone,) = sp.zones(scenario)
    assert zone.signed_distance(0.0, np.array([[2500.0, 0.0]]))[0] < 0.0
    straight = sp.SampledTrajectory([0.0, 5000.0], [[0.0, 0.0], [5000.0, 0.0]], [0.0, 0.0], [1.0, 1.0])
    certificate = sp.certify(scenario, straight)
    assert not certificate.holds
    assert {one.obstacle for one in certificate.violations} == {"corridor"}


def test_the_signed_distance_to_the_outside_is_the_room_in_the_corridor() -> None:
    polygons = [rectangle(-1, -1, 9, 1), [[7, -1], [9, -1], [10, 4], [8, 4]], rectangle(6, 3, 14, 8)]
    scenario = scene(goal={"position": [12.0, 6.0]}, corridor=polygons)
    (zone,) = sp.zones(scenario)
    assert zone.id == "corridor"
    union = unary_union([Polygon(polygon) for polygon in polygons])
    place = np.random.default_rng(0).uniform([-3.0, -3.0], [16.0, 10.0], (10_000, 2))
    found = zone.signed_distance(0.0, place)
    room = distance(union.boundary, points(place))
    inside = contains_xy(union, place[:, 0], place[:, 1])
    assert found[inside] == pytest.approx(room[inside], abs=1e-9)
    assert np.all(found[~inside] <= 1e-9)
    assert 0.1 < inside.mean() < 0.9


def test_a_way_through_lies_in_the_corridor() -> None:
    sides = [(-1, -1, 9, 1), (7, -1, 9, 6), (0, 4, 9, 6), (0, 4, 2, 12), (20, 20, 21, 21)]
    polygons = [rectangle(*each) for each in sides]
    rings = [[(float(x), float(y)) for x, y in polygon] for polygon in polygons]
    way = corridor.way_through(rings, (0.0, 0.0), (1.0, 11.0))
    assert len(way) == 3
    union = unary_union([Polygon(polygon) for polygon in polygons])
    assert union.buffer(1e-9).contains(LineString([(0.0, 0.0), *way, (1.0, 11.0)]))
    assert corridor.way_through(rings, (0.0, 0.0), (8.5, 0.5)) == ()
    assert corridor.way_through(rings, (0.0, 0.0), (8.0, 4.0)) != ()


BENT = [rectangle(-1, -1, 9, 1), rectangle(7, -1, 9, 9)]


def test_a_plan_takes_the_corner_of_the_corridor_and_no_more() -> None:
    scenario = scene(goal={"position": [8.0, 8.0]}, corridor=BENT)
    plan = sp.plan(scenario)
    assert plan.certified, plan.reason
    report = check_trip(scenario.to_dict(), plan.position, plan.start_time, plan.arrival_time)
    assert report.ok, str(report)
    corner = np.hypot(*(plan.position(np.linspace(plan.start_time, plan.arrival_time, 5000)) - [7.0, 1.0]).T)
    assert 0.3 <= corner.min() < 0.31


def test_a_path_outside_the_corridor_is_refused() -> None:
    plan = sp.plan(scene(disc("o", (10.0, 0.1))))
    wide, narrow = (scene(disc("o", (10.0, 0.1)), corridor=[rectangle(-1, -y, 21, y)]) for y in (1.3, 1.0))
    assert sp.certify(wide, plan).holds
    certificate = sp.certify(narrow, plan)
    assert {(violation.what, violation.obstacle) for violation in certificate.violations} == {("clearance", "corridor")}
    for scenario, broken in ((wide, []), (narrow, ["corridor"])):
        report = check_trip(scenario.to_dict(), plan.position, plan.start_time, plan.arrival_time)
        assert [finding.name for finding in report.violations] == broken


def test_a_planner_online_stays_in_the_corridor() -> None:
    scenario = scene(goal={"position": [8.0, 8.0]}, corridor=BENT)
    planner = sp.Planner(scenario)
    plan = planner.replan(time=0.0, position=(0.0, 0.0), heading=0.0, speed=1.0)
    for time in np.arange(0.2, 3.0, 0.2):
        x, y = plan.position(time)
        plan = planner.replan(time, (x, y), float(plan.heading(time)), float(plan.speed(time)))
        assert plan.safe, plan.reason
    position = plan.position(np.linspace(0.0, plan.arrival_time, 500))
    union = unary_union([Polygon(polygon) for polygon in BENT])
    assert min(union.boundary.distance(Point(p)) for p in position) >= 0.3
    assert all(union.contains(Point(p)) for p in position)


def test_walls_have_no_edge_that_is_only_rounding() -> None:
    """Three polygons meet in a point, up to rounding: walls could have an edge of that length."""
    tilt = 0.3
    turn = np.array([[np.cos(tilt), -np.sin(tilt)], [np.sin(tilt), np.cos(tilt)]])
    polygons = [
        tuple(map(tuple, (np.array(ring) @ turn.T + [100.0 / 3.0, 200.0 / 3.0]).tolist()))
        for ring in (
            rectangle(0, 0, 10, 4),
            [[6.0, 0.0], [10.0, -4.0], [14.0, 0.0], [10.0, 4.0 + 1e-12]],
            [[9.0, 4.0 + 1e-13], [10.0 - 2e-13, 3.0], [16.0, 4.0]],
        )
    ]
    walls = corridor.outside(polygons)
    xs, ys = zip(*(vertex for polygon in polygons for vertex in polygon), strict=True)
    extent = max(max(xs) - min(xs), max(ys) - min(ys))
    shortest = min(np.hypot(b[0] - a[0], b[1] - a[1]) for wall in walls for a, b in planar.edges(wall))
    assert shortest > COORDINATE_ROUNDING * extent
    inside = unary_union([Polygon(polygon) for polygon in polygons])
    low_x, low_y, high_x, high_y = inside.bounds
    around = box(low_x - 3.0, low_y - 3.0, high_x + 3.0, high_y + 3.0)
    assert unary_union([Polygon(wall) for wall in walls]).symmetric_difference(around - inside).area < 1e-6


def test_vertices_that_rounding_joins_become_one() -> None:
    sliver = Outline.polygon([[0.0, 0.0], [2.0, 0.0], [2.0 + 1e-13, 3e-13], [2.0, 1.0]]).rounded(9)
    assert sliver.vertices is not None
    assert len(sliver.vertices) == 3
    assert np.all(np.isfinite(sliver.normals))
    tiny = Outline.polygon([[0.0, 0.0], [1e-12, 0.0], [0.0, 1e-12]]).rounded(9)
    assert np.all(np.isfinite(tiny.normals))


def round_cells(count: int, corners: int) -> list[Ring]:
    """Cells in a row, each overlapping the next, with so many corners."""
    angles = np.linspace(0.0, 2.0 * np.pi, corners + 1)[:-1] + 0.01
    ring = np.stack([3.5 * np.cos(angles), 4.0 * np.sin(angles)], axis=1)
    return [(ring + np.array([5.0 * number, 0.0])).tolist() for number in range(count)]


def test_polygons_of_too_many_corners_are_refused_at_once() -> None:
    assert scene(corridor=round_cells(5, corridor.SIZE.most_corners)[:1] + round_cells(5, 8)[1:]).corridor is not None
    with pytest.raises(sp.ScenarioError, match=r"corridor\[2\].* must have at most 100 corners, not 500"):
        scene(corridor=[*round_cells(2, 8), *round_cells(5, 500)[2:3], *round_cells(5, 8)[3:]])
