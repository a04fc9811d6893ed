"""The table of results, a CSV file that no interrupt can break."""

from __future__ import annotations

import csv
import importlib.util
import io
import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path

from scp_planner.errors import ScpPlannerError
from scp_planner.files import regular_target, replacing

KEY = "file"
LOCKS = importlib.util.find_spec("fcntl") is not None
"""True if files can be held, and renamed while they are open: not so on Windows."""
_APPENDING = os.O_WRONLY | os.O_APPEND | getattr(os, "O_BINARY", 0)


class TableError(ScpPlannerError):
    """A file cannot be gone on with: it holds something else, or somebody else writes to it."""


class Table:
    """Rows by the file that they are about."""

    def __init__(self, path: Path, columns: Sequence[str], rows: Mapping[str, dict[str, str]]) -> None:
        self.path = path
        self.columns = tuple(columns)
        self.rows = dict(rows)
        self._file = self._written()

    def add(self, row: Mapping[str, str]) -> None:
        """Add a row at the end of the file."""
        kept = {column: row[column] for column in self.columns}
        if kept[KEY] in self.rows:
            self.rows[kept[KEY]] = kept
            self._write_anew()
            return
        _write(self._file, _as_csv(self.columns, [kept]))
        self.rows[kept[KEY]] = kept

    def finish(self) -> None:
        """Sort the file by the key, and close it."""
        if list(self.rows) != sorted(self.rows):
            self._write_anew()
        os.close(self._file)

    def _write_anew(self) -> None:
        os.close(self._file)
        self._file = self._written()

    def _written(self) -> int:
        """Write all rows to a new file that takes the place of the old one; return it open at its end, and held."""
        self.rows = {key: self.rows[key] for key in sorted(self.rows)}
        header = dict(zip(self.columns, self.columns, strict=True))
        with replacing(self.path) as temporary:
            file = os.open(temporary, _APPENDING)
            _hold(file)
            _write(file, _as_csv(self.columns, [header, *self.rows.values()]))
            if not LOCKS:
                os.close(file)
        return file if LOCKS else os.open(self.path, _APPENDING)


@contextmanager
def opened(path: Path, columns: Sequence[str]) -> Iterator[Table]:
    """Open a table, and leave it sorted, whatever happens; a new one without rows is taken away."""
    path = regular_target(path)
    is_new = not path.exists()
    with _held(path):
        table = Table(path, columns, read(path, columns))
    try:
        yield table
    finally:
        table.finish()
        if is_new and not table.rows:
            path.unlink()


def read(path: Path, columns: Sequence[str]) -> dict[str, dict[str, str]]:
    """Read the rows of a table by their keys, without a last one that was cut short."""
    if not path.exists() or path.stat().st_size == 0:
        return {}
    data = path.read_bytes()
    whole = data[: data.rfind(b"\n") + 1]
    try:
        lines = list(csv.reader(io.StringIO(whole.decode("utf-8"), newline=""), strict=True))
    except (UnicodeDecodeError, csv.Error) as error:
        raise TableError(f"{path}: is no table of this batch: {error}") from None
    if not lines or lines[0] != list(columns):
        header = ",".join(lines[0]) if lines else ""
        raise TableError(f"{path}: is no table of this batch: its columns are {header!r}, not {','.join(columns)!r}")
    rows = {}
    for number, line in enumerate(lines[1:], start=2):
        if len(line) != len(columns):
            raise TableError(f"{path}: line {number} has {len(line)} cells, not {len(columns)}")
        rows[line[0]] = dict(zip(columns, line, strict=True))
    return rows


def _as_csv(columns: Sequence[str], rows: Sequence[Mapping[str, str]]) -> bytes:
    text = io.StringIO()
    writer = csv.DictWriter(text, columns, lineterminator="\n")
    writer.writerows(rows)
    return text.getvalue().encode("utf-8")


def _write(file: int, data: bytes) -> None:
    """Bring data to the disk, in one write."""
    if os.write(file, data) != len(data):
        raise OSError("a row could be written only in part; the disk may be full")
    os.fsync(file)


@contextmanager
def _held(path: Path) -> Iterator[None]:
    """Refuse a file that another batch holds, and hold it until a new one, held too, has taken its place."""
    if not LOCKS:
        yield
        return
    file = os.open(path, _APPENDING | os.O_CREAT, 0o666)
    try:
        # One that was replaced since it was opened is held by nobody, and is not the one to hold.
        if not _hold(file) or os.fstat(file).st_ino != os.stat(path).st_ino:
            raise TableError(f"{path}: another batch is writing to it")
        yield
    finally:
        os.close(file)


def _hold(file: int) -> bool:
    """Hold a file until it is closed; return whether nobody else does."""
    if not LOCKS:
        return True
    import fcntl

    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    return True
