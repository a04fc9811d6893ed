"""One cycle of a closed loop as it is written down."""

from __future__ import annotations

from dataclasses import asdict, dataclass, fields, replace
from typing import Any, Self

import numpy as np

from scp_planner.arrays import Array
from scp_planner.online.plan import OnlinePlan
from scp_planner.simulation.sensors import Observation
from scp_planner.threat_zones.zone import ThreatZone


@dataclass(frozen=True, eq=False)
class State:
    """State of the vehicle at a replan."""

    time: float  # s
    position: tuple[float, float]  # m
    heading: float  # Of the vehicle's front, rad
    speed: float  # m/s, negative backwards
    wall_time: float = 0.0  # Of the replan, s


@dataclass(frozen=True, eq=False, kw_only=True)
class Cycle(State):
    """One cycle: what was seen, what came of it, and how near it was."""

    outcome: str
    status: str
    certified: bool
    safe: bool
    reason: str
    arrival_time: float  # By the plan, s
    iterations: int
    observations: tuple[Observation, ...]
    zones: tuple[ThreatZone, ...]  # As they were when this was planned, with the planner's margin
    truth: tuple[tuple[str, tuple[float, float]], ...]
    clearance: float  # Least distance to a true obstacle up to the next cycle, m; inf without any
    code: str = ""  # Kind of the reason
    obstacle: str | None = None  # That it is for
    lasts: float | None = None  # For how long it is likely to hold, s
    candidates: tuple[str, ...] = ()  # What was looked at, a line each

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


def record_to_dict(record: Cycle) -> dict[str, Any]:
    """Return a cycle as JSON; its wall time is not the same in two runs."""
    data = {each.name: getattr(record, each.name) for each in fields(record) if each.name != "wall_time"}
    return {
        **data,
        "observations": [asdict(seen) for seen in record.observations],
        "zones": [_zone_to_dict(zone) for zone in record.zones],
        "truth": dict(record.truth),
        "clearance": finite(record.clearance),
    }


def _zone_to_dict(zone: ThreatZone) -> dict[str, Any]:
    """Coefficients of the centre, (S, P, 2), and of the covariance, (S, P, 3), and the numbers of the outlines."""
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


def finite(value: float) -> float | None:
    return value if np.isfinite(value) else None


def infinite(value: float | None) -> float:
    return float("inf") if value is None else value
