"""Files of samples of a trip: tables with a row a time, whoever wrote them."""

from __future__ import annotations

import csv
import re
import struct
import zlib
from collections.abc import Callable, Iterable, Sequence
from io import BytesIO
from os import PathLike
from pathlib import Path
from typing import Any
from zipfile import BadZipFile, ZipFile

import numpy as np

from scp_planner.arrays import Array
from scp_planner.errors import MISSING, Fault, SamplesError
from scp_planner.files import LARGEST_FILE, read_bytes, read_json, read_text
from scp_planner.trips.sample_checks import MOST_FAULTS, check_columns

SAMPLE_SUFFIXES = (".csv", ".npz", ".json")

NAMES = {
    "time": ("time", "t", "time_s", "t_s"),
    "x": ("x", "x_m"),
    "y": ("y", "y_m"),
    "heading": ("heading", "heading_rad", "yaw", "yaw_rad", "theta"),
    "speed": ("speed", "speed_m_per_s", "v"),
}
"""Names of columns, in letters of either case; a unit may follow in brackets: ``time [s]``."""

_NEEDED = ("time", "x", "y")
_UNITS = {"time": "s", "x": "m", "y": "m", "heading": "rad", "speed": "m/s"}
_OTHER_UNITS = "ms us ns min h km cm mm ft deg degree degrees ° km_per_h kmh kph mph kn knots".split()
_BRACKETS = re.compile(r"([^\[(]*)[\[(](.*)[\])]")
_DELIMITERS = ",;\t"


def read_columns(path: str | PathLike[str]) -> dict[str, Array]:
    """Read the columns of a file of samples."""
    source, suffix = str(path), Path(path).suffix.lower()
    match suffix:
        case ".csv":
            return _of_csv(source, Path(path))
        case ".npz":
            return _joined(source, _of_npz(source), lambda column, row: f"{column}[{row}]")
        case ".json":
            return of_json(source, read_json(path, SamplesError))
        case _:
            text = f"must end in one of {', '.join(SAMPLE_SUFFIXES)}"
            raise SamplesError(source, [Fault("file name", Path(path).name, text)])


def of_json(source: str, data: Any) -> dict[str, Array]:
    """Return the columns in a parsed JSON file."""
    if isinstance(data, dict) and "samples" in data:
        data = data["samples"]
    if isinstance(data, list):
        data = _columns_of_rows(source, data)
    if not isinstance(data, dict):
        raise SamplesError(source, [Fault("", data, "must be columns by their names, or a list of rows")])
    columns = {plain_name(str(name)): column for name, column in data.items()}
    position = columns.pop("position", None)
    if position is not None:
        columns["x"], columns["y"] = _axes(source, position)
    wrong = [
        Fault(name, columns[name], "must be a list of numbers")
        for names in NAMES.values()
        for name in names
        if name in columns and not isinstance(columns[name], list)
    ]
    if wrong:
        raise SamplesError(source, wrong)
    return _joined(source, columns, lambda column, row: f"{column}[{row}]")


def _columns_of_rows(source: str, rows: list[Any]) -> dict[str, list[Any]]:
    first = rows[0] if rows else None
    if not isinstance(first, dict):
        raise SamplesError(source, [Fault("[0]", first if rows else MISSING, "must be a row: values by their names")])
    faults = [
        Fault(f"[{number}]", row, f"must have the keys of the first row: {', '.join(first)}")
        for number, row in enumerate(rows)
        if not isinstance(row, dict) or not first.keys() <= row.keys()
    ]
    if faults:
        raise SamplesError(source, faults[:MOST_FAULTS])
    return {name: [row[name] for row in rows] for name in first}


def _axes(source: str, position: Any) -> Iterable[list[Any]]:
    faults = (
        [
            Fault(f"position[{row}]", point, "must be a pair [x, y]")
            for row, point in enumerate(position)
            if not isinstance(point, list) or len(point) != 2
        ]
        if isinstance(position, list)
        else [Fault("position", position, "must be a list of pairs [x, y]")]
    )
    if faults:
        raise SamplesError(source, faults[:MOST_FAULTS])
    return [point[0] for point in position], [point[1] for point in position]


_UNREADABLE = (BadZipFile, EOFError, NotImplementedError, RuntimeError, ValueError, struct.error, zlib.error)
"""Errors of damaged archives, of how they are packed, and of the headers of arrays in them."""


def _of_npz(source: str) -> dict[str, Sequence[Any]]:
    try:
        with ZipFile(BytesIO(read_bytes(source))) as packed:
            if sum(each.file_size for each in packed.infolist()) > LARGEST_FILE:
                raise ValueError(f"must have at most {LARGEST_FILE:,} bytes when it is unpacked")
            members = {each.filename: packed.read(each) for each in packed.infolist()}
        columns = {plain_name(name.removesuffix(".npy")): _column(raw) for name, raw in members.items()}
    except _UNREADABLE as error:
        raise SamplesError(source, [Fault("", MISSING, f"not a file of arrays: {error}")]) from None
    return {name: column for name, column in columns.items() if column is not None}


def _column(raw: bytes) -> list[Any] | None:
    """Return the numbers of an array of one axis; None of others. No more is made than there are bytes."""
    file = BytesIO(raw)
    is_first = np.lib.format.read_magic(file) == (1, 0)
    header = np.lib.format.read_array_header_1_0 if is_first else np.lib.format.read_array_header_2_0
    shape, _, kind = header(file)
    numbers = len(shape) == 1 and kind.kind in "biuf"
    found: list[Any] | None = np.frombuffer(raw, kind, shape[0], file.tell()).tolist() if numbers else None
    return found


def _of_csv(source: str, path: Path) -> dict[str, Array]:
    text = read_text(path, SamplesError)
    lines = ["" if line.startswith("#") else line for line in text.splitlines()]
    first = next(filter(str.strip, lines), "")
    reader = csv.reader(lines, delimiter=delimiter_of(first))
    try:
        rows = [(reader.line_num, row) for row in reader if any(cell.strip() for cell in row)]
    except csv.Error as error:
        raise SamplesError(source, [Fault(f"line {reader.line_num}", MISSING, f"must be CSV: {error}")]) from None
    if not rows:
        raise SamplesError(source, [Fault("", text, "must hold samples; it is empty")])
    (_, header), *rest = rows
    if all(_is_number(cell) for cell in header):
        raise SamplesError(source, [Fault("first row", first, "must name the columns: t,x,y or t,x,y,heading,speed")])
    names = [plain_name(name) for name in header]
    faults = [
        Fault(f"line {line}", ",".join(row), f"must have {len(names)} values, as the first line has, not {len(row)}")
        for line, row in rest
        if len(row) != len(names)
    ]
    faults += [
        Fault(f"column {name}", MISSING, "must be there only once") for name in set(names) if names.count(name) > 1
    ]
    if faults:
        raise SamplesError(source, faults[:MOST_FAULTS])
    columns: dict[str, Sequence[Any]] = {name: [row[k] for _, row in rest] for k, name in enumerate(names)}
    return _joined(source, columns, lambda column, row: f"line {rest[row][0]}, {column}")


def delimiter_of(header: str) -> str:
    """Delimiter of a table: the first there is of comma, semicolon and tab."""
    return next((mark for mark in _DELIMITERS if mark in header), ",")


def plain_name(name: str) -> str:
    """A column's name as `NAMES` has it: small, and a unit in brackets as a part of it."""
    name = name.strip().lower()
    found = _BRACKETS.fullmatch(name)
    return f"{found[1].rstrip()}_{found[2].replace('/', '_per_')}" if found else name


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def _joined(source: str, columns: dict[str, Sequence[Any]], place_of: Callable[[str, int], str]) -> dict[str, Array]:
    """Columns by what they are, checked; text is read as numbers."""
    there = {what: [name for name in names if name in columns] for what, names in NAMES.items()}
    faults = [
        Fault(" and ".join(found), MISSING, f"say the same; one of them must go ({what})")
        for what, found in there.items()
        if len(found) > 1
    ]
    for what in (what for what, found in there.items() if not found):
        other = next(
            (f"{name}_{unit}" for name in NAMES[what] for unit in _OTHER_UNITS if f"{name}_{unit}" in columns), None
        )
        if other is not None:
            faults.append(Fault(f"column {other}", MISSING, f"must be in {_UNITS[what]}: {', '.join(NAMES[what])}"))
        elif what in _NEEDED:
            told = f"no such column; called {' or '.join(NAMES[what])}; there are {', '.join(columns)}"
            faults.append(Fault(what, MISSING, told))
    if faults:
        raise SamplesError(source, faults)
    # The name in the file, for messages, of what a column is.
    called = {what: found[0] for what, found in there.items() if found}
    numbers = {what: _numbers(columns[name], name, place_of, faults) for what, name in called.items()}
    lengths = {len(column) for column in numbers.values()}
    if len(lengths) > 1:
        counts = ", ".join(f"{called[what]} {len(column)}" for what, column in numbers.items())
        faults.append(Fault("", MISSING, f"columns must be equally long; there are {counts}"))
    if faults:
        raise SamplesError(source, faults[:MOST_FAULTS])
    position = np.stack([numbers.pop("x"), numbers.pop("y")], axis=1)
    given = {"time": numbers.pop("time"), "position": position, **numbers}
    check_columns(given, source, lambda what, row: place_of(called[what], row))
    return given


def _numbers(column: Sequence[Any], name: str, place_of: Callable[[str, int], str], faults: list[Fault]) -> Array:
    found = np.full(len(column), np.nan)
    for row, value in enumerate(column):
        try:
            if isinstance(value, bool):
                raise TypeError
            found[row] = float(value)
        except (TypeError, ValueError, OverflowError):
            comma = ", with a decimal point" if isinstance(value, str) and "," in value else ""
            faults.append(Fault(place_of(name, row), value, f"must be a number{comma}"))
    return found
