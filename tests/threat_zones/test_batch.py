"""Batches of zones: distances to brute-force borders, what is taken from a batch, what it bounds."""

from __future__ import annotations

import dataclasses
from math import atan2, cos, pi, sin

import numpy as np
import pytest
from scenes import disc, scene
from shapely import Point, Polygon

import scp_planner as sp
from scp_planner.mathematics.frames import PlanningFrame
from scp_planner.threat_zones.batch import ZoneBatch
from scp_planner.threat_zones.bounds import ZoneBounds

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


def test_far_distances_may_be_lower_bounds_that_are_still_far(batch: ZoneBatch) -> None:
    times, points = np.linspace(0.0, 4.0, 200), np.linspace([0.0, -5.0], [20.0, 5.0], 200)
    exact, quick = batch.distances(times, points), batch.distances(times, points, exact_below=1.0)
    near = exact < 1.0
    assert near.any() and not near.all()
    assert quick[near] == pytest.approx(exact[near], abs=1e-12)
    assert np.all(quick[~near] >= 1.0 - 1e-12) and np.all(quick <= exact + 1e-9)


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


def test_walls_are_as_far_away_as_shapely_says() -> None:
    rng = np.random.default_rng(3)
    angles = 2.0 * np.pi * np.arange(30) / 30.0
    ring = np.stack([0.9 * np.cos(angles), 0.5 * np.sin(angles)], axis=1)
    walls = [(ring + place).tolist() for place in rng.uniform([4.0, -5.0], [18.0, 5.0], (12, 2))]
    (zone,) = sp.zones(scene(walls=walls))
    batch = ZoneBatch.of([zone], FRAME, 0.0)
    places = rng.uniform([0.0, -6.0], [20.0, 6.0], (200, 2))
    found = batch.distances(np.zeros(200), places, 1.0)
    true = np.array([[Polygon(wall).distance(Point(place)) for wall in walls] for place in places])
    near = (true > 0.0) & (true < 1.0)
    assert near.sum() > 50
    assert found[near] == pytest.approx(true[near], abs=1e-9)
    assert np.all(found[true >= 1.0] >= 1.0 - 1e-9)
    assert np.all(found[true == 0.0] <= 1e-9)
