"""What a certificate finds missing is asked for: more of just that, and enough."""

from __future__ import annotations

import numpy as np
import pytest
from scenes import CROSSERS, scene

from scp_planner.certificate.verdict import Certificate, Clearance, Violation
from scp_planner.problem.build import build_problem
from scp_planner.problem.limits.drive import PowerLimit, TotalAccelerationLimit
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


@pytest.mark.parametrize("name", ["speed", "lateral_acceleration", "curvature"])
def test_a_limit_that_is_exceeded_is_lowered_by_more_than_that(problem: Problem, name: str) -> None:
    allowed = getattr(problem.limits, name)
    asked = tightened(problem, found(Violation(name, allowed * 1.002, allowed, 1.0)))
    for other in ("speed", "lateral_acceleration", "curvature", "acceleration", "deceleration"):
        before, after = getattr(problem.limits, other), getattr(asked.limits, other)
        if other == name:
            assert 0.996 * before < after < 0.998 * before
        else:
            assert after == before
    assert np.array_equal(asked.zones.radius, problem.zones.radius)
    assert np.array_equal(asked.box.offsets, problem.box.offsets)


def test_all_parts_of_an_entered_zone_grow_by_more_than_the_entry(problem: Problem) -> None:
    asked = tightened(problem, found(Violation("clearance", -0.01, 0.0, 1.0, "pocket")))
    grown = asked.zones.radius - problem.zones.radius
    mine = np.array([name == "pocket" for name in problem.zones.ids])
    assert mine.sum() > 1
    assert grown[mine] == pytest.approx(np.full(mine.sum(), 0.016))
    assert np.all(grown[~mine] == 0.0)


def test_the_workspace_shrinks_by_more_than_the_trip_left_it(problem: Problem) -> None:
    asked = tightened(problem, found(Violation("workspace bounds", -0.01, 0.0, 1.0)))
    assert problem.box.offsets - asked.box.offsets == pytest.approx(np.full(4, 0.016))


def test_driving_backwards_is_nothing_that_a_lower_limit_would_mend(problem: Problem) -> None:
    assert tightened(problem, found(Violation("speed", -0.01, 0.0, 1.0))).limits == problem.limits


@pytest.mark.parametrize("name", ["speed", "lateral_acceleration", "curvature"])
def test_no_limit_becomes_less_than_half_however_far_it_is_exceeded(problem: Problem, name: str) -> None:
    allowed = getattr(problem.limits, name)
    asked = tightened(problem, found(Violation(name, 9.0 * allowed, allowed, 1.0)), urgency=4.0)
    assert getattr(asked.limits, name) == 0.5 * allowed


def test_a_limit_that_is_exceeded_between_samples_is_looked_at_there() -> None:
    scenario = scene(vehicle={"max_power": 2.0, "max_total_acceleration": 2.2}, start={"time": 3.0})
    problem = build_problem(scenario, zones(scenario), Settings())
    certificate = found(Violation("total_acceleration", 2.21, 2.2, 5.0))
    tyres, motor = (
        {one.name: one for one in tightened(problem, certificate, travel_time=8.0).optional}[name]
        for name in ("total_acceleration", "power")
    )
    before = {one.name: one.times for one in problem.optional if isinstance(one, TotalAccelerationLimit | PowerLimit)}
    assert isinstance(tyres, TotalAccelerationLimit)
    assert isinstance(motor, PowerLimit)
    assert motor.times is before["power"]
    more = tyres.times.sigma[len(before["total_acceleration"].sigma) :]
    assert np.abs(more - 0.25).min() < 1e-12
    assert np.abs(more - 0.25).max() == pytest.approx(0.5 / problem.grid)
    trip = Trajectory.of(problem.space, problem.ends.theta, np.full(problem.space.acceleration_size, 0.1))
    assert len(tyres.excess(trip)) == len(tyres.times.sigma) * len(tyres.beside)
