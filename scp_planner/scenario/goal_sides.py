"""The sides of a goal that is a region, where the trip enters it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from scp_planner.arrays import Array
from scp_planner.mathematics import planar
from scp_planner.mathematics.frames import PlanningFrame
from scp_planner.scenario.goals import convex_parts
from scp_planner.scenario.models import Scenario


@dataclass(frozen=True)
class GoalSides:
    """Half planes normal . q <= offset of the planning frame that the middle of the vehicle ends in."""

    normals: Array  # (S, 2) Outward unit normals
    offsets: Array  # (S,) m, less the planner's margin

    @classmethod
    def of(cls, scenario: Scenario, frame: PlanningFrame, margin: float) -> GoalSides | None:
        """Return the sides of that part of the goal's region that the trip aims at; None without a region."""
        region = scenario.goal.region
        if region is None:
            return None
        aim = scenario.goal.position
        ahead = abs(scenario.vehicle.centre)
        parts = convex_parts(region)
        part = min(parts, key=lambda one: max(planar.distance_to_polygon(aim, one) - ahead, 0.0))
        ring = np.array(planar.anticlockwise(part))
        edge = np.roll(ring, -1, axis=0) - ring
        normals = np.stack([edge[:, 1], -edge[:, 0]], axis=1) / np.hypot(edge[:, 0], edge[:, 1])[:, None]
        offsets = np.einsum("ij,ij->i", normals, ring - np.asarray(frame.origin)) - margin
        return cls(normals @ frame.rotation, offsets)

    def along(self, point: Array, direction: Array) -> tuple[float, float]:
        """Return between which multiples of a direction from a point the line is inside."""
        rate, room = self.normals @ direction, self.offsets - self.normals @ point
        with np.errstate(divide="ignore", invalid="ignore"):
            at = room / rate
        low = float(at[rate < 0.0].max(initial=-np.inf))
        high = float(at[rate > 0.0].min(initial=np.inf))
        if np.any((rate == 0.0) & (room < 0.0)):
            return 1.0, -1.0
        return low, high
