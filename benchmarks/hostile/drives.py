"""Wild scenarios driven with an online planner that gets what it plans, each of its promises checked densely.

What is called certified has to be so by the dense check, for the scenario that the planner says it planned for; and so
has a stop for which a trip can be left.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

import scp_planner as sp
from scp_planner.online.plan import AWAY, OnlinePlan
from scp_planner.online.stops import standing_from
from scp_planner.scenario.models import Steering
from scp_planner.trips.trip import Trip
from verification.dense_check import check_trip
from verification.findings import Tolerances

Regions = Callable[[sp.Scenario, float], Mapping[str, float]]

CYCLES = (2, 12)
"""Replans of a drive, at least and at most."""
SAMPLES = 4000
SHORTEST_CHECKED = 0.05
"""Units of time; what is left of a trip, for differences to say something."""
GOAL_SPEED_SHARE = 1e-3 / 3.0
"""Of the highest speed, by which the goal's may be missed: the page of the certificate says so."""
ROUND_THE_END = 1e-6
"""Units of length; radius of the goal of a trip that ends anywhere."""


@dataclass
class Drive:
    """What came of a drive.

    Attributes
    ----------
    checked : int
        Trips and stops that the dense check looked at.
    refused : str
        What it says of the first that it refuses; empty if it refuses none.
    outcomes : tuple of str
        Of the replans.
    """

    checked: int = 0
    refused: str = ""
    outcomes: tuple[str, ...] = ()


def drive(scenario: sp.Scenario, options: Mapping[str, Any], deadline: float, regions: Regions) -> Drive:
    """Drive a scenario in its own units for some replans.

    Parameters
    ----------
    scenario : Scenario
    options : mapping
        ``period``, s, ``cycles`` and ``safety``.
    deadline : float
        Of each replan, s.
    regions : callable
        Gives the sizes of the regions of a scenario up to a time.

    Returns
    -------
    Drive
    """
    online = sp.OnlineSettings(period=options["period"], safety=options["safety"])
    planner, found = sp.Planner(scenario, online=online), Drive()
    time, start = scenario.start.time, scenario.start
    state: tuple[Any, Any, float] = (start.position, start.heading, start.speed)
    for _ in range(options["cycles"]):
        plan = planner.replan(time, *state, deadline=deadline)
        found.outcomes += (str(plan.outcome),)
        assert plan.reason, f"a plan without a reason: {plan.outcome}"
        _judge(found, planner.scenario, plan, time, regions)
        time += options["period"]
        if plan.arrived or found.refused or (plan.outcome not in AWAY and plan.arrival_time <= time):
            break
        state = (plan.position(time), float(plan.heading(time)), max(float(plan.speed(time)), 0.0))
    return found


def goal_speed_missed(data: Mapping[str, Any]) -> float:
    """How far off the speed at the goal may be in a scenario, as a dict, m/s."""
    return Tolerances().boundary_speed + GOAL_SPEED_SHARE * float(data["vehicle"]["max_speed"])


def _judge(found: Drive, scenario: sp.Scenario, plan: OnlinePlan, time: float, regions: Regions) -> None:
    data = scenario.to_dict()
    if scenario.vehicle.steering != Steering.AHEAD:
        data["start"]["heading"] = None  # it may set out backwards, or in any direction
    # Driving faster than allowed at the start is the scenario's business, not the plan's.
    data["vehicle"]["max_speed"] = max(data["vehicle"]["max_speed"], float(plan.speed(time)))
    if plan.certified:
        aim = data if plan.outcome not in AWAY else _ending(data, plan.trip, plan.arrival_time)
        _check(found, aim, plan.trip, (time, plan.arrival_time), regions(scenario, plan.arrival_time), plan.outcome)
    if plan.stop is not None and not found.refused:
        stands = max(plan.stop.frame.time + standing_from(plan.stop.trajectory), time)
        aim = _ending(data, plan.stop, stands)
        _check(found, aim, plan.stop, (time, stands), regions(scenario, stands), f"stop of {plan.outcome}")


def _places(trip: Trip, times: np.ndarray) -> Any:
    return trip.frame.to_world(trip.at(times)[0].path.position)


def _ending(data: Mapping[str, Any], trip: Trip, end: float) -> dict[str, Any]:
    """The scenario with the end of a trip as its goal: it does not go where the scenario says."""
    return {**data, "goal": {"position": _places(trip, np.array([end]))[0].tolist(), "radius": ROUND_THE_END}}


def _check(
    found: Drive,
    data: Mapping[str, Any],
    trip: Trip,
    span: tuple[float, float],
    regions: Mapping[str, float],
    what: str,
) -> None:
    if span[1] - span[0] < SHORTEST_CHECKED:
        return
    found.checked += 1
    allowed = replace(Tolerances(), goal_speed=goal_speed_missed(data))
    report = check_trip(
        data, lambda times: _places(trip, times), *span, tolerances=allowed, samples=SAMPLES, regions=regions
    )
    if not report.ok:
        found.refused = f"replan {len(found.outcomes)}, t = {span[0]:.6g} s, {what}: {report}"
