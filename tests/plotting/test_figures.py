"""The figure of a plan: that it shows what is, legibly, and leaves no file half done."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from figure_parts import Case, assert_legible, case_of, map_of, panel_of
from matplotlib import rcParams
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import to_hex
from matplotlib.figure import Figure
from matplotlib.patches import Circle, PathPatch, Polygon, Rectangle
from scenes import scene

import scp_planner as sp
from scp_planner.plotting import View, animate_plan, plot_plan, plot_profiles, plot_run_space_time, plot_space_time
from scp_planner.plotting.borders import vehicle_rectangle
from scp_planner.plotting.maps import border_of
from scp_planner.plotting.recording import record_plan
from scp_planner.plotting.scales import unit_of_rate
from scp_planner.plotting.style import COLOURS, INK, label_lengths


def _is_hollow(patch: Any) -> bool:
    return patch.get_facecolor()[3] == 0.0


def test_map_shows_vehicle_and_zones_in_one_colour_an_obstacle(radar: Case) -> None:
    plan, scenario = radar
    times = plan.start_time + np.array([0.3, 0.6]) * plan.travel_time
    axes = map_of(plot_plan(plan, scenario, times=times))
    discs = [patch for patch in axes.patches if isinstance(patch, Circle)]
    assert [disc.center for disc in discs] == [pytest.approx(plan.position(t)) for t in times]
    assert {disc.radius for disc in discs} == {scenario.vehicle.radius}
    colours = [to_hex(disc.get_facecolor()).upper() for disc in discs]
    assert colours == [INK, INK]
    shapes = [patch for patch in axes.patches if isinstance(patch, Polygon | PathPatch)]
    filled = {to_hex(shape.get_facecolor()).upper() for shape in shapes if not _is_hollow(shape)}
    assert filled <= {*COLOURS[: len(scenario.obstacles)], INK}
    # Every zone that is near the vehicle at one of the times is there, in its obstacle's colour.
    for t in times:
        for zone, own in zip(sp.zones(scenario), COLOURS, strict=False):
            if zone.signed_distance(t, plan.position(t)) - scenario.vehicle.radius < 0.1 * 20.0:
                zones = [s for s in shapes if to_hex(s.get_edgecolor()).upper() == own]
                outlines = [np.asarray(s.get_path().vertices) for s in zones if isinstance(s, PathPatch)]
                fits = [np.abs(zone.signed_distance(np.full(len(o), t), o)).max() < 1e-6 for o in outlines]
                assert any(fits), (zone.id, t)


def test_what_stands_is_drawn_once(radar: Case) -> None:
    plan, scenario = radar
    axes = map_of(plot_plan(plan, scenario, times=np.linspace(plan.start_time, plan.arrival_time, 5)))
    zones = [patch for patch in axes.patches if isinstance(patch, PathPatch)]
    buoy = COLOURS[[obstacle.id for obstacle in scenario.obstacles].index("buoy")]
    assert sum(to_hex(zone.get_edgecolor()).upper() == buoy for zone in zones) == 1


@pytest.mark.parametrize("discs", [(0.0, 1.0, 2.0), (-1.6, -0.4, 0.0, 0.8)])
def test_a_row_of_discs_is_drawn_as_the_rectangle_that_it_covers(discs: tuple[float, ...]) -> None:
    shapely = pytest.importorskip("shapely")
    scenario = scene(vehicle={"radius": 0.8, "discs": discs}, goal={"position": [20.0, 0.0], "heading": 0.0})
    plan = sp.plan(scenario)
    axes = map_of(plot_plan(plan, scenario, times=[plan.start_time, plan.arrival_time]))
    bodies = [patch for patch in axes.patches if isinstance(patch, Polygon) and not _is_hollow(patch)]
    covered = shapely.union_all([shapely.Point(ahead, 0.0).buffer(0.8, quad_segs=64) for ahead in discs])
    for body, time in zip(bodies, (plan.start_time, plan.arrival_time), strict=True):
        found = shapely.Polygon(body.get_xy())
        (x, y), heading = plan.position(time).tolist(), float(plan.heading(time))
        there = shapely.affinity.translate(shapely.affinity.rotate(covered, heading, (0, 0), use_radians=True), x, y)
        assert there.buffer(1e-3).contains(found) and not there.buffer(-1e-2).contains(found)
        # Vehicles at start and goal are inside the picture.
        (low_x, low_y, high_x, high_y) = there.bounds
        assert axes.get_xlim()[0] < low_x and high_x < axes.get_xlim()[1]
        assert axes.get_ylim()[0] < low_y and high_y < axes.get_ylim()[1]


def test_discs_that_do_not_overlap_stay_discs() -> None:
    assert vehicle_rectangle((0.0, 3.0), 1.0) is None
    assert vehicle_rectangle((0.0,), 1.0) is None


def test_border_of_several_pieces_has_no_seams(pocket: Case) -> None:
    """The border is all on the outside of the obstacle grown by its margin, and as long."""
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


def test_corridor_is_light_and_the_rest_is_shaded() -> None:
    shapely = pytest.importorskip("shapely")
    polygons = [[[-1, -1], [9, -1], [9, 1], [-1, 1]], [[7, 0.5], [7, -1.5], [13, -1.5], [13, 6], [11, 6]]]
    scenario = scene(goal={"position": [12.0, 4.0]}, corridor=polygons)
    axes = map_of(plot_plan(sp.plan(scenario), scenario))
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


def test_map_has_equal_axes(figure: Figure) -> None:
    FigureCanvasAgg(figure).draw()  # type: ignore[no-untyped-call]
    axes = map_of(figure)
    origin, right, up = axes.transData.transform([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
    assert right[0] - origin[0] == pytest.approx(up[1] - origin[1], rel=1e-6)


def test_path_is_coloured_by_speed(radar: Case, figure: Figure) -> None:
    plan, scenario = radar
    axes = map_of(figure)
    (line,) = axes.collections
    middles = np.array([segment.mean(axis=0) for segment in line.get_segments()])
    near_start = line.get_array()[0]
    assert near_start == pytest.approx(plan.speed(plan.start_time), abs=0.1)
    assert line.get_array()[-1] == pytest.approx(plan.speed(plan.arrival_time), abs=0.1)
    assert np.abs(middles[0] - plan.position(plan.start_time)).max() < 0.1
    speeds = plan.speed(np.linspace(plan.start_time, plan.arrival_time, 1000))
    assert line.get_clim() == pytest.approx((speeds.min(), speeds.max()), abs=0.01 * scenario.vehicle.max_speed)


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
    axes = panel_of(figure, title)
    curves = [line for line in axes.lines if len(np.asarray(line.get_xdata())) > 100]
    (curve,) = curves
    assert np.allclose(curve.get_ydata(), values(plan, curve.get_xdata()), rtol=1e-12, atol=1e-12)
    flat = {
        float(line.get_ydata()[0]) for line in axes.lines if line.get_linestyle() == "-" and len(line.get_xdata()) == 2
    }
    assert flat == limits


def test_clearance_over_time(radar: Case, figure: Figure) -> None:
    plan, scenario = radar
    axes = panel_of(figure, "clearance")
    least = [line for line in axes.lines if len(np.asarray(line.get_xdata())) > 100][-1]
    time = np.asarray(least.get_xdata())
    distances = [zone.signed_distance(time, plan.position(time)) for zone in sp.zones(scenario)]
    assert np.allclose(least.get_ydata(), np.min(distances, axis=0) - scenario.vehicle.radius, atol=1e-12)


def test_limits_by_place_are_drawn() -> None:
    scenario = scene(speed_limits=[{"from": 5.0, "to": 9.0, "speed": 1.5}])
    figure = plot_plan(sp.plan(scenario), scenario)
    drawn = [set(np.asarray(line.get_ydata()).tolist()) for line in panel_of(figure, "speed (m/s)").lines]
    assert {1.5, 3.0} in drawn


@pytest.mark.parametrize(
    "name",
    ["tall", *(pytest.param(n, marks=pytest.mark.slow) for n in ("slow-past-a-school", "crossing", "alone", "late"))],
)
def test_no_text_overlaps_or_is_cut_off(name: str) -> None:
    """So it is in the views of "radar", below."""
    plan, scenario = case_of(name)
    assert_legible(plot_plan(plan, scenario))
    assert_legible(plot_space_time(plan, scenario))


def test_truth_is_drawn_where_there_is_a_record(radar: Case) -> None:
    plan, scenario = radar
    seen = np.array([plan.start_time, plan.start_time + 2.0])
    went = np.array([[9.0, -5.0], [9.0, -3.0]])
    axes = map_of(plot_plan(plan, scenario, truth={"ferry": (seen, went)}, times=[seen[0], plan.arrival_time]))
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


@pytest.mark.parametrize(
    ("suffix", "begins"),
    [
        (".png", b"\x89PNG"),
        *(pytest.param(*one, marks=pytest.mark.slow) for one in ((".pdf", b"%PDF"), (".svg", b"<?xml"))),
    ],
)
def test_saved_figure(radar: Case, tmp_path: Path, suffix: str, begins: bytes) -> None:
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


# Axes are in units of what they show


def test_rates_are_in_units_of_their_size() -> None:
    names = {most: unit_of_rate("m/s", most).name for most in (7.8e3, 30.0, 1.5, 0.05, 0.02)}
    assert names == {7.8e3: "km/s", 30.0: "m/s", 1.5: "m/s", 0.05: "m/s", 0.02: "mm/s"}
    assert unit_of_rate("m/s²", 0.01).name == "mm/s²"
    curvatures = {most: unit_of_rate("1/m", most).name for most in (1e-4, 0.5, 100.0, 0.0)}
    assert curvatures == {1e-4: "1/km", 0.5: "1/m", 100.0: "1/mm", 0.0: "1/m"}


def test_ticks_say_what_is_shown() -> None:
    for name, most, value, text in (
        ("m/s", 0.02, 0.005, "5"),
        ("m/s", 7.8e3, 2.5e3, "2.5"),
        ("1/m", 1e-4, 5e-5, "0.05"),
        ("1/m", 100.0, 50.0, "0.05"),
        ("m/s", 3.0, 1.5, "1.5"),
    ):
        unit = unit_of_rate(name, most)
        figure = Figure()
        axes = figure.subplots()
        axes.set_ylim(0.0, most)
        label_lengths(axes.yaxis, "speed", unit)
        axes.set_yticks([value])
        figure.draw_without_rendering()
        assert [label.get_text() for label in axes.get_yticklabels()] == [text]
        assert axes.get_ylabel() == f"speed ({unit.name})"


def test_the_sketch_of_a_small_robots_plan_is_in_millimetres_each_second() -> None:
    plan = sp.plan(
        scene(
            vehicle={
                "radius": 1e-3,
                "max_speed": 0.01,
                "max_acceleration": 0.005,
                "max_deceleration": 0.005,
                "max_lateral_acceleration": 0.005,
                "max_curvature": 300.0,
            },
            start={"speed": 0.0},
            goal={"position": [0.1, 0.0]},
        )
    )
    labels = {axes.get_ylabel() for axes in plan.sketch().axes}
    assert {"y (mm)", "speed (mm/s)"} <= labels


# Views of plans and of closed loops


@pytest.mark.parametrize("view", View)
def test_views_of_a_plan(radar: Case, view: View) -> None:
    plan, scenario = radar
    assert_legible(plan.plot(scenario, view=view))


@pytest.mark.parametrize("view", View)
def test_views_of_a_run(drive: sp.Run, view: View) -> None:
    assert_legible(drive.plot(view=view))


def test_unknown_view_is_refused(radar: Case, drive: sp.Run) -> None:
    draws: list[Callable[[], Figure]] = [
        lambda: radar[0].plot(radar[1], view="globe"),
        lambda: drive.plot(view="globe"),
    ]
    for draw in draws:
        with pytest.raises(ValueError, match="view = 'globe': must be one of map, space-time, profiles"):
            draw()


def test_profiles_of_a_plan_are_those_of_the_map(radar: Case, figure: Figure) -> None:
    alone = radar[0].plot(radar[1], view="profiles")
    for title in ("speed (m/s)", "acceleration (m/s²)", "lateral", "curvature", "clearance"):
        drawn = [panel_of(each, title).lines[0].get_ydata() for each in (figure, alone)]
        assert np.ptp(drawn[1]) == pytest.approx(np.ptp(drawn[0]), rel=0.02)
        assert panel_of(alone, title).get_xlim() == panel_of(figure, title).get_xlim()


def test_map_of_a_run_shows_what_was_driven_and_planned(drive: sp.Run) -> None:
    axes = map_of(drive.plot())
    discs = [patch for patch in axes.patches if isinstance(patch, Circle) and patch.radius == 0.3]
    assert len(discs) >= 3
    for disc_of_vehicle in discs:
        assert np.linalg.norm(drive.position - disc_of_vehicle.center, axis=1).min() < 0.05
    (driven,) = axes.collections
    assert np.abs(driven.get_segments()[-1][-1] - drive.position[-1]).max() < 1e-9
    planned = [line for line in axes.lines if line.get_linestyle() == "--" and line.get_linewidth() == 1.0]
    assert len(planned) == len(discs)


# The view of space and time: which regions a plan meets


def _regions(axes: Any) -> list[Any]:
    return [path for collection in axes.collections for path in collection.get_paths() if len(path.vertices)]


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


def test_regions_have_the_colours_of_the_map(radar: Case) -> None:
    plan, scenario = radar
    figure = plot_space_time(plan, scenario)
    named = {text.get_text(): patch for text, patch in zip(*_key(figure), strict=True)}
    for number, obstacle in enumerate(scenario.obstacles):
        if obstacle.id in named:
            assert to_hex(named[obstacle.id].get_edgecolor()).upper() == COLOURS[number]


def _key(figure: Any) -> tuple[list[Any], list[Any]]:
    return figure.legends[0].get_texts(), figure.legends[0].legend_handles


def test_slow_stretches_are_bands_along_the_path() -> None:
    limits = [{"from": 5.0, "to": 9.0, "speed": 1.5}, {"from": 12.0, "speed": 2.0}]
    scenario = scene(speed_limits=limits)
    plan = sp.plan(scenario)
    above = plot_space_time(plan, scenario).axes[0]
    bands = sorted(
        (patch.get_y(), patch.get_y() + patch.get_height()) for patch in above.patches if isinstance(patch, Rectangle)
    )
    assert np.ravel(bands) == pytest.approx([5.0, 9.0, 12.0, 20.0], abs=0.1)
    assert [text.get_text() for text in above.texts] == [
        "\N{LESS-THAN OR EQUAL TO}1.5 m/s",
        "\N{LESS-THAN OR EQUAL TO}2 m/s",
    ]


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
