"""The map: path, vehicle, zones and obstacles at some times of a recording."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from scp_planner.arrays import Array, Index
from scp_planner.plotting.borders import borders_of
from scp_planner.plotting.drawn import SELECTION, covers_all, is_cut_off, is_near, is_shown, nearest, stands
from scp_planner.plotting.ground import (
    FORBIDDEN_LOOK,
    GUIDE_LOOK,
    LANE_LOOK,
    SLOW_LOOK,
    draw_ground,
    has_forbidden,
    path_of,
)
from scp_planner.plotting.recording import ObstacleRecord, Recording
from scp_planner.plotting.scales import unit_of, unit_of_rate
from scp_planner.plotting.style import DOTTED, FAINT, GREY, INK, LABEL, colour_of, halo, label_lengths, time_text
from scp_planner.trips.trip import discs_at

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.patches import Patch
    from matplotlib.path import Path

NAMED = 8
"""Obstacles have their names beside them where there are no more than these."""

Box = tuple[Array, Array]
"""Corners of a map, (2,) and (2,) m."""

_KEY_SPACING: dict[str, Any] = {"handletextpad": 0.4, "columnspacing": 1.0, "borderaxespad": 0.2}


def draw_map(axes: Axes, recording: Recording, indices: Index, box: Box, *, narrow: bool = False) -> None:
    """Draw the trip, coloured by speed, and vehicle and zones at some times."""
    draw_scene(axes, recording, indices, box, narrow=narrow)
    for index in indices if len(recording.paths) > 1 else ():  # what was planned at these times
        path = recording.paths[recording.path_index[index]]
        axes.plot(*path.T, color=GREY, linewidth=1.0, linestyle=(0, (4, 2)), zorder=2.8)
    _draw_speed(axes, recording)


def draw_scene(axes: Axes, recording: Recording, indices: Index, box: Box, *, narrow: bool = False) -> None:
    """Draw vehicle and zones at some times, and the ground; each obstacle has one colour."""
    lay_out(axes, recording, *box)
    draw_tracks(axes, recording)
    for number, obstacle in enumerate(recording.bodies):
        still = stands(recording, obstacle)
        for index in [nearest(obstacle)] if still else indices:
            _draw_obstacle(
                axes, recording, obstacle, int(index), colour_of(number), timed=not still and len(indices) > 1
            )
    for index in indices:
        _draw_vehicle(axes, recording, int(index))
    if len(recording.bodies) <= NAMED:
        places: list[Array] = []
        for obstacle in recording.bodies:
            _name(axes, recording, obstacle, indices, places)
    draw_ends(axes, recording)
    if narrow:
        part = axes.get_figure(root=False)
        assert part is not None
        part.legend(handles=key_to_symbols(recording), loc="outside upper center", ncols=4, **_KEY_SPACING)
    else:
        draw_key_above(axes, recording)


def lay_out(axes: Axes, recording: Recording, low: Array, high: Array) -> None:
    """Set the axes to a box with corners (2,) and (2,) m, in a unit that fits it, and draw the ground."""
    unit = unit_of(float((high - low).max()))
    axes.set_aspect("equal")
    axes.set_xlim(low[0], high[0])
    axes.set_ylim(low[1], high[1])
    label_lengths(axes.xaxis, "x", unit)
    label_lengths(axes.yaxis, "y", unit)
    axes.locator_params(axis="both", steps=[1, 2, 5, 10])
    axes.locator_params(axis="y", nbins=6 if high[1] - low[1] < high[0] - low[0] else 9)
    axes.locator_params(axis="x", nbins=9 if high[1] - low[1] < high[0] - low[0] else 5)
    draw_ground(axes, recording, low, high)


def draw_tracks(axes: Axes, recording: Recording) -> None:
    """Draw where the obstacles' centres go, where they were seen and where they really went."""
    for obstacle in recording.bodies:
        if obstacle.truth is None:
            axes.plot(*obstacle.center.T, color=FAINT, linewidth=0.8, zorder=1.5)
        else:
            axes.plot(*obstacle.truth.T, color=INK, linewidth=0.9, linestyle=DOTTED, zorder=3.5)
        if obstacle.observed is not None:
            axes.plot(*obstacle.observed.T, ".", color=GREY, markersize=2.2, markeredgewidth=0, zorder=1.6)


def outline_of(obstacle: ObstacleRecord, index: int) -> Path:
    """Give the boundary of an obstacle's zone at a time; where convex pieces overlap it is filled once."""
    from matplotlib.path import Path

    pieces = obstacle.zone_at(index)
    closed = np.concatenate([pieces, pieces[:, :1]], axis=1)
    codes = np.full(closed.shape[:2], Path.LINETO)
    codes[:, 0], codes[:, -1] = Path.MOVETO, Path.CLOSEPOLY
    return Path(closed.reshape(-1, 2), codes.ravel())


def border_of(obstacle: ObstacleRecord, index: int) -> Path:
    """Give the border of an obstacle's zone at a time, without the seams between its convex pieces."""
    if len(obstacle.boundary[index]) == 1:
        return outline_of(obstacle, index)
    return path_of(borders_of(list(obstacle.zone_at(index))))


def draw_ends(axes: Axes, recording: Recording) -> list[Artist]:
    """Mark start and goal; return the marks."""
    from matplotlib.patches import Circle, Polygon

    start, goal = recording.position[0], recording.goal
    marks: list[Artist] = [
        *axes.plot(*start, marker="o", markersize=5, color="white", markeredgecolor=INK, zorder=5),
        *axes.plot(*goal, marker="*", markersize=11, color="white", markeredgecolor=INK, zorder=5),
    ]
    if recording.places:
        marks += axes.plot(*zip(*recording.places, strict=True), "D", markersize=5, color="white", mec=INK, zorder=5)
    if recording.goal_radius > 0.0:
        area = Circle(goal, recording.goal_radius, fill=False, edgecolor=INK, linestyle=(0, (3, 2)), zorder=1.8)
        marks.append(axes.add_patch(area))
    if recording.goal_region is not None:
        region = Polygon(recording.goal_region, fill=False, edgecolor=INK, linestyle=(0, (3, 2)), zorder=1.8)
        marks.append(axes.add_patch(region))
    return marks


def draw_key_above(axes: Axes, recording: Recording) -> None:
    """Explain the symbols in one row above the right end of axes."""
    handles = key_to_symbols(recording)
    place: dict[str, Any] = {"loc": "lower right", "bbox_to_anchor": (1.0, 1.0)}
    key = axes.legend(handles=handles, ncols=len(handles), **place, **_KEY_SPACING)
    key.set_clip_on(False)  # or the layout would leave no room for it


def key_to_symbols(recording: Recording) -> list[Artist]:
    """Entries of a legend."""
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    hollow: dict[str, Any] = {"linestyle": "none", "color": "white", "markeredgecolor": INK}
    obstacles = recording.obstacles
    entries: list[tuple[object, Artist]] = [
        (True, Line2D([], [], marker="o", markersize=5, **hollow, label="start")),
        (True, Line2D([], [], marker="*", markersize=10, **hollow, label="goal")),
        (recording.bodies, Patch(facecolor=(GREY, 0.22), edgecolor=GREY, label="zone")),
        (has_forbidden(recording), Patch(**FORBIDDEN_LOOK, label="forbidden")),
        (recording.stretches, Patch(**SLOW_LOOK, label="slow")),
        (recording.lanes, Line2D([], [], **LANE_LOOK, label="lanes")),
        (recording.guide is not None, Line2D([], [], **GUIDE_LOOK, label="guide")),
        (
            any(obstacle.observed is not None for obstacle in obstacles),
            Line2D([], [], linestyle="none", marker=".", markersize=4, color=GREY, label="seen"),
        ),
        (
            any(obstacle.truth is not None for obstacle in obstacles),
            Line2D([], [], color=INK, linewidth=0.9, linestyle=DOTTED, label="really went"),
        ),
    ]
    return [entry for there, entry in entries if there]


def _draw_obstacle(
    axes: Axes, recording: Recording, obstacle: ObstacleRecord, index: int, colour: str, *, timed: bool
) -> None:
    """Draw an obstacle at a time: its zone, filled if near to the vehicle, else an outline; its shape, and the time."""
    from matplotlib.patches import PathPatch, Polygon

    near, shown = is_near(recording, obstacle, index), is_shown(recording, obstacle, index)
    if not shown and len(recording.bodies) > SELECTION.crowd:
        return
    low, high = np.array([axes.get_xlim(), axes.get_ylim()]).T
    if shown and (near or not is_cut_off(recording, obstacle.zone_at(index).reshape(-1, 2), low, high)):
        edge = (colour, 0.9 if near else 0.35)
        fill: Any = (colour, 0.22) if near and not covers_all(recording, obstacle, index) else "none"
        if len(obstacle.boundary[index]) == 1:
            outline = outline_of(obstacle, index)
            axes.add_patch(PathPatch(outline, facecolor=fill, edgecolor=edge, linewidth=1.0, zorder=2))
        else:
            axes.add_patch(PathPatch(outline_of(obstacle, index), facecolor=fill, edgecolor="none", zorder=2))
            border = border_of(obstacle, index)
            axes.add_patch(PathPatch(border, facecolor="none", edgecolor=edge, linewidth=1.0, zorder=2))
    true_center = obstacle.truth_at(index)
    if true_center is not None:
        body = obstacle.body_at(index, true_center)
        if near or not is_cut_off(recording, body, low, high):
            axes.add_patch(Polygon(body, facecolor="none", edgecolor=colour, linewidth=1.4, zorder=3.6))
    elif obstacle.padded and near:
        body = obstacle.body_at(index)
        axes.add_patch(Polygon(body, facecolor=(colour, 0.35), edgecolor="none", zorder=2.1))
    if timed and near:
        x, y = (obstacle.center[index] if true_center is None else true_center).tolist()
        _write_time(axes, recording, index, x, y)


def _write_time(axes: Axes, recording: Recording, index: int, x: float, y: float) -> None:
    text = time_text(recording.time[index] - recording.epoch)
    axes.text(x, y, text, ha="center", va="center", path_effects=halo(), **LABEL)


def _draw_speed(axes: Axes, recording: Recording) -> None:
    from matplotlib.collections import LineCollection

    points = recording.position
    axes.plot(*points.T, color="white", linewidth=5.0, solid_capstyle="round", zorder=2.9)
    segments: Any = np.stack([points[:-1], points[1:]], axis=1)
    line = LineCollection(segments, cmap="cividis_r", linewidth=3.2, capstyle="round", zorder=3)
    line.set_array(0.5 * (recording.speed[:-1] + recording.speed[1:]))
    line.set_clim(*recording.speeds)
    axes.add_collection(line)
    figure = axes.get_figure(root=False)
    assert figure is not None
    bar = figure.colorbar(line, ax=axes, fraction=0.025, pad=0.01, aspect=18, shrink=0.85)
    label_lengths(bar.ax.yaxis, "speed", unit_of_rate("m/s", recording.speeds[1]))
    bar.ax.spines[:].set_visible(False)


def vehicle_patches(recording: Recording, index: int = 0) -> list[Patch]:
    """Draw a vehicle at a time: a rectangle and the discs that cover it, or its disc."""
    from matplotlib.patches import Circle, Polygon

    body = recording.vehicle_at(index)
    whole: dict[str, Any] = {"facecolor": INK, "edgecolor": "white", "linewidth": 0.8, "zorder": 4}
    parts: dict[str, Any] = {"facecolor": "none", "edgecolor": (INK, 0.35), "linewidth": 0.6, "zorder": 3.9}
    discs: list[Patch] = [
        Circle(tuple(disc[index].tolist()), recording.radius, **(whole if body is None else parts))
        for disc in discs_at(recording.position, recording.heading, recording.discs)
    ]
    return discs if body is None else [*discs, Polygon(body, **whole)]


def _draw_vehicle(axes: Axes, recording: Recording, index: int) -> None:
    extent = float(np.ptp([axes.get_xlim(), axes.get_ylim()], axis=1).max())
    # A smaller vehicle has a mark, or nobody would see it.
    if recording.radius < 0.007 * extent:
        axes.plot(*recording.position[index], "o", markersize=6, color=INK, markeredgecolor="white", zorder=3.9)
    for patch in vehicle_patches(recording, index):
        axes.add_patch(patch)
    heading, middle = recording.heading[index], 0.5 * (min(recording.discs) + max(recording.discs))
    aside = max(recording.radius, 0.007 * extent) + 0.018 * extent
    x, y = recording.position[index] + middle * np.array([np.cos(heading), np.sin(heading)])
    _write_time(axes, recording, index, float(x - aside * np.sin(heading)), float(y + aside * np.cos(heading)))


def _name(axes: Axes, recording: Recording, obstacle: ObstacleRecord, indices: Index, places: list[Array]) -> None:
    """Write an obstacle's id beside its zone at the shown time at which it is nearest to the vehicle."""
    (left, right), (bottom, top) = axes.get_xlim(), axes.get_ylim()
    low, high = np.array([left, bottom]), np.array([right, top])
    clearance = obstacle.clearance[indices]
    index = int(indices[np.where(np.isnan(clearance), np.inf, clearance).argmin()])
    zone = obstacle.zone_at(index)
    above: bool | None = bool(obstacle.center[index, 1] >= recording.position[index, 1])
    x, y = float(obstacle.center[index, 0]), float(zone[..., 1].max() if above else zone[..., 1].min())
    room = 0.03 * float((high - low).max())
    if not low[1] + room < y < high[1] - room:
        y, above = float(obstacle.center[index, 1]), None
    if not (low[0] + room < x < high[0] - room and low[1] + room < y < high[1] - room):
        return
    if any(abs(y - other[1]) < room and abs(x - other[0]) < 4.0 * room for other in places):
        return
    places.append(np.array([x, y]))
    axes.annotate(
        obstacle.id,
        (x, y),
        xytext=(0, 0 if above is None else 2 if above else -2),
        textcoords="offset points",
        ha="center",
        va="center" if above is None else "bottom" if above else "top",
        fontweight="bold",
        path_effects=halo(),
        **LABEL,
    )
