"""The command `plan`: exit codes, what is written, and what goes to stdout and stderr."""

from __future__ import annotations

import inspect
import json
import sys
from dataclasses import fields
from pathlib import Path

import pytest
import yaml
from command import COARSE, run

import scp_planner as sp
from scp_planner.batch.jobs import Options
from scp_planner.planning.plan import Plan

PLAN_KEYS = {
    "schema",
    "scenario",
    "status",
    "reason",
    "start_time",
    "arrival_time",
    "travel_time",
    "method",
    "solver",
    "iterations",
    "wall_time",
    "path",
    "acceleration",
    "clearance",
    "limits",
    "samples",
}


def test_every_seed_gives_the_same_plan_and_the_help_says_so(easy: Path, tmp_path: Path) -> None:
    for seed in ("0", "7"):
        assert run("plan", easy, "-o", tmp_path / f"{seed}.json", "--seed", seed, "-q").exit_code == 0
    plans = [json.loads((tmp_path / f"{seed}.json").read_text()) for seed in ("0", "7")]
    for plan in plans:
        del plan["wall_time"]
        plan.pop("timings", None)
    assert plans[0] == plans[1]
    for command in ("plan", "batch"):
        said = " ".join(run(command, "--help").stdout.split())
        assert "draws nothing at random, every seed gives the same plan" in said.replace("│ ", "")
    assert "seed" not in inspect.signature(sp.plan).parameters
    assert "seed" not in {each.name for each in fields(Options)}


def test_plan_tells_of_shapes_that_became_discs(easy: Path) -> None:
    data = yaml.safe_load(easy.read_text())
    jitter = {"time": [0, 1, 2, 3], "position": [[10, 50], [10.01, 50.01], [10, 50.02], [9.99, 50]]}
    data["obstacles"] = [{"id": "pallet", "shape": {"rectangle": [3.0, 1.0]}, "motion": jitter}]
    easy.write_text(yaml.safe_dump(data))
    told = "pallet: taken for a disc of 1.58 m, the heading of its rectangle is not known: give shape.heading"
    assert run("plan", easy, *COARSE, "--no-bound").stderr.startswith(told)
    assert run("plan", easy, *COARSE, "--no-bound", "--quiet").stderr == ""


def test_a_plan_is_no_scenario_and_says_so(easy: Path, tmp_path: Path) -> None:
    assert run("plan", easy, "-o", tmp_path / "plan.json", *COARSE, "--no-bound", "-q").exit_code == 0
    result = run("compare", tmp_path / "plan.json", easy)
    assert result.exit_code == 2
    assert result.stderr.splitlines()[1:] == ["  (the whole file): this is a plan or a run, not a scenario"]


def test_plan_writes_a_certified_plan(easy: Path, tmp_path: Path) -> None:
    result = run("plan", easy, "-o", tmp_path / "plan.json", "--samples", "50")
    assert result.exit_code == 0, result.output
    assert result.stderr == ""
    assert "status:                  certified" in result.stdout
    data = json.loads((tmp_path / "plan.json").read_text())
    assert set(data) >= PLAN_KEYS
    assert (data["schema"], data["scenario"], data["status"], data["reason"]) == (
        1,
        "easy",
        "certified",
        None,
    )
    assert data["clearance"]["obstacle"] == "far"
    assert {len(values) for values in data["samples"].values()} == {50}
    assert f"travel time:             {data['travel_time']:.4f} s" in result.stdout


def test_plan_without_obstacles_has_a_summary_in_json(easy: Path) -> None:
    """An infinite clearance has no number in JSON."""
    easy.write_text(yaml.safe_dump(yaml.safe_load(easy.read_text()) | {"obstacles": []}))
    result = run("plan", easy, "--json")
    assert result.exit_code == 0
    assert json.loads(result.stdout)["least_clearance"] is None


def test_a_plan_that_is_not_certified_is_written_with_its_reason(hopeless: Path, tmp_path: Path) -> None:
    result = run("plan", hopeless, "-o", tmp_path / "plan.json")
    assert result.exit_code == 3
    assert f"{hopeless}: not certified: " in result.stderr
    assert "relative gap" not in result.stdout  # to a bound, of what does not hold
    data = json.loads((tmp_path / "plan.json").read_text())
    assert data["status"] != "certified"
    assert "on-goal" in data["reason"]
    assert data["reason"] in result.stderr


@pytest.mark.parametrize(
    ("suffix", "begins"), [(".html", b"<!DOCTYPE html>"), (".gif", b"GIF89a"), (".png", b"\x89PNG")]
)
def test_plan_draws_what_the_suffix_says(suffix: str, begins: bytes, easy: Path, tmp_path: Path) -> None:
    result = run("plan", easy, "--plot", tmp_path / f"plan{suffix}")
    assert result.exit_code == 0, result.output
    assert (tmp_path / f"plan{suffix}").read_bytes().startswith(begins)


def test_plan_draws_the_view_that_is_asked_for(easy: Path, tmp_path: Path) -> None:
    says = {"map": "x (m)", "space-time": "distance along the path (m)", "profiles": "lateral acceleration (m/s²)"}
    for view, text in says.items():
        result = run("plan", easy, "--plot", tmp_path / f"{view}.svg", "--view", view)
        assert result.exit_code == 0, result.output
        drawn = (tmp_path / f"{view}.svg").read_text(encoding="utf-8")
        assert text in drawn
        assert ("x (m)" in drawn) == (view == "map")


def test_page_needs_no_matplotlib(easy: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in [name for name in sys.modules if name.split(".")[0] == "matplotlib"] or ["matplotlib"]:
        monkeypatch.setitem(sys.modules, name, None)
    assert run("plan", easy, "--plot", tmp_path / "plan.html").exit_code == 0
    refused = run("plan", easy, "--plot", tmp_path / "plan.png")
    assert refused.exit_code == 2 and "needs matplotlib" in refused.stderr
    result = run("demo", "headon", "-o", tmp_path / "demo")
    assert result.exit_code == 0 and "no figures: matplotlib is not installed" in result.stderr
    assert {file.name for file in (tmp_path / "demo").iterdir()} == {
        "scenario.yaml",
        "plan.json",
        "plan.html",
        "run.json",
        "run.html",
    }


def test_video_without_ffmpeg_is_refused_before_planning(
    easy: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    result = run("plan", easy, "-o", tmp_path / "plan.json", "--plot", tmp_path / "plan.mp4")
    assert result.exit_code == 2 and "needs ffmpeg" in result.stderr
    assert not (tmp_path / "plan.json").exists()


def test_settings_are_changed_by_name(easy: Path, tmp_path: Path) -> None:
    changes = ("--set", "acceleration_degree=2", "--set", "path_degree=5")
    assert run("plan", easy, "-o", tmp_path / "plan.json", *changes).exit_code == 0
    data = json.loads((tmp_path / "plan.json").read_text())
    assert (data["acceleration"]["degree"], data["path"]["degree"]) == (2, 5)
    simulated = run("simulate", easy, "--set", "iterations=1", "--set", "path_span=3", "-o", tmp_path / "run.json")
    assert simulated.exit_code == 0, simulated.output
    compared = run("compare", easy, "--starts", "1", "--set", "samples=60", "--method", "scp")
    assert compared.exit_code == 0, compared.output


def test_plan_by_penalty_descent(easy: Path, tmp_path: Path) -> None:
    result = run("plan", easy, "-o", tmp_path / "plan.json", "--method", "penalty-descent")
    assert result.exit_code == 0, result.output
    data = json.loads((tmp_path / "plan.json").read_text())
    assert (data["method"], data["solver"], data["status"]) == ("penalty-descent", "l-bfgs", "certified")
    assert run("check", easy, tmp_path / "plan.json").exit_code == 0


def test_plan_says_what_no_trip_is_shorter_than(tmp_path: Path) -> None:
    suite = Path(__file__).parents[1] / "suite" / "wait-for-a-convoy.yaml"
    summaries = {}
    for option in ("--bound", "--no-bound"):
        file = tmp_path / f"{option}.json"
        result = run("plan", suite, option, "-o", file, "--json")
        assert result.exit_code == 0
        summaries[option] = json.loads(result.stdout)
        plan = Plan.load(file)
        assert plan.lower_bound == summaries[option]["lower_bound"]
        assert plan.gap == pytest.approx(plan.travel_time / plan.lower_bound - 1.0)
        assert plan.gap == pytest.approx(summaries[option]["relative_gap"])
    assert summaries["--no-bound"]["relative_gap"] > 1.0
    assert 0.0 <= summaries["--bound"]["relative_gap"] < 0.01
