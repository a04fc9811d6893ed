"""Contents of a plan file: how its fields are written and read, and samples, which must be those of its trip."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import inf, isfinite, pi
from typing import Any

import numpy as np

from scp_planner.arrays import Array
from scp_planner.certificate.verdict import Clearance, LimitUse
from scp_planner.planning.tolerances import SAMPLE_ROUNDING, SAMPLES_TOLERANCE
from scp_planner.trips.trip_file import KeyReader


def read_fields(reader: KeyReader) -> dict[str, Any]:
    """Read the fields of a plan but its trip and status."""
    data = reader.data
    limits = reader.part("limits")
    return {
        "scenario": reader.text("scenario"),
        "reason": reader.optional("reason", reader.text),
        "method": reader.text("method"),
        "solver": reader.text("solver"),
        "iterations": reader.integer("iterations", 0, None),
        "wall_time": reader.number("wall_time"),
        "clearance": _clearance_read(reader.part("clearance")),
        "limits": {
            key: LimitUse(part.number("worst"), part.optional("limit", part.number), part.number("time"))
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
        **{key: part.text(key) for key in ("model", "car")},
        **{key: part.integer(key, 0, None) for key in ("problem", "state", "discs")},
        **{key: part.number(key) for key in ("timed_way", "depth")},
        "turn": part.optional("turn", part.number),
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
        found = part.optional("minimum", part.number)
        minimum = inf if found is None else found
    return Clearance(minimum, part.optional("obstacle", part.text), part.optional("time", part.number))


@dataclass(frozen=True)
class Within:
    """A trip that samples are of: its start, absolute time in s, its duration, s, and its length, m."""

    first: float
    lasts: float
    length: float


def check_samples(part: KeyReader, trip: Within, told: Callable[[str, Array], Array]) -> None:
    """Refuse samples of a plan file that its path and acceleration do not give."""
    times, first, lasts = part.vector("time", None), trip.first, trip.lasts
    last = first + lasts
    slack = SAMPLES_TOLERANCE * lasts + SAMPLE_ROUNDING * max(abs(first), abs(last))
    if len(times) < 2 or np.any(np.diff(times) < 0.0) or times[0] < first - slack or times[-1] > last + slack:
        raise part.fault("time", times.tolist(), f"at least two times in order, from {first!r} to {last!r}")
    length = trip.length
    fastest = max(length / lasts, float(told("speed", times).max()))
    # A trip without curvature has values of rounding alone: there is a least scale
    scales = {
        "position": length,
        "velocity": fastest,
        "heading": 1.0,
        "speed": fastest,
        "acceleration": max(fastest / lasts, float(np.abs(told("acceleration", times)).max())),
        "curvature": max(1.0 / length, float(np.abs(told("curvature", times)).max())),
    }
    for name, scale in scales.items():
        if name not in part.data:
            continue
        vectors = name in ("position", "velocity")
        given = part.vectors(name, len(times)) if vectors else part.vector(name, len(times))
        # Times are rounded too, and where an acceleration jumps it has two values
        off = np.min([_apart(name, given, told(name, times + later)) for later in (-slack, 0.0, slack)], axis=0)
        allowed, worst = SAMPLES_TOLERANCE * scale + SAMPLE_ROUNDING * float(np.abs(given).max()), int(np.argmax(off))
        if not off[worst] <= allowed:
            found = told(name, times)[worst].tolist()
            wanted = f"{found!r} to {allowed:.2g}, which is what path and acceleration give"
            raise part.fault(f"{name}[{worst}]", given[worst].tolist(), wanted)


def _apart(name: str, given: Array, found: Array) -> Array:
    difference = given - found
    if name == "heading":
        difference = np.remainder(difference + pi, 2.0 * pi) - pi
    apart: Array = np.abs(difference) if difference.ndim == 1 else np.hypot(*difference.T)
    return apart
