"""The matrix of pairs: scenes that can be driven, wrong answers that are counted, refusals that name both features."""

from __future__ import annotations

import itertools
import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import scp_planner as sp
from benchmarks.hostile.oracle import occupied_ground, tolerances
from benchmarks.pairs import features, online
from benchmarks.pairs.__main__ import main
from benchmarks.pairs.scene import Feature, build
from benchmarks.pairs.verdict import Verdict, judge
from scp_planner.errors import Fault
from verification.dense_check import check_trip

SIZE = 25.0
"""Squares of standard deviations, of the regions of uncertain obstacles: more than the scenes' confidence asks for."""
NEIGHBOURS = [*itertools.pairwise((*features.OFFLINE, features.OFFLINE[0]))]


def named(pair: tuple[Feature, Feature]) -> str:
    return "+".join(feature.name for feature in pair)


@pytest.mark.parametrize("pair", NEIGHBOURS, ids=named)
def test_the_motion_of_a_scene_keeps_to_it(pair: tuple[Feature, Feature]) -> None:
    scene = build(pair, np.random.default_rng(4))
    motion = scene.motion
    times = np.linspace(motion.start, motion.end, 200)
    report = check_trip(
        scene.data,
        motion.position,
        motion.start,
        motion.end,
        heading=motion.heading,
        tolerances=tolerances(scene.data, motion.position(times), times),
        ground=occupied_ground(scene.map),
        regions={each["id"]: SIZE for each in scene.data["obstacles"]},
    )
    assert report.ok, str(report)


def test_a_slice_of_the_matrix_is_printed(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "pairs.json"
    assert main(["--only", "jerk,rectangle,courses", "--json", str(file)]) == 0
    assert "3 planned, 0 refused, 0 wrong of 3 combinations" in capsys.readouterr().out
    assert main(["--online", "--only", "jerk,deadline", "--seed", "2"]) == 0
    written = json.loads(file.read_text())
    assert written["combinations"][0]["features"] == ["jerk", "rectangle"]
    assert all(scene["verdict"] == "planned" for each in written["combinations"] for scene in each["scenes"])


def test_a_plan_that_breaks_a_limit_is_wrong(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    plan = sp.plan

    def too_fast(scenario: sp.Scenario, **options: Any) -> sp.Plan:
        faster = scenario.vehicle.model_copy(update={"max_speed": 1.5 * scenario.vehicle.max_speed})
        return plan(scenario.model_copy(update={"vehicle": faster}), **options)

    monkeypatch.setattr(sp, "plan", too_fast)
    assert main(["--only", "jerk,rectangle"]) == 1
    printed = capsys.readouterr()
    assert "0 1w" in printed.out
    assert "speed" in printed.err


def drive(pair: tuple[Feature, ...]) -> online.Drive:
    rng = np.random.default_rng(1)
    return online.Drive(build(pair, rng), rng)


def test_an_arrival_away_from_the_goal_is_wrong(monkeypatch: pytest.MonkeyPatch) -> None:
    replan = sp.Planner.replan

    def arrives(self: sp.Planner, *state: Any, **options: Any) -> Any:
        return replace(replan(self, *state, **options), code=sp.ReasonCode.ARRIVED)

    monkeypatch.setattr(sp.Planner, "replan", arrives)
    assert "goal_position" in drive((features.JERK, features.COURSES)).run()


def test_a_drive_that_never_arrives_is_wrong(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(online, "LONGEST", 0.05)
    assert "not arrived" in drive((features.JERK, features.COURSES)).run()


def test_a_drive_through_a_wall_is_wrong() -> None:
    """The planner does not know of this wall, which stands across the whole scene."""
    driven = drive((features.JERK, features.DEADLINE))
    scene = driven.scene
    (x, y), (dx, dy) = scene.beside(0.5, 0.0), 100.0 * (scene.beside(0.5, 1.0) - scene.beside(0.5, 0.0))
    scene.data["walls"].append([[x - dx, y - dy], [x + dx, y + dy], [x + dx + 0.01 * dy, y + dy - 0.01 * dx]])
    assert "walls" in driven.run()


@pytest.mark.parametrize(
    ("error", "verdict"),
    [
        (sp.ScenarioError("Scenario", [Fault("goals", 2, "must be empty where there is a map")]), Verdict.REFUSED),
        (sp.ScenarioError("Scenario", [Fault("goals", 2, "must be empty")]), Verdict.WRONG),
        (ValueError("goals: must be empty where there is a map"), Verdict.WRONG),
    ],
)
def test_a_refusal_names_both_features(error: Exception, verdict: Verdict) -> None:
    def attempt() -> str:
        raise error

    found: Callable[[], str] = attempt
    assert judge((features.PLACES, features.MAP), found).verdict is verdict
