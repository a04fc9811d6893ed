"""What the loop knows of a trip, against dense samples of it."""

from __future__ import annotations

import numpy as np
import pytest
from scenes import disc, scene
from slopes import problem_and_trip

from scp_planner.problem.build import build_problem
from scp_planner.scp.bend_sites import bend_sites, station_sites
from scp_planner.scp.evaluation import SAMPLE_STRIDE, among_smaller, evaluate_trip
from scp_planner.scp.linearisation import TrustRegion, linearise
from scp_planner.scp.merit import Limit, Penalties
from scp_planner.settings.planning import Settings
from scp_planner.threat_zones.of_scenario import zones
from scp_planner.trips.trajectory import Trajectory

pytestmark = pytest.mark.numerics


@pytest.mark.parametrize("degree", [0, 1, 2])
@pytest.mark.parametrize("seed", range(4))
def test_violations_are_those_of_dense_samples_and_the_merit_is_their_price(degree: int, seed: int) -> None:
    problem, trip = problem_and_trip(degree, seed=seed)
    found = evaluate_trip(problem, trip, 1.0)
    points = trip.at(problem.space.time_table(np.linspace(0.0, 1.0, 20_001)))
    entry = -problem.zones.distances(points.time, points.path.position, np.inf).min(axis=0)
    # Between samples the minimum of a parabola is looked at: no deeper than the deepest, and nearer to it
    at_samples = problem.zones.distances(found.points.time, found.points.path.position, 1.0)
    deepest, sampled = np.maximum(entry, 0.0), np.maximum(-at_samples.min(axis=0), 0.0)
    assert found.clearance == pytest.approx(at_samples[: problem.grid : SAMPLE_STRIDE], abs=1e-12)
    assert np.all(found.zone_violation <= deepest + 1e-6)
    assert np.all(deepest - found.zone_violation <= 0.5 * (deepest - sampled) + 1e-6)
    speed = np.abs(points.speed).max() / problem.limits.speed - 1.0
    assert found.limit_violation[Limit.SPEED] == pytest.approx(max(speed, 0.0), abs=1e-3)
    box = problem.box.offsets - trip.path.station_positions @ problem.box.normals.T
    assert found.limit_violation[Limit.WORKSPACE_BOUNDS] == pytest.approx(max(-box.min(), 0.0), abs=1e-12)
    assert found.worst_violation == max(found.zone_violation.max(), found.limit_violation.max())
    price = 7.0 * (found.zone_violation.sum() + found.limit_violation.sum())
    assert found.merit(Penalties.uniform(problem, 7.0)) == pytest.approx(trip.travel_time + price)


@pytest.mark.parametrize("seed", [0, 2, 3, 4, 6, 11])
def test_lateral_accelerations_over_a_curved_guide_are_seen_between_stations(seed: int) -> None:
    rng = np.random.default_rng(seed)
    turns = np.cumsum(rng.uniform(0.2, 0.4, 40) * (-1.0) ** np.arange(40))
    legs = np.stack([np.cos(turns), np.sin(turns)], axis=1) * rng.uniform(0.3, 0.6, (40, 1))
    line = np.concatenate([[[0.0, 0.0]], np.cumsum(legs, axis=0)]).tolist()
    scenario = scene(guide=line, goal={"position": line[-1]}, start={"heading": None, "speed": 3.0})
    problem = build_problem(scenario, (), Settings())
    space = problem.space
    beta = 0.1 * rng.choice([-1.0, 1.0], space.acceleration_size)  # the speed turns wherever it likes
    trip = Trajectory.of(space, np.zeros(space.path_size), beta)
    found = bend_sites(problem, trip, trip.at(problem.samples))
    lateral = np.abs(station_sites(trip, np.linspace(0.0, 1.0, 40_001)).lateral).max()
    assert lateral > problem.limits.lateral_acceleration, "else nothing is to be seen"
    assert found.worst_lateral == pytest.approx(lateral, rel=1e-4)


@pytest.mark.parametrize("seed", range(4))
def test_zones_smaller_than_the_way_between_samples_are_entered_as_deep_as_they_are(seed: int) -> None:
    rng = np.random.default_rng(seed)
    # Each would be met at full speed, a little before or behind its middle.
    places, speeds, early = np.linspace(2.0, 18.0, 9), rng.uniform(0.5, 1.5, 9), rng.uniform(-0.02, 0.02, 9)
    crossers = [
        disc(f"c{k}", (float(x), float(-v * (x / 3.0 + s))), (0.0, float(v)), radius=0.02)
        for k, (x, v, s) in enumerate(zip(places, speeds, early, strict=True))
    ]
    scenario = scene(*crossers, vehicle={"radius": 0.02}, start={"speed": 3.0})
    problem = build_problem(scenario, zones(scenario), Settings())
    space = problem.space
    trip = Trajectory.of(space, np.zeros(space.path_size), np.zeros(space.acceleration_size))
    found = evaluate_trip(problem, trip, 1.0).zone_violation
    # Both drive straight on: seen from the crosser, the vehicle passes by on a line. Zones are rounded a little.
    missed = np.abs(early) * speeds * 3.0 / np.hypot(speeds, 3.0)
    assert found == pytest.approx(problem.zones.radius - missed, abs=1e-6)


@pytest.mark.parametrize("seed", range(4))
def test_a_trip_among_smaller_zones_is_evaluated_as_if_for_the_first_time(seed: int) -> None:
    smaller, trip = problem_and_trip(1, seed=seed)
    less = np.linspace(0.1, 0.6, smaller.zones.size)
    problem = smaller.among(smaller.zones.inflated(less))
    expected, before = evaluate_trip(smaller, trip, 1.0), evaluate_trip(problem, trip, 1.0)
    found = among_smaller(before, less)
    assert before.zone_violation.sum() > expected.zone_violation.sum() > 0.0
    near = expected.clearance < 0.1  # farther away, clearances are bounds
    assert near.any() and found.clearance[near] == pytest.approx(expected.clearance[near], abs=1e-9)
    assert np.all(found.clearance[~near] > 0.1 - 1e-9)
    assert found.zone_violation == pytest.approx(expected.zone_violation, abs=1e-9)
    assert found.worst_violation == pytest.approx(expected.worst_violation, abs=1e-9)
    close = found.minima_contacts.distance < 0.1
    assert np.array_equal(found.minima_zone[close], expected.minima_zone[expected.minima_contacts.distance < 0.1])
    assert found.minima_contacts.distance[close] == pytest.approx(
        expected.minima_contacts.distance[expected.minima_contacts.distance < 0.1], abs=1e-9
    )


def test_walls_that_overlap_are_entered_once() -> None:
    bent = [[[-1, -1], [9, -1], [9, 1], [-1, 1]], [[7, -1], [9, -1], [9, 9], [7, 9]]]
    scenario = scene(disc("a", (4.0, 0.0)), goal={"position": [8.0, 8.0]}, corridor=bent)
    problem = build_problem(scenario, zones(scenario), Settings())
    space = problem.space
    theta = problem.ends.theta.copy()
    theta[problem.ends.free] += 2.5 * np.sin(np.linspace(0.0, 6.0, problem.ends.free.stop - problem.ends.free.start))
    astray = Trajectory.of(space, theta, np.zeros(space.acceleration_size))
    found = evaluate_trip(problem, astray, 1.0)
    points = astray.at(problem.space.time_table(np.linspace(0.0, 1.0, 20_001)))
    entry = -problem.zones.distances(points.time, points.path.position, np.inf).min(axis=0)
    walls = np.array(problem.zones.ids) == "corridor"
    assert (entry[walls] > 0.5).sum() > 1, "it is to be in several walls at once"
    assert found.zone_violation[walls].sum() == pytest.approx(entry[walls].max(), abs=1e-3)
    rows = linearise(problem, found, TrustRegion(1.0, 1.0, 0.1), 1.0)
    violated = np.unique(rows.group[rows.gap < 0.0])
    assert np.all(found.zone_violation[violated[violated < problem.zones.size]] > 0.0), "each has what it is about"
