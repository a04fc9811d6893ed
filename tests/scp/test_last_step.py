"""What the loop learns of the curvature of its constraints, against differences of the Lagrangian."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scenes import CROSSERS, scene
from slopes import moved

import scp_planner as sp
from scp_planner.constraints.drive import DriveRows
from scp_planner.constraints.rows import Rows
from scp_planner.problem.build import build_problem
from scp_planner.problem.problem import Problem
from scp_planner.scp.last_step import DAMPING, LastStep
from scp_planner.settings.planning import Settings
from scp_planner.trips.trajectory import Trajectory

pytestmark = pytest.mark.numerics

Array = np.ndarray
PRICES = np.array([0.7, 0.0, 1.3, 0.4])
ARRIVAL, UP, DOWN = -3.0, 0.2, 0.1


def clearances(problem: Problem, trip: Trajectory) -> Array:
    """Clearance from the first zone at four fixed times, m."""
    points = trip.at(problem.samples).take(np.array([40, 60, 80, 100]))
    return problem.zones.contacts(np.zeros(4, dtype=int), points.time, points.path.position).distance


def rows_at(problem: Problem, trip: Trajectory) -> Rows:
    clearance = problem.constraints[0].smooth(problem.samples)
    index = np.array([40, 60, 80, 100]) * problem.zones.size
    return Rows(clearance.gradient(trip, index), -clearance.excess(trip)[index], np.zeros(4, dtype=int), index)


@pytest.fixture
def step() -> tuple[Problem, LastStep, Array]:
    scenario = scene(*CROSSERS)
    problem = build_problem(scenario, sp.zones(scenario), Settings())
    rng = np.random.default_rng(0)
    theta = problem.ends.theta.copy()
    free = problem.ends.free
    theta[free] = 0.3 * rng.normal(size=free.stop - free.start)
    trip = Trajectory.of(problem.space, theta, rng.uniform(-0.1, 0.4, problem.space.acceleration_size))
    z = 1e-3 * rng.normal(size=problem.step_size)
    drive, accelerations = DriveRows(problem), problem.space.acceleration_size
    prices = np.zeros(drive.count)  # of arrival, speeds, then the upper and the lower bounds of accelerations
    prices[0], prices[-2 * accelerations + 2], prices[-accelerations + 5] = ARRIVAL, UP, DOWN
    rows = rows_at(problem, trip)
    active = np.flatnonzero(PRICES)
    last = LastStep(
        trip,
        moved(problem, trip, z),
        z,
        rows.key[active],
        rows.matrix[active],
        PRICES[active],
        ARRIVAL,
        drive.timing_curvature(prices),
    )
    return problem, last, z


def lagrangian(problem: Problem, trip: Trajectory, first: Trajectory) -> float:
    """Of what is active: clearances, arrival, and two bounds of the acceleration; what is linear is left out."""
    tau, b = trip.travel_time, trip.travel_time**2 * trip.beta
    highest, lowest = problem.highest_accelerations[2], problem.lowest_accelerations[5]
    bounds = UP * (b[2] - highest * tau**2) + DOWN * (lowest * tau**2 - b[5])
    return float(-PRICES @ clearances(problem, trip) - ARRIVAL * trip.path.arc_length + bounds / first.travel_time**2)


def test_change_of_the_gradient_is_the_curvature_of_the_lagrangian(step: tuple[Problem, LastStep, Array]) -> None:
    problem, last, z = step
    h = 2.0

    def value(share: float) -> float:
        return lagrangian(problem, moved(problem, last.start, share * z), last.start)

    # Central second difference along the step about its middle
    curvature = (value(0.5 + h) - 2.0 * value(0.5) + value(0.5 - h)) / h**2
    change = last.gradient_change(problem, rows_at(problem, last.end))
    assert float(z @ change) == pytest.approx(curvature, rel=2e-3)


def test_the_corrected_hessian_explains_the_step_and_stays_definite(step: tuple[Problem, LastStep, Array]) -> None:
    problem, last, z = step
    size = problem.step_size
    proximal = np.full(size, 1e-2)
    rows = rows_at(problem, last.end)
    # What bends downwards is damped, see below; here the path's length bends it upwards.
    convex = replace(last, arrival=-100.0)
    change = convex.gradient_change(problem, rows) + proximal * z
    assert float(z @ change) > 0.0
    for scale in (0.1, 1.0, 4.0):
        # Models that are softer, as stiff, and stiffer than what was seen
        model = scale * np.eye(size) * float(z @ change) / float(z @ z)
        hessian = model.copy()
        convex.teach(problem, rows, hessian, proximal)
        np.testing.assert_allclose(hessian @ z, change, rtol=1e-9, atol=1e-12)
        assert np.linalg.eigvalsh(hessian).min() > 0.0


def test_negative_curvature_is_damped(step: tuple[Problem, LastStep, Array]) -> None:
    problem, last, z = step
    concave = replace(last, timing=-1e6)
    hessian = np.eye(problem.step_size)
    concave.teach(problem, rows_at(problem, last.end), hessian, np.zeros(problem.step_size))
    assert float(z @ hessian @ z) == pytest.approx(DAMPING * float(z @ z))
    assert np.linalg.eigvalsh(hessian).min() > 0.0
