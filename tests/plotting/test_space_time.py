"""The view of space and time: which regions a plan meets."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from figure_parts import Case

import scp_planner as sp
from scp_planner.plotting import plot_run_space_time, plot_space_time


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
