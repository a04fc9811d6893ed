"""The command line: checks, the schema, the demo, settings, and the program as a whole."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import jsonschema
import numpy as np
import pytest
import yaml
from command import run

import scp_planner as sp
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


def test_the_module_runs_as_a_program() -> None:
    command = [sys.executable, "-m", "scp_planner"]
    version = subprocess.run([*command, "--version"], capture_output=True, text=True, check=True)
    assert version.stdout.strip() == __import__("scp_planner").__version__
    refused = subprocess.run([*command, "plan", "none.yaml"], capture_output=True, text=True, check=False)
    assert (refused.returncode, refused.stdout) == (2, "")
    assert refused.stderr == "none.yaml: No such file or directory\n"
    unfinished = subprocess.run([*command, "plan"], capture_output=True, text=True, check=False)
    assert unfinished.returncode == 2


# The command that certifies what planners made, and what is told while planning


def samples_file(easy: Path, path: Path, *columns: str, count: int = 400) -> Path:
    """Samples of a plan that uses 98 % of its limits, at the times at which its acceleration jumps, too."""
    parts = Scenario.load(easy).to_dict()
    for name, value in parts["vehicle"].items():
        if name.startswith("max_") and value is not None:
            parts["vehicle"][name] = 0.98 * value
    plan = sp.plan(Scenario(**parts))
    times = np.union1d(np.linspace(plan.start_time, plan.arrival_time, count), plan.knot_times)
    table = plan.table(times)
    cells = zip(*(table[name].tolist() for name in columns), strict=True)
    rows = [",".join(columns), *(",".join(map(repr, row)) for row in cells)]
    path.write_text("\n".join(rows))
    return path


COLUMNS = ("time_s", "x_m", "y_m", "heading_rad", "speed_m_per_s")


def test_check_certifies_samples_of_any_planner(easy: Path, tmp_path: Path) -> None:
    table = samples_file(easy, tmp_path / "mine.csv", *COLUMNS)
    result = run("check", easy, table)
    assert result.exit_code == 0, result.output
    assert "certified:               yes" in result.stdout
    assert "from positions" not in result.stdout
    data = json.loads(run("check", easy, samples_file(easy, table, *COLUMNS[:3]), "--json").stdout)
    assert data["from_positions"] == "heading and speed"


def test_check_compares_files_in_a_table(easy: Path, tmp_path: Path) -> None:
    run("plan", easy, "-o", tmp_path / "plan.json")
    samples_file(easy, tmp_path / "mine.csv", *COLUMNS)
    (tmp_path / "theirs.json").write_text(json.dumps([{"t": 0, "x": 0, "y": 0}, {"t": 4, "x": 20, "y": 0}]))
    files = [tmp_path / name for name in ("plan.json", "mine.csv", "theirs.json")]
    result = run("check", easy, *files)
    assert result.exit_code == 3
    head, *rows = result.stdout.splitlines()
    assert head.split()[:3] == ["file", "certified", "travel"] and "acceleration" in head
    assert [row.split()[1] for row in rows] == ["yes", "yes", "no"]
    assert [line.split(": ")[0] for line in result.stderr.splitlines()] == [str(files[2])]
    data = json.loads(run("check", easy, *files, "--json").stdout)
    assert [row["file"] for row in data] == [str(file) for file in files]
    assert [row["certified"] for row in data] == [True, True, False]
    assert data[1]["travel_time"] > data[0]["travel_time"]
    for row in data[:2]:
        assert 0.9 < row["limits"]["acceleration"]["used"] <= 1.0 + 1e-9
    assert run("check", easy, *files[:2], "--quiet").output == ""


def test_check_with_slack_forgives_what_is_lost_between_samples(easy: Path, tmp_path: Path) -> None:
    run("plan", easy, "-o", tmp_path / "plan.json")
    run("export", tmp_path / "plan.json", "-o", tmp_path / "plan.csv", "--samples", "1000")
    assert run("check", easy, tmp_path / "plan.csv").exit_code == 3
    result = run("check", easy, tmp_path / "plan.csv", "--slack", "0.15", "--json")
    assert result.exit_code == 0, result.output
    data = json.loads(result.stdout)
    assert 1.0 < max(use["used"] for use in data["limits"].values() if use["used"]) < 1.15
    assert data["limits"]["speed"]["limit"] == pytest.approx(Scenario.load(easy).vehicle.max_speed)
    wrong = run("check", easy, tmp_path / "plan.csv", "--slack", "-1")
    assert wrong.exit_code == 2 and "--slack" in wrong.stderr


def test_check_names_row_and_column_of_a_bad_file(easy: Path, tmp_path: Path) -> None:
    (tmp_path / "good.csv").write_text("t,x,y\n0,0,0\n9,20,0\n")
    (tmp_path / "bad.csv").write_text("t,x,y\n0,0,0\n1,one,1\n")
    result = run("check", easy, tmp_path / "good.csv", tmp_path / "bad.csv")
    assert (result.exit_code, result.stdout) == (2, "")
    assert "bad.csv: 1 fault" in result.stderr and "line 3, x = 'one': must be a number" in result.stderr


@pytest.mark.parametrize(
    ("part", "key", "value"), [("samples", "position", [[0.0, 0.0], [9.0, 9.0]]), ("path", "degree", 1)]
)
def test_check_refuses_plan_files_whose_trip_nobody_could_certify(
    easy: Path, tmp_path: Path, part: str, key: str, value: object
) -> None:
    file = tmp_path / "plan.json"
    run("plan", easy, "-o", file, "--samples", "2", "--quiet")
    data = json.loads(file.read_text())
    assert run("check", easy, file).exit_code == 0
    file.write_text(json.dumps(data | {"status": "failed"}))
    assert run("check", easy, file).exit_code == 0
    data[part][key] = value
    file.write_text(json.dumps(data))
    result = run("check", easy, file)
    assert result.exit_code == 2
    assert f"{part}.{key}" in result.stderr
