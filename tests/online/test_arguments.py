"""Refusals of a planner: calls, settings and solvers."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from scenes import disc, scene

from scp_planner.online.planner import Planner
from scp_planner.settings.online import OnlineSettings

pytestmark = pytest.mark.numerics


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda p: p.observe("who", 0.0, (0, 0)), "observe: there is no obstacle 'who'; add_obstacle adds one"),
        (lambda p: p.observe("d", 0.0, (0, 10**400)), r"position: \(0, 10+\) is not a point"),
        (lambda p: p.observe("d", 0.0, (0, 0), [[10**400, 0], [0, 1]]), "covariance: it is not an array of numbers"),
        (lambda p: p.replan(1.1, (0, 0), 0.0, None), "speed: None is not a finite number"),
        (lambda p: p.replan(1.1, (0, 0), 0.0, 1.0, deadline="soon"), "deadline: 'soon' is not a positive number"),
        (lambda p: p.observe("d", math.nan, (0, 0)), "time: nan is not a finite number"),
        (lambda p: p.observe("d", 0.0, (0, math.inf)), r"position: \(0, inf\) is not a point \[x, y\] of finite"),
        (lambda p: p.observe("d", 0.0, "here"), r"position: 'here' is not a point \[x, y\]"),
        (lambda p: p.observe("d", 0.0, (0, 0), [[1, 2], [2, 1]]), "covariance"),
        (lambda p: p.add_obstacle("d", {"disc": 1.0}), "add_obstacle: there is an obstacle 'd' already"),
        (lambda p: p.add_obstacle("e", {"disc": -1.0}), "disc"),
        (lambda p: p.remove_obstacle("e"), "remove_obstacle: there is no obstacle 'e'"),
        (lambda p: p.replan(0.9, (0, 0), 0.0, 1.0), "time: 0.9 is before 1.0, the time of the last replan"),
        (lambda p: p.replan(1.1, (0, 0), 0.0, math.nan), "speed: nan is not a finite number"),
        (lambda p: p.replan(1.1, (0, 0), math.inf, 1.0), "heading: inf is not a finite number"),
        (lambda p: p.replan(1.1, (0, 0, 0), 0.0, 1.0), "position"),
        (lambda p: p.replan(1.1, (0, 0), 0.0, 1.0, deadline=0.0), "deadline: 0.0 is not a positive number"),
    ],
)
def test_misuse_is_refused_and_changes_nothing(call: Callable[[Planner], object], message: str) -> None:
    planner = Planner(scene(disc("d", (10.0, 5.0))))
    planner.replan(1.0, (0.0, 0.0), 0.0, 1.0)
    before = planner.plan
    with pytest.raises(ValueError, match=message):
        call(planner)
    assert planner.plan is before and list(planner.obstacles.tracks) == ["d"]
    assert planner.replan(1.1, planner.plan.position(1.1), 0.0, 1.0).safe  # type: ignore[union-attr]


@pytest.mark.parametrize(
    ("call", "note"),
    [
        (lambda p: p.observe("d", 10**400, (0, 0)), "d: time: 10+ is beyond 1e"),
        (lambda p: p.observe("d", -1e300, (0, 0)), r"d: time: -1e\+300 is beyond 1e"),
        (lambda p: p.observe("d", 0.0, (0, 1e13)), r"d: position: 10000000000000\.0 is beyond 1e"),
        (lambda p: p.observe("d", 0.0, (0, 0), [[1e300, 0], [0, 1e300]]), r"d: covariance: .* is beyond 1e"),
        (lambda p: p.update_obstacle("d", 1e20, (0, 0), (0, 0), covariance=np.eye(4)), r"d: time: 1e\+20 is beyond"),
        (lambda p: p.update_obstacle("d", 1, (0, 0), (1e20, 0), covariance=np.eye(4)), r"d: velocity: 1e\+20 is bey"),
        (lambda p: p.update_obstacle("d", 1, (0, 0), (0, 0), covariance=1e20 * np.eye(4)), "d: covariance: 1e.20 is"),
    ],
)
def test_values_that_no_scene_has_are_left_out_with_a_note(call: Callable[[Planner], object], note: str) -> None:
    planner = Planner(scene(disc("d", (10.0, 5.0))))
    planner.replan(1.0, (0.0, 0.0), 0.0, 1.0)
    call(planner)
    assert planner.replan(1.1, planner.plan.position(1.1), 0.0, 1.0).safe  # type: ignore[union-attr]
    assert re.match(note, planner.notes[-1])
    assert planner.zones[0].center(1.1) == pytest.approx((10.0, 5.0))


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"period": 0.0}, r"period = 0.0: must be a number, above 0, up to 1e\+12 s, or none"),
        ({"tracking_error": -0.1}, r"tracking_error = -0.1: must be a number, 0 to 1e\+12 m"),
        ({"reaction_time": math.nan}, r"reaction_time = nan: must be a number, 0 to 1e\+12 s"),
        ({"foresight": -1.0}, "foresight = -1.0: must be a number, at least 0 s, or none"),
        ({"iterations": 0}, "iterations = 0: must be a whole number, 1 to 1000"),
        ({"look_every": 2.5}, "look_every = 2.5: must be a whole number, 1 to"),
    ],
)
def test_settings_are_checked(values: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        OnlineSettings(**values)


def test_unknown_solver_is_refused() -> None:
    with pytest.raises(ValueError, match="solver = 'magic': must be one of daqp"):
        Planner(scene(), solver="magic")
