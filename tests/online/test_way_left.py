"""Shortest ways of a vehicle that cannot turn more tightly than on a circle."""

from __future__ import annotations

import math

import numpy as np
import pytest

from scp_planner.online.way_left import way_left, way_left_both_ways

pytestmark = pytest.mark.numerics


def _least_of_many(goal: tuple[float, float]) -> float:
    """The shortest of all ways on a grid that turn by some angle, then go straight or turn the other way, radius 1."""
    first, then = np.meshgrid(np.linspace(0.0, 2.0 * math.pi, 601), np.linspace(0.0, 8.0, 401), indexing="ij")
    best = math.inf
    for side in (1.0, -1.0):
        x, y = np.sin(first), side * (1.0 - np.cos(first))
        straight = x + then * np.cos(first), y + then * side * np.sin(first)
        # About the centre on the other side, from the heading after the first turn.
        back = first - then
        bent = 2.0 * np.sin(first) - np.sin(back), side * (1.0 - 2.0 * np.cos(first) + np.cos(back))
        for end in (straight, bent):
            there = np.hypot(end[0] - goal[0], end[1] - goal[1]) < 0.02
            best = min(best, float((first + then)[there].min(initial=math.inf)))
    return best


@pytest.mark.parametrize(
    "goal", [(3.0, 0.0), (0.5, 2.5), (-2.0, 0.4), (-1.5, -3.0), (0.1, 0.8), (0.3, -1.2), (0.6, 0.3)]
)
def test_way_left_is_the_shortest_of_many(goal: tuple[float, float]) -> None:
    radius, heading, place = 1.7, 0.8, np.array([4.0, -2.0])
    c, s = math.cos(heading), math.sin(heading)
    target = place + radius * np.array([c * goal[0] - s * goal[1], s * goal[0] + c * goal[1]])
    found = float(way_left(place, np.array(heading), target, radius))
    assert found / radius == pytest.approx(_least_of_many(goal), abs=0.06)


def test_who_can_set_out_in_any_direction_has_the_distance_left() -> None:
    assert way_left(np.zeros((3, 2)), np.array([0.0, 1.0, 2.0]), np.array([3.0, 4.0]), 0.0) == pytest.approx([5.0] * 3)


def test_a_turn_that_passes_near_enough_need_not_begin_farther_away() -> None:
    """A point 0.2 inside of the circle, a quarter of a turn ahead: where that is near enough the quarter is all."""
    place, heading, goal = np.zeros(2), np.array(0.0), np.array([0.8, 1.0])
    assert float(way_left(place, heading, goal, 1.0, 0.3)) == pytest.approx(0.5 * math.pi)
    assert float(way_left(place, heading, goal, 1.0, 0.1)) > 0.5 * math.pi + 0.1


@pytest.mark.parametrize("goal", [(0.0, 0.7), (0.4, -0.9), (-0.5, 1.2), (-0.3, -0.6), (3.0, 0.5)])
def test_who_may_turn_back_has_nearly_the_least_way_with_a_cusp_left(goal: tuple[float, float]) -> None:
    radius, heading, place, turning_back = 1.7, 0.8, np.array([4.0, -2.0]), 0.5
    ahead = complex(math.cos(heading), math.sin(heading))
    target = complex(*place) + radius * complex(*goal) * ahead
    goal_at = np.array([target.real, target.imag])
    best = plain = min(float(way_left(place, np.array(heading + back), goal_at, radius)) for back in (0.0, math.pi))
    for drive in (ahead, -ahead):
        for angle in np.linspace(-2.0, 2.0, 201).tolist():
            # Positions are the integral of the direction along an arc.
            steps = drive * np.exp(1j * angle * (np.arange(200) + 0.5) / 200)
            end = complex(*place) + radius * abs(angle) * complex(steps.mean())
            back = math.atan2(-(drive * np.exp(1j * angle)).imag, -(drive * np.exp(1j * angle)).real)
            rest = float(way_left(np.array([end.real, end.imag]), np.array(back), goal_at, radius))
            best = min(best, radius * abs(angle) + turning_back + rest)
    found = float(way_left_both_ways(place, np.array(heading), goal_at, radius, 0.0, turning_back))
    assert best - 1e-4 <= found <= best + 0.3 * radius
    assert float(way_left_both_ways(place, np.array(heading), goal_at, radius, 0.0, math.inf)) == pytest.approx(plain)
