"""Choice of the zones that a problem is built with."""

from __future__ import annotations

import numpy as np

from scp_planner.arrays import Index
from scp_planner.problem.problem import Problem
from scp_planner.threat_zones.nearness import NEARNESS, SweptBoxes, least_clearances

GUIDE_LOOKS = 33
BEYOND = 1.0  # units of length, beyond the largest offset
LONGEST_TRIP = 4.0  # times the lower bound; obstacles that only a longer trip could meet are left out at first


def without_far_zones(problem: Problem, longest: float) -> Problem:
    """Return a problem without the zones that no trip shorter than ``longest``, s, can meet."""
    if problem.zones.size <= NEARNESS.few_zones:
        return problem
    guide = problem.space.guide
    line = guide.frame(np.linspace(0.0, guide.length, GUIDE_LOOKS)).position
    reach = problem.settings.max_offset + BEYOND + max(map(abs, problem.scenario.vehicle.discs))
    near: Index = np.arange(problem.zones.size)
    for count in NEARNESS.looks:
        half = 0.5 * longest / count
        looks = SweptBoxes(
            np.linspace(half, longest - half, count),
            half,
            np.broadcast_to(line.min(axis=0) - reach, (count, 2)),
            np.broadcast_to(line.max(axis=0) + reach, (count, 2)),
        )
        some = problem.zones if len(near) == problem.zones.size else problem.zones.subset(near)
        near = near[least_clearances(some, looks) < 0.0]
    return problem if len(near) == problem.zones.size else problem.among(problem.zones.subset(near))
