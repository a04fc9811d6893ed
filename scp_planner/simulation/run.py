"""Record of a closed loop: every cycle, the course of vehicle and obstacles, and the plans."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from functools import cache
from os import PathLike
from typing import TYPE_CHECKING, Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import TypeAdapter, create_model

from scp_planner.arrays import Array
from scp_planner.errors import PlanError
from scp_planner.files import read_json, write_text
from scp_planner.online.plan import Outcome
from scp_planner.outputs import output_named, picture_or_text
from scp_planner.scenario.models import Scenario
from scp_planner.scenario.shapes import Disc, Shape
from scp_planner.scenario.validation import fields_of, part_of_file
from scp_planner.scenario.values import Endless, Flag, Name, NotNegative, Whole
from scp_planner.simulation.cycle import Cycle
from scp_planner.simulation.run_file import (
    AnyCourse,
    AnyRun,
    Column,
    FiledChange,
    FiledPlan,
    FiledScenario,
    Places,
    PlacesThere,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure


RECORDING_SUFFIX = ".jsonl"
STRANGER = Disc(disc=0.3)
"""Shape of an obstacle that is not in the scenario, by default."""


@dataclass(frozen=True, eq=False)
class Run:
    """A closed loop from start to end. Two runs are equal if all that is recorded of them is.

    Attributes
    ----------
    scenario : Scenario
        What was given.
    seed : int
    arrived : bool
    contact : bool
        Whether the vehicle touched an obstacle while it moved.
    contact_standing : bool
        Whether it was touched while it stood.
    travel_time : float
        s; up to the end of the run if it did not arrive.
    least_clearance : float
        Least distance of the vehicle's disc to the true obstacles while it moved, m; inf without any.
    records : tuple of Cycle
    time : (n,) array
        Fine times, s.
    position : (n, 2) array
        Of the vehicle, m.
    heading, speed : (n,) arrays
        Of its front, rad, and along its path, m/s: also backwards not negative.
    obstacles : dict of str to (n, 2) array
        True centres, m; NaN where not there.
    plans : tuple of Plan
        One a cycle.
    shapes : dict of str to Shape
        Of obstacles that are not in the scenario.
    changes : tuple of Scenario
        What goal, ground and limits were from their ``start.time`` on, where they changed on the way.
    """

    scenario: FiledScenario
    seed: Whole
    arrived: Flag
    contact: Flag
    contact_standing: Flag
    travel_time: NotNegative
    least_clearance: Endless
    records: tuple[Cycle, ...]
    time: Column
    position: Places
    heading: Column
    speed: Column
    obstacles: Mapping[Name, PlacesThere]
    plans: tuple[FiledPlan, ...]
    shapes: Mapping[Name, Shape] = field(default_factory=dict)
    changes: tuple[FiledChange, ...] = ()

    @property
    def last_scenario(self) -> Scenario:
        """The scenario as it was at the end."""
        return self.changes[-1] if self.changes else self.scenario

    @property
    def outcomes(self) -> dict[str, int]:
        """Number of replans with each outcome."""
        counted = Counter(record.outcome for record in self.records)
        return {str(outcome): counted[str(outcome)] for outcome in Outcome}

    @property
    def wall_times(self) -> Array:
        """Wall time of each replan, (n,) s."""
        return np.array([record.wall_time for record in self.records])

    def __repr__(self) -> str:
        end = "arrived after" if self.arrived else "not arrived in"
        touched = ", touched an obstacle" if self.contact else ""
        return (
            f"Run({self.scenario.name!r}, {end} {self.travel_time:.4g} s, {self.least_clearance:.4g} m clear{touched},"
            f" {len(self.records)} replans)"
        )

    def _repr_html_(self) -> str:
        """For notebooks: what was driven, and where the obstacles were."""
        return picture_or_text(self.plot, repr(self))

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Run) and self.to_dict() == other.to_dict()

    __hash__ = None  # type: ignore[assignment]

    def to_dict(self) -> dict[str, Any]:
        """Return the contents of the run file."""
        data = _written().dump_python(self, mode="json", exclude={"records": {"__all__": {"wall_time"}}})
        course = {key: data.pop(key) for key in _COURSE}
        if not self.changes:
            del data["changes"]
        return {"schema": 1, **data, "outcomes": self.outcomes, "course": course}

    def save(self, path: str | PathLike[str]) -> None:
        """Write the run file, JSON, whole or not at all."""
        write_text(path, json.dumps(self.to_dict(), allow_nan=False) + "\n")

    @classmethod
    def load(cls, path: str | PathLike[str]) -> Self:
        """Read a run file, or a recording of :meth:`scp_planner.Planner.record`.

        Parameters
        ----------
        path : path
            .jsonl: a recording.

        Returns
        -------
        Run

        Raises
        ------
        PlanError
            If it is not one.
        """
        if str(path).lower().endswith(RECORDING_SUFFIX):
            found: Self = output_named("run recorded")(path)
            return found
        data = part_of_file(_run_part(), path, read_json(path, PlanError), PlanError)
        held = {**dict(data), **dict(data.course)}
        return cls(**{each.name: held[each.name] for each in fields(cls)})

    def table(self) -> dict[str, NDArray[Any]]:
        """Give what vehicle and obstacles did, (n,) arrays with units in their names; `pandas.DataFrame` takes it."""
        return output_named("run table")(self)

    def export(self, path: str | PathLike[str], **options: Any) -> None:
        """Write the run for other programs: .csv, .npz, .mcap, or a bag's folder; options of `export_run`."""
        output_named("run export")(self, path, **options)

    def plot(self, path: str | PathLike[str] | None = None, view: str = "map") -> Figure:
        """Draw a figure, .png, .pdf or .svg if it is to be saved, of a view: map, space-time or profiles.

        Parameters
        ----------
        path : path, optional
            Where to save the figure.
        view : str

        Returns
        -------
        matplotlib.figure.Figure

        Raises
        ------
        ValueError
            If the suffix or the view is another one.
        """
        return output_named("run plot")(self, path, view)

    def draw(self, path: str | PathLike[str], view: str = "map") -> None:
        """Draw into a file: .png, .pdf, .svg a figure; .gif, .mp4 an animation; .html a page for a browser.

        Parameters
        ----------
        path : path
        view : str
            Of a figure.

        Raises
        ------
        ValueError
            If the suffix or the view is another one.
        """
        output_named("run draw")(self, path, view)

    def recording(self, frames_per_second: float = 12.5, times: ArrayLike = ()) -> Any:
        """Sample the run, evenly and at times (n,) s, for pictures and the viewer: a `plotting.recording.Recording`."""
        return output_named("run recording")(self, frames_per_second, times)


_COURSE = ("time", "position", "heading", "speed", "obstacles")
"""Fields of a run that are below ``course`` in its file."""


@cache
def _written() -> TypeAdapter[Run]:
    return TypeAdapter(Run)


@cache
def _run_part() -> Any:
    """Model of a run file, of the fields of a run."""
    others = [each.name for each in fields(Run) if each.name not in _COURSE]
    course: Any = create_model("CoursePart", __base__=AnyCourse, **fields_of(Run, _COURSE))
    return create_model("RunPart", __base__=AnyRun, course=(course, ...), **fields_of(Run, others))
