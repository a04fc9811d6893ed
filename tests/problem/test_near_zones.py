"""Zones that no trip can meet are left out, and no other."""

from __future__ import annotations

import numpy as np
from scenes import disc, scene

import scp_planner as sp
from scp_planner.problem.build import build_problem
from scp_planner.problem.near_zones import BEYOND, without_far_zones
from scp_planner.settings.planning import Settings

LONGEST = 12.0  # s


def test_only_what_stays_away_from_all_trips_is_left_out() -> None:
    rng = np.random.default_rng(9)
    place, velocity = rng.uniform([-30.0, -40.0], [50.0, 40.0], (60, 2)), rng.normal(size=(60, 2))
    rows = np.concatenate([place, velocity], axis=1).tolist()
    scenario = scene(*(disc(f"d{k}", (x, y), (u, v)) for k, (x, y, u, v) in enumerate(rows)))
    problem = build_problem(scenario, sp.zones(scenario), Settings())
    near = without_far_zones(problem, LONGEST)

    times = np.linspace(0.0, LONGEST, 400)[:, None, None]
    center = place + times * velocity
    reach = problem.settings.max_offset + BEYOND
    start, goal = np.array(scenario.start.position), np.array(scenario.goal.position)
    nearest = np.clip(center, np.minimum(start, goal) - reach, np.maximum(start, goal) + reach)
    clearance = (np.linalg.norm(center - nearest, axis=2) - problem.zones.radius).min(axis=0)
    kept = np.isin(problem.zones.ids, near.zones.ids)
    assert np.all(kept[clearance < 0.0]) and (clearance < 0.0).sum() > 8
    wide = 0.5 * LONGEST / 32 * np.linalg.norm(velocity, axis=1)  # of an interval in which a zone is looked at
    assert not np.any(kept[clearance > 2.0 * wide + 1e-6]) and (~kept).sum() > 8


def test_few_zones_are_all_kept() -> None:
    scenario = scene(disc("far", (500.0, 500.0)))
    problem = build_problem(scenario, sp.zones(scenario), Settings())
    assert without_far_zones(problem, LONGEST) is problem
