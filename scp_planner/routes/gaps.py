"""Passages that are too narrow: how much of the vehicle fits through where no route leads to the goal."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from scp_planner.errors import TooLargeError
from scp_planner.pauses import OutOfTimeError
from scp_planner.routes.roadmap import Roadmap
from scp_planner.scenario.limits import Box

STEPS = 9  # of bisection


@dataclass(frozen=True)
class Gap:
    """The widest passage to the goal: its width, m, and the ids of what it lies between."""

    width: float
    between: tuple[str, ...]


def widest_gap(roadmap: Roadmap) -> Gap | None:
    """Return the passage that a smaller vehicle would take to the goal; None where even a point finds none."""
    radius = roadmap.scenario.vehicle.radius
    fits, too_large = 0.0, radius
    narrow = _smaller(roadmap, radius - fits)
    line = next(iter(narrow.taut), None)
    if line is None:
        return None
    for _ in range(STEPS):
        middle = 0.5 * (fits + too_large)
        found = next(iter(_smaller(roadmap, radius - middle).taut), None)
        if found is None:
            too_large = middle
        else:
            fits, line = middle, found
    standing = roadmap.zones.standing
    names = [roadmap.zones.ids[standing[k]] for k in roadmap.taut.met(line.points).tolist()]
    outside = bool(roadmap.box.room(line.points).min() < 0.0)
    return Gap(2.0 * fits, (*dict.fromkeys(names), *(("the workspace bounds",) if outside else ())))


def describe_gap(roadmap: Roadmap, radius: float, unit: float) -> str:
    """Say how wide the widest passage to the goal is, for a vehicle of a radius, m, with a unit of length, m."""
    try:
        gap, taken = widest_gap(roadmap), 2.0 * radius
    except (OutOfTimeError, TooLargeError):
        return ". No route leads to the goal"
    if gap is None:
        return ". No route leads to the goal, however small the vehicle"
    between = " and ".join(gap.between)
    where = f" (past {between})" if between else ""
    return (
        f". No route leads to the goal: the widest passage{where} is {gap.width * unit:.3g} m wide,"
        f" {taken - gap.width * unit:.3g} m less than the vehicle takes"
    )


def _smaller(roadmap: Roadmap, less: float) -> Roadmap:
    """The roadmap of a vehicle whose radius is less by so many m."""
    zones = replace(roadmap.zones, radius=np.maximum(roadmap.zones.radius - less, 0.0))
    box = Box(roadmap.box.normals, roadmap.box.offsets + less)
    return Roadmap(roadmap.scenario, roadmap.frame, roadmap.limits, zones, box, roadmap.deadline)
