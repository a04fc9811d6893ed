"""Maps: ground is told apart, nothing that is drawn is cut off, axes are in units that fit."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from matplotlib.colors import to_rgba
from matplotlib.figure import Figure
from matplotlib.legend import Legend
from matplotlib.lines import Line2D
from matplotlib.patches import Circle, PathPatch, Polygon, Rectangle
from matplotlib.text import Annotation, Text
from scenes import disc, scene

import scp_planner as sp
from scp_planner.plotting.drawn import map_extent
from scp_planner.plotting.ground import slow_cells
from scp_planner.plotting.maps import draw_map
from scp_planner.plotting.recording import Recording, record_plan
from scp_planner.plotting.scales import unit_of

WALL = [[4.0, 1.2], [8.0, 1.2], [8.0, 3.0], [4.0, 3.0]]


def _yard(**changes: Any) -> sp.Scenario:
    """A wall beside the way, two slow places, and a box around all; nothing moves."""
    ground = {
        "bounds": {"min": [-2.0, -3.0], "max": [22.0, 5.0]},
        "walls": [WALL],
        "speed_limits": [{"from": 5.0, "to": 9.0, "speed": 1.5}, {"from": 14.0, "to": 17.0, "speed": 2.0}],
        "guide": [[0.0, 0.0], [20.0, 0.0]],
    }
    return scene(**{**ground, **changes})


@pytest.fixture(scope="module")
def scenario() -> sp.Scenario:
    return _yard()


@pytest.fixture(scope="module")
def plan() -> sp.Plan:
    """A trip straight on: what is drawn round it need not be what it was planned for."""
    return sp.plan(scene())


def _map(recording: Recording) -> Any:
    axes = Figure().subplots()
    indices = np.array([0, len(recording.time) - 1])
    draw_map(axes, recording, indices, map_extent(recording, indices))
    return axes


@pytest.fixture(scope="module")
def axes(plan: sp.Plan, scenario: sp.Scenario) -> Any:
    return _map(record_plan(plan, scenario, 60))


def test_forbidden_ground_is_hatched_and_zones_are_not(axes: Any) -> None:
    hatched = [patch for patch in axes.patches if patch.get_hatch()]
    (wall,) = [patch for patch in hatched if isinstance(patch, Polygon)]
    assert np.allclose(wall.get_xy()[:-1], WALL)
    assert any(isinstance(patch, Rectangle) for patch in hatched)  # outside of the bounds
    assert not any(patch.get_hatch() for patch in axes.patches if isinstance(patch, Circle))


def test_legend_names_the_ground(axes: Any) -> None:
    texts = [text.get_text() for text in axes.figure.findobj(Text)]
    assert {"start", "goal", "forbidden", "slow", "guide"} <= set(texts)
    assert "zone" not in texts  # there is none


def test_slow_places_are_filled_and_say_how_slow(axes: Any) -> None:
    told = {text.get_text(): text.xy for text in axes.findobj(Annotation)}
    assert 5.0 < told["≤1.5 m/s"][0] < 9.0
    assert 14.0 < told["≤2 m/s"][0] < 17.0
    filled = [region for region in axes.collections if region.get_hatch() is not None or hasattr(region, "hatches")]
    spans = sorted(
        (float(path.vertices[:, 0].min()), float(path.vertices[:, 0].max()))
        for region in filled
        for path in region.get_paths()
        if len(path.vertices)
    )
    assert np.allclose(spans, [(5.0, 9.0), (14.0, 17.0)], atol=0.15)


def test_nobody_is_slow_where_nobody_may_be(plan: sp.Plan, scenario: sp.Scenario) -> None:
    recording = replace(
        record_plan(plan, scenario, 5), corridor=(np.array([[-1.0, -1.0], [21.0, -1.0], [21.0, 1.0], [-1.0, 1.0]]),)
    )
    limits = slow_cells(recording, np.array([7.0, 12.0, 15.0]), np.array([-2.0, 0.0, 0.9]))
    assert limits.tolist() == [[np.inf, np.inf, np.inf], [1.5, np.inf, 2.0], [1.5, np.inf, 2.0]]


def test_walls_and_corridor_have_a_clearance_each_and_no_body() -> None:
    corridor = [[[-1.0, -3.0], [21.0, -3.0], [21.0, 4.0], [-1.0, 4.0]]]
    scenario = _yard(corridor=corridor, speed_limits=[], guide=None)
    plan = sp.plan(scenario)
    recording = record_plan(plan, scenario, 30)
    assert recording.bodies == ()
    assert [obstacle.id for obstacle in recording.obstacles] == ["corridor", "walls"]
    x, y = recording.position.T
    beyond = np.stack([np.maximum.reduce([4.0 - x, x - 8.0, 0.0 * x]), np.maximum.reduce([1.2 - y, y - 3.0, 0.0 * y])])
    assert recording.obstacles[1].clearance == pytest.approx(np.hypot(*beyond) - 0.3, abs=1e-9)
    assert recording.walls[0].tolist() == WALL


def test_lanes_are_drawn_and_keep_nobody_out(plan: sp.Plan) -> None:
    across = [[10.0, -3.0], [10.0, 0.0], [11.0, 3.0]]
    scenario = _yard(walls=[], bounds=None, lanes=[across])
    assert sp.plan(scenario.model_copy(update={"speed_limits": ()})).travel_time == pytest.approx(plan.travel_time)
    recording = record_plan(plan, scenario, 30)
    assert recording.obstacles == ()
    axes = _map(recording)
    assert any(np.array_equal(line.get_xydata(), across) for line in axes.lines)
    assert "lanes" in [text.get_text() for legend in axes.figure.findobj(Legend) for text in legend.get_texts()]


def test_no_zone_that_is_drawn_is_cut_off(plan: sp.Plan) -> None:
    """One that hangs over the edge of what the trip alone would show."""
    scenario = _yard(bounds=None, obstacles=[disc("over", (10.0, -4.5), radius=1.5)])
    recording = record_plan(plan, scenario, 20)
    assert recording.extent()[0][1] > -6.0  # it would be cut off
    low, high = map_extent(recording, np.array([0, 19]))
    assert (low < [8.5, -6.0]).all() and (high > [11.5, -3.0]).all()
    axes = _map(recording)
    assert axes.get_ylim()[0] < -6.0


def test_a_zone_over_the_whole_map_hides_nothing(plan: sp.Plan) -> None:
    recording = record_plan(plan, _yard(obstacles=[disc("all", (80.0, 0.0), (-10.0, 0.0), radius=60.0)]), 20)
    zones = [patch for patch in _map(recording).patches if isinstance(patch, PathPatch)]
    assert zones and all(to_rgba(patch.get_facecolor())[3] == 0.0 for patch in zones)


@pytest.mark.parametrize(
    ("size", "name", "tick"), [(5000.0, "km", "1.5"), (300.0, "m", "1500"), (0.3, "mm", "1500000")]
)
def test_units_follow_what_is_shown(size: float, name: str, tick: str) -> None:
    unit = unit_of(size)
    assert (unit.name, unit.text(1500.0), unit.label("x")) == (name, tick, f"x ({name})")


def test_axes_of_a_long_trip_are_in_kilometres() -> None:
    scenario = scene(
        start={"speed": 20.0}, goal={"position": [5000.0, 0.0]}, vehicle={"max_speed": 30.0, "max_curvature": None}
    )
    axes = _map(record_plan(sp.plan(scenario), scenario, 20))
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("x (km)", "y (km)")
    labels = {label.get_text(): label.get_position()[0] for label in axes.get_xticklabels()}
    assert labels["4"] == 4000.0
    # A vehicle of 0.3 m has a mark that is seen.
    marks = [line for line in axes.lines if isinstance(line, Line2D) and line.get_markersize() == 6]
    assert len(marks) >= 2


def test_a_goal_that_is_a_polygon_is_drawn(plan: sp.Plan) -> None:
    region = [[18.0, -2.0], [23.0, -2.0], [23.0, 1.0], [18.0, 2.0]]
    recording = record_plan(plan, scene(goal={"region": region}), 60)
    drawn = [patch.get_xy() for patch in _map(recording).patches if isinstance(patch, Polygon) and not patch.get_fill()]
    assert any(len(corners) == 5 and np.allclose(corners[:-1], region) for corners in drawn)
