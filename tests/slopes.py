"""Trips a step away from others, and slopes by differences, to hold rows and gradients against."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from scenes import CROSSERS, observed, scene

import scp_planner as sp
from scp_planner.arrays import Array
from scp_planner.baseline.objective import PenalisedObjective
from scp_planner.problem.build import build_problem
from scp_planner.problem.problem import Problem
from scp_planner.settings.planning import Settings
from scp_planner.trips.path import Path
from scp_planner.trips.trajectory import Trajectory

BOX = {"min": [-1.0, -1.3], "max": [21.0, 2.0]}
STEP = 1e-6  # of the finite differences, m and m/s^2


def problem_and_trip(degree: int, heading: float | None = 0.1, seed: int = 0) -> tuple[Problem, Trajectory]:
    scenario = scene(*CROSSERS, observed("seen", 1), start={"heading": heading}, bounds=BOX)
    problem = build_problem(scenario, sp.zones(scenario), Settings(acceleration_degree=degree))
    return problem, trip_near_the_guide(problem, seed)


def curved_problem_and_trip(degree: int, heading: float | None = 0.1, seed: int = 0) -> tuple[Problem, Trajectory]:
    """With a bend in the guide, and two obstacles with corners, the last ones."""
    box: dict[str, Any] = {
        "id": "box",
        "shape": {"rectangle": [2.0, 1.0]},
        "motion": {"position": [13.0, 3.0], "velocity": [-1, -0.5]},
    }
    turning = {**box, "id": "turning", "motion": {**box["motion"], "acceleration": [0.1, 0.4]}}
    scenario = scene(
        *CROSSERS,
        observed("seen", 1),
        box,
        turning,
        start={"heading": heading},
        bounds=BOX,
        guide=[[0.0, 0.0], [8.0, 4.0], [14.0, -1.0], [20.0, 0.0]],
    )
    problem = build_problem(scenario, sp.zones(scenario), Settings(acceleration_degree=degree))
    trip = trip_near_the_guide(problem, seed)
    theta, free = trip.theta, problem.ends.free
    assert np.all((theta[free] < problem.ends.upper[free]) & (theta[free] > problem.ends.lower[free]))
    return problem, trip


def trip_near_the_guide(problem: Problem, seed: int) -> Trajectory:
    """A trip somewhere near the guide, that speeds up and slows down."""
    rng = np.random.default_rng(seed)
    theta = problem.ends.theta.copy()
    free = problem.ends.free
    theta[free] = 0.3 * rng.normal(size=free.stop - free.start)
    beta = rng.uniform(-0.2, 0.5, problem.space.acceleration_size)
    return Trajectory.of(problem.space, theta, beta)


def moved(problem: Problem, trip: Trajectory, z: Array) -> Trajectory:
    """The trip after a step in the variables of the subproblem, without making it consistent again."""
    free, size = problem.ends.free, problem.space.acceleration_size
    count = free.stop - free.start
    theta = trip.theta.copy()
    theta[free] += z[:count]
    beta = (trip.beta + z[count : count + size]) / (1.0 + z[-1]) ** 2
    return Trajectory(Path(problem.space, theta), beta, trip.travel_time * (1.0 + z[-1]))


def differences(problem: Problem, trip: Trajectory, value: Callable[[Trajectory], Array], step: float) -> Array:
    free, size = problem.ends.free, problem.space.acceleration_size
    columns = []
    for k in range(free.stop - free.start + size + 1):
        z = np.zeros(free.stop - free.start + size + 1)
        z[k] = step
        columns.append((value(moved(problem, trip, z)) - value(moved(problem, trip, -z))) / (2 * step))
    return np.array(columns).T


def assert_rows(matrix: Array, differences_of_value: Array, tolerance: float = 2e-5) -> None:
    scale = max(1.0, np.abs(differences_of_value).max())
    np.testing.assert_allclose(matrix / scale, differences_of_value / scale, atol=tolerance)


def random_trips(objective: PenalisedObjective, count: int, seed: int) -> list[Array]:
    """Variables of trips that arrive and do not reverse: the domain, without what can happen only outside."""
    random = np.random.default_rng(seed)
    free = objective.path_size
    found: list[Array] = []
    while len(found) < count:
        theta = random.normal(size=free) * random.choice([0.2, 0.6])
        beta = 0.2 + random.normal(size=objective.size - free) * 0.4
        omega = np.concatenate([theta, beta])
        trajectory = objective.trajectory(omega)
        if np.isfinite(trajectory.travel_time) and trajectory.speed_control_points()[1:].min() > 0.05:
            found.append(omega)
    return found


def finite_differences(objective: PenalisedObjective, omega: Array) -> Array:
    """Central differences of fourth order."""
    slopes = []
    for unit in np.eye(objective.size):
        near, far = (
            (objective.value(omega + k * STEP * unit) - objective.value(omega - k * STEP * unit)) / (2.0 * k * STEP)
            for k in (1, 2)
        )
        slopes.append((4.0 * near - far) / 3.0)
    return np.array(slopes)
