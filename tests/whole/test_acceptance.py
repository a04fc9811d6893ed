"""Promises of the planner on the reference scenarios: certified by every solver, and true when looked at closely."""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path

import pytest

import scp_planner as sp
from scp_planner.solvers.interface import SOLVERS
from verification.dense_check import SAMPLES, check_trip

AGREEMENT = 1e-3  # s, between the travel times of all solvers
ALL_SOLVERS = [f"{family}-{number}" for family in ("crossing3", "crossing5", "headon") for number in range(10)]
SOME_BY_ALL = [
    pytest.param(name, marks=pytest.mark.slow if place % 6 else ()) for place, name in enumerate(ALL_SOLVERS)
]
"""All of them where there is time; every one is planned by the solver that is used if none is named."""
DEFAULT_SOLVER = [
    *(name for place, name in enumerate(ALL_SOLVERS) if place % 6),
    *(f"{family}-{number}" for family in ("crossing10", "crossing20", "crowd60") for number in range(10)),
]


@cache
def planned(path: Path, solver: str) -> sp.Plan:
    return sp.plan(sp.Scenario.load(path), solver=solver)


def assert_true_when_looked_at_closely(path: Path, plan: sp.Plan) -> None:
    """Position, speed, acceleration, curvature and clearance from differences of 20,001 positions."""
    assert SAMPLES == 20_000
    report = check_trip(json.loads(path.read_text()), plan.position, plan.start_time, plan.arrival_time)
    assert report.ok, str(report)


@pytest.mark.parametrize("name", SOME_BY_ALL)
def test_all_solvers_certify_and_agree(reference_scenarios: Path, name: str) -> None:
    path = reference_scenarios / f"{name}.json"
    plans = {solver: planned(path, solver) for solver in SOLVERS}
    for solver, plan in plans.items():
        assert plan.certified, f"{solver}: {plan.reason}"
        assert plan.solver == solver
    times = [plan.travel_time for plan in plans.values()]
    assert max(times) - min(times) <= AGREEMENT
    for plan in plans.values():
        assert_true_when_looked_at_closely(path, plan)


@pytest.mark.parametrize("name", DEFAULT_SOLVER)
def test_certified_plans_of_the_usual_solver_are_true(reference_scenarios: Path, name: str) -> None:
    path = reference_scenarios / f"{name}.json"
    plan = planned(path, "daqp")
    assert plan.certified, plan.reason
    assert_true_when_looked_at_closely(path, plan)


@pytest.mark.parametrize("name", ALL_SOLVERS[:20:5])
def test_the_certificate_is_found_again_from_the_file(reference_scenarios: Path, tmp_path: Path, name: str) -> None:
    path = reference_scenarios / f"{name}.json"
    plan = planned(path, "daqp")
    plan.save(tmp_path / "plan.json")
    loaded = sp.Plan.load(tmp_path / "plan.json")
    certificate = sp.certify(sp.Scenario.load(path), loaded)
    assert certificate.holds
    assert certificate.clearance.minimum == pytest.approx(plan.clearance.minimum, abs=1e-9)
    assert_true_when_looked_at_closely(path, loaded)


@pytest.mark.parametrize(("name", "solver"), [*(("crossing5-4", solver) for solver in SOLVERS), ("headon-6", "daqp")])
def test_the_same_plan_comes_out_again(reference_scenarios: Path, name: str, solver: str) -> None:
    scenario = sp.Scenario.load(reference_scenarios / f"{name}.json")
    first, second = (sp.plan(scenario, solver=solver).to_dict() for _ in range(2))
    for plan in (first, second):
        plan.pop("wall_time")
    assert first == second
