"""A trip given by samples, as any planner can give it: times, positions, and perhaps headings and speeds."""

from __future__ import annotations

from dataclasses import dataclass, field
from os import PathLike
from typing import Self

import numpy as np
from numpy.typing import ArrayLike

from scp_planner.arrays import Array
from scp_planner.errors import Fault, SamplesError
from scp_planner.trips.sample_checks import check_columns
from scp_planner.units import Units

IN_MEMORY = "samples"


@dataclass(frozen=True, eq=False)
class SampledTrajectory:
    """A trip given by samples.

    What it does between them is a convention, see `scp_planner.trips.sampled_motion`.

    Attributes
    ----------
    time : (n,) array
        Absolute times, s, increasing; two or more.
    position : (n, 2) array
        Of the reference point in world coordinates, m.
    heading : (n,) array or None
        Directions of motion, rad.
    speed : (n,) array or None
        m/s, not negative.
    source : str
        Where they are from, for messages.
    """

    time: Array
    position: Array
    heading: Array | None = None
    speed: Array | None = None
    source: str = field(default=IN_MEMORY)

    def __init__(
        self,
        time: ArrayLike,
        position: ArrayLike,
        heading: ArrayLike | None = None,
        speed: ArrayLike | None = None,
        *,
        source: str = IN_MEMORY,
    ) -> None:
        """Take samples."""
        columns = {"time": time, "position": position, "heading": heading, "speed": speed}
        given = {name: _numbers(name, column, source) for name, column in columns.items() if column is not None}
        check_columns(given, source)
        for name in columns:
            object.__setattr__(self, name, given.get(name))
        object.__setattr__(self, "source", source)

    def __len__(self) -> int:
        return len(self.time)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, SampledTrajectory) and self._bits == other._bits

    def __hash__(self) -> int:
        return hash(self._bits)

    def __repr__(self) -> str:
        columns = " and ".join(name for name in ("heading", "speed") if getattr(self, name) is not None)
        return (
            f"SampledTrajectory({len(self)} samples{' with ' if columns else ''}{columns},"
            f" t = {self.time[0]:g} ... {self.time[-1]:g} s)"
        )

    @property
    def _bits(self) -> tuple[bytes | None, ...]:
        columns = self.time, self.position, self.heading, self.speed
        return tuple(None if column is None else column.tobytes() for column in columns)

    @property
    def travel_time(self) -> float:
        """From the first to the last sample, s."""
        return float(self.time[-1] - self.time[0])

    @classmethod
    def load(cls, path: str | PathLike[str]) -> Self:
        """Read a file of samples: .csv, .npz or .json.

        Parameters
        ----------
        path : path
            Columns or keys ``t``, ``x``, ``y``, and if there are any ``heading`` and ``speed``; with or without units
            in their names, as `scp_planner.export.save_table` writes them. Others are left alone.

        Returns
        -------
        SampledTrajectory

        Raises
        ------
        SamplesError
            Naming the file, and every row and column that is not allowed.
        OSError
            If the file cannot be read.
        """
        from scp_planner.trips.sample_files import read_columns

        columns = read_columns(path)
        return cls(columns["time"], columns["position"], columns.get("heading"), columns.get("speed"), source=str(path))

    def inside(self, units: Units) -> SampledTrajectory:
        """Return the samples in the units of their scene."""
        if units.are_those_of_the_user:
            return self
        return SampledTrajectory(
            (self.time - units.clock) / units.time,
            (self.position - np.asarray(units.origin)) / units.length,
            self.heading,
            None if self.speed is None else self.speed / units.speed,
            source=self.source,
        )


def _numbers(name: str, column: ArrayLike, source: str) -> Array:
    try:
        numbers = np.array(column, dtype=float)
    except (TypeError, ValueError):
        raise SamplesError(source, [Fault(name, column, "must be numbers, one for each time")]) from None
    numbers.flags.writeable = False
    return numbers
