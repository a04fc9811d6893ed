"""Recorded tracks: where people, cars and cyclists really went, read from files and turned into scenarios."""

from __future__ import annotations

import csv
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from scp_planner import files
from scp_planner.arrays import Array
from scp_planner.errors import MISSING, EstimationError, Fault, TracksError
from scp_planner.scenario.models import Scenario
from scp_planner.scenario.process_model import ProcessModel
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


class Tracks(Sequence[Track]):
    """Tracks of one place or several; ids are unique."""

    def __init__(self, tracks: Sequence[Track], source: str = "") -> None:
        self._tracks = tuple(tracks)
        self.source = source
        names: set[str] = set()
        for track in self._tracks:
            if track.id in names:
                raise EstimationError(f"tracks: the id {track.id!r} is there twice")
            names.add(track.id)

    def __getitem__(self, index: Any) -> Any:
        return Tracks(self._tracks[index], self.source) if isinstance(index, slice) else self._tracks[index]

    def __len__(self) -> int:
        return len(self._tracks)

    @property
    def ids(self) -> tuple[str, ...]:
        """The ids, in order."""
        return tuple(track.id for track in self._tracks)

    @property
    def start(self) -> float:
        """Time of the first position of all, s."""
        return min(float(track.times[0]) for track in self._tracks)

    @property
    def stop(self) -> float:
        """Time of the last position of all, s."""
        return max(float(track.times[-1]) for track in self._tracks)

    @property
    def observations(self) -> int:
        """Number of positions in all tracks."""
        return sum(len(track) for track in self._tracks)

    def of(self, name: str) -> Track:
        """Give the track with an id."""
        for track in self._tracks:
            if track.id == name:
                return track
        raise EstimationError(f"tracks: there is none with the id {name!r}")

    @classmethod
    def load(cls, path: str | PathLike[str]) -> Tracks:
        """Read a file, or all .csv, .txt and .xml files of a folder and of the folders in it.

        In a folder each id begins with the name of its file, as in ``eth_obsmat/12``.

        Parameters
        ----------
        path : path

        Returns
        -------
        Tracks

        Raises
        ------
        TracksError
            Naming the file and, for each fault, the line and the column.
        OSError
            If the file cannot be read.
        """
        root = Path(path)
        if not root.is_dir():
            return cls(_read(root), str(root))
        try:
            files.check_extent(root)
        except ValueError as error:
            raise TracksError(str(root), [Fault("", str(root), str(error))]) from None
        names = sorted(p for p in root.rglob("*") if p.suffix.lower() in _SUFFIXES and p.is_file())
        if not names:
            raise TracksError(str(root), [Fault("", root.name, f"must hold files ending in {' or '.join(_SUFFIXES)}")])
        tracks = []
        for name in names:
            place = name.relative_to(root).with_suffix("").as_posix()
            for track in _read(name):
                single = track.id == name.stem
                tracks.append(Track(place if single else f"{place}/{track.id}", track.times, track.positions))
        return cls(tracks, str(root))

    @classmethod
    def joined(cls, paths: Sequence[str | PathLike[str]]) -> Tracks:
        """Read several files or folders as one; then each id begins with the name of its file, too.

        Parameters
        ----------
        paths : sequence of path

        Returns
        -------
        Tracks

        Raises
        ------
        TracksError, OSError
            As in :meth:`load`.
        """
        parts = [cls.load(path) for path in paths]
        if len(parts) == 1:
            return parts[0]
        tracks = [
            Track(f"{Path(path).stem}/{track.id}", track.times, track.positions)
            for path, part in zip(paths, parts, strict=True)
            for track in part
        ]
        return cls(tracks, ", ".join(part.source for part in parts))

    def save(self, path: str | PathLike[str]) -> None:
        """Write a CSV file ``id,time,x,y`` that `load` reads back exactly, whole or not at all."""
        rows = [(track.id, *row) for track in self for row in np.column_stack([track.times, track.positions]).tolist()]
        files.write_csv(path, [("id", "time", "x", "y"), *rows])

    def halves(self) -> tuple[Tracks, Tracks]:
        """Split into every other track, in the order of the file: one half to fit, one to test."""
        return self[0::2], self[1::2]

    def scenario_at(
        self,
        time: float,
        *,
        start: Mapping[str, Any],
        window: float = 3.0,
        stale: float = 1.0,
        radius: float = 0.3,
        noise: float | None = 0.05,
        order: int = 1,
        process: ProcessModel | None = None,
        **fields: Any,
    ) -> Scenario:
        """Make the scenario of a vehicle that sets off at a moment, from what had been seen by then.

        Parameters
        ----------
        time : float, s
            The moment, on the clock of the tracks.
        start : mapping
            ``position``, ``heading`` and ``speed`` of the vehicle, as in `scp_planner.scenario.models.Start`; its
            time is ``time``.
        window : float, s
            How far back observations are used.
        stale : float, s
            Obstacles that were last seen longer ago than this have gone.
        radius : float, m
            Of the disc that covers an obstacle.
        noise : float or None, m
            Standard deviation of an observed coordinate; None: estimated from the residuals.
        order : int
            Of the motion. Obstacles seen too rarely for it get the highest order that they were seen often
            enough for.
        process : ProcessModel, optional
            A motion with process noise instead.
        **fields
            Further fields of the scenario: its ``vehicle`` and ``goal``, and ``name``, ``bounds``, ``confidence``,
            ``guide`` or others, as in `scp_planner.scenario.models.Scenario`.

        Returns
        -------
        Scenario

        Raises
        ------
        EstimationError
            If an obstacle was seen too rarely for its noise to be estimated.
        ScenarioError
            If the vehicle, its start or its goal is faulty.
        """
        obstacles = []
        for track in self._tracks:
            seen = track.between(time - window, time)
            if seen is None or seen.times[-1] < time - stale:
                continue
            model = {"order": _order_of(seen, order, noise is None and process is None), "process": process}
            covariance = None if noise is None else [[noise**2, 0.0], [0.0, noise**2]]
            positions = {"time": seen.times.tolist(), "position": seen.positions.tolist(), "covariance": covariance}
            shape = {"disc": radius}
            obstacles.append({"id": track.id, "shape": shape, "observations": positions, "model": model})
        named = {"name": f"{Path(self.source).stem or 'tracks'} at {time:g} s", **fields}
        return Scenario(start={**start, "time": float(time)}, obstacles=obstacles, **named)


def _order_of(seen: Track, order: int, is_noise_estimated: bool) -> int:
    """Give the highest order up to one asked for that a track is long enough for."""
    highest = len(seen) - (3 if is_noise_estimated else 1)
    if highest < 0:
        raise EstimationError(f"track {seen.id!r}: {len(seen)} positions are too few to estimate their noise; give it")
    return min(order, highest)


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
    id: str | None
    time: str
    x: str
    y: str
    seconds: float | None  # per unit of the time column; None: its steps tell, as of `_obsmat_seconds`


def _read(path: Path) -> list[Track]:
    if path.suffix.lower() == _XML:
        return _read_commonroad(path)
    text = files.read_text(path, TracksError)
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
    root = files.read_xml(path, TracksError)
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
    numbered: Iterator[tuple[int, Mapping[str, str | None]]], form: _Format, faults: list[Fault], single: str = ""
) -> Iterator[_TrackPoint]:
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
