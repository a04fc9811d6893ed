"""Rules of a trip's samples."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np

from scp_planner.arrays import Array
from scp_planner.errors import MISSING, Fault, SamplesError
from scp_planner.files import LARGEST_COORDINATE

FEWEST_TIMES = 2  # samples of a trip
MOST_FAULTS = 20  # of one input that are listed


def _place_of(name: str, row: int) -> str:
    return f"{name}[{row}]"


def check_columns(given: dict[str, Array], source: str, place_of: Callable[[str, int], str] = _place_of) -> None:
    """Refuse columns that are no samples of a trip."""
    faults = list(_shape_faults(given)) or list(_value_faults(given, place_of))
    if faults:
        raise SamplesError(source, faults[:MOST_FAULTS])


def _shape_faults(given: dict[str, Array]) -> Iterator[Fault]:
    count = given["time"].size
    if given["time"].ndim != 1 or count < FEWEST_TIMES:
        yield Fault(
            "time", MISSING, f"must be a row of {FEWEST_TIMES} or more times, not of shape {given['time'].shape}"
        )
        return
    for name, column in given.items():
        wanted = (count, 2) if name == "position" else (count,)
        if column.shape != wanted:
            yield Fault(name, MISSING, f"must be of shape {wanted}, as there are {count} times, not {column.shape}")


def _value_faults(given: dict[str, Array], place_of: Callable[[str, int], str]) -> Iterator[Fault]:
    largest = f"must be a finite number of at most {LARGEST_COORDINATE:g} in size"
    for name, column in given.items():
        good = np.abs(column) <= LARGEST_COORDINATE
        for row in np.flatnonzero(~good.reshape(len(column), -1).all(axis=1)):
            axis = "xy"[int(np.argmin(good[row]))] if name == "position" else name
            value = column[row][~good[row]][0] if name == "position" else column[row]
            yield Fault(place_of(axis, int(row)), float(value), largest)
    time = given["time"]
    for row in np.flatnonzero(time[1:] <= time[:-1]) + 1:
        yield Fault(
            place_of("time", int(row)), float(time[row]), f"must be later than {time[row - 1]:g}, the one before"
        )
    if "speed" in given:
        for row in np.flatnonzero(given["speed"] < 0.0):
            text = "must not be negative: a vehicle moves where it heads"
            yield Fault(place_of("speed", int(row)), float(given["speed"][row]), text)
