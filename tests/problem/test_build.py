"""Problems against their scenarios: limits, switching times of the textbook, ends that every trip keeps."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from scenes import CROSSERS, scene

import scp_planner as sp
from scp_planner.mathematics import corridor
from scp_planner.mathematics.outlines import Outline
from scp_planner.problem.build import acceleration_breakpoints, build_problem
from scp_planner.problem.problem import Problem
from scp_planner.settings.planning import Settings
from scp_planner.trips.path import Path

pytestmark = pytest.mark.numerics

MARGIN = 1e-3


def problem_of(*obstacles: dict[str, Any], **changes: Any) -> Problem:
    scenario = scene(*obstacles, **changes)
    return build_problem(scenario, sp.zones(scenario), Settings(limit_margin=MARGIN))


def test_limits_are_those_of_the_vehicle_less_the_margin() -> None:
    problem = problem_of(*CROSSERS)
    vehicle, limits = problem.scenario.vehicle, problem.limits
    for name in ("speed", "acceleration", "deceleration", "lateral_acceleration", "curvature"):
        assert getattr(limits, name) == pytest.approx(getattr(vehicle, f"max_{name}") * (1.0 - MARGIN), rel=1e-12)
    assert problem.zones.ids == tuple(one["id"] for one in CROSSERS)
    radii = [one["shape"]["disc"] + vehicle.radius + problem.settings.clearance_margin for one in CROSSERS]
    assert problem.zones.radius == pytest.approx(radii, rel=1e-12)


@pytest.mark.parametrize("goal_speed", [None, 0.0, 1.2])
def test_breakpoints_are_where_the_fastest_straight_drive_switches(goal_speed: float | None) -> None:
    """From 1 to 3 m/s, on, and down to the goal's speed, in 20 m; the top speed is reached."""
    problem = problem_of(goal={"speed": goal_speed})
    top, a, d = 3.0 * (1.0 - MARGIN), 1.5 * (1.0 - MARGIN), 2.0 * (1.0 - MARGIN)
    rise, end = (top - 1.0) / a, top if goal_speed is None else goal_speed
    fall = (top - end) / d
    cruise = (20.0 - 0.5 * (1.0 + top) * rise - 0.5 * (top + end) * fall) / top
    assert cruise > 0.0
    breaks = problem.space.acceleration.breakpoints
    for switch in {rise, rise + cruise if fall else rise}:
        assert np.abs(breaks - switch / (rise + cruise + fall)).min() < 1e-11
    assert breaks[0] == 0.0 and breaks[-1] == 1.0 and np.all(np.diff(breaks) > 0.0)


def test_a_switch_moves_the_nearest_breakpoint_and_adds_one_where_none_is_left() -> None:
    assert acceleration_breakpoints(4, (0.3,)) == (0.0, 0.3, 0.5, 0.75, 1.0)
    assert acceleration_breakpoints(4, (0.3, 0.26)) == (0.0, 0.26, 0.3, 0.5, 0.75, 1.0)
    assert acceleration_breakpoints(2, (1.5,)) == (0.0, 0.5, 1.0)


@pytest.mark.parametrize("seed", range(4))
def test_every_path_keeps_both_ends_and_their_headings(seed: int) -> None:
    """A polynomial through points of the outer spans has the derivatives of the path, whatever is free."""
    rng = np.random.default_rng(seed)
    start, goal = rng.uniform(-0.6, 0.6, 2)
    problem = problem_of(start={"heading": float(start)}, goal={"heading": float(goal)})
    theta = problem.ends.theta.copy()
    theta[problem.ends.free] = rng.uniform(-1.0, 1.0, len(theta[problem.ends.free]))
    path = Path(problem.space, theta)
    degree, span = problem.settings.path_degree, 1.0 / len(problem.space.path.widths)
    shares = 0.5 - 0.5 * np.cos(np.pi * np.arange(degree + 1) / degree)
    for parameter, inside, heading, place in ((0.0, span, start, (0.0, 0.0)), (1.0, -span, goal, (20.0, 0.0))):
        points = problem.frame.to_world(path.points(parameter + inside * shares).position)
        assert points[0] == pytest.approx(place, abs=1e-12)
        slopes = [np.polynomial.Polynomial.fit(shares, points[:, k], degree).deriv()(0.0) for k in (0, 1)]
        found = math.atan2(slopes[1] / inside, slopes[0] / inside)
        assert found == pytest.approx(heading, abs=1e-9)


def test_what_depends_on_a_corridor_alone_is_made_when_it_is_read(monkeypatch: pytest.MonkeyPatch) -> None:
    cells = [[[x - 2.0, y - 2.0], [x + 3.0, y - 2.0], [x + 3.0, y + 2.0], [x - 2.0, y + 2.0]] for x, y in BEND]
    read = scene(goal={"position": list(BEND[-1])}, corridor=cells)

    def again(*given: Any) -> Any:
        raise AssertionError("it was made when it was read")

    monkeypatch.setattr(corridor, "way_through", again)
    monkeypatch.setattr(corridor, "outside", again)
    monkeypatch.setattr(Outline, "polygon", again)
    plan = sp.plan(read)
    assert plan.certified, plan.reason


BEND = ((0.0, 0.0), (4.0, 0.0), (8.0, 1.5), (12.0, 4.0), (16.0, 6.5), (20.0, 8.0))
