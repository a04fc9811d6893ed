"""Batches of zones: distances to brute-force borders, what is taken from a batch, what it bounds."""

from __future__ import annotations

import dataclasses
from math import atan2, cos, pi, sin
from typing import TYPE_CHECKING

import numpy as np
import pytest
from scenes import disc, observed, scene
from shapely import Point, Polygon, distance, points
from shapely.geometry import MultiPoint
from zone_kinds import KINDS, batch_of

import scp_planner as sp
from scp_planner.mathematics.frames import PlanningFrame
from scp_planner.mathematics.outlines import Outline, Outlines
from scp_planner.threat_zones.batch import ZoneBatch
from scp_planner.threat_zones.bounds import ZoneBounds
from scp_planner.threat_zones.contacts import ZoneContacts, leading
from scp_planner.threat_zones.ground import Ground
from scp_planner.threat_zones.nearness import SweptBoxes, least_clearances
from scp_planner.threat_zones.sections import sections

if TYPE_CHECKING:
    from scp_planner.arrays import Array

pytestmark = pytest.mark.numerics

TRIANGLE = [[0.0, 0.0], [2.0, 0.0], [0.0, 3.0]]
MOTIONS = {
    "disc": ((6.0, -3.0), (0.5, 0.8), (0.0, -0.1)),
    "egg": ((12.0, 3.0), (-0.4, -0.6), (0.0, 0.0)),
    "triangle": ((4.0, 2.0), (0.3, -0.2), (0.1, 0.0)),
    "car": ((15.0, -2.0), (-0.9, 0.3), (0.2, 0.3)),
}
SHAPES = {
    "disc": {"disc": 0.7},
    "egg": {"ellipse": [1.5, 0.6], "heading": 0.4},
    "triangle": {"polygon": TRIANGLE},
    "car": {"rectangle": [4.0, 1.6]},
}
INFLATION = 0.3
FRAME = PlanningFrame.between((0.0, 0.0), (20.0, 0.0), 0.0)


@pytest.fixture(scope="module")
def batch() -> ZoneBatch:
    obstacles = [
        {
            "id": name,
            "shape": SHAPES[name],
            "motion": dict(zip(("position", "velocity", "acceleration"), m, strict=True)),
        }
        for name, m in MOTIONS.items()
    ]
    return ZoneBatch.of(sp.zones(scene(*obstacles)), FRAME, INFLATION)


def border(name: str, time: float) -> np.ndarray:
    """Points of a body's border at a time, drawn from its definition."""
    place, velocity, acceleration = (np.array(part) for part in MOTIONS[name])
    heading, turn = velocity + time * acceleration, np.linspace(0.0, 2.0 * pi, 4001)
    if name == "disc":
        local, angle = 0.7 * np.stack([np.cos(turn), np.sin(turn)], axis=1), 0.0
    elif name == "egg":
        local, angle = np.stack([1.5 * np.cos(turn), 0.6 * np.sin(turn)], axis=1), 0.4
    elif name == "triangle":
        local, angle = np.array(TRIANGLE), 0.0
    else:
        local, angle = np.array([[2.0, 0.8], [-2.0, 0.8], [-2.0, -0.8], [2.0, -0.8]]), atan2(heading[1], heading[0])
    turned = local @ np.array([[cos(angle), sin(angle)], [-sin(angle), cos(angle)]])
    return place + time * velocity + 0.5 * time**2 * acceleration + turned


def test_distances_are_those_to_borders_drawn_from_the_definitions(batch: ZoneBatch) -> None:
    """Outside the bodies; an ellipse drawn with 4,000 corners is off by 2e-6 m at most."""
    rng = np.random.default_rng(3)
    times, points = rng.uniform(0.0, 4.0, 60), rng.uniform([0.0, -6.0], [20.0, 6.0], (60, 2))
    found = batch.distances(times, points)
    for column, name in enumerate(batch.ids):
        drawn = np.array([Polygon(border(name, t)).distance(Point(*p)) for t, p in zip(times, points, strict=True)])
        outside = drawn > 1e-3
        assert outside.sum() > 40
        assert found[outside, column] == pytest.approx(drawn[outside] - INFLATION, abs=5e-6)
        assert np.all(found[~outside, column] < 1e-3 - INFLATION + 5e-6)


def test_parts_of_a_batch_and_larger_ones(batch: ZoneBatch) -> None:
    times, points = np.linspace(0.0, 4.0, 40), np.linspace([0.0, -4.0], [20.0, 4.0], 40)
    whole = batch.distances(times, points)
    some = batch.subset(np.array([3, 1]))
    assert some.ids == ("car", "egg") and some.size == 2
    assert some.distances(times, points) == pytest.approx(whole[:, [3, 1]], abs=1e-12)
    extra = np.array([0.0, 0.1, 0.2, 0.3])
    assert batch.inflated(extra).distances(times, points) == pytest.approx(whole - extra, abs=1e-12)
    assert batch.rounded().distances(times, points) == pytest.approx(whole, abs=1e-6)
    assert np.array_equal(batch.distances(times, points), whole)
    with pytest.raises(dataclasses.FrozenInstanceError):
        batch.radius = extra  # type: ignore[misc]


def test_polygons_that_stand_are_as_far_as_shapely_says() -> None:
    rng, polygons = np.random.default_rng(3), []
    for place in rng.uniform([2.0, -6.0], [18.0, 6.0], (12, 2)):
        angles = np.sort(rng.uniform(0.0, 2.0 * pi, rng.integers(3, 8)))
        polygons.append(place + rng.uniform(0.3, 2.0) * np.stack([np.cos(angles), np.sin(angles)], axis=1))
    still = [
        {"id": str(k), "shape": {"polygon": p.tolist()}, "motion": {"position": (0, 0)}} for k, p in enumerate(polygons)
    ]
    moving = {"id": "m", "shape": SHAPES["car"], "motion": {"position": (15.0, -9.0), "velocity": (-0.9, 0.3)}}
    zones = ZoneBatch.of(sp.zones(scene(*still, moving, start={"position": (-9.0, 0.0)})), FRAME, INFLATION)
    points, times = rng.uniform([0.0, -7.0], [20.0, 7.0], (300, 2)), rng.uniform(0.0, 9.0, 300)
    expected = []
    for zone in zones.ids[:-1]:
        body = Polygon(polygons[int(zone)])
        expected.append([body.distance(Point(p)) or -body.exterior.distance(Point(p)) for p in points])
    exact, rough = zones.distances(times, points)[:, :-1], zones.distances(times, points, 1.0)[:, :-1]
    assert exact == pytest.approx(np.array(expected).T - INFLATION, abs=1e-9)
    near = exact < 1.0
    assert rough[near] == pytest.approx(exact[near], abs=1e-12)
    assert np.all((rough[~near] >= 1.0 - 1e-12) & (rough[~near] <= exact[~near] + 1e-12))
    assert 0.02 < near.mean() < 0.8


def test_zones_come_no_nearer_than_their_bound_says() -> None:
    scenario = scene(disc("fast", (9.0, 0.5), (-1.5, 0.4), (0.3, 0.2)), disc("slow", (5.0, 2.0), (0.1, -0.2)))
    zones = ZoneBatch.of(sp.zones(scenario), FRAME, INFLATION)
    half, speed = np.array([0.05, 0.4]), np.array([3.0, 1.0])
    bound = ZoneBounds(zones).approach(0.0, 3.0, half, speed)
    rng = np.random.default_rng(5)
    for h, v, allowed in zip(half, speed, bound, strict=True):
        middle, start = rng.uniform(h, 3.0 - h, 300), rng.uniform([0.0, -3.0], [12.0, 3.0], (300, 2))
        when, way = rng.uniform(-h, h, 300), rng.uniform(0.0, 2.0 * pi, 300)
        moved = start + (v * np.abs(when))[:, None] * np.stack([np.cos(way), np.sin(way)], axis=1)
        nearer = zones.distances(middle, start) - zones.distances(middle + when, moved)
        assert np.all(nearer <= allowed + 1e-12)
        assert np.all(nearer.max(axis=0) > 0.5 * allowed)


def test_what_overlapping_parts_share_is_told_once() -> None:
    corners = [[0.0, 1.0], [6.0, 1.0], [6.0, 3.0], [0.0, 3.0]]
    walls = [corners, [[x + 4.0, y] for x, y in corners], [[x, y - 4.0] for x, y in corners]]
    zones = sp.zones(scene(disc("o", (5.0, 2.0), radius=1.0), walls=walls, start={"position": [-4.0, 0.0]}))
    several = ZoneBatch.of(zones, FRAME, 0.3)
    assert several.ids == ("o", "walls", "walls", "walls")
    places = np.array([[5.0, 0.0], [1.0, 0.0]])
    place, zone = np.divmod(np.arange(8), 4)
    contacts = several.contacts(zone, np.zeros(8), places[place])
    assert contacts.distance[1:4] == pytest.approx(contacts.distance[0])
    # Of what is as near only both walls above share a point: not the disc, nor the wall below.
    assert several.singles(place, zone, contacts).tolist() == [0, 1, 3, 4, 5, 6, 7]


# Contacts that others of the same place imply, against moves drawn at random

MOVE = 0.4


def contacts_at(places: int, each: int) -> tuple[np.ndarray, ZoneContacts]:
    """Contacts with walls to two sides of some places, many of them with nearly the same ones."""
    rng = np.random.default_rng(4)
    place = np.repeat(np.arange(places), each)
    way = np.where(rng.random(len(place)) < 0.5, 0.0, np.pi) + 0.3 * rng.normal(size=len(place))
    distance = rng.uniform(-0.1, 0.5, len(place))
    return place, ZoneContacts(distance, np.stack([np.cos(way), np.sin(way)], axis=1), np.zeros(len(place)))


def test_what_is_left_out_is_implied_by_what_is_kept_for_all_moves() -> None:
    place, contacts = contacts_at(30, 12)
    kept = leading(place, contacts, MOVE)
    assert np.all(np.diff(kept) > 0)
    assert 30 <= len(kept) < 0.7 * len(place)
    rng = np.random.default_rng(5)
    way, far = rng.uniform(0.0, 2.0 * np.pi, 400), MOVE * np.sqrt(rng.random(400))
    moves = np.stack([far * np.cos(way), far * np.sin(way)])
    left = contacts.distance[:, None] + contacts.normal @ moves
    for one in range(30):
        mine = np.flatnonzero(place == one)
        least = left[np.intersect1d(kept, mine)].min(axis=0)
        assert np.all(left[mine].min(axis=0) >= least - 1e-7)


def test_those_that_are_one_but_for_rounding_are_told_once() -> None:
    normal = np.array([[0.0, 1.0], [1e-12, 1.0], [0.0, -1.0], [0.0, 1.0]])
    contacts = ZoneContacts(np.array([0.2, 0.2 - 1e-14, 0.2, 0.2]), normal, np.zeros(4))
    assert leading(np.array([0, 0, 0, 1]), contacts, 1e3).tolist() == [0, 2, 3]
    assert leading(np.zeros(0, dtype=np.intp), ZoneContacts(np.zeros(0), np.zeros((0, 2)), np.zeros(0)), 1.0).size == 0


# Bounds of how near zones come to boxes in time

WORLD = PlanningFrame((0.0, 0.0), 0.0, 0.0)


def test_bounds_are_below_all_samples_and_near_them_on_short_intervals() -> None:
    rng = np.random.default_rng(4)
    place, velocity, pull = rng.uniform(-8.0, 8.0, (6, 2)), rng.normal(size=(6, 2)), rng.normal(size=(6, 2))
    rows = np.concatenate([place, velocity, pull], axis=1).tolist()
    moving = [disc(f"d{k}", (x, y), (u, v), (a, b), 0.5) for k, (x, y, u, v, a, b) in enumerate(rows)]
    batch = ZoneBatch.of(sp.zones(scene(*moving, observed("seen", 3))), WORLD, INFLATION)
    count, span = 8, 4.0
    half = 0.5 * span / count
    middle = np.linspace(half, span - half, count)
    corners = rng.uniform(-3.0, 3.0, (2, count, 2))
    boxes = SweptBoxes(middle, half, corners.min(axis=0), corners.max(axis=0))
    bounds = least_clearances(batch, boxes)
    assert bounds[6] == -np.inf  # nothing is known of it so cheaply

    times = middle[:, None] + np.linspace(-half, half, 41)
    off = np.empty((6, count, 41))
    for k in range(6):
        center = place[k] + velocity[k] * times[..., None] + 0.5 * pull[k] * times[..., None] ** 2
        nearest = np.clip(center, boxes.lower[:, None], boxes.upper[:, None])
        off[k] = np.linalg.norm(center - nearest, axis=2) - 0.5 - INFLATION
    sampled = off.min(axis=(1, 2))
    assert np.all(bounds[:6] <= sampled + 1e-9)
    farthest = np.linalg.norm(velocity, axis=1) + span * np.linalg.norm(pull, axis=1)
    assert np.all(bounds[:6] >= sampled - 2.0 * half * farthest)


def test_bound_of_what_stands_is_its_distance() -> None:
    batch = ZoneBatch.of(sp.zones(scene(disc("post", (5.0, 6.0), radius=1.0))), WORLD, INFLATION)
    boxes = SweptBoxes(np.array([1.0]), 1.0, np.array([[0.0, 0.0]]), np.array([[2.0, 2.0]]))
    assert least_clearances(batch, boxes)[0] == pytest.approx(5.0 - 1.0 - INFLATION, abs=1e-6)


# Cuts of zones against zones: what is not blocked is free, and what is blocked deeply is not


def test_sections_contain_exactly_what_is_inside() -> None:
    _, batch = batch_of(KINDS)
    rng = np.random.default_rng(0)
    lines = 16
    index = np.repeat(np.arange(batch.size), lines)
    times = rng.uniform(0.0, 6.0, len(index))
    angle = rng.uniform(0.0, 2.0 * np.pi, len(index))
    tangents = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    normals = np.stack([-np.sin(angle), np.cos(angle)], axis=1)
    origins = batch.centers.at(index, times) + rng.normal(size=(len(index), 2)) * 1.5
    cut = sections(batch, index, times, origins, tangents)
    offsets = np.linspace(-15.0, 15.0, 2001)
    met, slack = 0, []
    for row in range(len(index)):
        points = origins[row] + offsets[:, None] * normals[row]
        distance = batch.contacts(np.full(2001, index[row]), np.full(2001, times[row]), points).distance
        inside = offsets[distance < 0.0]
        if len(inside):
            met += 1
            assert cut.lower[row] <= inside[0] and inside[-1] <= cut.upper[row]
            if offsets[0] < inside[0] and inside[-1] < offsets[-1]:
                slack += [inside[0] - cut.lower[row], cut.upper[row] - inside[-1]]
        elif cut.lower[row] <= cut.upper[row]:
            # only a round corner's tangents reach the line
            assert distance.min() < 0.02 * (1.0 + batch.reach(times[row : row + 1])[0, index[row]])
    assert met > 0.6 * len(index)
    assert np.median(slack) < 0.02
    assert np.quantile(slack, 0.9) < 0.2


def test_what_stands_is_known_to_stand() -> None:
    _, batch = batch_of(KINDS)
    assert [batch.ids[k] for k in batch.standing] == ["standing", "wall", "standing egg"]
    assert sorted([*batch.standing, *batch.moving]) == list(range(batch.size))


# Polygons that stand, by the lines of their edges, against shapely


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
