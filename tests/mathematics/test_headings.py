"""Headings of what follows a course: along its velocity, and what serves where that is only jitter."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from scp_planner.arrays import Array
from scp_planner.mathematics.courses import course_polynomials
from scp_planner.mathematics.headings import course_heading
from scp_planner.mathematics.polynomials import PiecewisePolynomials

pytestmark = pytest.mark.numerics

LENGTH = 4.8
STEP = 0.5


def angles(pointing: PiecewisePolynomials, times: Array) -> Array:
    """Directions of lines, rad from 0 to pi."""
    velocity = pointing.derivative.grid(times)[:, 0]
    angle: Array = np.arctan2(velocity[:, 1], velocity[:, 0]) % np.pi
    return angle


def apart(one: Array | float, other: Array | float) -> Array:
    """Angle between two directions of lines, rad."""
    difference: Array = np.abs((np.asarray(one) - other + 0.5 * np.pi) % np.pi - 0.5 * np.pi)
    return difference


def stop_and_go(turn: float, jitter: float, stand: float = 6.0) -> tuple[Array, Array]:
    """East at 5 m/s, slower and slower; it stands; then it sets off in another direction, with jitter on all of it."""
    times = np.arange(0.0, 8.0 + stand, STEP)
    driven = np.where(times < 4.0, 5.0 * times - 0.625 * times**2, 10.0)
    since = np.maximum(times - 4.0 - stand, 0.0)
    places = driven[:, None] * [1.0, 0.0] + (0.7 * since**2)[:, None] * [np.cos(turn), np.sin(turn)]
    return times, places + np.random.default_rng(1).normal(0.0, 1.0, places.shape) * jitter


@pytest.mark.parametrize("jitter", [0.0, 0.02])
def test_the_last_known_heading_serves_while_it_stands(jitter: float) -> None:
    times, places = stop_and_go(0.0, jitter)
    pointing = course_heading(course_polynomials(times, places), LENGTH)
    assert pointing is not None
    # 2 cm across a metre or two on the way
    assert np.all(apart(angles(pointing, np.linspace(-1.0, 20.0, 2000)), 0.0) <= 0.05 * (jitter > 0.0) + 1e-9)


def test_it_turns_into_the_next_heading_by_the_way_that_is_behind_it() -> None:
    times, places = stop_and_go(0.6, 0.0)
    course = course_polynomials(times, places)
    pointing = course_heading(course, LENGTH)
    assert pointing is not None
    assert apart(angles(pointing, np.array([3.2]))[0], 0.0) < 0.1
    assert apart(angles(pointing, np.array([12.0]))[0], 0.6) < 0.1
    between = angles(pointing, np.linspace(3.2, 12.0, 500))
    assert np.all((between > -0.1) & (between < 0.7))
    assert np.all(np.abs(np.diff(between)) < 0.05)


def test_what_drives_back_the_way_it_came_does_not_turn_round() -> None:
    times, places = stop_and_go(np.pi, 0.0)
    pointing = course_heading(course_polynomials(times, places), LENGTH)
    assert pointing is not None
    assert np.all(apart(angles(pointing, np.linspace(-1.0, 20.0, 2000)), 0.0) < 1e-6)


def test_the_first_known_heading_serves_before_it() -> None:
    times = np.arange(0.0, 12.5, STEP)
    places = np.stack([np.where(times < 5.0, 0.0, (times - 5.0) ** 2), 3.0 + 0.0 * times], axis=1)
    places += np.random.default_rng(0).normal(0.0, 0.02, places.shape)
    pointing = course_heading(course_polynomials(times, places), LENGTH)
    assert pointing is not None
    assert np.all(apart(angles(pointing, np.linspace(-5.0, 15.0, 2000)), 0.0) < 0.06)


def test_what_is_nowhere_slow_is_its_own_heading_and_what_only_jitters_has_none() -> None:
    times = np.arange(0.0, 5.0, STEP)
    around = course_polynomials(times, np.stack([4.0 * np.cos(times), 4.0 * np.sin(times)], axis=1))
    assert course_heading(around, LENGTH) is around
    jitter = np.random.default_rng(2).normal(0.0, 0.02, (len(times), 2))
    assert course_heading(course_polynomials(times, jitter), LENGTH) is None
    assert course_heading(course_polynomials(times, np.zeros((len(times), 2))), LENGTH) is None


def test_headings_do_not_jump() -> None:
    """But for half turns, which a rectangle does not show."""
    for turn in (-1.2, 0.4, 2.5):
        times, places = stop_and_go(turn, 0.02)
        pointing = course_heading(course_polynomials(times, places), LENGTH)
        assert pointing is not None
        knots = pointing.breakpoints[0, 1:-1]
        assert np.all(apart(angles(pointing, knots - 1e-9), angles(pointing, knots + 1e-9)) < 1e-6)


def winding(seed: int) -> tuple[Array, Array]:
    """Drives, turns slowly and stands, at random."""
    rng = np.random.default_rng(seed)
    times = np.cumsum(rng.uniform(0.3, 8.0, 14))
    legs = rng.uniform(-1.0, 1.0, (14, 2)) * 10.0 ** rng.uniform(-1.0, 1.5, (14, 1)) * (rng.random((14, 1)) < 0.8)
    return times, np.cumsum(legs, axis=0)


@pytest.mark.parametrize("seed", range(40))
def test_it_heads_along_its_velocity_at_all_times_at_which_it_moves(seed: int) -> None:
    """By the rule as it is documented, of a spline of SciPy, with a thousandth to spare."""
    times, places = winding(seed)
    pointing = course_heading(course_polynomials(times, places), LENGTH)
    spline = CubicSpline(times, places, bc_type="natural")
    dense = np.linspace(times[0], times[-1], 100_001)
    dense = np.sort(np.concatenate([dense, *(at + np.geomspace(1e-9, 0.1, 50) for at in times[:-1])]))
    velocity = spline(dense, 1)
    speed = np.hypot(*velocity.T)
    slow, far = 0.05 * 1.001 * speed.max(), 0.1 * 1.001 * LENGTH
    reach = 0.1 * LENGTH / (0.05 * speed.max())
    inside = (dense - reach >= times[0]) & (dense + reach <= times[-1])
    ways = [np.hypot(*(spline(dense + away) - spline(dense)).T) for away in (reach, -reach)]
    moves = inside & (speed >= slow) & (ways[0] >= far) & (ways[1] >= far)
    if not moves.any():
        return
    assert pointing is not None
    expected = np.arctan2(velocity[moves, 1], velocity[moves, 0])
    assert np.all(apart(angles(pointing, dense[moves]), expected) < 1e-6)
