"""The command that fits models of motions, and the models that commands are given."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from command import run

from scp_planner.threat_zones.error_tube import TrackingRecord, fit_tracking_tube


def test_fit_motion_writes_a_model_that_a_scenario_can_refer_to(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    rows = ["id,time,x,y"]
    for person in range(30):
        velocity, position = rng.normal(size=2), rng.normal(size=2)
        for step in range(24):
            rows.append(f"{person},{0.4 * step:.1f},{position[0]:.4f},{position[1]:.4f}")
            velocity = velocity + 0.2 * rng.normal(size=2)
            position = position + 0.4 * velocity
    (tmp_path / "tracks.csv").write_text("\n".join(rows) + "\n")
    result = run("fit-motion", tmp_path / "tracks.csv", "-o", tmp_path / "people.yaml")
    assert result.exit_code == 0, result.stderr
    assert "random_walk" in result.stdout and "m2/s3" in result.stdout
    printed = run("fit-motion", tmp_path / "tracks.csv", "-o", tmp_path / "people.json", "--json", "--quiet")
    assert json.loads(printed.stdout) == json.loads((tmp_path / "people.json").read_text())
    assert printed.stderr == ""
    planned = run("plan", watched(tmp_path, {"process": "people.yaml"}, aside=9.0), "-o", tmp_path / "plan.json")
    assert planned.exit_code == 0, planned.stderr


def watched(folder: Path, model: object = None, aside: float = 5.0) -> Path:
    """A scenario of one person who is seen beside the way."""
    person = {
        "id": "walker",
        "shape": {"disc": 0.3},
        "observations": {
            "time": [-0.8, -0.4, 0.0],
            "position": [[5, aside], [5, aside + 0.01], [5, aside]],
            "covariance": [[0.0025, 0.0], [0.0, 0.0025]],
        },
    }
    scenario = {
        "schema": 1,
        "vehicle": {"radius": 0.3, "max_speed": 2.0, "max_acceleration": 1.0, "max_deceleration": 1.0},
        "start": {"time": 0.0, "position": [0, 0], "heading": 0.0, "speed": 1.0},
        "goal": {"position": [10, 0]},
        "obstacles": [person if model is None else {**person, "model": model}],
    }
    (folder / "scene.json").write_text(json.dumps(scenario))
    return folder / "scene.json"


def test_a_motion_model_can_be_named_on_the_command_line(tmp_path: Path) -> None:
    """Plan and check see the zones of the model that is named, whatever the file says."""
    seen, plan = watched(tmp_path), tmp_path / "plan.json"
    planned = run("plan", seen, "--model", "pedestrian", "-o", plan, "--no-bound")
    assert planned.exit_code == 0, planned.stderr
    checked = {
        model: json.loads(run("check", seen, plan, *(["--model", model] if model else []), "--json").stdout)
        for model in ("", "pedestrian", "car")
    }
    clearance = {model: each["least_clearance"] for model, each in checked.items()}
    assert clearance["pedestrian"] > clearance["car"] and clearance["pedestrian"] > clearance[""]
    named = json.loads(run("check", watched(tmp_path, "pedestrian"), plan, "--json").stdout)
    assert named == checked["pedestrian"]


def walkers(people: int, steps: int, seed: int) -> str:
    """Tracks of people whose velocities wander, as a table."""
    rng = np.random.default_rng(seed)
    rows = ["id,time,x,y"]
    for person in range(people):
        course = np.cumsum(0.4 * (rng.normal(size=2) + np.cumsum(0.2 * rng.normal(size=(steps, 2)), axis=0)), axis=0)
        rows += [f"{person},{0.4 * step:.1f},{x:.4f},{y:.4f}" for step, (x, y) in enumerate(course)]
    return "\n".join(rows) + "\n"


def test_a_model_fitted_to_half_of_the_tracks_is_tested_on_the_rest(tmp_path: Path) -> None:
    (tmp_path / "tracks.csv").write_text(walkers(60, 24, seed=2))
    options = ("--half", "--noise", "0.02", "--source", "made up", "-o", tmp_path / "half.yaml", "--json")
    fitted = json.loads(run("fit-motion", tmp_path / "tracks.csv", *options).stdout)
    assert fitted["fitted_to"]["tracks"] == 30 and fitted["fitted_to"]["source"] == "made up"
    assert fitted["noise_deviation"] == 0.02
    coverage = ("study", "coverage", tmp_path / "tracks.csv", "--model", tmp_path / "half.yaml", "-o", tmp_path / "out")
    measured = json.loads(run(*coverage, "--json").stdout)["recorded"]
    pointwise = {row["lead_time"]: row for row in measured if row["level"] == "per_time"}
    assert list(pointwise) == [1.0, 2.0, 4.0]
    assert all(row["tracks"] == 30 and row["coverage"] > 0.88 for row in pointwise.values())


def test_fit_motion_says_what_to_do_with_a_few_tracks(tmp_path: Path) -> None:
    rows = [f"{name},{0.4 * k},{k + 0.1 * (-1) ** k},{name}" for name in range(3) for k in range(12)]
    (tmp_path / "tracks.csv").write_text("\n".join(["id,time,x,y", *rows]))
    refused = run("fit-motion", tmp_path / "tracks.csv", "-o", tmp_path / "m.json")
    assert refused.exit_code == 2 and "--no-tails" in refused.stderr and "WARNING" not in refused.stderr
    assert run("fit-motion", tmp_path / "tracks.csv", "--no-tails", "-o", tmp_path / "m.json").exit_code == 0
    assert json.loads((tmp_path / "m.json").read_text())["tails"] is None


# The command that calibrates the tracking error

HEADER = "drive,speed,curvature,error,note"


def test_a_file_of_drives_gives_the_tube_of_its_records(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    lines, records = [HEADER], []
    for drive in range(40):
        speed, curvature = rng.uniform(0.0, 3.0, 20), rng.uniform(-0.3, 0.3, 20)
        error = (0.01 + 0.02 * speed) * rng.uniform(size=20)
        records.append(TrackingRecord(speed, speed**2 * np.abs(curvature), error))
        lines += [f"{drive},{v!r},{k!r},{e!r},x" for v, k, e in np.stack([speed, curvature, error], axis=1).tolist()]
    file = tmp_path / "drives.csv"
    file.write_text("\n".join(lines) + "\n")
    result = run("fit-tracking", file, "--probability", "0.9", "--json")
    assert result.exit_code == 0, result.stderr
    found, tube = json.loads(result.stdout), fit_tracking_tube(records, 0.9)
    assert found["per_speed"] == pytest.approx(tube.per_speed, rel=1e-12)
    assert found["largest_radius"] == pytest.approx(float(tube.radius(tube.max_speed, tube.max_lateral)), rel=1e-12)
    assert found["records"] == 20


@pytest.mark.parametrize(
    ("text", "options", "told"),
    [
        ("drive,speed,error\n1,2,3\n", [], "must have the columns drive, speed, curvature, error"),
        (f"{HEADER}\n1,2,0.1,-0.1,\n1,fast,0.1,0.1,\n", [], "line 2, column error"),
        (f"{HEADER}\n1,2,0.1,0.1,\n1,fast,0.1,0.1,\n", [], "line 3, column speed"),
        (f"{HEADER}\n1,2,0.1,0.1,\n2,2,0.1,0.1,\n", [], "2 drives are too few for 0.95; it takes 38"),
        (f"{HEADER}\n1,2,0.1,0.1,\n", ["--probability", "1"], "between 0 and 1"),
    ],
)
def test_what_is_wrong_is_told(text: str, options: list[str], told: str, tmp_path: Path) -> None:
    file = tmp_path / "drives.csv"
    file.write_text(text)
    result = run("fit-tracking", file, *options)
    assert result.exit_code != 0
    said = f"{result.output} {result.exception}"
    assert told in " ".join(said.split()), said
