"""Recordings of plans, as pictures show them."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scenes import disc, scene
from shapely import Polygon, unary_union

import scp_planner as sp
from scp_planner import builtin
from scp_planner.arrays import Array
from scp_planner.plotting.recording import record_plan
from scp_planner.plotting.scales import nice_times


@pytest.mark.parametrize("name", builtin.names())
def test_boundaries_lie_on_the_zones(name: str) -> None:
    scenario = builtin.load(name)
    plan = sp.plan(scenario)
    recording = record_plan(plan, scenario, 7)
    for zone, obstacle in zip(sp.zones(scenario), recording.obstacles, strict=True):
        points = obstacle.center[:, None] + obstacle.boundary[:, 0]
        times = np.broadcast_to(recording.time[:, None], points.shape[:2])
        assert np.abs(zone.signed_distance(times, points)).max() < 1e-6
        # In order, once around.
        assert all(Polygon(outline).is_valid and Polygon(outline).exterior.is_ccw for outline in points)


def test_an_obstacle_of_several_futures_is_one_with_the_zones_of_all() -> None:
    seen = {"time": [0.0, 9.0], "position": [[9.0, -4.0], [14.0, 2.0]], "covariance": [[0.04, 0.0], [0.0, 0.01]]}
    exact = {"position": [9.0, -4.0], "velocity": [0.0, 0.6]}
    futures = [{"weight": 0.4, "motion": seen}, {"weight": 0.6, "motion": exact}]
    fork = {"id": "fork", "shape": {"disc": 0.4}, "motion": {"futures": futures}}
    scenario = scene(fork, disc("post", (5.0, 3.0)))
    plan = sp.plan(scenario)
    recording = record_plan(plan, scenario, 9)
    assert [obstacle.id for obstacle in recording.obstacles] == ["fork", "post"]
    record, zones = recording.obstacles[0], sp.zones(scenario)[:2]
    assert record.boundary.shape[1] == 2
    for k, t in enumerate(recording.time):
        for zone, points in zip(zones, record.zone_at(k), strict=True):
            assert zone.signed_distance(t, points) == pytest.approx(np.zeros(len(points)), abs=1e-6)
    each = [zone.signed_distance(recording.time, recording.position) - 0.3 for zone in zones]
    assert record.clearance == pytest.approx(np.min(each, axis=0))
    assert record.center == pytest.approx(zones[0].center(recording.time))  # of the most probable one


def test_clearance_is_from_disc_to_zone(plan: sp.Plan, scenario: sp.Scenario) -> None:
    recording = record_plan(plan, scenario, 9)
    for obstacle in recording.obstacles:
        for i, position in enumerate(recording.position):
            # A polygon within the zone is at most a little farther away than the zone.
            disc = Polygon(position + scenario.vehicle.radius * _circle(720))
            farther = Polygon(obstacle.zone_at(i)[0]).distance(disc)
            assert obstacle.clearance[i] == pytest.approx(farther, abs=0.02)
    least = np.min([obstacle.clearance for obstacle in recording.obstacles], axis=0)
    assert np.array_equal(recording.clearance, least)


def _circle(count: int) -> Array:
    angles = np.linspace(0.0, 2.0 * np.pi, count, endpoint=False)
    return np.stack([np.cos(angles), np.sin(angles)], axis=-1)


def test_a_corner_is_not_filled_in(plan: sp.Plan, scenario: sp.Scenario) -> None:
    """A zone that is not convex is the union of convex pieces."""
    corner = [(-2.0, -2.0), (2.0, -2.0), (2.0, -1.0), (-1.0, -1.0), (-1.0, 2.0), (-2.0, 2.0)]
    motion = sp.Motion(position=(10.0, 30.0), velocity=(0.5, 0.0))
    obstacle = sp.Obstacle(id="corner", shape=sp.PolygonShape(polygon=corner), motion=motion, margin=0.1)
    (record,) = record_plan(plan, scenario.model_copy(update={"obstacles": (obstacle,)}), 3).obstacles
    drawn = unary_union([Polygon(piece) for piece in record.boundary[1]])
    assert drawn.symmetric_difference(Polygon(corner).buffer(0.1, quad_segs=64)).area < 0.01


def test_truth_as_function_and_as_record(plan: sp.Plan, scenario: sp.Scenario) -> None:
    def drift(t: Array) -> Array:
        return np.stack([t, 2.0 * t], axis=-1)

    seen = np.linspace(plan.start_time, plan.start_time + 3.0, 4)
    recording = record_plan(plan, scenario, 50, {"ferry": drift, "tug": (seen, drift(seen))})
    by_id = {obstacle.id: obstacle for obstacle in recording.obstacles}
    driven = by_id["ferry"].truth
    assert driven is not None and np.array_equal(driven, drift(recording.time))
    inside = recording.time <= seen[-1]
    truth = by_id["tug"].truth
    assert truth is not None
    assert np.allclose(truth[inside], drift(recording.time[inside]))
    assert np.isnan(truth[~inside]).all()
    assert by_id["tug"].truth_at(0) is not None and by_id["tug"].truth_at(49) is None
    assert by_id["buoy"].truth is None and by_id["buoy"].truth_at(0) is None


def test_truth_of_nobody_is_refused(plan: sp.Plan, scenario: sp.Scenario) -> None:
    with pytest.raises(ValueError, match="no obstacle 'nobody' in the scenario 'radar'"):
        record_plan(plan, scenario, 5, {"nobody": ([0.0, 1.0], [[0.0, 0.0], [1.0, 1.0]])})


def test_extent_holds_the_trip_and_little_else(plan: sp.Plan, scenario: sp.Scenario) -> None:
    low, high = record_plan(plan, scenario, 50).extent()
    path = plan.position(np.linspace(plan.start_time, plan.arrival_time, 500))
    assert (path - scenario.vehicle.radius > low).all() and (path + scenario.vehicle.radius < high).all()
    # Zones grow to many metres by the end, far from the vehicle; the picture does not.
    assert (high - low).max() < 1.5 * np.ptp(path, axis=0).max()


@given(
    start=st.floats(-1e3, 1e3),
    span=st.floats(1e-3, 1e4),
    most=st.integers(2, 9),
)
def test_nice_times(start: float, span: float, most: int) -> None:
    end = start + span
    times = nice_times(start, end, most)
    assert 2 <= len(times) <= most
    assert times[0] == start and times[-1] == end
    steps = np.diff(times)
    assert (steps > 0.0).all()
    assert np.allclose(steps[:-1], steps[0], rtol=1e-6, atol=1e-9)


@pytest.mark.parametrize("heading", [None, 0.4, -2.0])
@pytest.mark.parametrize("shape", [{"rectangle": [3.0, 1.0]}, {"ellipse": [2.0, 0.5]}])
def test_bodies_lie_on_the_borders_of_their_zones(shape: dict[str, object], heading: float | None) -> None:
    """Turned as the zones are: with the motion, or as they say."""
    motion = {"position": [8.0, 4.0], "velocity": [0.3, -0.2]}
    scenario = scene({"id": "body", "shape": {**shape, "heading": heading}, "motion": motion})
    recording = record_plan(sp.plan(scenario), scenario, 3)
    (zone,), (obstacle,) = sp.zones(scenario), recording.obstacles
    for i, time in enumerate(recording.time):
        body = obstacle.body_at(i)
        assert np.abs(zone.signed_distance(np.full(len(body), time), body)).max() < 1e-6


def test_speed_stands_against_the_limits_of_its_places() -> None:
    limits = [{"from": 5.0, "to": 9.0, "speed": 1.5}, {"from": 15.0, "speed": 2.0}]
    scenario = scene(speed_limits=limits)
    plan = sp.plan(scenario)
    speed, acceleration, *_ = record_plan(plan, scenario, 500).profiles
    x = plan.position(np.linspace(plan.start_time, plan.arrival_time, 500))[:, 0]
    expected = np.where((x >= 5.0) & (x <= 9.0), 1.5, np.where(x >= 15.0, 2.0, 3.0))
    assert speed.upper_at is not None and np.array_equal(speed.upper_at, expected)
    assert (speed.values <= speed.upper_at + 1e-6).all() and speed.upper == 3.0
    assert acceleration.upper_at is None
    assert record_plan(plan, scene(), 5).profiles[0].upper_at is None
