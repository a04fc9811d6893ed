"""Least length of any trip: the shortest way round polygons that lie inside what stands."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from scp_planner.arrays import Array
from scp_planner.certificate.inscribed import polygons_inside
from scp_planner.certificate.tolerances import ROUNDING
from scp_planner.errors import TooLargeError
from scp_planner.mathematics.frames import PlanningFrame
from scp_planner.mathematics.taut import TautLines
from scp_planner.pauses import OutOfTimeError
from scp_planner.scenario.limits import Box
from scp_planner.scenario.models import Scenario
from scp_planner.threat_zones.batch import ZoneBatch
from scp_planner.threat_zones.zone import ThreatZone

CORNERS = 8  # of the polygon inside each zone, besides those of its shape
SAME = 1e-8  # units of length: corners that are nearer to each other are one


def least_length(scenario: Scenario, threat_zones: Sequence[ThreatZone], deadline: float = np.inf) -> float:
    """Return a length that no trip among zones is shorter than, m: straight on where nothing stands.

    Of a scenario in natural units; inf if what stands lets no trip through.
    """
    straight = float(np.hypot(*np.subtract(scenario.goal.position, scenario.start.position)))
    straight = max(straight - scenario.goal.radius, 0.0)
    frame = PlanningFrame.between(scenario.start.position, scenario.goal.position, scenario.start.time)
    zones = ZoneBatch.of(threat_zones, frame, scenario.vehicle.radius - ROUNDING)
    zones = zones.subset(zones.standing)
    if zones.size == 0:
        return straight
    ends = frame.to_frame(np.array([scenario.start.position, scenario.goal.position]))
    everywhere = np.full(2, np.inf)
    inside = polygons_inside(zones, np.zeros(1), -everywhere, everywhere, CORNERS)
    polygons = [tidy for _, several in inside if len(tidy := _tidy(several[0])) >= 3]
    box = Box.of(scenario, frame, -ROUNDING)
    limits = list(zip(box.normals, box.offsets.tolist(), strict=True))
    try:
        line = next(iter(TautLines(polygons, ends[0], ends[1], limits, deadline)), None)
    except (OutOfTimeError, TooLargeError):
        return straight
    if line is None:
        return np.inf if scenario.goal.radius == 0.0 else straight
    return max(line.length - scenario.goal.radius - ROUNDING, straight)


def _tidy(polygon: Array) -> Array:
    """A convex polygon without corners that are the same as those before."""
    apart = np.abs(polygon - np.roll(polygon, 1, axis=0)).max(axis=1) > SAME
    kept: Array = polygon[apart]
    return kept
