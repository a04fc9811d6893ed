"""Files of recorded motions: what stands in them, row by row."""

from __future__ import annotations

import csv
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np

from scp_planner.arrays import Array
from scp_planner.errors import MISSING, EstimationError, Fault, TracksError
from scp_planner.trips.sample_checks import MOST_FAULTS
from scp_planner.trips.sample_files import NAMES, delimiter_of, plain_name

OBSMAT_STEP = 0.4  # s between the rows of one person
DUT_FRAME_RATE = 23.98  # 1/s

_OBSMAT_COLUMNS = ("frame", "id", "x", "z", "y", "vx", "vz", "vy")
_XML = ".xml"
_SUFFIXES = (".csv", ".txt", _XML)


@dataclass(frozen=True)
class Track:
    """Positions of one obstacle in order of time."""

    id: str
    times: Array
    positions: Array

    def __post_init__(self) -> None:
        times, positions = np.asarray(self.times, dtype=float), np.asarray(self.positions, dtype=float)
        object.__setattr__(self, "times", times)
        object.__setattr__(self, "positions", positions)
        if times.ndim != 1 or not len(times) or positions.shape != (len(times), 2):
            raise EstimationError(
                f"track {self.id!r}: shapes {times.shape}, {positions.shape}; must be (n,), (n, 2), n > 0"
            )
        if not (np.isfinite(times).all() and np.isfinite(positions).all()):
            raise EstimationError(f"track {self.id!r}: it has values that are not finite")
        if not np.all(np.diff(times) > 0.0):
            raise EstimationError(f"track {self.id!r}: its times do not increase")

    def __len__(self) -> int:
        return len(self.times)

    def between(self, start: float, stop: float) -> Track | None:
        """Cut out the positions with start <= time <= stop, s; None if there are none."""
        first, last = np.searchsorted(self.times, start, "left"), np.searchsorted(self.times, stop, "right")
        return Track(self.id, self.times[first:last], self.positions[first:last]) if last > first else None


@dataclass(frozen=True)
class _TrackPoint:
    """One position in a file; the time is in s or, where so said, in frames."""

    line: int
    id: str
    time: float
    x: float
    y: float


@dataclass(frozen=True)
class _Format:
    """Columns of a file."""

    id: str | None
    time: str
    x: str
    y: str
    seconds: float | None  # per unit of the time column; None: its steps tell, as of `_obsmat_seconds`


def _read(path: Path) -> list[Track]:
    """Read one file."""
    if path.suffix.lower() == _XML:
        return _read_commonroad(path)
    try:
        text = path.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError as error:
        raise TracksError(str(path), [Fault("", f"byte {error.start}", "must be UTF-8 text")]) from None
    lines = [(i, line) for i, line in enumerate(text.splitlines(), 1) if line.strip()]
    if not lines:
        raise TracksError(str(path), [Fault("", text, "must hold tracks; it is empty")])
    faults: list[Fault] = []
    if _is_obsmat(lines[0][1]):
        form = _Format("id", "frame", "x", "y", None)
        rows = list(_rows(((i, _obsmat_fields(line)) for i, line in lines), form, faults))
    else:
        header, mark = lines[0][1], delimiter_of(lines[0][1])
        names = [plain_name(name) for name in header.split(mark)]
        form = _csv_format(path, header, set(names))
        reader = csv.DictReader((line for _, line in lines[1:]), names, restkey="", restval=None, delimiter=mark)
        numbered = zip((i for i, _ in lines[1:]), reader, strict=False)
        rows = list(_rows(numbered, form, faults, path.stem))
    if faults:
        raise TracksError(str(path), faults)
    if not rows:
        raise TracksError(str(path), [Fault("", lines[0][1], "must have rows below its header")])
    return _tracks(path, rows, _obsmat_seconds(path, rows) if form.seconds is None else form.seconds, form.time)


def _read_commonroad(path: Path) -> list[Track]:
    """Read the trajectories of a scenario of CommonRoad: exact times in steps, and points."""
    from xml.etree import ElementTree

    try:
        root = ElementTree.parse(path).getroot()
    except ElementTree.ParseError as error:
        raise TracksError(str(path), [Fault("", path.name, f"must be XML ({error})")]) from None
    step = _number(root.get("timeStepSize"))
    if step is None or step <= 0.0:
        raise TracksError(str(path), [Fault("timeStepSize", root.get("timeStepSize"), "must be a positive number")])
    faults: list[Fault] = []
    rows: list[_TrackPoint] = []
    for obstacle in [*root.iter("dynamicObstacle"), *root.iter("obstacle")]:
        name = obstacle.get("id", "")
        states = [*obstacle.findall("initialState"), *obstacle.findall("trajectory/state")]
        for count, state in enumerate(states if len(states) > 1 else ()):
            values = [_number(state.findtext(each)) for each in ("time/exact", "position/point/x", "position/point/y")]
            time, x, y = values
            if time is None or x is None or y is None:
                faults.append(Fault(f"obstacle {name}, state {count}", values, "must have an exact time and a point"))
            else:
                rows.append(_TrackPoint(count, name, time, x, y))
    if faults:
        raise TracksError(str(path), faults[:MOST_FAULTS])
    if not rows:
        raise TracksError(str(path), [Fault("", path.name, "must hold obstacles with trajectories")])
    return _tracks(path, rows, step, "time")


def _is_obsmat(line: str) -> bool:
    try:
        return len([float(word) for word in line.split()]) == len(_OBSMAT_COLUMNS)
    except ValueError:
        return False


def _csv_format(path: Path, header: str, columns: set[str]) -> _Format:
    if columns >= {"id", "frame", "x_est", "y_est"}:
        return _Format("id", "frame", "x_est", "y_est", 1.0 / DUT_FRAME_RATE)
    if columns >= {"timestamp", "x", "y"}:
        return _Format(None, "timestamp", "x", "y", 1.0)
    time, x, y = (next(filter(columns.__contains__, NAMES[what]), None) for what in ("time", "x", "y"))
    if "id" in columns and time and x and y:
        return _Format("id", time, x, y, 1.0)
    text = "must be a header with the columns id, time, x and y; with their units time_s, x_m and y_m"
    raise TracksError(str(path), [Fault("line 1", header, text)])


def _rows(
    numbered: Iterator[tuple[int, Mapping[str, str | None]]],
    form: _Format,
    faults: list[Fault],
    single: str = "",
) -> Iterator[_TrackPoint]:
    """Turn lines into rows; what is wrong goes to ``faults``."""
    for number, fields in numbered:
        values = []
        for column in (form.time, form.x, form.y):
            text = fields.get(column)
            value = _number(text)
            if value is None:
                place = f"line {number}, column {column}"
                faults.append(Fault(place, text if text is not None else MISSING, "must be a finite number"))
            values.append(value)
        name = single if form.id is None else (fields.get(form.id) or "").strip()
        if form.id is not None and not name:
            faults.append(Fault(f"line {number}, column {form.id}", name, "must name the track"))
        if len(faults) >= MOST_FAULTS:
            return
        time, x, y = values
        if time is not None and x is not None and y is not None:
            yield _TrackPoint(number, name, time, x, y)


def _number(text: str | None) -> float | None:
    try:
        value = float(text) if text is not None else math.nan
    except ValueError:
        return None
    return value if math.isfinite(value) else None


def _obsmat_fields(line: str) -> dict[str, str]:
    fields = dict(zip(_OBSMAT_COLUMNS, line.split(), strict=False))
    number = _number(fields.get("id"))
    if number is not None and number == int(number):
        fields["id"] = str(int(number))  # the file has 1.0000000e+00
    return fields


def _obsmat_seconds(path: Path, rows: Sequence[_TrackPoint]) -> float:
    """Give seconds per frame: most rows of one person follow each other by `OBSMAT_STEP`."""
    frames: dict[str, list[float]] = {}
    for row in rows:
        frames.setdefault(row.id, []).append(row.time)
    steps = np.concatenate([np.diff(sorted(each)) for each in frames.values()])
    steps = steps[steps > 0.0]
    if not len(steps):
        raise TracksError(str(path), [Fault("", rows[0].id, "must have persons with more than one row")])
    values, counts = np.unique(steps, return_counts=True)
    return OBSMAT_STEP / float(values[np.argmax(counts)])


def _tracks(path: Path, rows: Sequence[_TrackPoint], seconds: float, column: str) -> list[Track]:
    by_id: dict[str, list[_TrackPoint]] = {}
    for row in rows:
        by_id.setdefault(row.id, []).append(row)
    faults, tracks = [], []
    for name, own in by_id.items():
        own.sort(key=lambda row: row.time)
        for before, row in pairwise(own):
            if row.time == before.time:
                text = f"must not be there twice for track {name}; it is in line {before.line} too"
                faults.append(Fault(f"line {row.line}, column {column}", row.time, text))
        if not faults:
            positions = np.array([[row.x, row.y] for row in own])
            tracks.append(Track(name, seconds * np.array([row.time for row in own]), positions))
    if faults:
        raise TracksError(str(path), faults[:MOST_FAULTS])
    return tracks
