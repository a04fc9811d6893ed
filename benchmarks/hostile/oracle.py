"""Any answer against what it promises, by the dense check: plans in legs, places, targets, maps."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

import scp_planner as sp
from benchmarks.hostile.combined import occupied_ground
from benchmarks.hostile.dense import goal_speed_missed, regions
from benchmarks.hostile.wild import Data
from verification.dense_check import SAMPLES, check_trip
from verification.differences import ACCELERATION_WINDOW, CHORD_LENGTH, SPEED_WINDOW, Array
from verification.findings import Tolerances

ROUNDING = 8.0 * np.finfo(float).eps
UNITS = 20.0
"""Units of length that a trip has; so many of them are its own."""
USERS = 1e-5
"""Of the trip's length, by which a user's constraint may be missed."""


def tolerances(data: Mapping[str, Any], places: Array, times: Array) -> Tolerances:
    """How far off a trip through places (n, 2), m, at times (n,), s, may be: by its units, and by rounding."""
    usual = Tolerances()
    length = float(np.linalg.norm(np.diff(places, axis=0), axis=1).sum())
    unit = max(1.0, length / UNITS)
    top = float(data["vehicle"]["max_speed"])
    off = ROUNDING * (float(np.abs(places).max()) + top * float(np.abs(times).max()))
    rough = 4.0 * off / (SPEED_WINDOW * ACCELERATION_WINDOW)
    bent = 8.0 * off / CHORD_LENGTH**2
    return replace(
        usual,
        position=2.0 * usual.position * unit + off,
        clearance=usual.clearance + 1e-6 * unit + off,
        speed=usual.speed + 2.0 * off / SPEED_WINDOW,
        boundary_speed=usual.boundary_speed + 10.0 * off / 1e-4,
        acceleration=usual.acceleration + rough,
        jerk=usual.jerk + 40.0 * rough,
        curvature=usual.curvature + bent,
        curvature_rate=usual.curvature_rate + 40.0 * bent,
        lateral_acceleration=usual.lateral_acceleration + bent * top**2,
        heading=usual.heading + 4.0 * off / 1e-4,
        goal_speed=goal_speed_missed(data),
    )


def contents(scenario: sp.Scenario) -> Data:
    """Give a scenario as a dict, but for its map, which need be in no file."""
    return scenario.model_copy(update={"ground": None}).to_dict()


def refused(
    scene: Data,
    scenario: sp.Scenario,
    plan: sp.Plan,
    *,
    data: Mapping[str, Any] | None = None,
    begin: float | None = None,
    samples: int = SAMPLES,
    lowered: bool = False,
    speed_met: float = 0.0,
) -> str:
    """Say what a plan that is said to be certified breaks of its scenario; nothing if nothing.

    Parameters
    ----------
    scene : dict
        With the map, and the least time that a user's constraint asks for.
    scenario : Scenario
        With the obstacles of which the regions are to be known.
    plan : Plan
    data : mapping, optional
        What is promised, if it is not the scenario.
    begin : float, optional
        Time from which on it is promised, s; None: from the plan's start.
    samples : int
    lowered : bool
        As for `check_trip`.
    speed_met : float
        By how much more than usual the speed at the end may be off, m/s.
    """
    data = contents(scenario) if data is None else data
    begin, end = plan.start_time if begin is None else begin, plan.arrival_time
    least = scene.get("least_time")
    if not (math.isfinite(begin) and math.isfinite(end)):
        return f"from {begin} s to {end} s"
    if not end > begin:
        return ""
    times = np.linspace(begin, end, 200)
    places = np.asarray(plan.position(times))
    allowed = tolerances(data, places, times)
    allowed = replace(allowed, goal_speed=allowed.goal_speed + speed_met)
    report = check_trip(
        data,
        lambda t: plan.position(np.clip(t, begin, end)),
        begin,
        end,
        heading=lambda t: plan.heading(np.clip(t, begin, end)),
        ground=occupied_ground(scene.get("map")),
        regions=regions(scenario, end),
        tolerances=allowed,
        samples=samples,
        lowered=lowered,
    )
    missed = [] if report.ok else [str(report)]
    length = float(np.linalg.norm(np.diff(places, axis=0), axis=1).sum())
    if least is not None and plan.travel_time < least - USERS * max(length, 1.0):
        missed.append(f"travel_time {plan.travel_time:.9g} against {least:.9g} of the user's constraint")
    return "; ".join(missed)
