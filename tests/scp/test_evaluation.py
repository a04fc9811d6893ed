"""What the loop knows of a trip, against dense samples of it."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scenes import disc, scene
from slopes import curved_problem_and_trip, differences, problem_and_trip

from scp_planner.arrays import rows_of
from scp_planner.constraints.lateral import fixed_sites, station_sites
from scp_planner.problem.build import build_problem
from scp_planner.scp.evaluation import Evaluation, evaluate_trip
from scp_planner.scp.linearisation import TrustRegion, linearise, rows_within
from scp_planner.scp.merit import Penalties
from scp_planner.settings.planning import Settings
from scp_planner.threat_zones.of_scenario import zones
from scp_planner.trips.trajectory import Trajectory

pytestmark = pytest.mark.numerics


def of_zones(found: Evaluation) -> np.ndarray:
    return found.violations[: found.zones]


@pytest.mark.parametrize("degree", [0, 1, 2])
@pytest.mark.parametrize("seed", range(4))
def test_violations_are_those_of_dense_samples_and_the_merit_is_their_price(degree: int, seed: int) -> None:
    problem, trip = problem_and_trip(degree, seed=seed)
    found = evaluate_trip(problem, trip)
    points = trip.at(problem.space.time_table(np.linspace(0.0, 1.0, 20_001)))
    entry = -problem.zones.distances(points.time, points.path.position, np.inf).min(axis=0)
    # Between samples the minimum of a parabola is looked at: no deeper than the deepest, and nearer to it
    at_samples = problem.zones.distances(found.points.time, found.points.path.position, 1.0)
    deepest, sampled = np.maximum(entry, 0.0), np.maximum(-at_samples.min(axis=0), 0.0)
    assert np.all(of_zones(found) <= deepest + 1e-6)
    assert np.all(deepest - of_zones(found) <= 0.5 * (deepest - sampled) + 1e-6)
    others = dict(zip([one.name for one in problem.constraints[1:]], found.violations[found.zones :], strict=True))
    speed = np.abs(points.speed).max() / problem.limits.speed - 1.0
    assert others["speed"] == pytest.approx(max(speed, 0.0), abs=1e-3)
    box = problem.box.offsets - trip.path.station_positions @ problem.box.normals.T
    assert others["workspace bounds"] == pytest.approx(max(-box.min(), 0.0), abs=1e-12)
    assert found.limit_violation == max(others.values())
    assert found.worst_violation == max(of_zones(found).max(), found.limit_violation)
    price = 7.0 * (of_zones(found).sum() + sum(others.values()))
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
    (limit,) = (one for one in problem.constraints if one.name == "lateral_acceleration")
    found = limit.worst(trip, limit.excess(trip))[0]
    lateral = np.abs(station_sites(trip, np.linspace(0.0, 1.0, 40_001)).lateral).max()
    assert lateral > problem.limits.lateral_acceleration, "else nothing is to be seen"
    assert found + 1.0 == pytest.approx(lateral / problem.limits.lateral_acceleration, rel=1e-4)


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
    found = of_zones(evaluate_trip(problem, trip))
    # Both drive straight on: seen from the crosser, the vehicle passes by on a line. Zones are rounded a little.
    missed = np.abs(early) * speeds * 3.0 / np.hypot(speeds, 3.0)
    assert found == pytest.approx(problem.zones.radius - missed, abs=1e-6)


def test_walls_that_overlap_are_entered_once() -> None:
    bent = [[[-1, -1], [9, -1], [9, 1], [-1, 1]], [[7, -1], [9, -1], [9, 9], [7, 9]]]
    scenario = scene(disc("a", (4.0, 0.0)), goal={"position": [8.0, 8.0]}, corridor=bent)
    problem = build_problem(scenario, zones(scenario), Settings())
    space = problem.space
    theta = problem.ends.theta.copy()
    theta[problem.ends.free] += 2.5 * np.sin(np.linspace(0.0, 6.0, problem.ends.free.stop - problem.ends.free.start))
    astray = Trajectory.of(space, theta, np.zeros(space.acceleration_size))
    found = evaluate_trip(problem, astray)
    points = astray.at(problem.space.time_table(np.linspace(0.0, 1.0, 20_001)))
    entry = -problem.zones.distances(points.time, points.path.position, np.inf).min(axis=0)
    walls = np.array(problem.zones.ids) == "corridor"
    assert (entry[walls] > 0.5).sum() > 1, "it is to be in several walls at once"
    assert of_zones(found)[walls].sum() == pytest.approx(entry[walls].max(), abs=1e-3)
    rows = linearise(problem, found, TrustRegion(1.0, 1.0, 0.1))
    violated = np.unique(rows.group[rows.gap < 0.0])
    assert np.all(of_zones(found)[violated[violated < problem.zones.size]] > 0.0), "each has what it is about"


# What a step could violate, linearised: nothing is left out that it could

Array = np.ndarray


@pytest.mark.parametrize("made", [problem_and_trip, curved_problem_and_trip])
def test_rows_out_of_reach_are_left_out_and_cannot_be_violated(made: Any) -> None:
    problem, trip = made(0)
    base = evaluate_trip(problem, trip)
    trust = TrustRegion(0.05, 0.1, 0.01)
    some, every = linearise(problem, base, trust), linearise(problem, base, trust.scaled(1e6))
    assert 0 < len(some.gap) < len(every.gap)
    again = rows_within(problem, every, trust)
    np.testing.assert_array_equal(again.key, some.key)
    np.testing.assert_array_equal(again.matrix, some.matrix)
    box = np.full(every.matrix.shape[1], trust.beta)
    free = problem.ends.free
    box[: free.stop - free.start] = trust.theta * problem.space.tables.leverage[free]
    box[-1] = trust.rho
    rng = np.random.default_rng(4)
    left = rows_of(every, np.flatnonzero(~np.isin(every.key, some.key)))
    assert len(left.gap) == len(every.gap) - len(some.gap)
    for _ in range(200):
        assert np.all(left.matrix @ (box * rng.choice([-1.0, 1.0], len(box))) <= left.gap)


def test_a_straight_path_is_kept_from_bending_too_much_in_one_step() -> None:
    problem, trip = problem_and_trip(0)
    straight = Trajectory.of(problem.space, problem.ends.theta, trip.beta, trip.travel_time)
    base, trust = evaluate_trip(problem, straight), TrustRegion(1.0, 1.0, 0.1)
    assert np.abs(fixed_sites(straight).lateral).max() < 0.1 * problem.limits.lateral_acceleration
    rows = linearise(problem, base, trust)

    def lateral(other: Trajectory) -> Array:
        return fixed_sites(other).lateral / problem.limits.lateral_acceleration

    use, rng = differences(problem, straight, lateral, 1e-5), np.random.default_rng(5)
    free = problem.ends.free
    for _ in range(20):
        z = np.zeros(problem.step_size)
        count = free.stop - free.start
        z[:count] = trust.theta * problem.space.tables.leverage[free] * rng.choice([-1.0, 1.0], count)
        worst = float(np.abs(use @ z).max()) - 1.0
        assert worst > 0.0, "the step is to bend too much"
        assert float((rows.matrix @ z - rows.gap).max()) >= worst - 1e-3
