"""The command line: checks, the schema, the demo, settings, and the program as a whole."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import jsonschema
import pytest
import yaml
from command import run

from scp_planner import builtin
from scp_planner.planning.plan import Plan
from scp_planner.scenario.models import Scenario
from scp_planner.settings.knobs import knobs
from scp_planner.settings.online import OnlineSettings
from scp_planner.settings.planning import Settings
from scp_planner.simulation.run import Run


def test_settings_are_listed(tmp_path: Path) -> None:
    result = run("settings")
    assert result.exit_code == 0
    for each in (*knobs(Settings).values(), *knobs(OnlineSettings).values()):
        if each.allowed is not None:
            assert f"\n  {each.name} = {each.default_text}  ({each.allowed_text})\n" in result.stdout
    one = json.loads(run("settings", "path_span", "--json").stdout)
    assert [(entry["name"], entry["default"], entry["allowed"]) for entry in one] == [
        ("path_span", "none", "a number, above 0, up to 1e+12 m, or none")
    ]
    wrong = run("settings", "path_spam")
    assert (wrong.exit_code, wrong.stdout) == (2, "")
    assert "did you mean 'path_span'?" in wrong.stderr


def test_check_certifies_a_plan(easy: Path, tmp_path: Path) -> None:
    run("plan", easy, "-o", tmp_path / "plan.json")
    result = run("check", easy, tmp_path / "plan.json")
    assert result.exit_code == 0, result.output
    assert "certified:               yes" in result.stdout
    assert run("check", easy, tmp_path / "plan.json", "--quiet").output == ""


def test_check_refuses_a_plan_that_meets_an_obstacle(easy: Path, scenario_data: dict[str, Any], tmp_path: Path) -> None:
    """The plan says of itself that it is certified; that was for another scenario."""
    run("plan", easy, "-o", tmp_path / "plan.json")
    scenario_data["obstacles"][0]["motion"]["position"] = [10, 0]
    easy.write_text(yaml.safe_dump(scenario_data))
    result = run("check", easy, tmp_path / "plan.json", "--json")
    assert result.exit_code == 3
    assert "not certified: clearance to far" in result.stderr
    summary = json.loads(result.stdout)
    assert summary["certified"] is False
    assert summary["least_clearance"] < 0
    assert summary["nearest_obstacle"] == "far"
    assert any("clearance to far" in violation for violation in summary["violations"])


@pytest.mark.parametrize("text", ["", "[]", "{}", '{"schema": 2}', "{nonsense"])
def test_check_refuses_what_is_no_plan(text: str, easy: Path, tmp_path: Path) -> None:
    (tmp_path / "plan.json").write_text(text)
    result = run("check", easy, tmp_path / "plan.json")
    assert result.exit_code == 2
    assert str(tmp_path / "plan.json") in result.stderr
    assert result.stdout == ""


def test_check_names_a_plan_that_is_missing(easy: Path, tmp_path: Path) -> None:
    result = run("check", easy, tmp_path / "none.json")
    assert result.exit_code == 2
    assert f"{tmp_path / 'none.json'}: No such file or directory" in result.stderr


def test_schema_prints_the_json_schema() -> None:
    result = run("schema")
    assert result.exit_code == 0
    schema = json.loads(result.stdout)
    assert schema == Scenario.json_schema()
    jsonschema.Draft202012Validator.check_schema(schema)


@pytest.mark.parametrize("arguments", [pytest.param([], marks=pytest.mark.slow, id="radar"), ["headon"]])
def test_demo_writes_scenario_plan_and_figure(
    arguments: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    result = run("demo", *arguments)
    assert result.exit_code == 0, result.output
    for words in ("status:", "arrival time:", "least clearance:", "iterations:", "wall time:"):
        assert words in result.stdout
    written = {
        "scenario.yaml",
        "plan.json",
        "run.json",
        "plan.html",
        "run.html",
        "plan.png",
        "space_time.png",
        "run.gif",
    }
    assert {file.name for file in (tmp_path / "demo").iterdir()} == written
    assert all(f"demo/{name}" in result.stderr for name in written)
    assert "simulated arrived:       yes" in result.stdout
    assert Run.load(tmp_path / "demo" / "run.json").arrived
    scenario = Scenario.load(tmp_path / "demo" / "scenario.yaml")
    assert scenario == builtin.load(scenario.name)
    assert Plan.load(tmp_path / "demo" / "plan.json").verified(scenario).certified


def test_demo_refuses_a_file_for_a_folder(tmp_path: Path) -> None:
    (tmp_path / "demo").write_text("mine")
    result = run("demo", "-o", tmp_path / "demo")
    assert result.exit_code == 2
    assert "must be a folder" in result.stderr
    assert (tmp_path / "demo").read_text() == "mine"


@pytest.mark.parametrize("name", builtin.names())
def test_every_built_in_scenario_has_a_certified_plan(name: str) -> None:
    result = run("plan", f"builtin:{name}")
    assert result.exit_code == 0, result.output


def test_the_module_runs_as_a_program() -> None:
    command = [sys.executable, "-m", "scp_planner"]
    version = subprocess.run([*command, "--version"], capture_output=True, text=True, check=True)
    assert version.stdout.strip() == __import__("scp_planner").__version__
    refused = subprocess.run([*command, "plan", "none.yaml"], capture_output=True, text=True, check=False)
    assert (refused.returncode, refused.stdout) == (2, "")
    assert refused.stderr == "none.yaml: No such file or directory\n"
    unfinished = subprocess.run([*command, "plan"], capture_output=True, text=True, check=False)
    assert unfinished.returncode == 2
