"""The comparison of methods: the same starts for all, and tables that say what the trials say."""

from __future__ import annotations

import csv
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scenes import CROSSERS, disc, scene

import scp_planner as sp
from scp_planner.baseline.comparison import (
    Curve,
    Trial,
    compare,
    save_trials,
    summaries,
    summary_table,
    trial_record,
)
from scp_planner.baseline.methods import Method
from scp_planner.problem.build import build_problem
from scp_planner.search.starts import starts
from scp_planner.settings.planning import Settings
from scp_planner.studies.figures import plot_comparison
from scp_planner.threat_zones.of_scenario import zones

SMALL = Settings(path_span=2.5, acceleration_spans=8, samples=80)
SMALLEST = Settings(path_span=10.0, acceleration_spans=3, samples=20)


@pytest.fixture(scope="module")
def trials() -> list[Trial]:
    hopeless = scene(disc("on-goal", (20.0, 0.5), radius=2.0), name="hopeless")
    methods = [Method.SCP, Method.LBFGS]
    return [
        *compare([scene(*CROSSERS)], starts_each=2, methods=methods, settings=SMALL),
        *compare([hopeless], starts_each=2, methods=methods, settings=SMALLEST),
    ]


def test_every_method_runs_from_every_start(trials: list[Trial]) -> None:
    assert [(trial.scenario, trial.start, trial.method.value) for trial in trials] == [
        (scenario, start, method)
        for scenario in ("scene", "hopeless")
        for start in (0, 1)
        for method in ("scp", "l-bfgs")
    ]


def test_curves_begin_at_the_same_start_and_never_rise(trials: list[Trial]) -> None:
    for first, second in zip(trials[::2], trials[1::2], strict=True):
        assert first.curve.merit[0] == second.curve.merit[0]
    for trial in trials:
        assert np.all(np.diff(trial.curve.merit) <= 0.0)
        assert np.all(np.diff(trial.curve.seconds) >= 0.0)
        assert np.all(np.diff(trial.curve.evaluations) >= 0)
        assert trial.curve.evaluations[-1] <= trial.evaluations
        assert 0.0 <= trial.curve.seconds[-1] <= trial.wall_time + 1e-9  # to rounding of the clock


def test_certified_trials_end_at_their_travel_time(trials: list[Trial]) -> None:
    certified = [trial for trial in trials if trial.certified]
    assert {trial.method for trial in certified} == {Method.SCP, Method.LBFGS}
    for trial in certified:
        assert trial.scenario == "scene"
        assert trial.least_clearance >= 0.0
        assert trial.violations == ""
        assert trial.curve.merit[-1] == pytest.approx(trial.travel_time, abs=0.02)


def test_failures_are_shown(trials: list[Trial]) -> None:
    failed = [trial for trial in trials if trial.scenario == "hopeless"]
    assert not any(trial.certified for trial in failed)
    assert all("clearance to on-goal" in trial.violations for trial in failed)
    assert all(trial.worst_violation > 0.1 for trial in failed)


def test_the_starts_are_those_of_the_planner(trials: list[Trial]) -> None:
    scenario = scene(*CROSSERS)
    problem = build_problem(scenario, zones(scenario), SMALL)
    _, start = next(starts(problem, SMALL.searches))
    plan = sp.penalty_descent(scenario, SMALL, start=start)
    assert plan.travel_time == trials[1].travel_time


def _trial(scenario: str, start: int, method: Method, certified: bool, travel_time: float) -> Trial:
    none = Curve(np.zeros(1, dtype=np.int64), np.zeros(1), np.ones(1))
    return Trial(
        scenario, start, method, "done", certified, travel_time, 0.0, 0.0, 1, 10 + start, 1.0 + start, "", none
    )


def test_summaries_count_and_compare() -> None:
    scp, descent = Method.SCP, Method.LBFGS
    trials = [
        _trial("a", 0, scp, True, 10.0),
        _trial("a", 0, descent, True, 10.2),
        _trial("a", 1, scp, True, 12.0),
        _trial("a", 1, descent, True, 11.0),
        _trial("b", 0, scp, True, 5.0),
        _trial("b", 0, descent, False, 4.0),
        _trial("b", 1, scp, False, 5.0),
        _trial("b", 1, descent, True, 5.001),
        _trial("c", 0, scp, True, 7.0),
        _trial("c", 0, descent, True, 7.001),
    ]
    first, second = summaries(trials)
    assert (first.method, first.trials, first.certified, first.faster, first.slower) == (scp, 5, 4, 0, 0)
    assert (second.trials, second.certified, second.faster, second.slower) == (5, 4, 2, 2)
    assert first.excess == pytest.approx(0.0)
    assert first.excess_worst == pytest.approx(0.2)
    assert second.excess_worst == pytest.approx(0.1)
    assert second.evaluations == 10.0
    assert second.wall_time == 1.0
    lines = summary_table(trials).splitlines()
    assert [line.split()[0] for line in lines] == ["method", "scp", "l-bfgs", "excess:"]
    assert "4 (80%)" in lines[1]


def test_a_method_that_never_succeeds_has_no_excess() -> None:
    row = summaries([_trial("a", 0, Method.SCP, False, 1.0)])[0]
    assert np.isnan(row.excess)
    assert row.certified == 0


def test_trials_are_written_and_drawn(trials: list[Trial], tmp_path: Path) -> None:
    save_trials(trials, tmp_path / "trials.csv")
    with open(tmp_path / "trials.csv", newline="") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == len(trials)
    assert rows[0]["method"] == "scp"
    assert float(rows[0]["travel_time"]) == trials[0].travel_time
    assert "curve" not in rows[0]
    assert set(rows[0]) == set(trial_record(trials[0]))
    plot_comparison(trials, tmp_path / "comparison.png")
    assert (tmp_path / "comparison.png").stat().st_size > 20_000
    plot_comparison([replace(trial, certified=False) for trial in trials], tmp_path / "failed.svg")
    assert "<svg" in (tmp_path / "failed.svg").read_text()
