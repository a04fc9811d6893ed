"""The way over time: which part of it is taken when."""

from __future__ import annotations

import math
from dataclasses import dataclass
from os import PathLike
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from scp_planner.plotting.style import (
    COLOURS,
    FIGURE_SUFFIXES,
    GREY,
    INK,
    check_suffix,
    save,
    settle,
    style,
    time_label,
)
from scp_planner.recording import clock_of
from scp_planner.zones import zones

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from scp_planner.plan import Plan
    from scp_planner.scenario import Scenario

Array = NDArray[np.float64]

GRID = 240
"""Points of the grid in time and in space; regions are drawn to about a pixel."""


@dataclass(frozen=True)
class _Grids:
    """Where the vehicle's reference point could be instead.

    Attributes
    ----------
    time : (GRID,) array
        Absolute, s.
    position : (GRID, 2) array
        Of the vehicle, m.
    distance, offset : (GRID,) arrays
        Of the vehicle along its path and to the left of the guide, m.
    stations, offsets : (GRID,) arrays
        The grid's distances and offsets, m.
    along, across : (GRID, GRID, 2) arrays
        Points on the path at each station and time; beside the guide, level with the vehicle, at each offset
        and time; m.
    """

    time: Array
    position: Array
    distance: Array
    offset: Array
    stations: Array
    offsets: Array
    along: Array
    across: Array


@dataclass(frozen=True)
class _Region:
    """Clearance to one zone, m: of a vehicle elsewhere, (GRID, GRID), and the least of the vehicle itself."""

    id: str
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
        If the suffix is another one.
    """
    from matplotlib.figure import Figure

    if path is not None:
        check_suffix(path, FIGURE_SUFFIXES)
    grids = _grids(plan, 6.0 * scenario.vehicle.radius)
    regions = _regions(grids, scenario)
    with style():
        figure = Figure(figsize=(7.5, 6.5), dpi=150, layout="constrained")
        above, below = figure.subplots(2, 1, sharex=True, height_ratios=[1.6, 1.0])
        _draw_regions(above, below, grids, regions)
        _draw_vehicle(above, below, grids)
        above.set_title(f"{scenario.name}: when which part of the way is taken", loc="left", fontweight="bold")
        _draw_key(figure, regions)
        settle(figure)
        if path is not None:
            save(figure, path)
    return figure


def _grids(plan: Plan, least_reach: float) -> _Grids:
    time = np.linspace(plan.start_time, plan.arrival_time, GRID)
    trip, _ = plan.trip.at(time)
    position = plan.position(time)
    # The path by distance: the trip itself runs along it, if not evenly.
    stations = np.linspace(0.0, float(trip.distance[-1]), GRID)
    fine = np.linspace(plan.start_time, plan.arrival_time, 10 * GRID)
    runs, points = plan.trip.at(fine)[0].distance, plan.position(fine)
    path = np.stack([np.interp(stations, runs, points[:, axis]) for axis in (0, 1)], axis=-1)
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
    )


def _regions(grids: _Grids, scenario: Scenario) -> list[_Region]:
    """Give the zones that could be met, nearest first."""
    radius = scenario.vehicle.radius
    every_time = np.broadcast_to(grids.time, (GRID, GRID))
    regions = [
        _Region(
            zone.id,
            zone.signed_distance(every_time, grids.along) - radius,
            zone.signed_distance(every_time, grids.across) - radius,
            float(zone.signed_distance(grids.time, grids.position).min()) - radius,
        )
        for zone in zones(scenario)
    ]
    met = [region for region in regions if min(region.along.min(), region.across.min()) < 0.0]
    return sorted(met, key=lambda region: region.least)


def _draw_regions(above: Axes, below: Axes, grids: _Grids, regions: list[_Region]) -> None:
    time = grids.time - clock_of(grids.time)
    for number, region in reversed(list(enumerate(regions))):
        colour = COLOURS[number] if number < len(COLOURS) else GREY
        for axes, values, ordinate in (
            (above, region.along, grids.stations),
            (below, region.across, grids.offsets),
        ):
            if values.min() < 0.0:
                axes.contourf(time, ordinate, values, levels=[-math.inf, 0.0], colors=[colour], alpha=0.3)
                axes.contour(time, ordinate, values, levels=[0.0], colors=[colour], linewidths=1.0)


def _draw_vehicle(above: Axes, below: Axes, grids: _Grids) -> None:
    epoch = clock_of(grids.time)
    time = grids.time - epoch
    above.plot(time, grids.distance, color=INK, linewidth=2.0)
    below.plot(time, grids.offset, color=INK, linewidth=2.0)
    below.axhline(0.0, color=GREY, linewidth=0.8, linestyle=(0, (4, 3)))
    above.set_ylim(0.0, grids.stations[-1])
    below.set_ylim(grids.offsets[0], grids.offsets[-1])
    below.set_xlim(time[0], time[-1])
    above.set_ylabel("distance along the path (m)")
    below.set_ylabel("offset from the guide (m)")
    below.set_xlabel(time_label(epoch))


def _draw_key(figure: Figure, regions: list[_Region]) -> None:
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    handles: list[Any] = [Line2D([], [], color=INK, linewidth=2.0)]
    labels = ["vehicle", *(region.id for region in regions[: len(COLOURS)])]
    handles += [Patch(facecolor=(colour, 0.3), edgecolor=colour) for colour in COLOURS[: len(labels) - 1]]
    others = len(regions) - len(COLOURS)
    if others > 0:
        handles.append(Patch(facecolor=(GREY, 0.3), edgecolor=GREY))
        labels.append(f"{others} more")
    figure.legend(handles, labels, loc="outside lower center", ncols=min(len(labels), 5))
