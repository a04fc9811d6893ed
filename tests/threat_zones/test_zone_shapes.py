"""Zones with corners: against shapely in world coordinates, differences in time, and dense samples of intervals."""

from __future__ import annotations

import numpy as np
import pytest
from scenes import scene
from shapely import affinity, distance, points
from shapely.geometry import Point, Polygon, box
from zone_kinds import KINDS, batch_of, seen, shaped

import scp_planner as sp
from scp_planner.threat_zones.bounds import MovingPoint, ZoneBounds

pytestmark = pytest.mark.numerics

Array = np.ndarray


def figure(obstacle: sp.Obstacle, t: float) -> Polygon:
    """The true outline at a time, made with shapely; the direction of motion by differences."""
    motion, shape = obstacle.motion, obstacle.shape
    assert isinstance(motion, sp.Motion)

    def centre(time: float) -> Array:
        time -= motion.reference_time
        return (
            np.array(motion.position) + time * np.array(motion.velocity) + time**2 / 2 * np.array(motion.acceleration)
        )

    heading = np.arctan2(*(centre(t + 1e-4) - centre(t - 1e-4))[::-1])
    if isinstance(shape, sp.PolygonShape):
        drawn = Polygon(shape.polygon)
    elif isinstance(shape, sp.Disc):
        drawn = Point(0.0, 0.0).buffer(shape.disc, quad_segs=4000)
    else:
        heading = shape.heading if shape.heading is not None else heading
        if isinstance(shape, sp.Rectangle):
            length, width = shape.rectangle
            drawn = box(-length / 2, -width / 2, length / 2, width / 2)
        else:
            drawn = affinity.scale(Point(0.0, 0.0).buffer(1.0, quad_segs=4000), *shape.ellipse)
        drawn = affinity.rotate(drawn, heading, origin=(0.0, 0.0), use_radians=True)
    return affinity.translate(drawn, *centre(t))


@pytest.mark.parametrize("name", [o.id for o in KINDS.obstacles if o.motion is not None])
def test_known_zones_are_what_shapely_draws(name: str) -> None:
    number = [o.id for o in KINDS.obstacles].index(name)
    obstacle, zone = KINDS.obstacles[number], sp.zones(KINDS)[number]
    rng = np.random.default_rng(number)
    for t in (5.0, 6.3, 9.0):
        place = zone.center(t) + rng.normal(size=(300, 2)) * rng.choice([0.4, 3.0], (300, 1))
        drawn = figure(obstacle, t)
        at = points(place)
        inside = np.array([drawn.contains(p) for p in at])
        expected = np.where(inside, -distance(drawn.exterior, at), distance(drawn, at))
        found = zone.signed_distance(t, place)
        assert 3 < inside.sum() < 250
        if name == "ell":  # inside of concave polygons, to the border of a convex piece: not as deep as it is
            np.testing.assert_allclose(found[~inside], expected[~inside], atol=1e-6)
            assert np.all(found[inside] <= 1e-12)
            assert np.all(found[inside] >= expected[inside] - 1e-9)
        else:
            np.testing.assert_allclose(found, expected, atol=1e-6)


def test_a_zone_is_within_its_support() -> None:
    angle = np.linspace(0.0, 2.0 * np.pi, 14_401)
    directions = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    rng = np.random.default_rng(0)
    for zone in sp.zones(KINDS):
        for t in (5.0, 7.5):
            place = zone.center(t) + rng.normal(size=(50, 2)) * 3.0
            gaps = (place - zone.center(t)) @ directions.T - zone.support(np.full(14_401, t), directions)
            found = zone.signed_distance(t, place)
            outside = found > 0.0
            if zone.id == "ell":  # the support is that of the convex hull
                assert np.all(gaps.max(axis=1)[outside] <= found[outside] + 1e-9)
            else:
                np.testing.assert_allclose(gaps.max(axis=1)[outside], found[outside], atol=1e-3)


def test_the_batch_agrees_with_the_single_zones_in_world_coordinates() -> None:
    zones = sp.zones(KINDS)
    frame, batch = batch_of(KINDS)
    rng = np.random.default_rng(4)
    times, place = rng.uniform(0.0, 6.0, 60), rng.uniform([-2, -8], [20, 12], (60, 2))
    local = frame.to_frame(place)
    grid = batch.distances(times, local)
    index = np.tile(np.arange(batch.size), 60)
    contacts = batch.contacts(index, np.repeat(times, batch.size), np.repeat(local, batch.size, axis=0))
    np.testing.assert_allclose(contacts.distance.reshape(60, -1), grid, atol=1e-9)
    for zone in zones:
        mine = [k for k, name in enumerate(batch.ids) if name == zone.id]
        assert len(mine) == (2 if zone.id == "ell" else 1)
        expected = zone.signed_distance(times + frame.time, place) - 0.3
        np.testing.assert_allclose(grid[:, mine].min(axis=1), expected, atol=1e-9)
    lower = batch.distances(times, local, exact_below=1.0)
    assert np.all(lower <= grid + 1e-9)
    near = grid < 1.0
    np.testing.assert_allclose(lower[near], grid[near], atol=1e-12)
    assert near.any() and np.all(lower[~near] >= 1.0 - 1e-12)
    some = np.array([1, 3, 8, 9, 11])
    np.testing.assert_allclose(batch.subset(some).distances(times, local), grid[:, some], atol=1e-12)
    reach = batch.reach(times)
    assert np.all(np.hypot(*(local[:, None] - batch.centers.grid(times)).T).T - reach <= grid + 1e-9)


def test_contacts_give_the_gradient_and_the_rate_of_the_distance() -> None:
    _, batch = batch_of(KINDS)
    rng = np.random.default_rng(5)
    index, times = np.tile(np.arange(batch.size), 60), rng.uniform(0.1, 6.0, 60 * batch.size)
    place = batch.centers.at(index, times) + rng.normal(size=(len(index), 2)) * 4.0
    contacts = batch.contacts(index, times, place)
    step = 1e-6

    def difference(delay: float, shift: Array) -> Array:
        ahead = batch.contacts(index, times + delay, place + shift).distance
        behind = batch.contacts(index, times - delay, place - shift).distance
        return (ahead - behind) / (2.0 * step)

    outside = contacts.distance > -0.25
    assert outside.sum() > 500 and batch.turning[index[outside]].sum() > 80
    np.testing.assert_allclose(contacts.rate[outside], difference(step, np.zeros(2))[outside], atol=5e-6)
    for axis in range(2):
        slope = difference(0.0, np.eye(2)[axis] * step)
        np.testing.assert_allclose(contacts.normal[outside, axis], slope[outside], atol=5e-6)


def test_bounds_of_turning_zones_contain_dense_samples() -> None:
    """A vehicle at constant acceleration, and a supporting line that turns with the zone."""
    _, batch = batch_of(KINDS)
    rng = np.random.default_rng(6)
    count = 300
    index = rng.integers(0, batch.size, count)
    middle, half = rng.uniform(0.5, 6.0, count), rng.choice([0.3, 0.05, 0.005], count)
    place, velocity, pull = (rng.normal(size=(count, 2)) * scale for scale in (6.0, 2.0, 1.5))
    contacts = batch.contacts(index, middle, place)
    bend = ZoneBounds(batch).second_bound(index, middle, half, contacts.normal, place, velocity, np.hypot(*pull.T))
    step = 1e-3

    def heading(t: Array) -> Array:
        v = batch.velocities.at(index, t)
        return np.where(batch.turning[index], np.arctan2(v[:, 1], v[:, 0]), 0.0)

    def gap(t: Array) -> Array:
        turn, (x, y) = heading(t) - heading(middle), contacts.normal.T
        nu = np.stack([np.cos(turn) * x - np.sin(turn) * y, np.sin(turn) * x + np.cos(turn) * y], axis=1)
        there = place + (t - middle)[:, None] * velocity + 0.5 * ((t - middle) ** 2)[:, None] * pull
        value = np.einsum("ij,ij->i", nu, there - batch.centers.at(index, t)) - batch.radius[index]
        for row in range(count):
            zone = index[row]
            if batch.slot[zone] >= 0:
                assert batch.covariances is not None
                packed = batch.covariances.at(batch.slot[zone : zone + 1], t[row : row + 1])[0]
                value[row] -= np.sqrt(nu[row] @ packed[[0, 1, 1, 2]].reshape(2, 2) @ nu[row])
            if batch.outline_slot[zone] >= 0:
                assert batch.outlines is not None
                angle = -heading(t)[row]
                c, s = np.cos(angle), np.sin(angle)
                own = np.array([c * nu[row, 0] - s * nu[row, 1], s * nu[row, 0] + c * nu[row, 1]])
                value[row] -= batch.outlines.outlines[batch.outline_slot[zone]].support(own)
        return value

    np.testing.assert_allclose(gap(middle), contacts.distance, atol=1e-9)
    assert np.isfinite(bend).mean() > 0.9
    moving = MovingPoint(middle, half, place, velocity, np.hypot(*pull.T))
    crude = ZoneBounds(batch).crude(moving)
    bounds = ZoneBounds(batch).fine(index, np.arange(count), moving)
    np.testing.assert_allclose(bounds.value, contacts.distance, atol=1e-12)
    for x in np.linspace(-1.0, 1.0, 7):
        t = middle + x * half
        values = [gap(t + s * step) for s in (-1, 0, 1)]
        second = (values[0] - 2.0 * values[1] + values[2]) / step**2
        assert np.all(-second <= bend + 1e-4)
        # and the line separates: it never says more than the true distance
        true = batch.contacts(
            index, t, place + (t - middle)[:, None] * velocity + 0.5 * ((t - middle) ** 2)[:, None] * pull
        )
        assert np.all(values[1] <= true.distance + 1e-9)
        assert np.all(bounds.lower <= true.distance + 1e-9)
        assert np.all(crude[np.arange(count), index] <= true.distance + 1e-9)


def test_estimated_headings_are_not_trusted() -> None:
    zone = sp.zones(scene(seen("car", {"rectangle": [4.0, 3.0]}, 1)))[0]
    disc = sp.zones(scene(seen("car", {"disc": 2.5}, 1)))[0]
    place = np.random.default_rng(0).normal(size=(50, 2)) * 8.0
    np.testing.assert_allclose(zone.signed_distance(2.0, place), disc.signed_distance(2.0, place))


def test_what_sets_off_heads_where_it_accelerates() -> None:
    """At rest at the start: its heading then is that of the next moment, in the check of the start too."""
    car = shaped("car", {"rectangle": [4.0, 1.0]}, (1.5, 0.0), (0.0, 0.0), (0.0, 1.0))
    zone = sp.zones(scene(car))[0]
    np.testing.assert_allclose(zone.signed_distance(0.0, np.array([[2.5, 0.0], [1.5, 2.5]])), [0.5, 0.5])
