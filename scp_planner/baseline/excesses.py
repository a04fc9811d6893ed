"""How far a trip is beyond its limits, and a problem that asks for more or less of them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from scp_planner.arrays import Array
from scp_planner.baseline.objective_parts import (
    BOX,
    CURVATURE,
    GOAL_SPEED,
    LATERAL,
    OBJECTIVE_LIMITS,
    OFFSET,
    OPTIONAL,
    REVERSE,
    SPEED,
    Margins,
)
from scp_planner.problem.problem import Problem
from scp_planner.scp.evaluation import Evaluation

SETTLED_EXCESS = 1e-4  # units of length or relative; distance to active constraints at which settling ends


def signed_excess(problem: Problem, evaluation: Evaluation) -> tuple[Array, Array]:
    """Return signed excesses over zones (L,) m and limits (8 + E,), with the minima between samples refined."""
    trajectory, limits = evaluation.trajectory, problem.limits
    zones = -evaluation.clearance.min(axis=0) if problem.zones.size else np.zeros(0)
    np.maximum.at(zones, evaluation.minima_zone, -evaluation.minima_contacts.distance)
    speeds = trajectory.speed_control_points()[1:] / limits.speed
    found = np.full(len(OBJECTIVE_LIMITS) + len(problem.optional), -np.inf)
    found[OPTIONAL:] = [excess.max(initial=-np.inf) for excess in evaluation.optional]
    found[LATERAL] = evaluation.sites.worst_lateral / limits.lateral_acceleration - 1.0
    found[CURVATURE] = float(np.abs(evaluation.sites.curvature).max()) / limits.curvature - 1.0
    found[SPEED] = float(speeds.max()) - 1.0
    found[BOX] = -float(evaluation.box_gaps.min(initial=np.inf))
    if problem.ends.goal_speed is not None:
        found[GOAL_SPEED] = abs(trajectory.final_speed - problem.ends.goal_speed) - SETTLED_EXCESS
    found[REVERSE] = -float(speeds.min())
    theta, ends, free = trajectory.theta[problem.ends.free], problem.ends, problem.ends.free
    found[OFFSET] = float(np.max(np.maximum(theta - ends.upper[free], ends.lower[free] - theta), initial=-np.inf))
    return zones, found


def with_margins(problem: Problem, more: Margins) -> Problem:
    """Return the problem with larger zones and lower limits, as the exact checks see it."""
    optional = {limit.name: more.limits[OPTIONAL + place] for place, limit in enumerate(problem.optional)}
    tightened = problem.tightened(more.zones, more.limits[LATERAL], more.limits[CURVATURE], more.limits[BOX], optional)
    return replace(
        tightened, limits=replace(tightened.limits, speed=tightened.limits.speed * (1.0 - more.limits[SPEED]))
    )
