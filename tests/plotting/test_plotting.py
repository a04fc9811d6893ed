"""Figures and animations: that they show what is, legibly, and leave nothing half done."""

from __future__ import annotations

import math
import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib import rcParams
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import to_hex
from matplotlib.figure import Figure
from matplotlib.image import imread
from matplotlib.patches import Circle, PathPatch, Polygon
from matplotlib.text import Annotation, Text
from PIL import Image
from scenes import disc, scene

import scp_planner as sp
from scp_planner import builtin
from scp_planner.plotting import (
    View,
    animate,
    animate_plan,
    plot_plan,
    plot_profiles,
    plot_run_space_time,
    plot_space_time,
)
from scp_planner.plotting.animation import Film
from scp_planner.plotting.maps import border_of
from scp_planner.plotting.recording import record_plan
from scp_planner.plotting.style import COLOURS, GREY, style

Case = tuple[sp.Plan, sp.Scenario]


def _tall() -> sp.Scenario:
    """Upwards, far from the origin, on a Unix clock, with shapes that are no discs."""
    return sp.Scenario.model_validate(
        {
            "name": "tall",
            "vehicle": {"radius": 0.3, "max_speed": 3.0, "max_acceleration": 1.5, "max_deceleration": 2.0},
            "start": {"time": 1.6e9, "position": [691000.0, 5335000.0], "speed": 0.5},
            "goal": {"position": [691002.0, 5335020.0], "radius": 0.5},
            "obstacles": [
                {"id": "car", "shape": {"rectangle": [4.5, 1.8]}, "motion": {"position": [691006.0, 5335008.0]}},
                {
                    "id": "block",
                    "shape": {"polygon": [[-1, -1], [1, -1], [0, 1.6]]},
                    "motion": {"position": [690997.0, 5335014.0]},
                },
            ],
        }
    )


def _case(name: str) -> Case:
    if name == "tall":
        scenario = _tall()
    elif name == "alone":
        scenario = builtin.load("crossing").model_copy(update={"obstacles": ()})
    elif name == "late":
        scenario = builtin.load("headon")
        scenario = scenario.model_copy(update={"goal": scenario.goal.model_copy(update={"latest_arrival": 0.5})})
    elif name in builtin.names():
        scenario = builtin.load(name)
    else:
        scenario = sp.Scenario.load(Path(__file__).parents[1] / "suite" / f"{name}.yaml")
    return sp.plan(scenario, sp.Settings(max_runs=1)), scenario  # any trip will do for a picture


@pytest.fixture(scope="module")
def radar() -> Case:
    return _case("radar")


@pytest.fixture(scope="module")
def figure(radar: Case) -> Figure:
    return plot_plan(*radar)


def _map_of(figure: Figure) -> Any:
    return next(axes for axes in figure.axes if axes.get_xlabel() == "x (m)")


def _panel(figure: Figure, title: str) -> Any:
    return next(axes for axes in figure.axes if axes.get_title("left").startswith(title))


def frames_of(film: Any) -> int:
    """Number of pictures of a film, which only some kinds of files have."""
    return int(film.n_frames)


def _is_hollow(patch: Any) -> bool:
    return patch.get_facecolor()[3] == 0.0


# The figure of a plan


@pytest.mark.usefixtures("unsettled")
def test_map_shows_vehicle_and_zones_in_one_colour_a_time(radar: Case) -> None:
    plan, scenario = radar
    times = plan.start_time + np.array([0.3, 0.6]) * plan.travel_time
    axes = _map_of(plot_plan(plan, scenario, times=times))
    discs = [patch for patch in axes.patches if isinstance(patch, Circle)]
    assert [disc.center for disc in discs] == [pytest.approx(plan.position(t)) for t in times]
    assert {disc.radius for disc in discs} == {scenario.vehicle.radius}
    colours = [to_hex(disc.get_facecolor()).upper() for disc in discs]
    assert colours == list(COLOURS[:2])
    shapes = [patch for patch in axes.patches if isinstance(patch, Polygon | PathPatch)]
    filled = {to_hex(shape.get_facecolor()).upper() for shape in shapes if not _is_hollow(shape)}
    assert filled <= {*COLOURS[:2], GREY}
    # Every zone that is near the vehicle at one of the times is there, in that time's colour; in grey if it stands.
    for t, colour in zip(times, COLOURS, strict=False):
        for zone in sp.zones(scenario):
            if zone.signed_distance(t, plan.position(t)) - scenario.vehicle.radius < 0.1 * 20.0:
                own = GREY if zone.id == "buoy" else colour
                zones = [s for s in shapes if to_hex(s.get_edgecolor()).upper() == own]
                outlines = [np.asarray(s.get_path().vertices) for s in zones if isinstance(s, PathPatch)]
                fits = [np.abs(zone.signed_distance(np.full(len(o), t), o)).max() < 1e-6 for o in outlines]
                assert any(fits), (zone.id, t)


@pytest.mark.usefixtures("unsettled")
def test_what_stands_is_drawn_once(radar: Case) -> None:
    plan, scenario = radar
    for count in (1, 5):
        axes = _map_of(plot_plan(plan, scenario, times=np.linspace(plan.start_time, plan.arrival_time, count)))
        zones = [patch for patch in axes.patches if isinstance(patch, PathPatch)]
        assert sum(to_hex(zone.get_edgecolor()).upper() == GREY for zone in zones) == 1


def _pocket() -> sp.Scenario:
    """A room that is open to the left, of three convex pieces."""
    walls = [[-2, -2], [2, -2], [2, 2], [-2, 2], [-2, 1.6], [1.6, 1.6], [1.6, -1.6], [-2, -1.6]]
    return scene({"id": "pocket", "shape": {"polygon": walls}, "motion": {"position": [9.0, 1.0]}, "margin": 0.2})


@pytest.fixture(scope="module")
def pocket() -> Case:
    return sp.plan(_pocket()), _pocket()


def test_border_of_several_pieces_has_no_seams(pocket: Case) -> None:
    """It is all on the outside of the obstacle grown by its margin, and as long as that is."""
    shapely = pytest.importorskip("shapely")
    plan, scenario = pocket
    (obstacle,) = record_plan(plan, scenario, 3).obstacles
    assert len(obstacle.boundary[0]) > 2
    border = border_of(obstacle, 0)
    bits = np.asarray(border.vertices).reshape(-1, 2, 2)
    shape = scenario.obstacles[0].shape
    assert isinstance(shape, sp.PolygonShape)
    room = shapely.affinity.translate(shapely.Polygon(shape.polygon), 9.0, 1.0)
    # Corners are rounded, and drawn from a few points: 60 on each piece.
    outside = room.buffer(0.2, quad_segs=64).exterior
    off = [outside.distance(shapely.Point(point)) for point in bits.mean(axis=1)]
    assert max(off) < 0.02
    # Where pieces grown by the margin overlap, a little of it is drawn twice.
    assert outside.length < np.linalg.norm(bits[:, 1] - bits[:, 0], axis=1).sum() < 1.05 * outside.length


@pytest.mark.usefixtures("unsettled")
def test_corridor_is_light_and_the_rest_is_shaded() -> None:
    shapely = pytest.importorskip("shapely")
    polygons = [[[-1, -1], [9, -1], [9, 1], [-1, 1]], [[7, 0.5], [7, -1.5], [13, -1.5], [13, 6], [11, 6]]]
    scenario = scene(goal={"position": [12.0, 4.0]}, corridor=polygons)
    axes = _map_of(plot_plan(sp.plan(scenario), scenario))
    white = [
        patch for patch in axes.patches if isinstance(patch, Polygon) and to_hex(patch.get_facecolor()) == "#ffffff"
    ]
    assert len(white) == 2
    (border,) = [patch for patch in axes.patches if isinstance(patch, PathPatch)]
    bits = np.asarray(border.get_path().vertices).reshape(-1, 2, 2)
    outside = shapely.union_all([shapely.Polygon(polygon) for polygon in polygons]).exterior
    assert max(outside.distance(shapely.Point(point)) for point in bits.mean(axis=1)) < 1e-9
    # A bit at each crossing of two borders ends beyond it.
    assert np.linalg.norm(bits[:, 1] - bits[:, 0], axis=1).sum() == pytest.approx(outside.length, rel=0.03)


@pytest.mark.usefixtures("unsettled")
def test_animation_of_several_pieces(pocket: Case, tmp_path: Path) -> None:
    animate_plan(*pocket, tmp_path / "pocket.gif", frames_per_second=1.0)
    with Image.open(tmp_path / "pocket.gif") as film:
        assert frames_of(film) == math.ceil(pocket[0].travel_time) + 1


@pytest.mark.usefixtures("unsettled")
def test_names_do_not_lie_on_each_other() -> None:
    twins = [disc(name, (10.0, 0.9)) for name in ("one", "other")]
    scenario = scene(*twins, disc("third", (15.0, -0.9)))
    names = [a.get_text() for a in _map_of(plot_plan(sp.plan(scenario), scenario)).findobj(Annotation)]
    assert names == ["one", "third"]


def test_map_has_equal_axes(figure: Figure) -> None:
    FigureCanvasAgg(figure).draw()  # type: ignore[no-untyped-call]
    axes = _map_of(figure)
    origin, right, up = axes.transData.transform([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
    assert right[0] - origin[0] == pytest.approx(up[1] - origin[1], rel=1e-6)


def test_path_is_coloured_by_speed(radar: Case, figure: Figure) -> None:
    plan, scenario = radar
    axes = _map_of(figure)
    (line,) = axes.collections
    middles = np.array([segment.mean(axis=0) for segment in line.get_segments()])
    near_start = line.get_array()[0]
    assert near_start == pytest.approx(plan.speed(plan.start_time), abs=0.1)
    assert line.get_array()[-1] == pytest.approx(plan.speed(plan.arrival_time), abs=0.1)
    assert np.abs(middles[0] - plan.position(plan.start_time)).max() < 0.1
    assert line.get_clim() == (0.0, scenario.vehicle.max_speed)


@pytest.mark.parametrize(
    ("title", "values", "limits"),
    [
        ("speed (m/s)", lambda p, t: p.speed(t), {0.0, 3.0}),
        ("acceleration (m/s²)", lambda p, t: p.acceleration(t), {-2.0, 1.5}),
        ("lateral acceleration (m/s²)", lambda p, t: p.speed(t) ** 2 * p.curvature(t), {-2.0, 2.0}),
        ("curvature (1/m)", lambda p, t: p.curvature(t), {-1.0, 1.0}),
    ],
)
def test_profiles_stand_against_their_limits(
    radar: Case, figure: Figure, title: str, values: Any, limits: set[float]
) -> None:
    plan, _ = radar
    axes = _panel(figure, title)
    curves = [line for line in axes.lines if len(np.asarray(line.get_xdata())) > 100]
    (curve,) = curves
    assert np.allclose(curve.get_ydata(), values(plan, curve.get_xdata()), rtol=1e-12, atol=1e-12)
    flat = {
        float(line.get_ydata()[0]) for line in axes.lines if line.get_linestyle() == "-" and len(line.get_xdata()) == 2
    }
    assert flat == limits


def test_clearance_over_time(radar: Case, figure: Figure) -> None:
    plan, scenario = radar
    axes = _panel(figure, "clearance")
    least = [line for line in axes.lines if len(np.asarray(line.get_xdata())) > 100][-1]
    time = np.asarray(least.get_xdata())
    distances = [zone.signed_distance(time, plan.position(time)) for zone in sp.zones(scenario)]
    assert np.allclose(least.get_ydata(), np.min(distances, axis=0) - scenario.vehicle.radius, atol=1e-12)


@pytest.mark.usefixtures("unsettled")
def test_limits_by_place_are_drawn() -> None:
    scenario = scene(speed_limits=[{"from": 5.0, "to": 9.0, "speed": 1.5}])
    figure = plot_plan(sp.plan(scenario), scenario)
    drawn = [set(np.asarray(line.get_ydata()).tolist()) for line in _panel(figure, "speed (m/s)").lines]
    assert {1.5, 3.0} in drawn


@pytest.mark.usefixtures("unsettled")
def test_limits_that_are_none_are_not_drawn() -> None:
    figure = plot_plan(*_case("tall"))
    for title in ("lateral acceleration", "curvature"):
        flat = [line for line in _panel(figure, title).lines if len(line.get_xdata()) == 2]
        assert flat == []


def _texts(figure: Figure) -> list[Text]:
    """All that can be read, but for the obstacles' names, which stand where the obstacles are."""
    return [
        text
        for text in figure.findobj(Text)
        if text.get_visible() and text.get_text().strip() and not isinstance(text, Annotation)
    ]


def _assert_legible(figure: Figure) -> None:
    canvas = FigureCanvasAgg(figure)
    canvas.draw()  # type: ignore[no-untyped-call]
    renderer = canvas.get_renderer()  # type: ignore[no-untyped-call]
    frame = figure.bbox
    # Labels of ticks beyond the axes' ends exist, but are not drawn.
    drawn = {
        id(label)
        for axes in figure.axes
        if axes.axison
        for axis in (axes.xaxis, axes.yaxis)
        for tick in axis._update_ticks()  # type: ignore[union-attr]
        for label in (tick.label1, tick.label2)
    }
    ticks = {id(label) for axes in figure.axes for axis in (axes.xaxis, axes.yaxis) for label in axis.get_ticklabels()}
    boxes = [
        (text.get_text(), text.get_window_extent(renderer))
        for text in _texts(figure)
        if id(text) not in ticks or id(text) in drawn
    ]
    assert len(boxes) > 10
    for text, box in boxes:
        assert box.x0 >= -1 and box.y0 >= -1 and box.x1 <= frame.x1 + 1 and box.y1 <= frame.y1 + 1, text
        assert box.height >= 9.0, text
    for (one, first), (other, second) in combinations(boxes, 2):
        apart = first.x1 <= second.x0 or second.x1 <= first.x0 or first.y1 <= second.y0 or second.y1 <= first.y0
        assert apart, (one, other)


@pytest.mark.parametrize(
    "name",
    ["tall", *(pytest.param(n, marks=pytest.mark.slow) for n in ("slow-past-a-school", "crossing", "alone", "late"))],
)
def test_no_text_overlaps_or_is_cut_off(name: str) -> None:
    """So it is in the views of "radar", below."""
    plan, scenario = _case(name)
    _assert_legible(plot_plan(plan, scenario))
    _assert_legible(plot_space_time(plan, scenario))


@pytest.mark.usefixtures("unsettled")
def test_truth_is_drawn_where_there_is_a_record(radar: Case) -> None:
    plan, scenario = radar
    seen = np.array([plan.start_time, plan.start_time + 2.0])
    went = np.array([[9.0, -5.0], [9.0, -3.0]])
    axes = _map_of(plot_plan(plan, scenario, truth={"ferry": (seen, went)}, times=[seen[0], plan.arrival_time]))
    dotted = [line for line in axes.lines if line.get_linestyle() not in ("-", "None")]
    (line,) = dotted
    points = np.stack(line.get_data(), axis=-1)
    known = ~np.isnan(points).any(axis=1)
    assert np.allclose(points[known][0], went[0]) and np.allclose(points[known][-1], went[1], atol=0.05)
    shapes = [patch.get_xy() for patch in axes.patches if isinstance(patch, Polygon) and _is_hollow(patch)]
    true_discs = [xy for xy in shapes if np.allclose(np.linalg.norm(xy - went[0], axis=1), 0.8)]
    assert len(true_discs) == 1  # at the start; at the arrival nobody knows


@pytest.mark.parametrize("times", [[], [0.0] * 8, [[0.0, 1.0]]])
def test_wrong_times_are_refused(radar: Case, times: Any) -> None:
    with pytest.raises(ValueError, match="times: must be 1 to 7 times"):
        plot_plan(*radar, times=times)


# Space and time


def _regions(axes: Any) -> list[Any]:
    return [path for collection in axes.collections for path in collection.get_paths() if len(path.vertices)]


@pytest.mark.usefixtures("unsettled")
def test_a_clear_plan_meets_no_region(radar: Case) -> None:
    plan, scenario = radar
    for axes in plot_space_time(plan, scenario).axes[:2]:
        (curve,) = [line for line in axes.lines if len(np.asarray(line.get_xdata())) > 100]
        points = np.stack(curve.get_data(), axis=-1)
        regions = _regions(axes)
        assert regions
        # Regions are drawn from a grid: where the vehicle all but touches a zone, nobody can see which it is.
        time = np.asarray(curve.get_xdata())
        distances = [zone.signed_distance(time, plan.position(time)) for zone in sp.zones(scenario)]
        clear = np.min(distances, axis=0) - scenario.vehicle.radius > 0.02
        assert clear.mean() > 0.5
        assert not any(region.contains_points(points[clear]).any() for region in regions)


@pytest.mark.usefixtures("unsettled")
@pytest.mark.parametrize("offsets", [(0.0,), (-0.6, 0.0, 0.8)])
def test_a_plan_through_an_obstacle_meets_its_region(radar: Case, offsets: tuple[float, ...]) -> None:
    plan, scenario = radar
    vehicle = scenario.vehicle.model_copy(update={"discs": offsets})
    scenario = scenario.model_copy(update={"vehicle": vehicle})
    middle = plan.start_time + 0.5 * plan.travel_time
    motion = sp.Motion(position=tuple(plan.position(middle).tolist()))
    wall = sp.Obstacle(id="wall", shape=sp.Disc(disc=1.0), motion=motion)
    blocked = scenario.model_copy(update={"obstacles": (wall,)})
    for axes in plot_space_time(plan, blocked).axes[:2]:
        (curve,) = [line for line in axes.lines if len(np.asarray(line.get_xdata())) > 100]
        points = np.stack(curve.get_data(), axis=-1)
        inside = np.any([region.contains_points(points) for region in _regions(axes)], axis=0)
        time = np.asarray(curve.get_xdata())
        heading = plan.heading(time)
        ahead = np.stack([np.cos(heading), np.sin(heading)], axis=-1)
        discs = [plan.position(time) + offset * ahead for offset in offsets]
        distance = np.min([sp.zones(blocked)[0].signed_distance(time, disc) for disc in discs], axis=0)
        distance = distance - scenario.vehicle.radius
        agree = inside == (distance < 0.0)
        assert inside.any() and agree[np.abs(distance) > 0.05].all()


@pytest.mark.usefixtures("unsettled")
def test_space_time_axes(radar: Case) -> None:
    plan, scenario = radar
    above, below = plot_space_time(plan, scenario).axes[:2]
    curve = max(above.lines, key=lambda line: len(np.asarray(line.get_xdata())))
    points = plan.position(np.linspace(plan.start_time, plan.arrival_time, 20_000))
    length = np.linalg.norm(np.diff(points, axis=0), axis=1).sum()
    assert np.asarray(curve.get_ydata())[-1] == pytest.approx(length, rel=1e-5)
    offset = max(below.lines, key=lambda line: len(np.asarray(line.get_xdata())))
    times = np.asarray(offset.get_xdata())
    assert np.allclose(offset.get_ydata(), plan.position(times)[:, 1], atol=1e-9)  # the guide is y = 0


# Views of plans and of closed loops


@pytest.fixture(scope="module")
def drive() -> sp.Run:
    """A vehicle that waits for a convoy to pass."""
    convoy = [disc(f"truck-{k}", (8.0, -2.0 - 3.0 * k), (0.0, 1.0), radius=1.2) for k in range(2)]
    bounds = {"min": [-1.0, -0.6], "max": [17.0, 0.6]}
    return sp.simulate(scene(*convoy, goal={"position": [16.0, 0.0]}, bounds=bounds), noise=0.01, rate=4.0)


@pytest.mark.parametrize("view", View)
def test_views_of_a_plan(radar: Case, view: View) -> None:
    plan, scenario = radar
    _assert_legible(plan.plot(scenario, view=view))


@pytest.mark.usefixtures("unsettled")
def test_plans_and_runs_are_drawn_as_they_are_plotted(radar: Case, drive: sp.Run, tmp_path: Path) -> None:
    plan, scenario = radar
    view = View.PROFILES
    plan.plot(scenario, tmp_path / "plotted.svg", view)
    plan.draw(scenario, tmp_path / "drawn.svg", str(view))
    assert (tmp_path / "plotted.svg").read_bytes() == (tmp_path / "drawn.svg").read_bytes()
    drive.plot(tmp_path / "plotted.svg", view)
    drive.draw(tmp_path / "drawn.svg", str(view))
    assert (tmp_path / "plotted.svg").read_bytes() == (tmp_path / "drawn.svg").read_bytes()


@pytest.mark.parametrize("view", View)
def test_views_of_a_run(drive: sp.Run, view: View) -> None:
    _assert_legible(drive.plot(view=view))


def test_unknown_view_is_refused(radar: Case, drive: sp.Run) -> None:
    draws: list[Callable[[], Figure]] = [
        lambda: radar[0].plot(radar[1], view="globe"),
        lambda: drive.plot(view="globe"),
    ]
    for draw in draws:
        with pytest.raises(ValueError, match="view = 'globe': must be one of map, space-time, profiles"):
            draw()


@pytest.mark.usefixtures("unsettled")
def test_profiles_of_a_plan_are_those_of_the_map(radar: Case, figure: Figure) -> None:
    alone = radar[0].plot(radar[1], view="profiles")
    for title in ("speed (m/s)", "acceleration (m/s²)", "lateral", "curvature", "clearance"):
        drawn = [_panel(each, title).lines[0].get_ydata() for each in (figure, alone)]
        assert np.ptp(drawn[1]) == pytest.approx(np.ptp(drawn[0]), rel=0.02)
        assert _panel(alone, title).get_xlim() == _panel(figure, title).get_xlim()


@pytest.mark.usefixtures("unsettled")
def test_map_of_a_run_shows_what_was_driven_and_planned(drive: sp.Run) -> None:
    axes = _map_of(drive.plot())
    discs = [patch for patch in axes.patches if isinstance(patch, Circle) and patch.radius == 0.3]
    assert len(discs) >= 3
    for disc_of_vehicle in discs:
        assert np.linalg.norm(drive.position - disc_of_vehicle.center, axis=1).min() < 0.05
    (driven,) = axes.collections
    assert np.abs(driven.get_segments()[-1][-1] - drive.position[-1]).max() < 1e-9
    planned = [line for line in axes.lines if line.get_linestyle() == "--" and line.get_linewidth() == 1.0]
    assert len(planned) == len(discs)


@pytest.mark.usefixtures("unsettled")
def test_space_time_of_a_run_tells_why_it_waited(drive: sp.Run) -> None:
    (axes,) = plot_run_space_time(drive).axes
    curve = max(axes.lines, key=lambda line: line.get_linewidth())
    time, station = (np.asarray(part) for part in curve.get_data())
    assert station[-1] == pytest.approx(np.linalg.norm(np.diff(drive.position, axis=0), axis=1).sum())
    # Before it has passed the trucks' way, and while one of them is in it, that lies ahead of it.
    trucks = np.stack([center[:, 1] for center in drive.obstacles.values()])
    waiting = (drive.position[:, 0] < 5.0) & (np.abs(trucks).min(axis=0) < 1.0)
    assert waiting.mean() > 0.2 and drive.speed[waiting].min() < 1.5
    regions = _regions(axes)
    ahead = [
        any(region.contains_point((t, s)) for region in regions for s in np.arange(at, station[-1], 0.2))
        for t, at in zip(time[waiting], station[waiting], strict=True)
    ]
    assert all(ahead)
    # And it meets nothing.
    recording = drive.recording()
    points = np.stack([recording.time, np.interp(recording.time, time, station)], axis=-1)
    met = np.any([region.contains_points(points) for region in regions], axis=0)
    clear = np.abs(recording.clearance) > 0.05
    assert clear.mean() > 0.5 and np.array_equal(met[clear], recording.clearance[clear] < 0.0)


# Files


@pytest.mark.parametrize(
    ("suffix", "begins"),
    [(".png", b"\x89PNG"), (".pdf", b"%PDF"), pytest.param(".svg", b"<?xml", marks=pytest.mark.slow)],
)
def test_saved_figure(radar: Case, tmp_path: Path, suffix: str, begins: bytes, request: pytest.FixtureRequest) -> None:
    if suffix == ".pdf":
        request.getfixturevalue("unsettled")
    files = [tmp_path / f"{n}{suffix}" for n in (1, 2)]
    for file in files:
        plot_profiles(*radar, file)
    first, second = (file.read_bytes() for file in files)
    assert first.startswith(begins)
    assert first == second
    assert sorted(tmp_path.iterdir()) == files


@pytest.mark.parametrize("draw", [plot_plan, plot_space_time, animate_plan])
def test_wrong_suffix_is_refused_before_anything_is_written(radar: Case, tmp_path: Path, draw: Any) -> None:
    with pytest.raises(ValueError, match=r"plan\.docx: must end in one of"):
        draw(*radar, tmp_path / "plan.docx")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.usefixtures("unsettled")
def test_failure_leaves_the_old_file(radar: Case, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    target = tmp_path / "plan.png"
    target.write_bytes(b"old")

    def fail(self: Figure, file: Path, **_: Any) -> None:
        Path(file).write_bytes(b"half")
        raise OSError("disk full")

    monkeypatch.setattr(Figure, "savefig", fail)
    with pytest.raises(OSError, match="disk full"):
        plot_plan(*radar, target)
    assert target.read_bytes() == b"old"
    assert list(tmp_path.iterdir()) == [target]


@pytest.mark.usefixtures("unsettled")
def test_users_settings_neither_matter_nor_change(radar: Case, tmp_path: Path) -> None:
    plot_profiles(*radar, tmp_path / "before.png")
    before = dict(rcParams)
    rcParams["font.size"] = 30.0
    rcParams["lines.linestyle"] = "--"
    try:
        plot_profiles(*radar, tmp_path / "after.png")
        assert rcParams["font.size"] == 30.0
    finally:
        rcParams.update({key: before[key] for key in ("font.size", "lines.linestyle")})
    assert dict(rcParams) == before
    assert (tmp_path / "before.png").read_bytes() == (tmp_path / "after.png").read_bytes()


def test_pyplot_stays_out_and_matplotlib_waits() -> None:
    script = """
import sys
import scp_planner.plotting, scp_planner.plotting.viewer
assert "matplotlib" not in sys.modules
import scp_planner as sp
from scp_planner import builtin
scenario = builtin.load("headon")
scp_planner.plotting.plot_profiles(sp.plan(scenario, sp.Settings(max_runs=1)), scenario)
assert "matplotlib" in sys.modules and "matplotlib.pyplot" not in sys.modules
"""
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    done = subprocess.run([sys.executable, "-c", script], env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


# Animations


@pytest.mark.usefixtures("unsettled")
def test_gif_plays_in_real_time(radar: Case, tmp_path: Path) -> None:
    plan, scenario = radar
    path = tmp_path / "plan.gif"
    animate_plan(plan, scenario, path, frames_per_second=4.0)
    with Image.open(path) as film:
        frames = math.ceil(4.0 * plan.travel_time) + 1
        assert frames_of(film) == frames
        durations = []
        for index in range(frames):
            film.seek(index)
            durations.append(film.info["duration"])
    # Each frame is shown until the next; the last for a second more.
    assert sum(durations[:-1]) == pytest.approx(1000.0 * plan.travel_time, abs=10.0)
    assert durations[-1] > 1000
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.usefixtures("unsettled")
def test_frames_of_a_gif_are_those_of_the_film(radar: Case, tmp_path: Path) -> None:
    recording = record_plan(*radar, 6)
    animate(recording, tmp_path / "plan.gif")
    with style():
        film = Film(recording)
        drawn = [film.frame(index).astype(float) for index in range(6)]
    with Image.open(tmp_path / "plan.gif") as played:
        for index, frame in enumerate(drawn):
            played.seek(index)
            shown = np.asarray(played.convert("RGB")).astype(float)
            # The colours are those of a palette, so nearly the same everywhere.
            off = np.abs(shown - frame).max(axis=2)
            assert off.mean() < 1.0 and (off > 60.0).mean() < 1e-3
        assert np.abs(drawn[0] - drawn[5]).max() > 100.0


@pytest.mark.usefixtures("unsettled")
def test_frames_do_not_depend_on_those_before(radar: Case) -> None:
    recording = record_plan(*radar, 5)
    with style():
        forwards, alone = Film(recording), Film(recording)
        for index in range(3):
            frame = forwards.frame(index)
        assert np.array_equal(frame, alone.frame(2))


@pytest.mark.usefixtures("unsettled")
def test_vehicle_moves_through_the_film(radar: Case) -> None:
    plan, scenario = radar
    recording = record_plan(plan, scenario, 4)
    with style():
        film = Film(recording)
        for index, position in enumerate(recording.position):
            frame = film.frame(index)
            axes = film._vehicle[0].axes
            assert axes is not None
            place = axes.transData.transform(position)
            column, row = round(place[0]), frame.shape[0] - 1 - round(place[1])
            if index not in (0, 3):  # start and goal have their own marks
                assert frame[row, column].max() < 60  # the vehicle's ink


@pytest.mark.usefixtures("unsettled")
def test_film_of_a_closed_loop_shows_the_plan_of_each_cycle(radar: Case) -> None:
    """One path a cycle, as a closed loop has."""
    recording = record_plan(*radar, 4)
    straight = recording.paths[0] * [1.0, 0.0]
    loop = replace(recording, paths=(recording.paths[0], straight), path_index=np.array([0, 1, 1, 0]))
    with style():
        film, alone = Film(loop), Film(recording)
        same = [bool(np.array_equal(film.frame(i), alone.frame(i))) for i in range(4)]
    assert same == [True, False, False, True]


@pytest.mark.usefixtures("unsettled")
def test_film_without_obstacles(tmp_path: Path) -> None:
    plan, scenario = _case("alone")
    animate_plan(plan, scenario, tmp_path / "alone.gif", frames_per_second=1.0)
    with Image.open(tmp_path / "alone.gif") as film:
        assert frames_of(film) == math.ceil(plan.travel_time) + 1


def test_video_without_ffmpeg_is_refused(radar: Case, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(shutil, "which", lambda name: None)
    with pytest.raises(ValueError, match=r"\.mp4 needs ffmpeg, which is not installed"):
        animate_plan(*radar, tmp_path / "plan.mp4")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.skipif(shutil.which("ffmpeg") is None, reason="needs ffmpeg, which is not installed")
def test_video(radar: Case, tmp_path: Path) -> None:
    plan, scenario = radar
    path = tmp_path / "plan.mp4"
    animate_plan(plan, scenario, path, frames_per_second=5.0)
    ffmpeg = str(shutil.which("ffmpeg"))
    still = tmp_path / "still.png"
    command = [ffmpeg, "-loglevel", "error", "-ss", "1", "-i", str(path), "-frames:v", "1", str(still)]
    subprocess.run(command, check=True)
    height, width = imread(still).shape[:2]
    assert height % 2 == 0 and width == 720
    assert path.read_bytes()[4:8] == b"ftyp"
