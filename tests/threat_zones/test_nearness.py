"""Bounds of how near zones come to boxes in time."""

from __future__ import annotations

import numpy as np
import pytest
from scenes import disc, observed, scene

import scp_planner as sp
from scp_planner.mathematics.frames import PlanningFrame
from scp_planner.threat_zones.batch import ZoneBatch
from scp_planner.threat_zones.nearness import SweptBoxes, least_clearances

INFLATION = 0.3
WORLD = PlanningFrame((0.0, 0.0), 0.0, 0.0)


def test_bounds_are_below_all_samples_and_near_them_on_short_intervals() -> None:
    rng = np.random.default_rng(4)
    place, velocity, pull = rng.uniform(-8.0, 8.0, (6, 2)), rng.normal(size=(6, 2)), rng.normal(size=(6, 2))
    rows = np.concatenate([place, velocity, pull], axis=1).tolist()
    moving = [disc(f"d{k}", (x, y), (u, v), (a, b), 0.5) for k, (x, y, u, v, a, b) in enumerate(rows)]
    batch = ZoneBatch.of(sp.zones(scene(*moving, observed("seen", 3))), WORLD, INFLATION)
    count, span = 8, 4.0
    half = 0.5 * span / count
    middle = np.linspace(half, span - half, count)
    corners = rng.uniform(-3.0, 3.0, (2, count, 2))
    boxes = SweptBoxes(middle, half, corners.min(axis=0), corners.max(axis=0))
    bounds = least_clearances(batch, boxes)
    assert bounds[6] == -np.inf  # nothing is known of it so cheaply

    times = middle[:, None] + np.linspace(-half, half, 41)
    off = np.empty((6, count, 41))
    for k in range(6):
        center = place[k] + velocity[k] * times[..., None] + 0.5 * pull[k] * times[..., None] ** 2
        nearest = np.clip(center, boxes.lower[:, None], boxes.upper[:, None])
        off[k] = np.linalg.norm(center - nearest, axis=2) - 0.5 - INFLATION
    sampled = off.min(axis=(1, 2))
    assert np.all(bounds[:6] <= sampled + 1e-9)
    farthest = np.linalg.norm(velocity, axis=1) + span * np.linalg.norm(pull, axis=1)
    assert np.all(bounds[:6] >= sampled - 2.0 * half * farthest)


def test_bound_of_what_stands_is_its_distance() -> None:
    batch = ZoneBatch.of(sp.zones(scene(disc("post", (5.0, 6.0), radius=1.0))), WORLD, INFLATION)
    boxes = SweptBoxes(np.array([1.0]), 1.0, np.array([[0.0, 0.0]]), np.array([[2.0, 2.0]]))
    assert least_clearances(batch, boxes)[0] == pytest.approx(5.0 - 1.0 - INFLATION, abs=1e-6)
