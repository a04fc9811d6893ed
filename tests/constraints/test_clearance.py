"""When trips are nearest to corners, against dense samples of them."""

from __future__ import annotations

import numpy as np
import pytest
from scenes import scene

from scp_planner.problem.build import build_problem
from scp_planner.settings.planning import Settings
from scp_planner.threat_zones.of_scenario import zones
from scp_planner.trips.trajectory import Trajectory

pytestmark = pytest.mark.numerics


@pytest.mark.parametrize("turn", [0.02, 0.3, 1.5])
@pytest.mark.parametrize("speed", [0.0, 0.7])
def test_corners_that_stand_or_come_are_passed_as_near_as_they_are(turn: float, speed: float) -> None:
    rng = np.random.default_rng(5)
    # Roofs over the way, each with its ridge somewhere between two samples
    roofs = [
        {
            "id": f"roof{k}",
            "shape": {"polygon": [(0.0, 0.0), (-2.0, -2.0 * np.tan(turn / 2)), (2.0, -2.0 * np.tan(turn / 2))]},
            "motion": {"position": (float(x), -0.36), "velocity": (-speed, 0.0)},
        }
        for k, x in enumerate(rng.uniform(5.0, 15.0, 8))
    ]
    scenario = scene(*roofs, vehicle={"radius": 0.3}, start={"speed": 2.0})
    problem = build_problem(scenario, zones(scenario), Settings())
    space = problem.space
    theta = 0.05 * np.sin(np.linspace(0.0, np.pi, space.path_size)) ** 2
    trip = Trajectory.of(space, theta, np.linspace(0.2, -0.2, space.acceleration_size))
    clearance = problem.constraints[0]
    dense = trip.at(space.time_table(np.linspace(0.0, 1.0, 40_001)))
    expected = problem.zones.distances(dense.time, dense.path.position).min(axis=0)
    np.testing.assert_allclose(-clearance.worst(trip, clearance.excess(trip)), expected, atol=2e-6)
