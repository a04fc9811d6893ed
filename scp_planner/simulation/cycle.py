"""One cycle of a closed loop as it is written down, and the zones in it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Annotated, Any, ClassVar, Self

import numpy as np
from pydantic import Field

from scp_planner.arrays import Array
from scp_planner.mathematics.outlines import Outline
from scp_planner.mathematics.polynomials import PiecewisePolynomials
from scp_planner.online.plan import OnlinePlan
from scp_planner.scenario.validation import FiledAs, Objection, Part, Row, Rule
from scp_planner.scenario.values import (
    Count,
    Endless,
    Flag,
    Name,
    NotNegative,
    Number,
    RateNumber,
    Text,
    Vector,
    endless,
    finite,
)
from scp_planner.simulation.sensors import Observation
from scp_planner.threat_zones.zone import ThreatZone

Three = tuple[RateNumber, RateNumber, RateNumber]
Times = Annotated[Row[Number | None], Field(min_length=2)]


def is_one_shape(outline: Any) -> Iterator[Objection]:
    """An outline is a polygon or an ellipse."""
    if (outline.vertices is None) == (outline.matrix is None):
        yield Objection((), outline, "must have vertices or a matrix, and null for the other")


class OutlinePart(Part):
    rules: ClassVar[tuple[Rule, ...]] = (is_one_shape,)

    vertices: Annotated[Row[Vector], Field(min_length=3)] | None
    matrix: Three | None
    turning: Flag


def pieces_fit(zone: Any) -> Iterator[Objection]:
    """Breakpoints increase, and there is a polynomial between two of them, all of as many coefficients."""
    for key, times in (("center", "breakpoints"), ("covariance", "covariance_breakpoints")):
        breakpoints, pieces = getattr(zone, times), getattr(zone, key)
        if breakpoints is None or pieces is None:
            if breakpoints is not pieces:
                yield Objection((times,), breakpoints, f"must be null where {key} is, and only there")
            continue
        if any(a >= b for a, b in pairwise(map(endless, breakpoints))):
            yield Objection((times,), breakpoints, "must increase; null is the end of time")
        if len(pieces) != len(breakpoints) - 1 or not pieces[0] or len(set(map(len, pieces))) > 1:
            text = f"must be as many polynomials as there are spaces in {times}, of equally many coefficients"
            yield Objection((key,), pieces, text)


class ZonePart(Part):
    """Coefficients (S, P, 2) of the centre and (S, P, 3) of the covariance, and the numbers of the outlines."""

    rules: ClassVar[tuple[Rule, ...]] = (pieces_fit,)

    id: Text
    radius: NotNegative
    breakpoints: Times
    center: Row[Row[tuple[RateNumber, RateNumber]]]
    covariance_breakpoints: Times | None
    covariance: Row[Row[Three]] | None
    outlines: Row[OutlinePart] = ()

    def zone(self) -> ThreatZone:
        spread = None if self.covariance is None else _polynomials(self.covariance_breakpoints, self.covariance)
        outlines = (Outline(_array(o.vertices), _array(o.matrix), o.turning) for o in self.outlines)
        centers = _polynomials(self.breakpoints, self.center)
        return ThreatZone(self.id, self.radius, centers, spread, tuple(outlines))


def _polynomials(breakpoints: Any, coefficients: Any) -> PiecewisePolynomials:
    return PiecewisePolynomials(np.array([[*map(endless, breakpoints)]]), np.array([coefficients], dtype=float))


def _array(values: Any) -> Array | None:
    return None if values is None else np.array(values, dtype=float)


def _written(zone: ThreatZone) -> dict[str, Any]:
    centers, spread = zone.centers, zone.covariances
    return {
        "id": zone.id,
        "radius": zone.radius,
        "breakpoints": [finite(time) for time in centers.breakpoints[0].tolist()],
        "center": centers.coefficients[0].tolist(),
        "covariance_breakpoints": None if spread is None else [finite(t) for t in spread.breakpoints[0].tolist()],
        "covariance": None if spread is None else spread.coefficients[0].tolist(),
        "outlines": [
            {"vertices": _listed(each.vertices), "matrix": _listed(each.matrix), "turning": each.turning}
            for each in zone.outlines
        ],
    }


def _listed(values: Array | None) -> Any:
    return None if values is None else values.tolist()


FiledZone = Annotated[ThreatZone, FiledAs(ZonePart, ZonePart.zone, _written)]


def _items(mapping: Mapping[str, Any]) -> tuple[tuple[str, Any], ...]:
    return tuple(mapping.items())


@dataclass(frozen=True, eq=False)
class State:
    """State of the vehicle at a replan."""

    time: Number  # s
    position: Vector  # m
    heading: Number  # Of the vehicle's front, rad
    speed: Number  # m/s, negative backwards
    wall_time: NotNegative = 0.0  # Of the replan, s; not written, as it is not the same in two runs


@dataclass(frozen=True, eq=False, kw_only=True)
class Cycle(State):
    """One cycle: what was seen, what came of it, and how near it was."""

    outcome: Name
    status: Name
    certified: Flag
    safe: Flag
    reason: Name
    arrival_time: Number  # By the plan, s
    iterations: Count
    observations: tuple[Observation, ...]
    zones: tuple[FiledZone, ...]  # As they were when this was planned, with the planner's margin
    truth: Annotated[tuple[tuple[str, tuple[float, float]], ...], FiledAs(dict[Name, Vector], _items, dict)]
    clearance: Endless  # Least distance to a true obstacle up to the next cycle, m; inf without any
    code: Name = ""  # Kind of the reason
    obstacle: Name | None = None  # That it is for
    lasts: NotNegative | None = None  # For how long it is likely to hold, s
    candidates: tuple[Name, ...] = ()  # What was looked at, a line each

    @classmethod
    def of(
        cls,
        state: State,
        plan: OnlinePlan,
        observations: tuple[Observation, ...],
        zones: tuple[ThreatZone, ...],
        truth: tuple[tuple[str, tuple[float, float]], ...] = (),
    ) -> Self:
        """Write down a replan; of zones where they are and how large, and no more."""
        return cls(
            **vars(state),
            outcome=str(plan.outcome),
            status=str(plan.status),
            certified=plan.certified,
            safe=plan.safe,
            reason=plan.reason or "",
            code=str(plan.code),
            obstacle=plan.obstacle,
            lasts=plan.lasts,
            arrival_time=plan.arrival_time,
            iterations=plan.iterations,
            observations=observations,
            zones=tuple(replace(zone, pointing=None, until=np.inf, expected=None) for zone in zones),
            truth=truth,
            clearance=np.inf,
            candidates=tuple(map(str, plan.candidates)),
        )
