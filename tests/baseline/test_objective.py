"""The penalised objective: its value against computations from its parts, its gradient against finite differences."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scenes import CROSSERS, disc, scene
from slopes import finite_differences, random_trips

import scp_planner as sp
from scp_planner.baseline.objective import ObjectiveValue, PenalisedObjective
from scp_planner.baseline.priced import (
    places_of,
    soft_excess,
    times_near,
    uniform,
    violation_count,
)
from scp_planner.problem.build import build_problem
from scp_planner.problem.problem import Problem
from scp_planner.scp.evaluation import evaluate_trip
from scp_planner.scp.merit import Penalties
from scp_planner.settings.planning import Settings, for_scene
from scp_planner.threat_zones.of_scenario import zones

SMALL = Settings(path_span=2.5, acceleration_spans=8, samples=80)
SMOOTHER = replace(SMALL, acceleration_degree=1, path_degree=4)


def seen(name: str, position: tuple[float, float], velocity: tuple[float, float]) -> dict[str, Any]:
    """An obstacle whose motion is estimated, with an uncertainty that is no circle and grows."""
    random = np.random.default_rng(7)
    time = np.linspace(-3.0, 0.0, 16)
    noise = random.multivariate_normal(np.zeros(2), [[0.004, 0.002], [0.002, 0.006]], len(time))
    track = np.asarray(position) + time[:, None] * np.asarray(velocity) + noise
    return {
        "id": name,
        "shape": {"disc": 0.5},
        "observations": {"time": time.tolist(), "position": track.tolist(), "covariance": None},
        "model": {"order": 1},
    }


SCENES = {
    "known obstacles": (scene(*CROSSERS), SMALL),
    "estimated obstacles": (
        scene(CROSSERS[0], seen("seen", (12.0, -3.0), (-0.2, 1.0)), seen("far", (15.0, 9.0), (0.0, -0.5))),
        SMALL,
    ),
    "box, goal speed and heading": (
        scene(
            *CROSSERS,
            bounds={"min": [-1.0, -1.5], "max": [21.0, 1.0]},
            goal={"position": [20.0, 0.0], "speed": 1.5, "heading": 0.2},
        ),
        replace(SMALL, max_offset=1.0),
    ),
    "from rest, linear acceleration": (
        scene(*CROSSERS, start={"speed": 0.0, "heading": None}),
        SMOOTHER,
    ),
    "along a bent guide": (
        scene(
            disc("on-the-way", (9.0, 1.5), (0.3, 0.1), radius=0.8),
            disc("late", (16.0, -6.0), (0.0, 0.8), radius=0.7),
            guide=[[0.0, 0.0], [10.0, 2.0], [20.0, 0.0]],
            bounds={"min": [-1.0, -1.0], "max": [21.0, 2.0]},
            start={"heading": None},
        ),
        SMALL,
    ),
    "turned, on another clock": (
        scene(
            {
                "id": "late",
                "shape": {"disc": 0.8},
                "motion": {"position": [100.0, -996.0], "velocity": [1.0, -0.01], "acceleration": [0.0, 0.0]},
            },
            start={"time": 1000.0, "position": [1100.0, -1010.0], "heading": None},
            goal={"position": [1100.0, -990.0]},
        ),
        replace(SMALL, acceleration_degree=2),
    ),
}


def problem_of(name: str) -> Problem:
    scenario, settings = SCENES[name]
    return build_problem(scenario, zones(scenario), settings)


def objective_of(problem: Problem, price: float, width: float = 0.0) -> PenalisedObjective:
    return PenalisedObjective(problem, uniform(problem, price, price), uniform(problem, width, width))


def violation(found: ObjectiveValue, problem: Problem, name: str) -> float:
    (place,) = places_of(problem, name)
    return float(found.violations[place])


# the hinge


@given(st.lists(st.floats(-3.0, 3.0), min_size=1, max_size=8), st.floats(1e-3, 2.0))
def test_the_hinge_is_the_formula(excess: list[float], width: float) -> None:
    g, shares = np.array(excess), np.full(len(excess), 1.0 / len(excess))
    violation, _ = soft_excess(g, shares, width)
    scaled = g.astype(np.longdouble) / width
    top = max(scaled.max(), np.longdouble(0.0))
    expected = width * (top + np.log(np.exp(-top) + np.mean(np.exp(scaled - top))))
    assert violation == pytest.approx(float(expected), rel=1e-12, abs=1e-12)
    assert soft_excess(g, shares, 0.0)[0] == max(0.0, g.max())


@given(st.lists(st.floats(-2.0, 2.0), min_size=2, max_size=6), st.floats(0.05, 2.0))
def test_the_derivative_of_the_hinge(excess: list[float], width: float) -> None:
    g, shares = np.array(excess), np.full(len(excess), 1.0 / len(excess))
    _, derivative = soft_excess(g, shares, width)
    numeric = [
        (soft_excess(g + 1e-5 * unit, shares, width)[0] - soft_excess(g - 1e-5 * unit, shares, width)[0]) / 2e-5
        for unit in np.eye(len(g))
    ]
    assert derivative == pytest.approx(np.array(numeric), abs=1e-7)
    assert np.all(derivative >= 0.0)
    assert derivative.sum() <= 1.0 + 1e-12


def test_what_does_not_count_counts_for_nothing() -> None:
    shares = np.array([0.5, 0.5])
    for width in (0.0, 0.1):
        violation, derivative = soft_excess(np.array([-np.inf, -np.inf]), shares, width)
        assert violation == 0.0
        assert np.all(derivative == 0.0)
    assert soft_excess(np.zeros(0), np.zeros(0), 0.1)[0] == 0.0


# the gradient


@pytest.mark.parametrize(
    "width", [pytest.param(0.3, marks=pytest.mark.slow), 0.05, pytest.param(0.01, marks=pytest.mark.slow), 0.0]
)
@pytest.mark.parametrize("name", SCENES)
def test_the_gradient_agrees_with_finite_differences(name: str, width: float) -> None:
    problem = problem_of(name)
    objective = PenalisedObjective(problem, uniform(problem, 5.0, 7.0), uniform(problem, width, 0.5 * width))
    for omega in random_trips(objective, 2, seed=1):
        gradient = objective.gradient(omega)
        scale = max(1.0, float(np.abs(gradient).max()))
        assert gradient == pytest.approx(finite_differences(objective, omega), abs=1e-6 * scale)


def test_the_gradient_with_margins_and_more_samples() -> None:
    problem = problem_of("estimated obstacles")
    plain = objective_of(problem, 5.0, 0.02)
    omega = random_trips(plain, 1, seed=3)[0]
    margins = np.concatenate([[0.3, 0.2, 0.1], np.full(violation_count(problem) - 3, 0.05)])
    sigma = times_near(problem, plain.trajectory(omega), 3.0)
    objective = PenalisedObjective(problem, plain.prices, plain.widths, sigma, margins)
    assert len(sigma) > len(problem.samples.sigma)
    assert objective.value(omega) > plain.value(omega)
    assert objective.gradient(omega) == pytest.approx(finite_differences(objective, omega), abs=1e-5)


def test_the_use_of_a_violation_is_its_derivative_by_a_margin() -> None:
    problem = problem_of("known obstacles")
    base = objective_of(problem, 5.0, 0.1)
    omega = random_trips(base, 1, seed=4)[0]
    known = base.evaluate(omega)
    for index in range(problem.zones.size + 3):
        margins = np.zeros(violation_count(problem))
        margins[index] = 1e-6
        moved = PenalisedObjective(problem, base.prices, base.widths, margins=margins).evaluate(omega)
        assert (moved.violations - known.violations)[index] / 1e-6 == pytest.approx(known.use[index], abs=1e-5)


# the value


@pytest.mark.parametrize("name", SCENES)
def test_violations_of_zones_are_those_of_the_public_zones(name: str) -> None:
    """From positions in the world and `ThreatZone.signed_distance`, integrated by the trapezoidal rule."""
    scenario, settings = SCENES[name]
    problem = problem_of(name)
    width = 0.1
    objective = objective_of(problem, 5.0, width)
    for omega in random_trips(objective, 3, seed=5):
        found, trajectory = objective.evaluate(omega), objective.trajectory(omega)
        sigma = np.unique(problem.samples.sigma)
        points = trajectory.at(problem.space.time_table(sigma))
        world = problem.frame.to_world(points.path.position)
        keep = scenario.vehicle.radius + for_scene(settings).clearance_margin
        for index, zone in enumerate(sp.zones(scenario)):
            clearance = zone.signed_distance(problem.frame.time + points.time, world) - keep
            expected = width * np.log1p(np.trapezoid(np.exp(-clearance / width), sigma))
            assert found.violations[index] == pytest.approx(expected, rel=1e-8, abs=1e-12)


def test_violations_of_limits_are_those_of_the_trip() -> None:
    problem = problem_of("box, goal speed and heading")
    objective = objective_of(problem, 1.0)
    limits = problem.limits
    for omega in random_trips(objective, 5, seed=6):
        found, trajectory = objective.evaluate(omega), objective.trajectory(omega)
        speeds = trajectory.speed_control_points()[1:]
        assert violation(found, problem, "speed") == pytest.approx(max(0.0, speeds.max() / limits.speed - 1.0))
        assert violation(found, problem, "reverse") == pytest.approx(max(0.0, -speeds.min() / limits.speed))
        use = np.maximum(trajectory.beta / limits.acceleration, -trajectory.beta / limits.deceleration)
        assert violation(found, problem, "acceleration") == pytest.approx(max(0.0, use.max() - 1.0))
        assert violation(found, problem, "goal speed") == pytest.approx(abs(trajectory.final_speed - 1.5))
        stations = trajectory.path.points(problem.space.tables.station_parameters)
        theta, ends = trajectory.theta[problem.ends.free], problem.ends
        offset = max((theta - ends.upper[ends.free]).max(), (ends.lower[ends.free] - theta).max(), 0.0)
        assert violation(found, problem, "offset") == pytest.approx(offset)
        curvature = np.abs(trajectory.path.bend(stations).curvature)
        assert violation(found, problem, "curvature") == pytest.approx(
            max(0.0, curvature.max() / limits.curvature - 1.0)
        )
        world = problem.frame.to_world(stations.position)[:, 1]
        outside = max(world.max() - (1.0 - 0.305), (-1.5 + 0.305) - world.min(), 0.0)
        assert violation(found, problem, "workspace bounds") == pytest.approx(outside, abs=1e-12)


@pytest.mark.parametrize("name", SCENES)
def test_the_exact_hinge_gives_the_merit_of_sequential_convex_programming(name: str) -> None:
    """But for peaks of the lateral acceleration between stations, and what SCP keeps by linear rows."""
    problem = problem_of(name)
    penalties = Penalties(np.concatenate([np.full(problem.zones.size, 5.0), np.full(sum(problem.sizes[1:]), 3.0)]))
    count, exact = len(penalties.weights), uniform(problem, 0.0, 0.0)
    prices = np.concatenate([penalties.weights, np.full(violation_count(problem) - count, 3.0)])
    (lateral,) = places_of(problem, "lateral_acceleration")
    for omega in random_trips(PenalisedObjective(problem, prices, exact), 4, seed=8):
        trajectory = PenalisedObjective(problem, prices, exact).trajectory(omega)
        found = PenalisedObjective(problem, prices, exact, times_near(problem, trajectory, 1.0)).evaluate(omega)
        evaluation = evaluate_trip(problem, trajectory)
        missed = evaluation.violations - found.violations[:count]
        assert missed[: problem.zones.size] == pytest.approx(np.zeros(problem.zones.size), abs=2e-5)
        assert missed[lateral] >= -1e-12
        same = np.delete(missed, lateral)[problem.zones.size :]
        assert same == pytest.approx(np.zeros(len(same)), abs=1e-12)
        rows = float(prices[count:] @ found.violations[count:])
        beyond = prices[lateral] * missed[lateral]
        assert found.value + beyond - rows == pytest.approx(evaluation.merit(penalties), abs=2e-4)


# the domain


@pytest.mark.parametrize("name", ["known obstacles", "from rest, linear acceleration"])
def test_the_objective_is_infinite_outside_the_domain(name: str) -> None:
    problem = problem_of(name)
    objective = objective_of(problem, 5.0, 0.1)
    omega = np.zeros(objective.size)
    omega[objective.path_size :] = -0.5
    found = objective.evaluate(omega)
    assert found.value == np.inf
    assert found.travel_time == np.inf


def test_at_the_border_of_the_domain_the_trip_ends_standing() -> None:
    """There v0^2 + 4 A L = 0 and tau = 2 L / v0: finite for v0 > 0, though its slope is not."""
    problem = problem_of("known obstacles")
    objective = objective_of(problem, 0.0)
    omega = np.zeros(objective.size)
    length = objective.trajectory(omega).path.arc_length
    gain = float(problem.space.drive.final_distance.sum())
    border = -(problem.space.start_speed**2) / (4.0 * gain * length)
    omega[objective.path_size :] = border * (1.0 - 1e-12)
    assert objective.value(omega) == pytest.approx(2.0 * length / problem.space.start_speed, rel=1e-5)
    omega[objective.path_size :] = border * (1.0 + 1e-12)
    assert objective.value(omega) == np.inf


def test_there_and_back() -> None:
    problem = problem_of("box, goal speed and heading")
    objective = objective_of(problem, 5.0)
    omega = random_trips(objective, 1, seed=10)[0]
    assert objective.omega(objective.trajectory(omega)) == pytest.approx(omega, abs=0.0)
    assert objective.size == len(omega)
