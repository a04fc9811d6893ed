"""Samples of a trip and their files: what is read, and what is refused, with row and column."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from scp_planner import SampledTrajectory, SamplesError

TIME, X, Y = [0.0, 0.5, 1.0], [0.0, 1.0, 2.5], [0.0, 0.0, 0.5]
HEADING, SPEED = [0.0, 0.1, 0.2], [1.5, 2.0, 3.5]
POSITION = [list(pair) for pair in zip(X, Y, strict=True)]
WHOLE = SampledTrajectory(TIME, POSITION, HEADING, SPEED)


def csv(header: str, *columns: list[float]) -> str:
    return "\n".join([header, *(",".join(map(repr, row)) for row in zip(*columns, strict=True))])


@pytest.mark.parametrize(
    "header",
    [
        "t,x,y,heading,speed",
        "time_s,x_m,y_m,heading_rad,speed_m_per_s",
        " Time , X,Y, Yaw ,v",
        "time [s],x [m],y (m),heading [rad],speed [m/s]",
    ],
)
def test_tables_are_read_by_the_names_of_their_columns(header: str, tmp_path: Path) -> None:
    path = tmp_path / "trip.csv"
    path.write_text("\ufeff" + csv(header + ",v_x", TIME, X, Y, HEADING, SPEED, [7.0, 7.0, 7.0]) + "\n\n")
    assert SampledTrajectory.load(path) == WHOLE
    path.write_text(path.read_text().replace(",", ";") + "# the end")
    assert SampledTrajectory.load(path) == WHOLE
    path.write_text("# another planner\n" + csv("x,t,y", X, TIME, Y).replace(",", "\t"))
    assert SampledTrajectory.load(path) == SampledTrajectory(TIME, POSITION)


@pytest.mark.parametrize(
    "data",
    [
        {"time": TIME, "position": POSITION, "heading": HEADING, "speed": SPEED},
        {"samples": {"t": TIME, "x": X, "y": Y, "yaw": HEADING, "v": SPEED, "acceleration": [0.0] * 3}},
        [
            {"t": t, "x": x, "y": y, "heading": h, "speed": v}
            for t, x, y, h, v in zip(TIME, X, Y, HEADING, SPEED, strict=True)
        ],
    ],
)
def test_json_may_hold_columns_or_rows(data: Any, tmp_path: Path) -> None:
    path = tmp_path / "trip.json"
    path.write_text(json.dumps(data))
    assert SampledTrajectory.load(path) == WHOLE


def test_arrays_are_read(tmp_path: Path) -> None:
    path = tmp_path / "trip.npz"
    np.savez(path, time_s=TIME, x_m=X, y_m=Y, heading_rad=HEADING, speed_m_per_s=SPEED)
    assert SampledTrajectory.load(path) == WHOLE


@pytest.mark.parametrize(
    ("text", "faults"),
    [
        (
            "t,x,y\n0,0,0\n1,abc,2\n2,1,\n",
            ["line 3, x = 'abc': must be a number", "line 4, y = '': must be a number"],
        ),
        ("t,x,y\n0,0,0\n1,1,2\n2,1,nan\n", ["line 4, y = nan: must be a finite"]),
        ("t,x,y\n0,0,0\n1,1,1\n1,2,2\n", ["line 4, t = 1.0: must be later than 1, the one before"]),
        ("t,x,y,v\n0,0,0,1\n1,1,1,-2\n", ["line 3, v = -2.0: must not be negative"]),
        ("t,x,y\n0,0,0\n\n1,1\n", ["line 4 = '1,1': must have 3 values, as the first line has, not 2"]),
        ("t,x\n0,0\n1,1\n", ["y: no such column; called y or y_m; there are t, x"]),
        ("t;x;y\n0;0;0\n1;1,5;1\n", ["line 3, x = '1,5': must be a number, with a decimal point"]),
        ("0,0,0\n1,1,1\n", ["first row = '0,0,0': must name the columns"]),
        ("t_ms,x,y,v_kmh\n0,0,0,1\n1,1,1,1\n", ["column t_ms: must be in s: ", "column v_kmh: must be in m/s: "]),
        ("t,x,y,yaw [deg]\n0,0,0,90\n1,1,1,90\n", ["column yaw_deg: must be in rad: heading"]),
        ("t,time,x,y\n0,0,0,0\n1,1,1,1\n", ["time and t: say the same"]),
        ("t,x,x,y\n0,0,0,0\n1,1,1,1\n", ["column x: must be there only once"]),
        ("t,x,y\n0,0,0\n", ["time: must be a row of 2 or more times"]),
        ("", ["must hold samples; it is empty"]),
    ],
)
def test_faults_of_a_table_are_told_with_line_and_column(text: str, faults: list[str], tmp_path: Path) -> None:
    path = tmp_path / "trip.csv"
    path.write_text(text)
    with pytest.raises(SamplesError) as caught:
        SampledTrajectory.load(path)
    said = str(caught.value)
    assert said.startswith(f"{path}: {len(faults)} fault")
    for fault in faults:
        assert fault in said


@pytest.mark.parametrize(
    ("data", "fault"),
    [
        ({"t": [0, 1], "x": [0, True], "y": [0, 1]}, "x[1] = true: must be a number"),
        ({"t": [0, 1], "x": [0, 1, 2], "y": [0, 1]}, "columns must be equally long; there are t 2, x 3, y 2"),
        ({"time": [0, 1], "position": [[0, 0], [1]]}, "position[1] = [1]: must be a pair [x, y]"),
        ({"time": [0, 1], "position": 3}, "position = 3: must be a list of pairs [x, y]"),
        ({"t": 5, "x": [0], "y": [0]}, "t = 5: must be a list of numbers"),
        ([{"t": 0, "x": 0, "y": 0}, {"t": 1, "x": 1}], "[1] = {'t': 1, 'x': 1}: must have the keys of the first row"),
        ([], "[0]: must be a row"),
        ("text", "must be columns by their names, or a list of rows"),
    ],
)
def test_faults_of_json_are_told_with_their_keys(data: Any, fault: str, tmp_path: Path) -> None:
    path = tmp_path / "trip.json"
    path.write_text(json.dumps(data))
    with pytest.raises(SamplesError) as caught:
        SampledTrajectory.load(path)
    assert fault in str(caught.value)


def test_other_files_are_refused(tmp_path: Path) -> None:
    (tmp_path / "trip.txt").write_text("t,x,y")
    (tmp_path / "trip.json").write_text("{")
    (tmp_path / "trip.npz").write_text("no archive")
    (tmp_path / "trip.csv").write_bytes(b"t,x,y\n\xff")
    said = {
        "txt": "must end in one of .csv, .npz, .json",
        "json": "not a JSON file",
        "npz": "not a file of arrays",
        "csv": "UTF-8",
    }
    for suffix, text in said.items():
        with pytest.raises(SamplesError) as caught:
            SampledTrajectory.load(tmp_path / f"trip.{suffix}")
        assert text in str(caught.value)


def test_arrays_of_other_shapes_are_refused() -> None:
    with pytest.raises(SamplesError, match=r"position: must be of shape \(3, 2\), as there are 3 times, not \(2, 2\)"):
        SampledTrajectory(TIME, POSITION[:2])
    with pytest.raises(SamplesError, match=r"speed\[1\] = -2.0"):
        SampledTrajectory(TIME, POSITION, speed=[1.0, -2.0, 1.0])
    with pytest.raises(SamplesError, match=r"y\[2\] = inf"):
        SampledTrajectory(TIME, [[0.0, 0.0], [1.0, 1.0], [2.0, np.inf]])
    with pytest.raises(SamplesError, match="heading = 'east': must be numbers"):
        SampledTrajectory(TIME, POSITION, "east")


def test_samples_compare_and_hash_by_what_they_are() -> None:
    same = SampledTrajectory(np.array(TIME), np.array(POSITION), HEADING, SPEED, source="elsewhere")
    assert same == WHOLE and hash(same) == hash(WHOLE)
    assert SampledTrajectory(TIME, POSITION) != WHOLE
    assert repr(WHOLE) == "SampledTrajectory(3 samples with heading and speed, t = 0 ... 1 s)"
    with pytest.raises(ValueError, match="read-only"):
        WHOLE.time[0] = 7.0
