"""Results of a study on disk: what an interrupted study goes on from."""

from __future__ import annotations

import json
import os
from collections.abc import Sequence
from pathlib import Path

from scp_planner.errors import StudyError
from scp_planner.files import regular_target
from scp_planner.studies.field import Record, Replication, ZoneKind


class ResultFile:
    """Results of repetitions, one line of JSON each."""

    def __init__(self, path: Path, fingerprint: str) -> None:
        self.path = regular_target(path)
        self.fingerprint = fingerprint

    def load(self) -> dict[Replication, list[Record]]:
        """Return the results that are there; a last line that was cut short is taken away."""
        if not self.path.exists():
            return {}
        text = self.path.read_bytes()
        whole = text.rfind(b"\n") + 1
        if whole < len(text):
            with open(self.path, "r+b") as file:
                file.truncate(whole)
        found: dict[Replication, list[Record]] = {}
        for number, line in enumerate(text[:whole].decode("utf-8").splitlines(), start=1):
            try:
                data = json.loads(line)
                task = Replication(data["noise"], data["size"], data["repetition"])
                records = [Record(task, ZoneKind(kind), values) for kind, values in data["kinds"].items()]
            except (ValueError, KeyError, TypeError, AttributeError):
                raise StudyError(f"{self.path}: line {number} is no result of this study") from None
            if data.get("study") == self.fingerprint:
                found[task] = records
        return found

    def append(self, records: Sequence[Record]) -> None:
        """Add the records of one repetition: one write to the end of the file, which is there whole or not at all."""
        task = records[0].task
        data = {
            "study": self.fingerprint,
            "noise": task.noise,
            "size": task.size,
            "repetition": task.repetition,
            "kinds": {record.kind.value: record.values for record in records},
        }
        line = json.dumps(data, allow_nan=False) + "\n"
        descriptor = os.open(self.path, os.O_WRONLY | os.O_APPEND | os.O_CREAT, 0o666)
        try:
            os.write(descriptor, line.encode("utf-8"))
            os.fsync(descriptor)
        finally:
            os.close(descriptor)
