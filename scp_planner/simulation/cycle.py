"""One cycle of a closed loop as it is written down."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Annotated, Any, Self

import numpy as np

from scp_planner.online.plan import OnlinePlan
from scp_planner.scenario.validation import FiledAs
from scp_planner.scenario.values import Count, Endless, Flag, Name, NotNegative, Number, Vector
from scp_planner.simulation.sensors import Observation
from scp_planner.simulation.zone_file import FiledZone
from scp_planner.threat_zones.zone import ThreatZone


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
