"""One cycle of a closed loop as it is written down."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from typing import Any, Self

import numpy as np

from scp_planner.mathematics.outlines import Outline
from scp_planner.mathematics.polynomials import PiecewisePolynomials
from scp_planner.simulation.sensors import Observation
from scp_planner.threat_zones.zone import ThreatZone


@dataclass(frozen=True)
class OutlineRecord:
    """A convex outline: the numbers of an `Outline`."""

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
        vertices, matrix = (None if part is None else np.array(part) for part in (self.vertices, self.matrix))
        return Outline(vertices, matrix, self.turning)


@dataclass(frozen=True)
class ZoneRecord:
    """A zone as the planner saw it: the numbers of a `ThreatZone`."""

    id: str
    radius: float  # m
    breakpoints: tuple[float, ...]  # s
    center: tuple[Any, ...]  # Coefficients, (S, P, 2) and (S, P, 3); the covariance is None where the motion is known
    covariance_breakpoints: tuple[float, ...] | None
    covariance: tuple[Any, ...] | None  # Coefficients, (S, P, 2) and (S, P, 3)
    outlines: tuple[OutlineRecord, ...] = ()  # None for a disc

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
    """One cycle: what was seen, what came of it, and how near it was."""

    time: float  # s
    position: tuple[float, float]  # m
    heading: float  # Of the vehicle's front, rad
    speed: float  # m/s, negative backwards
    outcome: str
    status: str
    certified: bool
    safe: bool
    reason: str
    arrival_time: float  # By the plan, s
    iterations: int
    observations: tuple[Observation, ...]
    zones: tuple[ZoneRecord, ...]  # As they were when this was planned, with the planner's margin
    truth: tuple[tuple[str, tuple[float, float]], ...]
    clearance: float  # Least distance to a true obstacle up to the next cycle, m; inf without any
    wall_time: float = field(default=0.0, compare=False)
    code: str = ""  # Kind of the reason
    obstacle: str | None = None  # That it is for
    lasts: float | None = None  # For how long it is likely to hold, s


def record_to_dict(record: Cycle) -> dict[str, Any]:
    """Return a cycle as JSON; its wall time is not the same in two runs."""
    data = asdict(record)
    del data["wall_time"]
    for zone in data["zones"]:
        for key in ("breakpoints", "covariance_breakpoints"):
            zone[key] = None if zone[key] is None else [finite(value) for value in zone[key]]
    return {**data, "truth": dict(record.truth), "clearance": finite(record.clearance)}


def record_from_dict(data: dict[str, Any]) -> Cycle:
    """Return a cycle of what `record_to_dict` made, after JSON."""
    given = _all_tuples(data)
    given["observations"] = tuple(Observation(**_all_tuples(seen)) for seen in data["observations"])
    given["zones"] = tuple(_zone_from_dict(zone) for zone in data["zones"])
    given["truth"] = tuple((name, _tuples(place)) for name, place in data["truth"].items())
    return Cycle(**{**given, "clearance": infinite(data["clearance"])})


def _zone_from_dict(data: dict[str, Any]) -> ZoneRecord:
    given = _all_tuples(data)
    for key in ("breakpoints", "covariance_breakpoints"):
        given[key] = None if given[key] is None else tuple(map(infinite, given[key]))
    outlines = tuple(OutlineRecord(**_all_tuples(outline)) for outline in data.get("outlines", ()))
    return ZoneRecord(**{**given, "outlines": outlines})


def finite(value: float) -> float | None:
    return value if np.isfinite(value) else None


def infinite(value: float | None) -> float:
    return float("inf") if value is None else value


def _pieces(polynomials: PiecewisePolynomials) -> tuple[Any, ...]:
    """Coefficients of the first of them, (S, P, d)."""
    return tuple(tuple(map(tuple, piece)) for piece in polynomials.coefficients[0].tolist())


def _tuples(value: Any) -> Any:
    return tuple(_tuples(each) for each in value) if isinstance(value, list) else value


def _all_tuples(data: dict[str, Any]) -> dict[str, Any]:
    return {key: _tuples(value) for key, value in data.items()}
