"""The way over time: which part of it is taken when."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from os import PathLike
from typing import TYPE_CHECKING, Any

import numpy as np

from scp_planner.arrays import Array, unit_vectors
from scp_planner.mathematics.polylines import lengths_along, points_at
from scp_planner.plotting.ground import SLOW_LOOK
from scp_planner.plotting.recording import clearance_of, ground_of
from scp_planner.plotting.run_recording import names_of
from scp_planner.plotting.scales import clock_of, unit_of
from scp_planner.plotting.style import (
    COLOURS,
    DPI,
    GREY,
    INK,
    LABEL,
    SLOW_TEXT,
    check_figure,
    colour_of,
    finish,
    halo,
    label_lengths,
    style,
    time_label,
)
from scp_planner.scenario.places import limits_at, stretches
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
class _Panel:
    """Places that the vehicle's reference point could be at instead, by an ordinate."""

    name: str  # Of the ordinate
    ordinate: Array  # (GRID,) m
    driven: Array  # (GRID,) Ordinates at which the vehicle is, m
    places: Array  # (GRID, GRID, 2) m at each ordinate and time
    ahead: Array  # (GRID, GRID, 2) Unit vectors in which the vehicle looks there


@dataclass(frozen=True)
class _Region:
    """Clearance to one zone, m: of a vehicle elsewhere, (GRID, GRID) a panel, and the least of the vehicle itself."""

    name: str
    clearances: list[Array]
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
    check_figure(path)
    time = np.linspace(plan.start_time, plan.arrival_time, GRID)
    panels = _panels(plan, time, 6.0 * scenario.vehicle.radius)
    every_zone = by_obstacle(zones(scenario))
    regions, colours = _regions(plan, scenario.vehicle, every_zone, time, panels), _colours(every_zone, scenario)
    epoch = clock_of(time)
    with style():
        figure = Figure(figsize=(7.5, 6.5), dpi=DPI, layout="constrained")
        above, below = figure.subplots(2, 1, sharex=True, height_ratios=[1.6, 1.0])
        _draw_slow(above, scenario, panels[0].ordinate, panels[0].places[:, 0])
        for number, (axes, panel) in enumerate(zip((above, below), panels, strict=True)):
            for region in reversed(regions):
                clearance = region.clearances[number]
                _draw_region(axes, time - epoch, panel.ordinate, clearance, colours[region.name])
            axes.plot(time - epoch, panel.driven, color=INK, linewidth=2.0)
            axes.set_ylim(panel.ordinate[0], panel.ordinate[-1])
            # Both in the same unit, or a small offset looks as large as the whole way.
            label_lengths(axes.yaxis, panel.name, unit_of(float(panels[0].ordinate[-1])))
        below.axhline(0.0, color=GREY, linewidth=0.8, linestyle=(0, (4, 3)))
        below.set_xlim(time[0] - epoch, time[-1] - epoch)
        below.set_xlabel(time_label(epoch))
        above.set_title(f"{scenario.name}: when which part of the way is taken", loc="left", fontweight="bold")
        _draw_key(figure, {region.name: colours[region.name] for region in regions})
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

    check_figure(path)
    driven = lengths_along(run.position)
    time, stations = np.linspace(run.time[0], run.time[-1], GRID), np.linspace(0.0, float(driven[-1]), GRID)
    points = points_at(stations, driven, run.position)
    ahead = unit_vectors(np.interp(stations, driven, np.unwrap(run.heading)))
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


def _panels(plan: Plan, time: Array, least_reach: float) -> tuple[_Panel, _Panel]:
    """Distances along the path, and offsets beside where the vehicle then is."""
    trip, _ = plan.trip.at(time)
    position = plan.position(time)
    # The path by distance: the trip itself runs along it, if not evenly.
    stations = np.linspace(0.0, float(trip.distance[-1]), GRID)
    fine = np.linspace(plan.start_time, plan.arrival_time, 10 * GRID)
    runs = plan.trip.at(fine)[0].distance
    path = points_at(stations, runs, plan.position(fine))
    ahead = unit_vectors(np.interp(stations, runs, np.unwrap(plan.heading(fine))))
    normal = plan.trip.frame.vectors_to_world(np.broadcast_to(trip.path.normal, position.shape))
    guide = position - trip.path.offset[:, None] * normal
    reach = max(1.4 * float(np.abs(trip.path.offset).max()), least_reach)
    offsets, grid = np.linspace(-reach, reach, GRID), (GRID, GRID, 2)
    across = guide[None] + offsets[:, None, None] * normal[None]
    own_ahead = np.broadcast_to(unit_vectors(plan.heading(time))[None], grid)
    along, along_ahead = np.broadcast_to(path[:, None], grid), np.broadcast_to(ahead[:, None], grid)
    return (
        _Panel("distance along the path", stations, trip.distance, along, along_ahead),
        _Panel("offset from the guide", offsets, trip.path.offset, across, own_ahead),
    )


def _regions(
    plan: Plan, vehicle: Vehicle, every_zone: Mapping[str, list[ThreatZone]], time: Array, panels: tuple[_Panel, _Panel]
) -> list[_Region]:
    """Give the zones that could be met, nearest first."""
    every_time = np.broadcast_to(time, (GRID, GRID))
    regions = [
        _Region(
            name,
            [_clearance(several, vehicle, every_time, panel.places, panel.ahead) for panel in panels],
            float(_clearance(several, vehicle, time, plan.position(time), panels[1].ahead[0]).min()),
        )
        for name, several in every_zone.items()
    ]
    met = [region for region in regions if min(clearance.min() for clearance in region.clearances) < 0.0]
    return sorted(met, key=lambda region: region.least)


def _colours(names: Iterable[str], scenario: Scenario) -> dict[str, str]:
    ground = ground_of(scenario)
    bodies = [name for name in names if name not in ground]
    return {**dict.fromkeys(ground, GREY), **{name: colour_of(number) for number, name in enumerate(bodies)}}


def _clearance(several: Sequence[ThreatZone], vehicle: Vehicle, time: Array, place: Array, ahead: Array) -> Array:
    """Clearance of a vehicle at places (..., 2) m that looks in directions (..., 2), at times (...) s, to zones, m."""
    discs = [place + offset * ahead if offset else place for offset in vehicle.discs]
    return clearance_of(several, time, discs, vehicle.radius)


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


def _draw_key(figure: Figure, colours: Mapping[str, str], *, planned: bool = False) -> None:
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    handles: list[Any] = [Line2D([], [], color=INK, linewidth=2.0, label="vehicle")]
    if planned:
        handles.append(Line2D([], [], color=GREY, linewidth=0.7, label="planned"))
    shown = dict(list(colours.items())[: len(COLOURS)])
    if len(colours) > len(shown):
        shown[f"{len(colours) - len(shown)} more"] = GREY
    handles += [Patch(facecolor=(colour, 0.3), edgecolor=colour, label=name) for name, colour in shown.items()]
    figure.legend(handles=handles, loc="outside lower center", ncols=min(len(handles), 5))
