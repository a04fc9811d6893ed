"""Plans of scenes, judged by the dense check."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

import scp_planner as sp
from benchmarks.hostile.oracle import USERS, Drive, refused
from benchmarks.hostile.scenes import constraints_of
from benchmarks.pairs.scene import Feature, Scene
from benchmarks.pairs.verdict import Result, judge


def try_offline(features: Sequence[Feature], scene: Scene) -> Result:
    """Plan a scene, and judge the plan."""
    return judge(features, lambda: _attempt(scene))


def _attempt(scene: Scene) -> str:
    scenario = scene.scenario()
    plan = sp.plan(scenario, constraints=_constraints(scene))
    if not plan.certified:
        return f"{plan.status}: {plan.reason}"
    missed = [refused(scene.described, scenario, Drive(plan)), _beyond_bound(scene, plan)]
    return "; ".join(filter(None, missed))


def _constraints(scene: Scene) -> Any:
    """User's constraints of a scene, as `scp_planner.plan` takes them."""
    if scene.bound is None:
        return constraints_of(scene.described)
    normal, most = scene.bound
    return lambda trip: [trip.position(trip.stations) @ normal <= most]


def _beyond_bound(scene: Scene, plan: sp.Plan) -> str:
    """Say how far a path is beyond the line that the user's constraint is about."""
    if scene.bound is None:
        return ""
    normal, most = scene.bound
    places = np.asarray(plan.position(np.linspace(plan.start_time, plan.arrival_time, 2000)))
    beyond = float((places @ normal).max()) - most
    length = float(np.linalg.norm(np.diff(places, axis=0), axis=1).sum())
    # Between the stations that the constraint names nothing is promised: as much again as there
    return f"{beyond:.3g} m beyond the user's line" if beyond > 100.0 * USERS * max(length, 1.0) else ""
