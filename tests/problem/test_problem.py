"""What a problem says of itself, and the tightened one, against the scenario's own numbers."""

from __future__ import annotations

import numpy as np
import pytest
from scenes import CROSSERS, scene

import scp_planner as sp
from scp_planner.problem.build import build_problem
from scp_planner.problem.problem import Problem
from scp_planner.settings.planning import Settings
from scp_planner.trips.trajectory import Trajectory

pytestmark = pytest.mark.numerics
BOX = {"min": [-1.0, -4.0], "max": [21.0, 5.0]}


def problem_of(**changes: object) -> Problem:
    scenario = scene(*CROSSERS, **changes)
    return build_problem(scenario, sp.zones(scenario), Settings())


def test_a_tightened_problem_has_larger_zones_lower_limits_and_a_smaller_box() -> None:
    problem = problem_of(bounds=BOX)
    inflation = np.array([0.1, 0.0, 0.25])
    tight = problem.tightened(inflation, {"lateral_acceleration": 0.2, "curvature": 0.05, "workspace bounds": 0.3})
    times, places = np.linspace(0.0, 6.0, 7), np.random.default_rng(3).uniform(-4.0, 20.0, (7, 2))
    for number, one in enumerate(CROSSERS):
        motion = {key: np.array(value) for key, value in one["motion"].items()}
        t = times[:, None]
        center = motion["position"] + t * motion["velocity"] + 0.5 * t**2 * motion["acceleration"]
        margin = problem.settings.clearance_margin
        radius = one["shape"]["disc"] + problem.scenario.vehicle.radius + margin + inflation[number]
        frame = problem.frame.to_frame(places)
        found = tight.zones.distances(times - problem.frame.time, frame, np.inf)[:, number]
        assert found == pytest.approx(np.hypot(*(places - center).T) - radius, abs=1e-6)  # rounded to 1e-7
    rng, space = np.random.default_rng(4), problem.space
    theta = 0.3 * rng.normal(size=space.path_size)
    trip = Trajectory.of(space, theta, rng.uniform(-0.2, 0.5, space.acceleration_size))
    before, after = (
        {one.name: one.worst(trip, one.excess(trip)).max() for one in each.constraints} for each in (problem, tight)
    )
    assert tight.zones.radius - problem.zones.radius == pytest.approx(inflation, abs=1e-12)
    assert after["curvature"] == pytest.approx((before["curvature"] + 1.0) / 0.95 - 1.0, rel=1e-12)
    assert after["lateral_acceleration"] == pytest.approx((before["lateral_acceleration"] + 1.0) / 0.8 - 1.0, rel=1e-9)
    assert after["workspace bounds"] == pytest.approx(before["workspace bounds"] + 0.3, abs=1e-12)
    assert after["speed"] == before["speed"] and tight.limits.speed == problem.limits.speed
    assert problem.among(tight.zones).zones is tight.zones and problem.among(tight.zones).limits is problem.limits


@pytest.mark.parametrize("given", [None, -0.5])
def test_accelerations_are_bounded_by_the_vehicle_but_for_the_given_one(given: float | None) -> None:
    problem = problem_of(start={"acceleration": given})
    highest, lowest = problem.highest_accelerations, problem.lowest_accelerations
    assert len(highest) == len(lowest) == problem.space.acceleration_size
    assert highest[1:] == pytest.approx(1.5, rel=1e-3) and lowest[1:] == pytest.approx(-2.0, rel=1e-3)
    if given is not None:
        assert (highest[0], lowest[0]) == (given, given)


def test_sizes_are_those_of_the_splines() -> None:
    """A path and a drive of so many spans, with both ends and the start's heading given."""
    problem = problem_of()
    spans, degree = len(problem.space.path.widths), problem.settings.path_degree
    given = degree + spans - (problem.ends.free.stop - problem.ends.free.start)
    assert given == 3  # offset and slope at the start, offset at the goal
    accelerations = len(problem.space.acceleration.widths) + problem.settings.acceleration_degree
    assert problem.step_size == spans + degree - given + accelerations + 1
    assert problem.jumps.sigma == pytest.approx(problem.space.acceleration.breakpoints[1:-1])
    assert problem.agility == pytest.approx(1.0)  # 2 m/s^2 where 2 are usual
