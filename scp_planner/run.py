"""What happened in a closed loop: every cycle, the whole course of vehicle and obstacles, and the plans."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from scp_planner.errors import MISSING, Fault, PlanError
from scp_planner.files import write_text
from scp_planner.online import OnlinePlan
from scp_planner.online_settings import Outcome
from scp_planner.plan import Plan
from scp_planner.polynomials import PiecewisePolynomials
from scp_planner.scenario import Disc, Obstacle, Scenario, Shape
from scp_planner.sensors import Observation
from scp_planner.shapes import Outline
from scp_planner.zones import ThreatZone

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from scp_planner.recording import Recording

Array = NDArray[np.float64]

PLAN_SAMPLES = 21
STRANGER = Disc(disc=0.3)
"""What an obstacle that is not in the scenario looks like, if nothing else is said."""


@dataclass(frozen=True)
class OutlineRecord:
    """A convex outline: the numbers of an `Outline`.

    Attributes
    ----------
    vertices, matrix : nested tuples or None
        Of a polygon, (V, 2) m, or of an ellipse, (3,) m2.
    turning : bool
    """

    vertices: tuple[Any, ...] | None
    matrix: tuple[float, ...] | None
    turning: bool

    @classmethod
    def of(cls, outline: Outline) -> Self:
        """Write down an outline."""
        vertices, matrix = outline.vertices, outline.matrix
        return cls(
            None if vertices is None else _tuples(vertices.tolist()),
            None if matrix is None else tuple(matrix.tolist()),
            outline.turning,
        )

    def outline(self) -> Outline:
        """The outline."""
        vertices, matrix = (None if part is None else np.array(part) for part in (self.vertices, self.matrix))
        return Outline(vertices, matrix, self.turning)


@dataclass(frozen=True)
class ZoneRecord:
    """A zone as the planner saw it: the numbers of a `ThreatZone`.

    Attributes
    ----------
    id : str
    radius : float
        m.
    breakpoints : tuple of float
        s.
    center, covariance : nested tuples
        Coefficients, (S, P, 2) and (S, P, 3); the covariance is None where the motion is known.
    outlines : tuple of OutlineRecord
        None for a disc.
    """

    id: str
    radius: float
    breakpoints: tuple[float, ...]
    center: tuple[Any, ...]
    covariance_breakpoints: tuple[float, ...] | None
    covariance: tuple[Any, ...] | None
    outlines: tuple[OutlineRecord, ...] = ()

    @classmethod
    def of(cls, zone: ThreatZone) -> Self:
        """Write down a zone."""
        spread = zone.covariances
        return cls(
            zone.id,
            zone.radius,
            tuple(zone.centers.breakpoints[0].tolist()),
            _pieces(zone.centers),
            None if spread is None else tuple(spread.breakpoints[0].tolist()),
            None if spread is None else _pieces(spread),
            tuple(OutlineRecord.of(outline) for outline in zone.outlines),
        )

    def zone(self) -> ThreatZone:
        """The zone, to ask for its place and size."""
        spread = None
        if self.covariance is not None:
            spread = PiecewisePolynomials(np.array([self.covariance_breakpoints]), np.array([self.covariance]))
        centers = PiecewisePolynomials(np.array([self.breakpoints]), np.array([self.center]))
        outlines = tuple(record.outline() for record in self.outlines)
        return ThreatZone(self.id, self.radius, centers, spread, outlines)


@dataclass(frozen=True)
class Cycle:
    """One cycle: what was seen, what came of it, and how near it was.

    Attributes
    ----------
    time : float
        Of the replan, s.
    position : (x, y)
        Of the vehicle, m.
    heading, speed : float
        rad, m/s.
    outcome, status : str
        Of the plan.
    certified, safe : bool
        Whether its whole trip is certified; whether that or a stop from it is.
    reason : str
    arrival_time : float
        By the plan, s.
    iterations : int
    observations : tuple of Observation
        That came in since the last cycle.
    zones : tuple of ZoneRecord
        As they were when this was planned, with the planner's margin.
    truth : tuple of (id, (x, y))
        Where obstacles really were.
    clearance : float
        Least distance to a true obstacle up to the next cycle, m; inf without any.
    wall_time : float
        That the replan took, s; not part of the record: it is not the same in two runs.
    """

    time: float
    position: tuple[float, float]
    heading: float
    speed: float
    outcome: str
    status: str
    certified: bool
    safe: bool
    reason: str
    arrival_time: float
    iterations: int
    observations: tuple[Observation, ...]
    zones: tuple[ZoneRecord, ...]
    truth: tuple[tuple[str, tuple[float, float]], ...]
    clearance: float
    wall_time: float = field(default=0.0, compare=False)


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
        rad, m/s.
    obstacles : dict of str to (n, 2) array
        True centres, m; NaN where not there.
    plans : tuple of Plan
        One a cycle.
    shapes : dict of str to Shape
        Of obstacles that are not in the scenario.
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

    @property
    def outcomes(self) -> dict[str, int]:
        """How often each outcome came about."""
        counted = Counter(record.outcome for record in self.records)
        return {str(outcome): counted[str(outcome)] for outcome in Outcome}

    @property
    def wall_times(self) -> Array:
        """What each replan took, (n,) s."""
        return np.array([record.wall_time for record in self.records])

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
            "least_clearance": _finite(self.least_clearance),
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
            "records": [_record_to_dict(record) for record in self.records],
            "plans": [_plan_to_dict(plan) for plan in self.plans],
            "shapes": {name: shape.model_dump(mode="json") for name, shape in self.shapes.items()},
        }

    def save(self, path: str | PathLike[str]) -> None:
        """Write the run file, JSON, whole or not at all."""
        write_text(path, json.dumps(self.to_dict(), allow_nan=False) + "\n")

    @classmethod
    def load(cls, path: str | PathLike[str]) -> Self:
        """Read a run file.

        Parameters
        ----------
        path : path

        Returns
        -------
        Run

        Raises
        ------
        PlanError
            If it is not one.
        """
        name = str(path)
        try:
            data = json.loads(Path(path).read_text(encoding="utf-8"))
            course = data["course"]
            return cls(
                scenario=Scenario.model_validate(data["scenario"]),
                seed=data["seed"],
                arrived=data["arrived"],
                contact=data["contact"],
                contact_standing=data["contact_standing"],
                travel_time=data["travel_time"],
                least_clearance=_infinite(data["least_clearance"]),
                records=tuple(_record_from_dict(record) for record in data["records"]),
                time=np.array(course["time"]),
                position=np.array(course["position"]).reshape(-1, 2),
                heading=np.array(course["heading"]),
                speed=np.array(course["speed"]),
                obstacles={
                    key: np.array([[np.nan, np.nan] if place is None else place for place in center])
                    for key, center in course["obstacles"].items()
                },
                plans=tuple(_plan_from_dict(plan, name) for plan in data["plans"]),
                shapes={key: _shape_from_dict(shape) for key, shape in data["shapes"].items()},
            )
        except (UnicodeDecodeError, json.JSONDecodeError) as error:
            raise PlanError(name, [Fault("", MISSING, f"not a JSON file: {error}")]) from None
        except (KeyError, TypeError, IndexError) as error:
            raise PlanError(name, [Fault("", MISSING, f"not a run file: {error!r}")]) from None

    def table(self) -> dict[str, NDArray[Any]]:
        """Give what vehicle and obstacles did, (n,) arrays with units in their names; `pandas.DataFrame` takes it."""
        from scp_planner.export import run_table

        return run_table(self)

    def export(self, path: str | PathLike[str], **options: Any) -> None:
        """Write the run for other programs: .csv, .npz, .mcap, or a bag's folder; options of `export_run`."""
        from scp_planner.export import export_run

        export_run(self, path, **options)

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
        from scp_planner.plotting import plot_run_view

        return plot_run_view(self, path, view)

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
        from scp_planner.plotting import draw_run

        draw_run(self, path, view)

    def recording(self, frames_per_second: float = 12.5, times: ArrayLike = ()) -> Recording:
        """Sample the run, evenly and at times (n,) s, for pictures and the viewer."""
        from scp_planner.run_recording import record_run

        return record_run(self, frames_per_second, times)


def _record_to_dict(record: Cycle) -> dict[str, Any]:
    return {
        "time": record.time,
        "position": list(record.position),
        "heading": record.heading,
        "speed": record.speed,
        "outcome": record.outcome,
        "status": record.status,
        "certified": record.certified,
        "safe": record.safe,
        "reason": record.reason,
        "arrival_time": record.arrival_time,
        "iterations": record.iterations,
        "observations": [
            {
                "obstacle": seen.obstacle,
                "time": seen.time,
                "arrival": seen.arrival,
                "position": list(seen.position),
                "deviation": seen.deviation,
            }
            for seen in record.observations
        ],
        "zones": [
            {
                "id": zone.id,
                "radius": zone.radius,
                "breakpoints": [_finite(b) for b in zone.breakpoints],
                "center": zone.center,
                "covariance_breakpoints": None
                if zone.covariance_breakpoints is None
                else [_finite(b) for b in zone.covariance_breakpoints],
                "covariance": zone.covariance,
                "outlines": [
                    {"vertices": outline.vertices, "matrix": outline.matrix, "turning": outline.turning}
                    for outline in zone.outlines
                ],
            }
            for zone in record.zones
        ],
        "truth": {name: list(place) for name, place in record.truth},
        "clearance": _finite(record.clearance),
    }


def _record_from_dict(data: dict[str, Any]) -> Cycle:
    x, y = data["position"]
    return Cycle(
        time=data["time"],
        position=(x, y),
        heading=data["heading"],
        speed=data["speed"],
        outcome=data["outcome"],
        status=data["status"],
        certified=data["certified"],
        safe=data["safe"],
        reason=data["reason"],
        arrival_time=data["arrival_time"],
        iterations=data["iterations"],
        observations=tuple(
            Observation(
                seen["obstacle"],
                seen["time"],
                seen["arrival"],
                (seen["position"][0], seen["position"][1]),
                seen["deviation"],
            )
            for seen in data["observations"]
        ),
        zones=tuple(
            ZoneRecord(
                zone["id"],
                zone["radius"],
                tuple(_infinite(b) for b in zone["breakpoints"]),
                _tuples(zone["center"]),
                None
                if zone["covariance_breakpoints"] is None
                else tuple(_infinite(b) for b in zone["covariance_breakpoints"]),
                None if zone["covariance"] is None else _tuples(zone["covariance"]),
                tuple(
                    OutlineRecord(_tuples(outline["vertices"]), _tuples(outline["matrix"]), outline["turning"])
                    for outline in zone.get("outlines", ())
                ),
            )
            for zone in data["zones"]
        ),
        truth=tuple((name, (place[0], place[1])) for name, place in data["truth"].items()),
        clearance=_infinite(data["clearance"]),
    )


def _plan_to_dict(plan: Plan) -> dict[str, Any]:
    data = plan.to_dict(PLAN_SAMPLES)
    data["wall_time"] = 0.0  # not the same in two runs
    if isinstance(plan, OnlinePlan):
        data["outcome"] = str(plan.outcome)
    return data


def _plan_from_dict(data: dict[str, Any], name: str) -> Plan:
    plan = Plan.from_dict(data, name)
    if "outcome" not in data:
        return plan
    fields = {key: getattr(plan, key) for key in Plan.__dataclass_fields__}
    return OnlinePlan(**fields, outcome=Outcome(data["outcome"]))


def _shape_from_dict(data: dict[str, Any]) -> Shape:
    return Obstacle.model_validate({"id": "any", "shape": data, "motion": {"position": [0.0, 0.0]}}).shape


def _finite(value: float) -> float | None:
    return value if np.isfinite(value) else None


def _infinite(value: float | None) -> float:
    return float("inf") if value is None else value


def _pieces(polynomials: PiecewisePolynomials) -> tuple[Any, ...]:
    """Coefficients of the first of them, (S, P, d)."""
    return tuple(tuple(map(tuple, piece)) for piece in polynomials.coefficients[0].tolist())


def _tuples(value: Any) -> Any:
    return tuple(_tuples(each) for each in value) if isinstance(value, list) else value
