"""Samples of a trip and their files: what is read, and what is refused, with row and column."""

from __future__ import annotations

import io
import json
import tracemalloc
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from scp_planner import SampledTrajectory, SamplesError
from scp_planner.trips.sampled_motion import EndVelocity, SampledMotion, velocities

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
        "json": "must be JSON",
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


# What is made of samples between them, against the equations that define it and motions with known derivatives

Array = np.ndarray


def test_a_constant_acceleration_is_met_exactly_even_from_positions_alone() -> None:
    time = np.array([0.0, 0.3, 0.5, 1.1, 1.2])
    acceleration = np.array([0.7, -0.4])
    position = np.array([1.0, 2.0]) + np.outer(time, [1.0, 0.5]) + 0.5 * np.outer(time**2, acceleration)
    samples = SampledTrajectory(time, position)
    found = velocities(samples)
    np.testing.assert_allclose(found, np.array([1.0, 0.5]) + np.outer(time, acceleration), atol=1e-12)
    motion = SampledMotion.between(samples, found)
    np.testing.assert_allclose(motion.acceleration, np.tile(acceleration, (8, 1)), atol=1e-11)


def test_a_constant_jerk_is_missed_by_what_is_said() -> None:
    step, jerk = 0.4, 3.0
    samples = SampledTrajectory(
        [0.0, step], [[0.0, 0.0], [jerk * step**3 / 6.0, 0.0]], [0.0, 0.0], [0.0, jerk * step**2 / 2.0]
    )
    motion = SampledMotion.between(samples, velocities(samples))
    t = np.linspace(0.0, step, 1201)
    piece = (t > 0.5 * step).astype(np.intp)
    position = np.abs(motion.position_at(piece, t)[:, 0] - jerk * t**3 / 6.0).max()
    velocity = np.abs(motion.velocity_at(piece, t)[:, 0] - jerk * t**2 / 2.0).max()
    acceleration = np.abs(motion.acceleration[piece][:, 0] - jerk * t).max()
    assert position == pytest.approx(jerk * step**3 / 324.0, rel=1e-4)
    assert velocity == pytest.approx(jerk * step**2 / 24.0, rel=1e-9)
    assert acceleration == pytest.approx(jerk * step / 3.0, rel=1e-9)
    assert motion.acceleration[:, 0].min() >= 0.0 and motion.acceleration[:, 0].max() <= jerk * step


@pytest.mark.parametrize("share", np.linspace(0.02, 0.98, 13))
def test_a_jump_of_the_acceleration_is_overshot_by_an_eighth_of_it_at_most(share: float) -> None:
    """The acceleration is 0 for a share of the time and 1 for the rest."""
    driven, speed = 0.5 * (1.0 - share) ** 2, 1.0 - share
    samples = SampledTrajectory([0.0, 1.0], [[0.0, 0.0], [1.0 + driven, 0.0]], [0.0, 0.0], [1.0, 1.0 + speed])
    found = SampledMotion.between(samples, velocities(samples)).acceleration[:, 0]
    assert -0.125 - 1e-12 <= found.min() and found.max() <= 1.125 + 1e-12


def test_what_is_missing_comes_from_the_positions() -> None:
    time, position = [0.0, 1.0, 2.0, 4.0], [[0.0, 0.0], [1.0, 0.0], [2.0, 1.0], [2.0, 3.0]]
    every = velocities(SampledTrajectory(time, position))
    np.testing.assert_allclose(every[1], [1.0, 0.5])  # the mean of (1, 0) and (1, 1)
    np.testing.assert_allclose(every[2], [2.0 / 3.0, 1.0])  # weighted by the other side's time
    fast = velocities(SampledTrajectory(time, position, speed=[2.0, 2.0, 2.0, 2.0]))
    np.testing.assert_allclose(fast, 2.0 * every / np.hypot(*every.T)[:, None])
    turned = velocities(SampledTrajectory(time, position, heading=[0.0, 0.0, np.pi / 2, np.pi / 2]))
    np.testing.assert_allclose(turned[1:3], [[1.0, 0.0], [0.0, 1.0]], atol=1e-12)


def test_ends_are_as_fast_as_is_known_from_elsewhere() -> None:
    time, position = [0.0, 1.0, 2.0], [[0.0, 0.0], [1.0, 0.0], [2.0, 1.0]]
    first, last = EndVelocity(3.0, np.pi / 2), EndVelocity(0.0, None)
    found = velocities(SampledTrajectory(time, position), first, last)
    np.testing.assert_allclose(found[[0, -1]], [[0.0, 3.0], [0.0, 0.0]], atol=1e-12)
    # What the samples say themselves is left as it is.
    given = velocities(SampledTrajectory(time, position, [0.0, 0.0, 0.0], [1.0, 1.0, 1.0]), first, last)
    np.testing.assert_allclose(given, [[1.0, 0.0]] * 3)


def test_a_vehicle_that_stays_where_it_is_stands() -> None:
    time, position = [0.0, 1.0, 2.0, 3.0, 4.0], [[0.0, 0.0], [1.0, 0.0], [1.0, 0.0], [1.0, 0.0], [2.0, 0.0]]
    found = velocities(SampledTrajectory(time, position))
    np.testing.assert_array_equal(found[1:4], np.zeros((3, 2)))
    motion = SampledMotion.between(SampledTrajectory(time, position), found)
    assert (motion.velocity_at(np.arange(8), motion.end)[:, 0] >= 0.0).all()


def test_arrays_that_unpack_to_much_are_refused_first(tmp_path: Path) -> None:
    file = tmp_path / "trip.npz"
    with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as packed, packed.open("time.npy", "w") as inside:
        for _ in range(300):
            inside.write(bytes(2**20))
    with pytest.raises(SamplesError, match="when it is unpacked"):
        SampledTrajectory.load(file)


def test_no_more_numbers_are_made_than_an_array_has_bytes(tmp_path: Path) -> None:
    file, inside = tmp_path / "trip.npz", io.BytesIO()
    np.lib.format.write_array_header_1_0(inside, {"descr": "<f8", "fortran_order": False, "shape": (10**10,)})
    with zipfile.ZipFile(file, "w") as packed:
        packed.writestr("time.npy", inside.getvalue() + bytes(80))
    tracemalloc.start()
    with pytest.raises(SamplesError, match="not a file of arrays"):
        SampledTrajectory.load(file)
    assert tracemalloc.get_traced_memory()[1] < 10**7
    tracemalloc.stop()


def test_a_header_of_brackets_is_looked_at_once(tmp_path: Path) -> None:
    """A name in which each bracket was looked at from each other one took half a minute."""
    (tmp_path / "trip.csv").write_text(10**5 * "[" + "\n")
    with pytest.raises(SamplesError, match="no such column"):
        SampledTrajectory.load(tmp_path / "trip.csv")
