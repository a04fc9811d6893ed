"""What a certificate finds missing is asked for: more of just that, and enough."""

from __future__ import annotations

import numpy as np
import pytest
from scenes import CROSSERS, scene

from scp_planner.certificate.verdict import Certificate, Clearance, Violation
from scp_planner.constraints.box import InBox
from scp_planner.constraints.constraint import Limit
from scp_planner.constraints.power import Power
from scp_planner.constraints.total_acceleration import TotalAcceleration
from scp_planner.problem.build import build_problem
from scp_planner.problem.problem import Problem
from scp_planner.problem.tightening import tightened
from scp_planner.settings.planning import Settings
from scp_planner.threat_zones.of_scenario import zones
from scp_planner.trips.trajectory import Trajectory

pytestmark = pytest.mark.numerics

POCKET = {
    "id": "pocket",
    "shape": {"polygon": [[-2, -2], [2, -2], [2, 2], [-2, 2], [-2, 1.6], [1.6, 1.6], [1.6, -1.6], [-2, -1.6]]},
    "motion": {"position": [9.0, 5.3]},
}


@pytest.fixture(scope="module")
def problem() -> Problem:
    scenario = scene(*CROSSERS, POCKET, bounds={"min": [-5.0, -20.0], "max": [25.0, 20.0]})
    return build_problem(scenario, zones(scenario), Settings())


def found(*violations: Violation) -> Certificate:
    return Certificate(False, Clearance(0.0), {}, violations)


def limits_of(problem: Problem) -> dict[str, float]:
    """Upper limits by name, m/s and so on; of the box how far its upper border is above the middle, m."""
    found = {one.name: one.limit for one in problem.constraints if isinstance(one, Limit)}
    (box,) = (one for one in problem.constraints if isinstance(one, InBox))
    return {**found, box.name: float(box.box.offsets.min())}


@pytest.mark.parametrize("name", ["speed", "lateral_acceleration", "curvature"])
def test_a_limit_that_is_exceeded_is_lowered_by_more_than_that(problem: Problem, name: str) -> None:
    before = limits_of(problem)
    asked = tightened(problem, found(Violation(name, before[name] * 1.002, before[name], 1.0)))
    after = limits_of(asked)
    assert 0.996 * before[name] < after.pop(name) < 0.998 * before.pop(name)
    assert after == before
    assert np.array_equal(asked.zones.radius, problem.zones.radius)
    assert asked.limits.speed == limits_of(asked)["speed"]


def test_all_parts_of_an_entered_zone_grow_by_more_than_the_entry(problem: Problem) -> None:
    asked = tightened(problem, found(Violation("clearance", -0.01, 0.0, 1.0, "pocket")))
    grown = asked.zones.radius - problem.zones.radius
    mine = np.array([name == "pocket" for name in problem.zones.ids])
    assert mine.sum() > 1
    assert grown[mine] == pytest.approx(np.full(mine.sum(), 0.016))
    assert np.all(grown[~mine] == 0.0)


def test_the_workspace_shrinks_by_more_than_the_trip_left_it(problem: Problem) -> None:
    asked = tightened(problem, found(Violation("workspace bounds", -0.01, 0.0, 1.0)))
    box = "workspace bounds"
    assert limits_of(problem)[box] - limits_of(asked)[box] == pytest.approx(0.016)


def test_driving_backwards_is_nothing_that_a_lower_limit_would_mend(problem: Problem) -> None:
    assert limits_of(tightened(problem, found(Violation("speed", -0.01, 0.0, 1.0)))) == limits_of(problem)


@pytest.mark.parametrize("name", ["speed", "lateral_acceleration", "curvature"])
def test_no_limit_becomes_less_than_half_however_far_it_is_exceeded(problem: Problem, name: str) -> None:
    allowed = limits_of(problem)[name]
    asked = tightened(problem, found(Violation(name, 9.0 * allowed, allowed, 1.0)), urgency=4.0)
    assert limits_of(asked)[name] == 0.5 * allowed


def test_a_limit_that_is_exceeded_between_samples_is_looked_at_there() -> None:
    scenario = scene(vehicle={"max_power": 2.0, "max_total_acceleration": 2.2}, start={"time": 3.0})
    problem = build_problem(scenario, zones(scenario), Settings())
    certificate = found(Violation("total_acceleration", 2.21, 2.2, 5.0))
    tyres, motor = (
        {one.name: one for one in tightened(problem, certificate, travel_time=8.0).constraints}[name]
        for name in ("total_acceleration", "power")
    )
    before = {one.name: one.times for one in problem.constraints if isinstance(one, TotalAcceleration | Power)}
    assert isinstance(tyres, TotalAcceleration)
    assert isinstance(motor, Power)
    assert motor.times is before["power"]
    more = tyres.times.sigma[len(before["total_acceleration"].sigma) :]
    assert np.abs(more - 0.25).min() < 1e-12
    assert np.abs(more - 0.25).max() == pytest.approx(0.5 / problem.grid)
    trip = Trajectory.of(problem.space, problem.ends.theta, np.full(problem.space.acceleration_size, 0.1))
    assert len(tyres.excess(trip)) == len(tyres.times.sigma) * len(tyres.beside)
