"""The contents of a plan file: how its fields are written and read."""

from __future__ import annotations

from math import inf, isfinite
from typing import Any

from scp_planner.certificate.verdict import Clearance, LimitUse
from scp_planner.trips.trip_file import KeyReader


def read_fields(reader: KeyReader) -> dict[str, Any]:
    """Read the fields of a plan but its trip and status."""
    data = reader.data
    limits = reader.part("limits")
    return {
        "scenario": str(reader.get("scenario")),
        "reason": reader.get("reason"),
        "method": str(reader.get("method")),
        "solver": str(reader.get("solver")),
        "iterations": reader.integer("iterations", 0, None),
        "wall_time": reader.number("wall_time"),
        "clearance": _clearance_read(reader.part("clearance")),
        "limits": {
            key: LimitUse(part.number("worst"), part.get("limit"), part.number("time"))
            for key in limits.data
            for part in (limits.part(key),)
        },
        "lower_bound": reader.number("lower_bound") if "lower_bound" in data else 0.0,
        "converged": reader.flag("converged") if data.get("converged") is not None else None,
        "commonroad": _commonroad_read(reader.part("commonroad")) if data.get("commonroad") is not None else None,
    }


def _commonroad_read(part: KeyReader) -> dict[str, Any]:
    """Check the kinds of values alone: what models and cars there are is known to those who plan for them."""
    return {
        **{key: str(part.get(key)) for key in ("model", "car")},
        **{key: part.integer(key, 0, None) for key in ("problem", "state", "discs")},
        **{key: part.number(key) for key in ("timed_way", "depth")},
        "turn": None if part.get("turn") is None else part.number("turn"),
    }


def clearance_written(clearance: Clearance) -> dict[str, Any]:
    """A clearance for a file: null without obstacles, no number at all if it is not known."""
    minimum = {"minimum": clearance.minimum if isfinite(clearance.minimum) else None}
    return {
        **(minimum if clearance.minimum > -inf else {}),
        "obstacle": clearance.obstacle,
        "time": clearance.time,
    }


def _clearance_read(part: KeyReader) -> Clearance:
    minimum = -inf
    if "minimum" in part.data:
        minimum = inf if part.get("minimum") is None else part.number("minimum")
    return Clearance(minimum, part.get("obstacle"), part.get("time"))
