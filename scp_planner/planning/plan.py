"""The resulting plan: callable at any time, saved and loaded."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field, fields, replace
from enum import StrEnum
from functools import cached_property
from math import inf
from os import PathLike
from typing import TYPE_CHECKING, Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from scp_planner.arrays import Array
from scp_planner.certificate.lower_bound import kinematic_bound, lower_bound
from scp_planner.certificate.verdict import Clearance, LimitUse
from scp_planner.errors import PlanError
from scp_planner.files import read_json, write_text
from scp_planner.mathematics.splines import clamped_knots
from scp_planner.outputs import output_named, picture_or_text
from scp_planner.planning.search import Tried
from scp_planner.trips.legs import Leg, Legs
from scp_planner.trips.trajectory import TripPoints
from scp_planner.trips.trip import Trip

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from scp_planner.certificate.verdict import Certificate
    from scp_planner.scenario.models import Scenario
    from scp_planner.threat_zones.error_tube import TrackingTube
    from scp_planner.threat_zones.zone import ThreatZone

UNCHECKED = "No time was left to check the trip"
SAMPLED = ("position", "velocity", "heading", "speed", "acceleration", "curvature")
"""Functions of time in the samples of a plan file."""
_WORK = ("wall_time", "timings", "planned", "candidates", "tried")
"""Fields about the making of a plan, not about the plan."""


class PlanStatus(StrEnum):
    """Trust that a plan deserves.

    ``certified``: the continuous-time certificate holds. ``feasible``: all sampled constraints hold, the certificate
    does not. ``infeasible``: some constraint is violated. ``failed``: no trip came out but the start of the search.
    ``unverified``: the plan was read from a file, and has not been certified since.
    """

    CERTIFIED = "certified"
    FEASIBLE = "feasible"
    INFEASIBLE = "infeasible"
    FAILED = "failed"
    UNVERIFIED = "unverified"


@dataclass(frozen=True, eq=False)
class Plan:
    """A planned trip. Times are absolute, s; positions in world coordinates, m.

    Plans are equal if all that they say is, but for how long it took to make them.

    Attributes
    ----------
    scenario : str
        Name of the scenario.
    status : PlanStatus
    reason : str or None
        Why there is no certificate.
    trip : Trip
        Of several legs the first one.
    method, solver : str
    iterations : int
        Of all runs together.
    wall_time : float
        s.
    clearance : Clearance
    limits : dict of str to LimitUse
        ``speed``, ``acceleration``, ``lateral_acceleration``, ``curvature``.
    lower_bound : float
        No trip of this scenario is shorter than this, s: without obstacles, unless :func:`scp_planner.lower_bound`
        was asked for more, or an effort of 2 or more was; ``relative_gap`` asks for more.
    timings : dict of str to float
        Wall time of each stage, s; not saved.
    converged : bool or None
        Whether the run that the trip came from found nothing left to gain: else it was at a limit of work. It says
        nothing of other ways round; ``relative_gap`` does. None: not known.
    planned : Scenario or None
        What ``relative_gap`` and a notebook's picture look at; not saved.
    stated_status : PlanStatus or None
        Of an unverified plan: the status that its file states, as ``reason``, ``clearance`` and ``limits`` are those
        that it states. Files can be edited: ``verified`` and :func:`scp_planner.certify` tell whether the plan holds.
    commonroad : dict or None
        Model, car, problem and aim of CommonRoad that it was planned for; None if it is no plan for one of its models.
    legs : Legs or None
        Legs ahead and backwards, with the vehicle standing between them; None: one trip ahead.
    tried : tuple of Tried
        Skeletons that the search tried, in order: the decisions of each, its bound, its result and its time; not saved.
    """

    scenario: str
    status: PlanStatus
    reason: str | None
    trip: Trip
    method: str
    solver: str
    iterations: int
    wall_time: float
    clearance: Clearance
    limits: dict[str, LimitUse]
    lower_bound: float = 0.0
    timings: dict[str, float] = field(default_factory=dict)
    converged: bool | None = None
    planned: Scenario | None = field(default=None, repr=False)
    stated_status: PlanStatus | None = None
    commonroad: dict[str, Any] | None = None
    legs: Legs | None = None
    tried: tuple[Tried, ...] = field(default=(), repr=False)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, type(self)) and isinstance(self, type(other)) and self._identity == other._identity

    def __hash__(self) -> int:
        return hash(self._identity)

    def __repr__(self) -> str:
        return f"{type(self).__name__}({self.scenario!r}, {self._verdict}, {self.travel_time:.4g} s, {self.clearance})"

    def _repr_html_(self) -> str:
        """For notebooks: where it leads among the obstacles, and how fast."""
        return picture_or_text(lambda: self.sketch(self.planned), repr(self))

    @property
    def _verdict(self) -> str:
        return str(self.status)

    @property
    def _identity(self) -> tuple[Any, ...]:
        """All that it says."""
        values = ((each.name, getattr(self, each.name)) for each in fields(self) if each.name not in _WORK)
        return tuple((name, tuple(value.items()) if isinstance(value, dict) else value) for name, value in values)

    @property
    def certified(self) -> bool:
        """True if the continuous-time certificate holds."""
        return self.status is PlanStatus.CERTIFIED

    @property
    def explanation(self) -> str:
        """The reason where there is no certificate, and a line for each skeleton that the search tried."""
        return "\n".join([*filter(None, [self.reason]), *map(str, self.tried)])

    @property
    def gap(self) -> float:
        """Excess of the travel time over ``lower_bound``, relative."""
        return self.travel_time / self.lower_bound - 1.0 if self.lower_bound > 0.0 else inf

    @cached_property
    def relative_gap(self) -> float:
        """Excess of the travel time over the best lower bound, relative: a better plan can gain no more.

        By the lower bound among the obstacles, which is looked for when this is first asked for, and may take longer
        than the plan: a second among 20 obstacles. Of plans that are not certified, were read from a file or made while
        driving it is ``gap``, by the bound that they have.
        """
        return self._bounded.gap

    def bounded(self) -> Self:
        """Return the same plan with the lower bound among the obstacles, as :func:`scp_planner.lower_bound` finds it.

        Of plans that are not certified, were read from a file or made while driving: as it is.
        """
        return self._bounded

    @cached_property
    def _bounded(self) -> Self:
        if self.planned is None or not self.certified:
            return self
        bound = lower_bound(self.planned, at_most=self.travel_time)
        return replace(self, lower_bound=max(self.lower_bound, bound), planned=None)

    @property
    def start_time(self) -> float:
        """Absolute time of the start, s."""
        return self.trip.frame.time if self.legs is None else self.legs.first.time

    @property
    def travel_time(self) -> float:
        """Duration of the trip, s."""
        if self.legs is not None:
            return self.legs.last.time - self.legs.first.time
        return self.trip.trajectory.travel_time

    @property
    def arrival_time(self) -> float:
        """Absolute time of arrival, s."""
        return self.start_time + self.travel_time

    def _told(self, t: ArrayLike, value: Callable[[Leg, TripPoints], Array]) -> Array:
        """Return a value of points of the legs at absolute times, (...) s to (..., k)."""
        if self.legs is not None:
            return self.legs.told(t, value)
        leg = Leg(self.trip)
        return self.trip.told(t, lambda points: value(leg, points))

    def position(self, t: ArrayLike) -> Array:
        """Position at absolute times, (...) s to (..., 2) m; at the ends of the trip outside it."""
        return self._told(t, lambda leg, points: leg.trip.frame.to_world(points.path.position))

    def velocity(self, t: ArrayLike) -> Array:
        """Velocity vector at absolute times, (...) s to (..., 2) m/s."""

        def driven(leg: Leg, points: TripPoints) -> Array:
            unit = points.path.direction / points.path.speed[:, None]
            return leg.trip.frame.vectors_to_world(points.speed[:, None] * unit)

        return self._told(t, driven)

    def speed(self, t: ArrayLike) -> Array:
        """Speed along the path at absolute times, (...) s to (...) m/s, also backwards not negative."""
        return self._told(t, lambda leg, points: points.speed)  # noqa: ARG005

    def acceleration(self, t: ArrayLike) -> Array:
        """Acceleration along the path, as it is driven, at absolute times, (...) s to (...) m/s^2."""
        found = self._told(t, lambda leg, points: points.acceleration)  # noqa: ARG005
        return found if self.legs is None else np.where(self.legs.standing(t), 0.0, found)

    def heading(self, t: ArrayLike) -> Array:
        """Heading of the vehicle at absolute times, (...) s to (...) rad in (-pi, pi].

        It is the direction of the path; where the vehicle drives backwards, the opposite one.
        """
        if self.legs is not None:
            return self.legs.heading(t)
        return self._told(t, lambda leg, points: leg.heading(points))

    def curvature(self, t: ArrayLike) -> Array:
        """Signed curvature of the path, as it is driven, at absolute times, (...) s to (...) 1/m, positive to the left.

        The heading changes by it times the speed, ahead and backwards.
        """
        return self._told(t, lambda leg, points: leg.trip.trajectory.path.bend(points.path).curvature)

    def distance(self, t: ArrayLike) -> Array:
        """Distance driven since the start at absolute times, (...) s to (...) m."""
        found = self._told(t, lambda leg, points: points.distance)  # noqa: ARG005
        return found if self.legs is None else found + self.legs.driven_before(t)

    def backward(self, t: ArrayLike) -> NDArray[np.bool_]:
        """True at the absolute times, (...) s to (...), at which it drives backwards, or stood after it did."""
        return np.zeros(np.shape(t), dtype=bool) if self.legs is None else self.legs.backward(t)

    def samples(self, count: int = 200) -> dict[str, list[Any]]:
        """Equidistant samples of the trip as plain lists, keyed as in the plan file."""
        times = np.linspace(self.start_time, self.arrival_time, count)
        names = [*SAMPLED, *(("backward",) if self.legs is not None else ())]
        return {"time": times.tolist(), **{name: getattr(self, name)(times).tolist() for name in names}}

    def to_dict(self, samples: int = 200) -> dict[str, Any]:
        """Return the contents of the plan file."""
        return {
            "schema": 1,
            "scenario": self.scenario,
            "status": str(self.stated_status or self.status),
            "reason": self.reason,
            "start_time": self.start_time,
            "arrival_time": self.arrival_time,
            "travel_time": self.travel_time,
            # A stop ends on its path, not at the goal.
            **({"stops": True} if self.legs is None and not self.trip.trajectory.arrives else {}),
            "lower_bound": self.lower_bound,
            **({} if self.converged is None else {"converged": self.converged}),
            "method": self.method,
            "solver": self.solver,
            "iterations": self.iterations,
            "wall_time": self.wall_time,
            **({} if self.commonroad is None else {"commonroad": self.commonroad}),
            **(_trip_written(self.trip) if self.legs is None else _legs_written(self.legs)),
            "clearance": self.clearance.to_dict(),
            "limits": {name: asdict(use) for name, use in self.limits.items()},
            "samples": self.samples(samples),
        }

    def save(self, path: str | PathLike[str], samples: int = 200) -> None:
        """Write the plan file, JSON; a file that stood there is replaced only by a whole one.

        Parameters
        ----------
        path : path
        samples : int
            Number of equidistant samples in the file, at least 2.
        """
        text = json.dumps(self.to_dict(samples), allow_nan=False)
        write_text(path, text + "\n")

    def table(self, times: ArrayLike | int = 200) -> dict[str, NDArray[Any]]:
        """Sample the trip at absolute times (n,) s, or at so many equidistant ones.

        Parameters
        ----------
        times : (n,) array or int
            Absolute times, s, or how many.

        Returns
        -------
        dict of str to (n,) array
            Columns with their units in their names, see `scp_planner.export.plan_table`; `pandas.DataFrame` takes it.
        """
        return output_named("plan table")(self, times)

    def export(self, path: str | PathLike[str], **options: Any) -> None:
        """Write the trip for other programs: .csv, .npz, .mcap, or a bag's folder; options of `export_plan`."""
        output_named("plan export")(self, path, **options)

    def plot(self, scenario: Scenario, path: str | PathLike[str] | None = None, view: str = "map") -> Figure:
        """Draw a figure, .png, .pdf or .svg if it is to be saved, of a view: map, space-time or profiles.

        Parameters
        ----------
        scenario : Scenario
            What was planned.
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
        return output_named("plan plot")(self, scenario, path, view)

    def sketch(self, scenario: Scenario | None = None) -> Figure:
        """Draw where it leads and how fast, as notebooks show it.

        Parameters
        ----------
        scenario : Scenario, optional
            What was planned, to show its obstacles.

        Returns
        -------
        matplotlib.figure.Figure
        """
        return output_named("plan sketch")(self, scenario)

    def draw(self, scenario: Scenario, path: str | PathLike[str], view: str = "map") -> None:
        """Draw into a file: .png, .pdf, .svg a figure; .gif, .mp4 an animation; .html a page for a browser.

        Parameters
        ----------
        scenario : Scenario
            What was planned.
        path : path
        view : str
            Of a figure.

        Raises
        ------
        ValueError
            If the suffix or the view is another one.
        """
        output_named("plan draw")(self, scenario, path, view)

    @classmethod
    def load(cls, path: str | PathLike[str]) -> Self:
        """Read a plan file. The plan is ``unverified``, whatever the file states; see ``stated_status``.

        Parameters
        ----------
        path : path

        Returns
        -------
        Plan

        Raises
        ------
        PlanError
            Naming the file, the key and the value; also if the file's samples are not those of its path and
            acceleration, to 1e-6 of the path's length, the travel time and the largest value of each quantity.
        """
        return cls.from_dict(read_json(path, PlanError), str(path))

    @classmethod
    def from_dict(cls, data: dict[str, Any], name: str) -> Self:
        """Read the contents of a plan file; ``name`` is where they are from, for messages.

        Parameters
        ----------
        data : dict
            What the file holds.
        name : str

        Returns
        -------
        Plan

        Raises
        ------
        PlanError
            Naming the key and the value.
        """
        made: Self = output_named("plan read")(cls, data, name)
        return made

    def verified(
        self,
        scenario: Scenario,
        *,
        tube: TrackingTube | None = None,
        threat_zones: Sequence[ThreatZone] | None = None,
        deadline: float = inf,
    ) -> Self:
        """Return the same plan with what :func:`scp_planner.certify` says of it, whatever was said before.

        Parameters
        ----------
        scenario : Scenario
        tube, threat_zones : optional
            As for :func:`scp_planner.certify`.
        deadline : float
            Value of :func:`time.perf_counter` at which the check is given up, s.

        Returns
        -------
        Plan
            ``certified``, or ``infeasible`` with the violations as its reason; clearance and limits are those found.
        """
        from scp_planner.certificate.check import certify

        found = certify(scenario, self, threat_zones, tube=tube, deadline=deadline)
        return replace(
            self,
            status=PlanStatus.CERTIFIED if found.holds else PlanStatus.INFEASIBLE,
            reason=None if found.holds else "; ".join(map(str, found.violations)) or UNCHECKED,
            clearance=found.clearance,
            limits=found.limits,
            stated_status=None,
        )

    @cached_property
    def knot_times(self) -> Array:
        """Absolute times at which the acceleration's pieces begin and end, (K + 1,) s."""
        trips = [self.trip] if self.legs is None else [leg.trip for leg in self.legs.legs]
        each = [
            trip.frame.time + trip.trajectory.travel_time * trip.trajectory.space.acceleration.breakpoints
            for trip in trips
        ]
        return np.concatenate(each)


def judged_by(plan: Plan, scenario: Scenario, found: Certificate) -> Plan:
    """Return a plan as one of a scenario that it was not made for; it is feasible at most if the certificate fails."""
    status = PlanStatus.FEASIBLE if plan.certified else plan.status
    return replace(
        plan,
        status=PlanStatus.CERTIFIED if found.holds else status,
        reason=None if found.holds else plan.reason or "; ".join(map(str, found.violations)) or UNCHECKED,
        clearance=found.clearance,
        limits=found.limits,
        lower_bound=kinematic_bound(scenario),
        planned=scenario,
    )


def _trip_written(trip: Trip) -> dict[str, Any]:
    """Return the path and the acceleration of a trip for a plan file."""
    trajectory, frame = trip.trajectory, trip.frame
    space = trajectory.space
    path_degree, drive_degree = (spline.coefficients.shape[1] - 1 for spline in (space.path, space.acceleration))
    return {
        "path": {
            "degree": path_degree,
            "knots": (clamped_knots(path_degree, space.path.breakpoints) * space.length).tolist(),
            "offsets": trajectory.theta.tolist(),
            "guide": {"origin": list(frame.origin), "heading": frame.heading, **space.guide.to_dict()},
        },
        "acceleration": {
            "degree": drive_degree,
            "knots": clamped_knots(drive_degree, space.acceleration.breakpoints).tolist(),
            "coefficients": trajectory.beta.tolist(),
            "start_speed": space.start_speed,
        },
    }


def _legs_written(legs: Legs) -> dict[str, Any]:
    """Return legs for a plan file."""
    each = [
        {
            "backward": leg.backward,
            "start_time": leg.begin,
            "travel_time": leg.trip.trajectory.travel_time,
            **({} if leg.trip.trajectory.arrives else {"stops": True}),
            **_trip_written(leg.trip),
        }
        for leg in legs.legs
    ]
    return {"legs": each, "first_heading": legs.first.heading, "last_heading": legs.last.heading}


def joined(plans: Sequence[Plan]) -> Plan:
    """Return one plan of several: each begins where and when the vehicle stands at the end of the one before."""
    each = [plan.legs or Legs.of(plan.trip) for plan in plans]
    legs = tuple(leg for one in each for leg in one.legs)
    return replace(plans[0], legs=Legs(legs, each[0].first, each[-1].last))
