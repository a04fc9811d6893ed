"""Record of a closed loop: every cycle, the course of vehicle and obstacles, and the plans."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from os import PathLike
from typing import TYPE_CHECKING, Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from scp_planner.arrays import Array
from scp_planner.errors import PlanError
from scp_planner.files import read_json, write_text
from scp_planner.online.plan import OnlinePlan, Outcome
from scp_planner.outputs import output_named, picture_or_text
from scp_planner.planning.plan import Plan
from scp_planner.scenario.models import Scenario
from scp_planner.scenario.shapes import Disc, Shape
from scp_planner.simulation.cycle import Cycle, finite, infinite, record_to_dict
from scp_planner.simulation.run_file import RunPart, read_part, read_plan

if TYPE_CHECKING:
    from matplotlib.figure import Figure


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

    scenario: Scenario
    seed: int
    arrived: bool
    contact: bool
    contact_standing: bool
    travel_time: float
    least_clearance: float
    records: tuple[Cycle, ...]
    time: Array
    position: Array
    heading: Array
    speed: Array
    obstacles: Mapping[str, Array]
    plans: tuple[Plan, ...]
    shapes: Mapping[str, Shape] = field(default_factory=dict)
    changes: tuple[Scenario, ...] = ()

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
        return {
            "schema": 1,
            "scenario": self.scenario.to_dict(),
            "seed": self.seed,
            "arrived": self.arrived,
            "contact": self.contact,
            "contact_standing": self.contact_standing,
            "travel_time": self.travel_time,
            "least_clearance": finite(self.least_clearance),
            "outcomes": self.outcomes,
            "course": {
                "time": self.time.tolist(),
                "position": self.position.tolist(),
                "heading": self.heading.tolist(),
                "speed": self.speed.tolist(),
                "obstacles": {
                    name: [None if np.isnan(x) else [x, y] for x, y in center.tolist()]
                    for name, center in self.obstacles.items()
                },
            },
            "records": [record_to_dict(record) for record in self.records],
            "plans": [plan_to_dict(plan) for plan in self.plans],
            "shapes": {name: shape.model_dump(mode="json") for name, shape in self.shapes.items()},
            **({"changes": [each.to_dict() for each in self.changes]} if self.changes else {}),
        }

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
        name = str(path)
        if name.lower().endswith(".jsonl"):
            found: Self = output_named("run recorded")(path)
            return found
        data = read_part(RunPart, read_json(path, PlanError), name)
        course = data.course
        return cls(
            scenario=data.scenario,
            seed=data.seed,
            arrived=data.arrived,
            contact=data.contact,
            contact_standing=data.contact_standing,
            travel_time=data.travel_time,
            least_clearance=infinite(data.least_clearance),
            records=tuple(record.cycle() for record in data.records),
            time=np.array(course.time),
            position=np.array(course.position),
            heading=np.array(course.heading),
            speed=np.array(course.speed),
            obstacles={
                key: np.array([[np.nan, np.nan] if place is None else place for place in center])
                for key, center in course.obstacles.items()
            },
            plans=tuple(read_plan(plan, name, f"plans[{number}]") for number, plan in enumerate(data.plans)),
            shapes=data.shapes,
            changes=tuple(data.changes),
        )

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


def plan_to_dict(plan: Plan) -> dict[str, Any]:
    """Return a plan of a run, as small as it may be."""
    data = plan.to_dict(samples=21)
    data["wall_time"] = 0.0  # not the same in two runs
    if isinstance(plan, OnlinePlan):
        data.update(outcome=str(plan.outcome), code=str(plan.code), obstacle=plan.obstacle, lasts=plan.lasts)
    return data
