"""The way over time: which part of it is taken when."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from os import PathLike
from typing import TYPE_CHECKING, Any

import numpy as np

from scp_planner.arrays import Array
from scp_planner.files import check_suffix
from scp_planner.mathematics.polylines import lengths_along, points_at
from scp_planner.plotting.ground import SLOW_LOOK
from scp_planner.plotting.recording import ground_of
from scp_planner.plotting.run_recording import names_of
from scp_planner.plotting.scales import clock_of, unit_of
from scp_planner.plotting.style import (
    COLOURS,
    DPI,
    GREY,
    INK,
    LABEL,
    SLOW_TEXT,
    colour_of,
    finish,
    halo,
    label_lengths,
    style,
    time_label,
)
from scp_planner.scenario.places import limits_at, stretches
from scp_planner.settings.pictures import FIGURE_SUFFIXES
from scp_planner.threat_zones.of_scenario import zones
from scp_planner.threat_zones.zone import by_obstacle

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from scp_planner.planning.plan import Plan
    from scp_planner.scenario.models import Scenario, Vehicle
    from scp_planner.simulation.run import Run
    from scp_planner.threat_zones.zone import ThreatZone

GRID = 480
"""Points of the grid in time and in space; regions are drawn to about a pixel."""


@dataclass(frozen=True)
class _Grids:
    """Places that the vehicle's reference point could be at instead."""

    time: Array  # (GRID,) Absolute, s
    position: Array  # (GRID, 2) m
    distance: Array  # (GRID,) m
    offset: Array  # (GRID,) m
    stations: Array  # (GRID,) Distances of the grid, m
    offsets: Array  # (GRID,) Its offsets, m
    along: Array  # (GRID, GRID, 2) Points on the path at each station and time
    across: Array  # (GRID, GRID, 2) Points at each offset and time, beside where the vehicle then is
    along_ahead: Array  # (GRID, GRID, 2) Unit vectors in which the vehicle looks there
    across_ahead: Array  # (GRID, GRID, 2)


@dataclass(frozen=True)
class _Region:
    """Clearance to one zone, m: of a vehicle elsewhere, (GRID, GRID), and the least of the vehicle itself."""

    id: str
    colour: str
    along: Array
    across: Array
    least: float


def plot_space_time(plan: Plan, scenario: Scenario, path: str | PathLike[str] | None = None) -> Figure:
    """Draw which part of the way is taken when: it shows at once why the vehicle waits or swerves.

    Above: distance along the planned path against time; in the regions the vehicle's disc would meet a zone.
    Below: offset to the left of the guide against time; at each time the vehicle is at the station of its
    plan, and in the regions its disc would meet a zone if it were that far to the side.

    Parameters
    ----------
    plan : Plan
    scenario : Scenario
    path : path, optional
        Where to save the figure: .png, .pdf or .svg.

    Returns
    -------
    matplotlib.figure.Figure

    Raises
    ------
    ValueError
        If the suffix is another one, or the plan has several legs.
    """
    from matplotlib.figure import Figure

    if plan.legs is not None:
        raise ValueError(f"view: space-time shows one trip ahead, and this plan has {len(plan.legs.legs)} legs")
    if path is not None:
        check_suffix(path, FIGURE_SUFFIXES)
    grids = _grids(plan, 6.0 * scenario.vehicle.radius)
    regions = _regions(grids, scenario)
    with style():
        figure = Figure(figsize=(7.5, 6.5), dpi=DPI, layout="constrained")
        above, below = figure.subplots(2, 1, sharex=True, height_ratios=[1.6, 1.0])
        _draw_slow(above, scenario, grids.stations, grids.along[:, 0])
        _draw_regions(above, below, grids, regions)
        _draw_vehicle(above, below, grids)
        above.set_title(f"{scenario.name}: when which part of the way is taken", loc="left", fontweight="bold")
        _draw_key(figure, {region.id: region.colour for region in regions})
        return finish(figure, path)


def plot_run_space_time(run: Run, path: str | PathLike[str] | None = None) -> Figure:
    """Draw which part of the driven way was taken when: it shows at once why the vehicle waited.

    Distance along the driven path against time; in the regions the vehicle's disc would have met a zone as it was
    known at that time. Thin lines are what was planned on the way.

    Parameters
    ----------
    run : Run
    path : path, optional
        Where to save the figure: .png, .pdf or .svg.

    Returns
    -------
    matplotlib.figure.Figure

    Raises
    ------
    ValueError
        If the suffix is another one.
    """
    from matplotlib.figure import Figure

    if path is not None:
        check_suffix(path, FIGURE_SUFFIXES)
    driven = lengths_along(run.position)
    time, stations = np.linspace(run.time[0], run.time[-1], GRID), np.linspace(0.0, float(driven[-1]), GRID)
    points = points_at(stations, driven, run.position)
    ahead = _unit(np.interp(stations, driven, np.unwrap(run.heading)))
    regions = _known_regions(run, time, points, ahead, far=float(driven[-1]))
    colours = _colours(names_of(run), run.scenario)
    epoch = clock_of(time)
    with style():
        figure = Figure(figsize=(7.5, 4.8), dpi=DPI, layout="constrained")
        axes = figure.subplots()
        _draw_slow(axes, run.scenario, stations, points)
        for name, values in reversed(regions):
            _draw_region(axes, time - epoch, stations, values, colours[name])
        for number in np.unique(np.linspace(0, len(run.plans) - 1, 12).astype(int)):
            plan, now = run.plans[number], run.records[number].time
            later = np.linspace(now, max(now, plan.arrival_time), GRID)
            ahead = plan.trip.at(later)[0].distance
            gone = float(np.interp(now, run.time, driven))
            axes.plot(later - epoch, gone + ahead - ahead[0], color=GREY, linewidth=0.7, alpha=0.7)
        axes.plot(run.time - epoch, driven, color=INK, linewidth=2.0)
        axes.set(xlim=(time[0] - epoch, time[-1] - epoch), ylim=(0.0, stations[-1]))
        axes.set_xlabel(time_label(epoch))
        label_lengths(axes.yaxis, "distance along the driven path", unit_of(float(np.ptp(axes.get_ylim()))))
        axes.set_title(f"{run.scenario.name}: when which part of the way was taken", loc="left", fontweight="bold")
        _draw_key(figure, {name: colours[name] for name, _ in regions}, planned=True)
        return finish(figure, path)


def _known_regions(run: Run, time: Array, points: Array, ahead: Array, far: float) -> list[tuple[str, Array]]:
    """Give the clearance to each zone as it was known, (stations, times) m, nearest first; `far` where it was not."""
    cycles = np.array([record.time for record in run.records])
    cycle = np.clip(np.searchsorted(cycles, time + 1e-9, "right") - 1, 0, None)
    values: dict[str, Array] = {}
    for number in np.unique(cycle):
        now = np.flatnonzero(cycle == number)
        shape = (len(points), len(now))
        for name, several in by_obstacle(run.records[number].zones).items():
            places, directions = (np.broadcast_to(each[:, None], (*shape, 2)) for each in (points, ahead))
            moments = np.broadcast_to(time[now], shape)
            clearance = _clearance(several, run.scenario.vehicle, moments, places, directions)
            known = values.setdefault(name, np.full((len(points), len(time)), far))
            known[:, now] = clearance
    met = [(name, clearance) for name, clearance in values.items() if clearance.min() < 0.0]
    # The one that reaches into most of the way and time first: it is the one that was waited for.
    return sorted(met, key=lambda region: -int((region[1] < 0.0).sum()))


def _grids(plan: Plan, least_reach: float) -> _Grids:
    time = np.linspace(plan.start_time, plan.arrival_time, GRID)
    trip, _ = plan.trip.at(time)
    position = plan.position(time)
    # The path by distance: the trip itself runs along it, if not evenly.
    stations = np.linspace(0.0, float(trip.distance[-1]), GRID)
    fine = np.linspace(plan.start_time, plan.arrival_time, 10 * GRID)
    runs = plan.trip.at(fine)[0].distance
    path = points_at(stations, runs, plan.position(fine))
    ahead = _unit(np.interp(stations, runs, np.unwrap(plan.heading(fine))))
    normal = plan.trip.frame.vectors_to_world(np.broadcast_to(trip.path.normal, position.shape))
    guide = position - trip.path.offset[:, None] * normal
    reach = max(1.4 * float(np.abs(trip.path.offset).max()), least_reach)
    offsets = np.linspace(-reach, reach, GRID)
    return _Grids(
        time=time,
        position=position,
        distance=trip.distance,
        offset=trip.path.offset,
        stations=stations,
        offsets=offsets,
        along=np.broadcast_to(path[:, None], (GRID, GRID, 2)),
        across=guide[None] + offsets[:, None, None] * normal[None],
        along_ahead=np.broadcast_to(ahead[:, None], (GRID, GRID, 2)),
        across_ahead=np.broadcast_to(_unit(plan.heading(time))[None], (GRID, GRID, 2)),
    )


def _regions(grids: _Grids, scenario: Scenario) -> list[_Region]:
    """Give the zones that could be met, nearest first."""
    every_time, vehicle = np.broadcast_to(grids.time, (GRID, GRID)), scenario.vehicle
    own_ahead, every_zone = grids.across_ahead[0], by_obstacle(zones(scenario))
    colours = _colours(every_zone, scenario)
    regions = [
        _Region(
            name,
            colours[name],
            _clearance(several, vehicle, every_time, grids.along, grids.along_ahead),
            _clearance(several, vehicle, every_time, grids.across, grids.across_ahead),
            float(_clearance(several, vehicle, grids.time, grids.position, own_ahead).min()),
        )
        for name, several in every_zone.items()
    ]
    met = [region for region in regions if min(region.along.min(), region.across.min()) < 0.0]
    return sorted(met, key=lambda region: region.least)


def _colours(names: Iterable[str], scenario: Scenario) -> dict[str, str]:
    ground = ground_of(scenario)
    bodies = [name for name in names if name not in ground]
    return {**dict.fromkeys(ground, GREY), **{name: colour_of(number) for number, name in enumerate(bodies)}}


def _clearance(several: Sequence[ThreatZone], vehicle: Vehicle, time: Array, place: Array, ahead: Array) -> Array:
    """Clearance of a vehicle at places (..., 2) m that looks in directions (..., 2), at times (...) s, to zones, m."""
    distances = [
        zone.signed_distance(time, place + offset * ahead if offset else place)
        for zone in several
        for offset in vehicle.discs
    ]
    clearance: Array = np.min(distances, axis=0) - vehicle.radius
    return clearance


def _unit(angle: Array) -> Array:
    return np.stack([np.cos(angle), np.sin(angle)], axis=-1)


def _draw_regions(above: Axes, below: Axes, grids: _Grids, regions: list[_Region]) -> None:
    time = grids.time - clock_of(grids.time)
    for region in reversed(regions):
        _draw_region(above, time, grids.stations, region.along, region.colour)
        _draw_region(below, time, grids.offsets, region.across, region.colour)


def _draw_slow(axes: Axes, scenario: Scenario, stations: Array, points: Array) -> None:
    """Draw where along a path, with points (n, 2) m at stations (n,) m, the speed is limited, and to how much."""
    if not scenario.speed_limits:
        return
    limit = limits_at(stretches(scenario), points)
    edges = [0, *(np.flatnonzero(limit[1:] != limit[:-1]) + 1).tolist(), len(limit)]
    for first, end in pairwise(edges):
        if np.isfinite(limit[first]):
            low, high = stations[first], stations[end - 1]
            axes.axhspan(low, high, **SLOW_LOOK, zorder=0.2)
            text = f"\N{LESS-THAN OR EQUAL TO}{limit[first]:.3g} m/s"
            place: Any = {"transform": axes.get_yaxis_transform(), "ha": "right", "va": "center"}
            axes.text(0.99, 0.5 * (low + high), text, color=SLOW_TEXT, path_effects=halo(), **place, **LABEL)


def _draw_region(axes: Axes, time: Array, ordinate: Array, clearance: Array, colour: str) -> None:
    """Draw where a clearance (ordinates, times) is negative."""
    if clearance.min() < 0.0:
        axes.contourf(time, ordinate, clearance, levels=[-math.inf, 0.0], colors=[colour], alpha=0.3)
        axes.contour(time, ordinate, clearance, levels=[0.0], colors=[colour], linewidths=1.0)


def _draw_vehicle(above: Axes, below: Axes, grids: _Grids) -> None:
    epoch = clock_of(grids.time)
    time = grids.time - epoch
    above.plot(time, grids.distance, color=INK, linewidth=2.0)
    below.plot(time, grids.offset, color=INK, linewidth=2.0)
    below.axhline(0.0, color=GREY, linewidth=0.8, linestyle=(0, (4, 3)))
    above.set_ylim(0.0, grids.stations[-1])
    below.set_ylim(grids.offsets[0], grids.offsets[-1])
    below.set_xlim(time[0], time[-1])
    # Both in the same unit, or a small offset looks as large as the whole way.
    unit = unit_of(float(grids.stations[-1]))
    label_lengths(above.yaxis, "distance along the path", unit)
    label_lengths(below.yaxis, "offset from the guide", unit)
    below.set_xlabel(time_label(epoch))


def _draw_key(figure: Figure, colours: Mapping[str, str], *, planned: bool = False) -> None:
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    handles: list[Any] = [Line2D([], [], color=INK, linewidth=2.0)]
    labels = ["vehicle"]
    if planned:
        handles.append(Line2D([], [], color=GREY, linewidth=0.7))
        labels.append("planned")
    named = list(colours)[: len(COLOURS)]
    handles += [Patch(facecolor=(colours[name], 0.3), edgecolor=colours[name]) for name in named]
    labels += named
    others = len(colours) - len(COLOURS)
    if others > 0:
        handles.append(Patch(facecolor=(GREY, 0.3), edgecolor=GREY))
        labels.append(f"{others} more")
    figure.legend(handles, labels, loc="outside lower center", ncols=min(len(labels), 5))
