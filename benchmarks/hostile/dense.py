"""Certified plans of wild scenarios, checked densely in the units that these were drawn in."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

import scp_planner as sp
from benchmarks.hostile.outcome import Outcome, judged
from benchmarks.hostile.wild import Wild
from scp_planner.scenario.models import Obstacle
from scp_planner.scenario.motions import Course, Futures, is_uncertain
from scp_planner.threat_zones.of_scenario import given_zones
from scp_planner.threat_zones.zone import ThreatZone
from scp_planner.tracking.confidence import alpha_of_one, marginal_scale
from scp_planner.tracking.estimate import estimate_obstacle
from scp_planner.tracking.motion_estimate import region_scale
from verification.dense_check import check_trip
from verification.findings import Tolerances

GOAL_SPEED_SHARE = 1e-3 / 3.0
"""Of the highest speed, by which the goal's may be missed: the page of the certificate says so."""


def goal_speed_missed(data: Mapping[str, Any]) -> float:
    """How far off the speed at the goal may be in a scenario, as a dict, m/s."""
    return Tolerances().boundary_speed + GOAL_SPEED_SHARE * float(data["vehicle"]["max_speed"])


def checked(drawn: Wild, scenario: sp.Scenario, plan: sp.Plan) -> Outcome:
    """Check a plan that is said to be certified, in the scenario's own units."""
    length, time = drawn.length, drawn.time
    # What the planner promises to a micrometre and to a millisecond is that in its units, not in the scenario's own.
    usual, finer = Tolerances(), min(1.0, length)
    allowed = replace(
        usual,
        position=max(usual.position, 2e-6 / finer),
        clearance=usual.clearance + 1e-6 / finer,
        arrival=usual.arrival / min(1.0, time),
        goal_speed=goal_speed_missed(drawn.data),
    )
    aimed = {"position": [value / length for value in scenario.goal.position]}  # may be left out for a region
    report = check_trip(
        {**drawn.data, "goal": {**aimed, **drawn.data["goal"]}},
        lambda times: plan.position(np.clip(times * time, plan.start_time, plan.arrival_time)) / length,
        plan.start_time / time,
        plan.arrival_time / time,
        tolerances=allowed,
        regions=regions(scenario, plan.arrival_time),
    )
    return judged("certified", "" if report.ok else str(report), plan=plan.to_dict())


def regions(scenario: sp.Scenario, until: float) -> dict[str, float]:
    """Size of each confidence region up to a time, s; the level is the planner's business, not the check's."""
    level, probability = str(scenario.confidence.level), scenario.confidence.probability
    start = scenario.start.time
    uncertain = [each for each in scenario.obstacles if is_uncertain(each.motion)]
    found: dict[str, float] = {}
    for each in uncertain:
        if each.motion is None:
            estimate = estimate_obstacle(each)
            found[each.id] = region_scale(
                level, probability, estimate, obstacles=len(uncertain), start=start, stop=max(until, start)
            )
        elif isinstance(each.motion, Futures):
            found |= _of_futures(each, each.motion, scenario, len(uncertain))
        else:
            assert isinstance(each.motion, Course)
            found[each.id] = marginal_scale(level, probability, len(each.motion.time), len(uncertain))
    return found


def _of_futures(obstacle: Obstacle, motion: Futures, scenario: sp.Scenario, uncertain: int) -> dict[str, float]:
    """Size of the region of each future, read off its zone; of one that is improbable enough there is none.

    Raises
    ------
    AssertionError
        If all together miss the obstacle with more than the probability that is left to it.
    """
    confidence, found, missed = scenario.confidence, {}, 0.0
    zones = given_zones(obstacle.id, obstacle.shape, obstacle.margin, motion, confidence, uncertain)
    level = str(confidence.level)
    for k, future in enumerate(motion.futures):
        course = future.motion
        if not isinstance(course, Course) or course.covariance is None:
            continue  # known exactly, and kept clear of
        times = np.array(course.time)
        given = np.broadcast_to(np.array(course.covariance), (len(times), 2, 2))
        own = [each for each in zones if _is_about(each, course)]
        if not own:
            missed += future.weight
            continue
        assert own[0].covariances is not None
        scaled = own[0].covariances.grid(times[:1]).ravel()
        scale = float(scaled[0] / given[0, 0, 0])
        found[f"{obstacle.id}[{k}]"] = scale
        once = math.exp(-0.5 * scale)
        missed += future.weight * (once if level == "per_time" else -math.expm1(len(times) * math.log1p(-once)))
    alpha = alpha_of_one(level, confidence.probability, uncertain)
    assert missed <= alpha * (1.0 + 1e-6), f"{obstacle.id}: missed with {missed}, {alpha} allowed"
    return found


def _is_about(zone: ThreatZone, course: Course) -> bool:
    place = zone.centers.grid(np.array(course.time[:1])).ravel()
    return zone.covariances is not None and math.dist(place, course.position[0]) < 1e-6 * (1.0 + math.hypot(*place))
