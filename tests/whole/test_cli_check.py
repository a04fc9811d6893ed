"""The command that certifies what planners made, and what is told while planning."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from command import run
from scenes import disc, scene

import scp_planner as sp
from scp_planner.scenario.models import Scenario


@pytest.fixture
def easy(tmp_path: Path) -> Path:
    """A scenario whose one obstacle stays out of the way."""
    file = tmp_path / "easy.yaml"
    scene(disc("far", (10.0, 50.0), radius=1.0), name="easy").save(file)
    return file


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
