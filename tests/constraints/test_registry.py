"""The table of constraints, and the one that ARCHITECTURE.md adds as an example."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scenes import CROSSERS, scene
from slopes import differences

import scp_planner as sp
from scp_planner.arrays import Array
from scp_planner.constraints.registry import CONSTRAINTS
from scp_planner.constraints.setup import OPTIONAL_MARGIN
from scp_planner.problem.build import build_problem
from scp_planner.settings.planning import Settings
from scp_planner.trips.trajectory import Trajectory

pytestmark = pytest.mark.numerics

PAGE = Path(__file__).resolve().parents[2] / "ARCHITECTURE.md"
USUAL = 4  # constraints that every scene has
STOPPING = scene(*CROSSERS, goal={"speed": 0.0})


@pytest.fixture
def example(monkeypatch: pytest.MonkeyPatch) -> dict[str, Any]:
    """The example's names, with its limit registered until the test is over."""
    for name, made in CONSTRAINTS.items():
        monkeypatch.setitem(CONSTRAINTS, name, made)
    monkeypatch.setitem(CONSTRAINTS, "gentle_braking", lambda _: ())
    (block,) = re.findall(r"^```python\n(.*?)^```$", PAGE.read_text(encoding="utf-8"), re.M | re.S)
    names: dict[str, Any] = {"__name__": __name__}
    exec(compile(block, str(PAGE), "exec"), names)
    assert CONSTRAINTS["gentle_braking"] is names["gentle_braking"]
    return names


def hardest_braking(plan: sp.Plan) -> float:
    """By differences of its speeds, m/s^2."""
    times = np.linspace(plan.start_time, plan.arrival_time, 2001)
    return float(-np.min(np.diff(plan.speed(times)) / np.diff(times)))


@pytest.mark.parametrize("planned", [sp.plan, sp.penalty_descent])
def test_plans_keep_the_limit_that_the_example_adds(planned: Any, example: dict[str, Any]) -> None:
    allowed = example["GENTLE"] * STOPPING.vehicle.max_deceleration
    coarse = Settings(path_span=2.5, acceleration_spans=10, samples=80, max_runs=1)
    gentle = planned(STOPPING, coarse)
    assert gentle.certified, gentle.reason
    assert hardest_braking(gentle) <= allowed * (1.0 + 1e-6)
    del CONSTRAINTS["gentle_braking"]
    usual = planned(STOPPING, coarse)
    assert hardest_braking(usual) > 1.5 * allowed
    assert gentle.travel_time > usual.travel_time


def test_the_examples_gradient_agrees_with_differences(example: dict[str, Any]) -> None:
    problem = build_problem(STOPPING, sp.zones(STOPPING), Settings())
    limit = next(one for one in problem.constraints if isinstance(one, example["GentleBraking"]))
    beta = np.random.default_rng(3).uniform(-0.2, 0.5, problem.space.acceleration_size)
    trip = Trajectory.of(problem.space, problem.ends.theta, beta)

    def value(other: Trajectory) -> Array:
        return limit.excess(other)

    index = np.arange(len(beta))
    assert limit.gradient(trip, index) == pytest.approx(differences(problem, trip, value, 1e-6), abs=1e-6)


def test_what_a_scenario_asks_for_is_made_with_the_margins_off() -> None:
    vehicle = {"max_jerk": 2.0, "max_curvature_rate": 0.4, "max_power": 3.0, "max_total_acceleration": 2.5}
    asked = scene(vehicle=vehicle, goal={"earliest_arrival": 12.0})
    settings = Settings(limit_margin=0.01)
    found = {limit.name: limit for limit in build_problem(asked, (), settings).constraints[USUAL:]}
    assert list(found) == ["earliest arrival", "jerk", "curvature_rate", "power", "total_acceleration"]
    for name, value in vehicle.items():
        limit: Any = found[name.removeprefix("max_")]
        assert limit.limit == pytest.approx(value * (1.0 - 0.01 - OPTIONAL_MARGIN), rel=1e-12)


def test_tightened_drive_limits_are_lower() -> None:
    asked = scene(vehicle={"max_power": 3.0, "max_total_acceleration": 2.5})
    limits: Any = build_problem(asked, (), Settings()).constraints[USUAL:]
    assert len(limits) == 2
    for limit in limits:
        assert limit.tightened(0.1).limit == pytest.approx(0.9 * limit.limit, rel=1e-12)
        assert limit.tightened(0.1).times is limit.times


def test_a_limit_of_places_asks_nothing_of_the_speed_at_the_start_however_much_it_is_tightened() -> None:
    slow = scene(speed_limits=[{"from": 0.0, "to": 5.0, "speed": 1.0}], start={"speed": 1.0})
    problem = build_problem(slow, sp.zones(slow), Settings())
    (limit,) = (one for one in problem.constraints if one.name == "speed_limits")
    steady = np.zeros(problem.space.acceleration_size)
    braked = np.where(np.arange(len(steady)) < 2, -0.1, steady)
    before, after = (
        float(limit.tightened(0.01).excess(Trajectory.of(problem.space, problem.ends.theta, beta, 12.0)).max())
        for beta in (steady, braked)
    )
    assert before > 0.01 and after < 0.0
