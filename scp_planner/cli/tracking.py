"""The command that calibrates what planners allow for from recorded drives: fit-tracking."""

from __future__ import annotations

import csv
import math
from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

from scp_planner.cli.groups import Printing
from scp_planner.cli.options import Json, Quiet, bad_option
from scp_planner.cli.output import report
from scp_planner.errors import MISSING, Fault, TracksError

COLUMNS = ("drive", "speed", "curvature", "error")


def fit_tracking(
    drives: Annotated[
        Path, typer.Argument(metavar="DRIVES", help="CSV file with the columns drive, speed, curvature and error.")
    ],
    probability: Annotated[
        float,
        typer.Option("--probability", metavar="P", help="With which a whole new drive stays in the tube, at least."),
    ] = 0.95,
    as_json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Calibrate the tracking error from recorded drives.

    The tube round a plan that the vehicle stays in, its radius growing with speed and lateral acceleration. In the file
    speed (m/s) and curvature (1/m) are what was planned, error (m) is how far the vehicle was from there; rows of one
    drive have the same text in the column drive.
    """
    if not 0.0 < probability < 1.0:
        raise bad_option("--probability", probability, "must be between 0 and 1")
    import numpy as np

    from scp_planner.tracking.error_tube import TrackingRecord, fit_tracking_tube

    records = []
    for rows in _drives(drives).values():
        speed, curvature, error = np.array(rows).T
        records.append(TrackingRecord(speed, speed**2 * np.abs(curvature), error))
    tube = fit_tracking_tube(records, probability)
    largest = float(tube.radius(tube.max_speed, tube.max_lateral))
    report({**asdict(tube), "largest_radius": largest}, Printing(as_json, quiet))


def _drives(path: Path) -> dict[str, list[list[float]]]:
    """Read the planned speed and curvature and the error at each moment of each drive."""
    drives: dict[str, list[list[float]]] = {}
    faults: list[Fault] = []
    with path.open(encoding="utf-8", newline="") as file:
        table = csv.DictReader(file)
        missing = [name for name in COLUMNS if name not in (table.fieldnames or ())]
        if missing:
            raise TracksError(str(path), [Fault("line 1", missing[0], f"must have the columns {', '.join(COLUMNS)}")])
        for row in table:
            values = [_number(row[name]) for name in COLUMNS[1:]]
            for name, value in zip(COLUMNS[1:], values, strict=True):
                if not math.isfinite(value) or (value < 0.0 and name != "curvature"):
                    least = "" if name == "curvature" else " of at least 0"
                    place = f"line {table.line_num}, column {name}"
                    faults.append(Fault(place, row[name] or MISSING, f"must be a finite number{least}"))
            drives.setdefault(row["drive"], []).append(values)
            if len(faults) >= 20:
                break
    if faults:
        raise TracksError(str(path), faults)
    return drives


def _number(text: str | None) -> float:
    try:
        return math.nan if text is None else float(text)
    except ValueError:
        return math.nan
