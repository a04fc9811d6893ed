"""Bad scenario files: refused with exit code 2, nothing written, and a message with file, key and value."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
import yaml
from bad_scenarios import CASES, Case, changed
from typer.testing import CliRunner

from scp_planner import files
from scp_planner.cli import app
from scp_planner.errors import ScenarioError
from scp_planner.scenario.models import MOST_OBSTACLES, Scenario

TEXTS = {
    "YAML syntax": (
        "bad.yaml",
        "schema: 1\nvehicle: [1, 2\nstart: 3\n",
        "line 3",
        "start: 3",
        "must be YAML",
    ),
    "YAML tabs": ("bad.yaml", "vehicle:\n\tradius: 1\n", "line 2", "radius: 1", "must be YAML"),
    "YAML tag": ("bad.yaml", "name: !!python/object:os.system x\n", "line 1", "os.system", "must be YAML"),
    "YAML repeated key": ("bad.yaml", "obstacles:\n- id: a\n  id: b\n", "obstacles[0].id", "'b'", "line 3"),
    "YAML number as a key": ("bad.yaml", "goal: {3: 4}\n", "goal[3]", "3", "keys must be text"),
    "YAML of two documents": ("bad.yaml", "name: a\n---\nname: b\n", "line 2", "---", "must be YAML"),
    "YAML without end": ("bad.yaml", "guide: &a [*a]\n", "guide", "[[[...", "at least 2"),
    "YAML nested deeply": ("bad.yaml", "name: " + "[" * 99999 + "]" * 99999, "line 1", "[[[[", "nested"),
    "empty": ("bad.yaml", "", "(the whole file)", "null", "mapping"),
    "list": ("bad.yaml", "- 1\n- 2\n", "(the whole file)", "[1, 2]", "mapping"),
    "JSON syntax": ("bad.json", '{"schema": 1,\n "name": }', "line 2", '"name": }', "must be JSON"),
    "JSON repeated key": ("bad.json", '{"start": {"time": 1, "time": 2}}', "start.time", "2", "only once"),
    "JSON NaN": ("bad.json", '{"vehicle": {"radius": NaN}}', "vehicle.radius", "nan", "finite"),
    "JSON number too long": (
        "bad.json",
        '{"schema": ' + "1" * 5000 + "}",
        "(the whole file)",
        "1111",
        "must be JSON",
    ),
    "JSON nested deeply": ("bad.json", "[" * 99999, "(the whole file)", "[[[[", "nested"),
    "unknown suffix": ("bad.toml", "schema = 1\n", "file name", "'bad.toml'", ".yaml, .yml, .json"),
}


def assert_refused(file: Path, path: str, value: str, allowed: str) -> None:
    """Plan the file on the command line with all that could be written, and read the message."""
    folder = file.parent / "written"
    folder.mkdir()
    options = ["-o", str(folder / "plan.json"), "--plot", str(folder / "plan.png"), "--json"]
    result = CliRunner().invoke(app, ["plan", str(file), *options])
    assert result.exit_code == 2, result.output
    assert not list(folder.iterdir())
    assert result.stdout == ""
    first, *lines = result.stderr.splitlines()
    assert str(file) in first
    line = next(line for line in lines if line.strip().startswith((f"{path} =", f"{path}:")))
    assert value in line
    assert allowed in line


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.name)
@pytest.mark.parametrize("suffix", [".yaml", ".json"])
def test_one_fault_is_named_with_file_key_and_value(
    case: Case, suffix: str, scenario_data: dict[str, Any], tmp_path: Path
) -> None:
    data = changed(scenario_data, case.change)
    file = tmp_path / f"bad{suffix}"
    file.write_text(yaml.safe_dump(data) if suffix == ".yaml" else json.dumps(data))
    assert_refused(file, case.path, case.value, case.allowed)


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.name)
def test_python_construction_says_the_same(case: Case, scenario_data: dict[str, Any]) -> None:
    data = changed(scenario_data, case.change)
    with pytest.raises(ScenarioError) as caught:
        Scenario(**data)
    (fault,) = caught.value.faults  # a fault of one key makes no check of another one complain
    assert fault.path == case.path
    assert case.value in str(fault)
    assert case.allowed in str(fault)


@pytest.mark.parametrize("name", TEXTS)
def test_text_that_is_no_scenario_is_refused(name: str, tmp_path: Path) -> None:
    file_name, text, path, value, allowed = TEXTS[name]
    file = tmp_path / file_name
    file.write_text(text)
    assert_refused(file, path, value, allowed)


def test_bytes_that_are_no_text_are_refused(tmp_path: Path) -> None:
    file = tmp_path / "bad.yaml"
    file.write_bytes(b"name: caf\xe9\n")
    assert_refused(file, "(the whole file)", "b'\\xe9'", "UTF-8 text; byte 9 is not")


def test_a_file_that_is_missing_is_refused_by_name(tmp_path: Path) -> None:
    result = CliRunner().invoke(app, ["plan", str(tmp_path / "none.yaml"), "-o", str(tmp_path / "plan.json")])
    assert result.exit_code == 2
    assert f"{tmp_path / 'none.yaml'}: No such file or directory" in result.stderr
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("suffix", [".json", ".yaml"])
def test_a_file_of_too_many_obstacles_is_refused_before_it_is_parsed(
    suffix: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(files, "read", None)
    one = '{"id": "o", "shape": {"disc": 1.0}, "motion": {"position": [0.0, 9.0]}}'
    file = tmp_path / f"many{suffix}"
    file.write_text('{"schema": 1, "obstacles": [\n' + ",\n".join([one] * (MOST_OBSTACLES + 1)) + "]}")
    with pytest.raises(ScenarioError, match=rf"obstacles: too many: about {MOST_OBSTACLES + 1}; .* {MOST_OBSTACLES}"):
        Scenario.load(file)


@pytest.mark.parametrize("place", ["start", "goal"])
@pytest.mark.parametrize(("heading", "told"), [(90.0, True), (-45.0, True), (3.2, False), (-7.0, False)])
def test_a_heading_that_is_almost_certainly_degrees_is_told_of(
    place: str, heading: float, told: bool, scenario_data: dict[str, Any], caplog: pytest.LogCaptureFixture
) -> None:
    scenario_data[place]["heading"] = heading
    Scenario(**scenario_data)
    assert ("almost certainly degrees" in caplog.text) == told
