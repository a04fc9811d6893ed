"""The command that calibrates the tracking error."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from scp_planner.cli import app
from scp_planner.tracking.error_tube import TrackingRecord, fit_tracking_tube

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
    result = CliRunner().invoke(app, ["fit-tracking", str(file), "--probability", "0.9", "--json"])
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
    result = CliRunner().invoke(app, ["fit-tracking", str(file), *options])
    assert result.exit_code != 0
    said = f"{result.output} {result.exception}"
    assert told in " ".join(said.split()), said
