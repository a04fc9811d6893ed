"""Summaries of plans, certificates and runs: a name and a figure each."""

from __future__ import annotations

import math
import statistics
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from scp_planner.certificate.verdict import Certificate
    from scp_planner.planning.plan import Plan
    from scp_planner.scenario.models import Scenario
    from scp_planner.simulation.run import Run


def of_plan(scenario: Scenario, plan: Plan) -> dict[str, Any]:
    """Sum up a plan."""
    return {
        "scenario": scenario.name,
        "status": str(plan.status),
        "certified": plan.certified,
        "reason": plan.reason,
        "arrival_time": plan.arrival_time,
        "travel_time": plan.travel_time,
        "lower_bound": plan.lower_bound,
        "relative_gap": plan.gap if plan.certified else None,
        "converged": plan.converged,
        "least_clearance": plan.clearance.minimum,
        "nearest_obstacle": plan.clearance.obstacle,
        "time_of_least_clearance": plan.clearance.time,
        "iterations": plan.iterations,
        "wall_time": plan.wall_time,
        "method": plan.method,
        "solver": plan.solver,
        **(_of_meeting(scenario, plan) if scenario.goal.target is not None else {}),
        **(_of_passages(scenario, plan) if scenario.goals else {}),
    }


def _of_passages(scenario: Scenario, plan: Plan) -> dict[str, Any]:
    """Sum up in which order, and when, a plan passes places and meets targets on the way."""
    from scp_planner.planning.meeting import meetings

    found = meetings(scenario, plan)
    return {"goals_passed": list(found), "times_of_passing": [one.time for one in found.values()]}


def _of_meeting(scenario: Scenario, plan: Plan) -> dict[str, Any]:
    """Sum up the arrival of a plan at a target: where, how much faster than it, and whether within the radius."""
    from scp_planner.planning.meeting import meeting

    met, (heading, speed) = (
        meeting(scenario, plan),
        (float(one(plan.arrival_time)) for one in (plan.heading, plan.speed)),
    )
    driven = speed * math.cos(heading), speed * math.sin(heading)
    return {
        "meeting_x": met.place[0],
        "meeting_y": met.place[1],
        "relative_speed": math.dist(driven, met.velocity),
        "distance_at_meeting": met.distance,
        "probability_within": met.probability,
    }


def of_run(run: Run) -> dict[str, Any]:
    """Sum up a closed loop."""
    return {
        "scenario": run.scenario.name,
        "arrived": run.arrived,
        "contact": run.contact,
        "contact_standing": run.contact_standing,
        "travel_time": run.travel_time,
        "least_clearance": run.least_clearance,
        "replans": len(run.records),
        **run.outcomes,
        "median_replan_time": statistics.median(run.wall_times.tolist()),
        "seed": run.seed,
    }


def of_certificate(scenario: Scenario, certificate: Certificate) -> dict[str, Any]:
    """Sum up a certificate."""
    return {
        "scenario": scenario.name,
        "certified": certificate.holds,
        "least_clearance": certificate.clearance.minimum,
        "nearest_obstacle": certificate.clearance.obstacle,
        "time_of_least_clearance": certificate.clearance.time,
        "limits": {
            name: {
                "worst": use.worst,
                "limit": use.limit,
                "used": None if use.limit is None else use.worst / use.limit,
                "time": use.time,
            }
            for name, use in certificate.limits.items()
        },
        "violations": [str(violation) for violation in certificate.violations],
    }
