"""Optimal reciprocal collision avoidance: against closed forms, against looking everywhere, and against linprog."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.optimize import linprog

from scp_planner.simulation.orca import Bodies, HalfPlanes, half_planes, nearest_velocities

HORIZON, STEP = 5.0, 0.25
Array = np.ndarray


def body(x: float, y: float, vx: float, vy: float, radius: float = 0.5) -> Bodies:
    return Bodies(np.array([[[x, y]]]), np.array([[[vx, vy]]]), np.array([[radius]]))


def least_distance(place: Array, relative: Array, horizon: float) -> Array:
    """Distances (n,) of a disc's centre at a place from one that moves by relative velocities (n, 2) for a time."""
    squared = (relative**2).sum(axis=1)
    time = np.clip(relative @ place / np.where(squared > 0.0, squared, 1.0), 0.0, horizon)
    return np.hypot(*(place - time[:, None] * relative).T)


# half-planes


def test_two_discs_head_on_slow_down_until_they_would_touch_at_the_horizon() -> None:
    """With a relative speed below that of their middle, the nearest way out is to be slower: (d - r) / horizon."""
    own, other = body(0.0, 0.0, 0.95, 0.0), body(10.0, 0.0, -0.95, 0.0)
    rows = half_planes(own, other, HORIZON, STEP)
    assert rows.normal[0, 0] == pytest.approx((-1.0, 0.0))
    chosen = nearest_velocities(rows, np.array([[0.95, 0.0]]), np.array([1.0]))
    assert chosen[0] == pytest.approx((0.5 * (10.0 - 1.0) / HORIZON, 0.0))


def test_two_fast_discs_head_on_turn_to_the_tangent() -> None:
    """Otherwise each takes half of the turn after which the relative velocity is tangent to the other's disc."""
    distance, reach, speed = 10.0, 1.0, 1.5
    own, other = body(0.0, 0.0, speed, 0.0), body(distance, 0.0, -speed, 0.0)
    first = half_planes(own, other, HORIZON, STEP)
    second = half_planes(other, own, HORIZON, STEP)
    ours = nearest_velocities(first, np.array([[speed, 0.0]]), np.array([2.0]))[0]
    theirs = nearest_velocities(second, np.array([[-speed, 0.0]]), np.array([2.0]))[0]
    relative = ours - theirs
    assert theirs == pytest.approx(-ours)
    angle = math.asin(reach / distance)
    assert abs(math.atan2(relative[1], relative[0])) == pytest.approx(angle)
    assert np.hypot(*relative) == pytest.approx(2.0 * speed * math.cos(angle))


def test_overlapping_discs_part_within_a_step() -> None:
    own, other = body(0.0, 0.0, 0.0, 0.0), body(0.8, 0.0, 0.0, 0.0)
    rows = half_planes(own, other, HORIZON, STEP)
    chosen = nearest_velocities(rows, np.zeros((1, 2)), np.array([5.0]))[0]
    assert 0.8 - 2.0 * chosen[0] * STEP == pytest.approx(1.0)
    same = half_planes(own, own, HORIZON, STEP)
    assert np.hypot(*same.normal[0, 0]) == pytest.approx(1.0) and np.isfinite(same.offset).all()


@pytest.mark.parametrize("seed", range(20))
def test_border_is_the_nearest_velocity_after_which_discs_just_touch(seed: int) -> None:
    """With the whole share, the own velocity moved to the border is on that of the true obstacle, nowhere nearer."""
    rng = np.random.default_rng(seed)
    place = rng.uniform(1.2, 6.0) * np.array([math.cos(seed), math.sin(seed)])
    velocity, others = rng.uniform(-1.5, 1.5, 2), rng.uniform(-1.0, 1.0, 2)
    own, other = body(0.0, 0.0, *velocity), body(*place, *others)
    rows = half_planes(own, other, HORIZON, STEP, share=1.0)
    normal, offset = rows.normal[0, 0], float(rows.offset[0, 0])
    depth = offset - float(normal @ velocity)
    border = velocity + depth * normal
    assert least_distance(place, (border - others)[None], HORIZON)[0] == pytest.approx(1.0, abs=1e-9)
    collides = least_distance(place, (velocity - others)[None], HORIZON)[0] < 1.0
    assert collides == (depth > 0.0)
    angles = np.linspace(0.0, 2.0 * math.pi, 721)
    nearer = velocity + 0.99 * abs(depth) * np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    assert ((least_distance(place, nearer - others, HORIZON) < 1.0) == collides).all()


# the linear programme


def rows_of(rng: np.random.Generator, bodies: int, lines: int, shift: float) -> HalfPlanes:
    angles = rng.uniform(0.0, 2.0 * math.pi, (bodies, lines))
    normal = np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    return HalfPlanes(normal, rng.uniform(-1.0, 1.0, (bodies, lines)) + shift)


def test_nearest_velocity_is_the_best_of_all() -> None:
    """No velocity of a fine grid that keeps all rows is nearer by more than the grid's width."""
    rng = np.random.default_rng(3)
    rows, top = rows_of(rng, 40, 4, -0.6), rng.uniform(0.5, 1.5, 40)
    wanted = rng.uniform(-1.5, 1.5, (40, 2))
    chosen = nearest_velocities(rows, wanted, top)
    ticks = np.linspace(-1.0, 1.0, 401)
    grid = np.stack(np.meshgrid(ticks, ticks), axis=-1).reshape(-1, 2)
    grid = grid[np.hypot(*grid.T) <= 1.0]
    feasible = 0
    for k in range(40):
        some = top[k] * grid
        kept = (some @ rows.normal[k].T >= rows.offset[k]).all(axis=1)
        if not kept.any():
            continue
        feasible += 1
        assert (rows.normal[k] @ chosen[k] >= rows.offset[k] - 1e-7).all() and np.hypot(*chosen[k]) <= top[k] + 1e-7
        best = np.hypot(*(some[kept] - wanted[k]).T).min()
        assert best - 0.01 <= np.hypot(*(chosen[k] - wanted[k])) <= best + 1e-7
    assert feasible > 25


def test_least_bad_velocity_is_that_of_linprog() -> None:
    """No velocity keeps all rows; the disc is a polygon of 720 sides."""
    rng = np.random.default_rng(4)
    rows = rows_of(rng, 30, 6, 0.3)
    chosen = nearest_velocities(rows, rng.uniform(-1.0, 1.0, (30, 2)), np.ones(30))
    angles = np.linspace(0.0, 2.0 * math.pi, 720, endpoint=False)
    sides = np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    bad = 0
    for k in range(30):
        # minimise s: offset - normal . v <= s
        matrix = np.vstack([np.column_stack([-rows.normal[k], -np.ones(6)]), np.column_stack([sides, np.zeros(720)])])
        vector = np.concatenate([-rows.offset[k], np.ones(720)])
        best = linprog([0.0, 0.0, 1.0], matrix, vector, bounds=[(None, None)] * 3).fun
        if best <= 0.0:
            continue
        bad += 1
        assert np.hypot(*chosen[k]) <= 1.0 + 1e-7
        assert (rows.offset[k] - rows.normal[k] @ chosen[k]).max() == pytest.approx(best, abs=2e-5)
    assert bad > 20


def test_without_rows_the_wish_is_granted_up_to_the_top_speed() -> None:
    none = HalfPlanes(np.zeros((2, 0, 2)), np.zeros((2, 0)))
    wanted = np.array([[0.3, 0.4], [3.0, 4.0]])
    assert nearest_velocities(none, wanted, np.ones(2)) == pytest.approx(np.array([[0.3, 0.4], [0.6, 0.8]]))
    absent = HalfPlanes(np.tile([1.0, 0.0], (2, 1, 1)), np.full((2, 1), -np.inf))
    assert nearest_velocities(absent, wanted, np.ones(2)) == pytest.approx(np.array([[0.3, 0.4], [0.6, 0.8]]))
