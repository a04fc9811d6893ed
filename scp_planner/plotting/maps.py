"""The map: path, vehicle, zones and obstacles at some times of a recording."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import compress
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from scp_planner.arrays import Array, Index
from scp_planner.plotting.borders import borders_of
from scp_planner.plotting.recording import ObstacleRecord, Recording
from scp_planner.plotting.style import COLOURS, DOTTED, FAINT, GREY, INK, time_text
from scp_planner.trips.trip import discs_at

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.path import Path

CLOSE_BY = 0.12
"""Zones no farther from the vehicle than this part of the trip's extent are filled."""
CROWD = 12
"""With more obstacles than this only those near the vehicle are drawn."""
LARGE, UNSURE = 0.24, 1.5
"""Outlines of zones that are far away are left out if they are larger than this part of the trip's extent, and so
many times as large as the obstacle: so little is known that they would only hide what matters."""
STILL = 1e-3
"""What moves and grows by less than this part of the trip's extent stands."""
NAME_HEIGHT = 0.03
"""Room that a name takes, as a part of the map's longer side."""
NAMED = 8
"""With no more obstacles than this they are named on the map."""

_KEY_SPACING: dict[str, Any] = {"handletextpad": 0.4, "columnspacing": 1.0, "borderaxespad": 0.2}


def draw_map(axes: Axes, recording: Recording, indices: Index, *, narrow: bool) -> None:
    """Draw the trip, coloured by speed, and vehicle and zones at some times in one colour a time.

    Parameters
    ----------
    axes : Axes
    recording : Recording
    indices : (k,) array of int
        Of the times to show; no more than there are colours.
    narrow : bool
        Whether the legend needs several rows.
    """
    lay_out(axes, recording)
    draw_tracks(axes, recording)
    standing = [_stands(recording, obstacle) for obstacle in recording.bodies]
    for obstacle in compress(recording.bodies, standing):
        _draw_obstacle(axes, recording, obstacle, _nearest(obstacle), GREY)
    for index, colour in zip(indices, COLOURS, strict=False):
        for obstacle, stands in zip(recording.bodies, standing, strict=True):
            if not stands:
                _draw_obstacle(axes, recording, obstacle, int(index), colour)
    if len(recording.paths) > 1:
        _draw_plans(axes, recording, indices)
    _draw_speed(axes, recording)
    for index, colour in zip(indices, COLOURS, strict=False):
        _draw_vehicle(axes, recording, int(index), colour)
    if len(recording.bodies) <= NAMED:
        places: list[Array] = []
        for obstacle in recording.bodies:
            _name(axes, recording, obstacle, indices, places)
    draw_ends(axes, recording)
    times, symbols = _key_to_times(recording, indices), key_to_symbols(recording)
    if narrow:
        part, key = axes.get_figure(root=False), times + symbols
        assert part is not None
        part.legend(key.handles, key.labels, loc="outside upper center", ncols=4, **_KEY_SPACING)
    else:
        times.set_above(axes, "left")
        symbols.set_above(axes, "right")


def lay_out(axes: Axes, recording: Recording) -> None:
    """Set the axes to the extent of a recording, and draw the workspace."""
    from matplotlib.patches import Rectangle

    low, high = recording.extent()
    axes.set_aspect("equal")
    axes.set_xlim(low[0], high[0])
    axes.set_ylim(low[1], high[1])
    axes.set_xlabel("x (m)")
    axes.set_ylabel("y (m)")
    axes.locator_params(axis="both", steps=[1, 2, 5, 10])
    axes.locator_params(axis="y", nbins=6 if high[1] - low[1] < high[0] - low[0] else 9)
    axes.locator_params(axis="x", nbins=9 if high[1] - low[1] < high[0] - low[0] else 5)
    if recording.bounds is not None:
        corner, opposite = recording.bounds
        sides = opposite[0] - corner[0], opposite[1] - corner[1]
        axes.add_patch(Rectangle(corner, *sides, fill=False, edgecolor=GREY, linewidth=1.4, zorder=1))
    if recording.corridor:
        _draw_corridor(axes, recording)


def _draw_corridor(axes: Axes, recording: Recording) -> None:
    """Shade what lies outside the corridor."""
    from matplotlib.patches import PathPatch, Polygon, Rectangle

    low, high = recording.extent()
    # Below the grid, which has 0.5.
    corner, (width, height) = (float(low[0]), float(low[1])), high - low
    axes.add_patch(Rectangle(corner, width, height, facecolor=(GREY, 0.22), edgecolor="none", zorder=0.1))
    for polygon in recording.corridor:
        axes.add_patch(Polygon(polygon, facecolor="white", edgecolor="none", zorder=0.2))
    border = _path_of(borders_of(list(recording.corridor)))
    axes.add_patch(PathPatch(border, facecolor="none", edgecolor=GREY, linewidth=1.4, zorder=1))


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
    return _path_of(borders_of(list(obstacle.zone_at(index))))


def _path_of(bits: Array) -> Path:
    """Give a path of bits of a border, (n, 2, 2) m."""
    from matplotlib.path import Path

    return Path(bits.reshape(-1, 2), np.tile([Path.MOVETO, Path.LINETO], len(bits)))


def draw_ends(axes: Axes, recording: Recording) -> list[Artist]:
    """Mark start and goal; return the marks."""
    from matplotlib.patches import Circle

    start, goal = recording.position[0], recording.goal
    marks: list[Artist] = [
        *axes.plot(*start, marker="o", markersize=5, color="white", markeredgecolor=INK, zorder=5),
        *axes.plot(*goal, marker="*", markersize=11, color="white", markeredgecolor=INK, zorder=5),
    ]
    if recording.goal_radius > 0.0:
        area = Circle(goal, recording.goal_radius, fill=False, edgecolor=INK, linestyle=(0, (3, 2)), zorder=1.8)
        marks.append(axes.add_patch(area))
    return marks


@dataclass(frozen=True)
class Key:
    """Entries of a legend."""

    handles: list[Any]
    labels: list[str]

    def __add__(self, other: Key) -> Key:
        return Key(self.handles + other.handles, self.labels + other.labels)

    def set_above(self, axes: Axes, side: Literal["left", "right"]) -> None:
        """Set the entries in one row above the left or right end of axes."""
        from matplotlib.legend import Legend

        place: Any = {"loc": f"lower {side}", "bbox_to_anchor": (0.0 if side == "left" else 1.0, 1.0)}
        columns = len(self.labels)
        # Not axes.legend: axes have one, and there may be two rows.
        key = axes.add_artist(Legend(axes, self.handles, self.labels, ncols=columns, **place, **_KEY_SPACING))
        key.set_clip_on(False)  # or the layout would leave no room for it


def key_to_symbols(recording: Recording) -> Key:
    """What the marks on the map mean."""
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    hollow: dict[str, Any] = {"linestyle": "none", "color": "white", "markeredgecolor": INK}
    start = Line2D([], [], marker="o", markersize=5, **hollow)
    goal = Line2D([], [], marker="*", markersize=10, **hollow)
    key = Key([start, goal], ["start", "goal"])
    if recording.bodies:
        key += Key([Patch(facecolor=(GREY, 0.22), edgecolor=GREY)], ["zone"])
    if any(obstacle.observed is not None for obstacle in recording.obstacles):
        key += Key([Line2D([], [], linestyle="none", marker=".", markersize=4, color=GREY)], ["seen"])
    if any(obstacle.truth is not None for obstacle in recording.obstacles):
        key += Key([Line2D([], [], color=INK, linewidth=0.9, linestyle=DOTTED)], ["really went"])
    return key


def _key_to_times(recording: Recording, indices: Index) -> Key:
    from matplotlib.lines import Line2D

    handles: list[Any] = [
        Line2D([], [], linestyle="none", marker="o", markersize=7, color=colour, markeredgecolor="white")
        for _, colour in zip(indices, COLOURS, strict=False)
    ]
    return Key(handles, [time_text(recording.time[index] - recording.epoch) for index in indices])


def _draw_obstacle(axes: Axes, recording: Recording, obstacle: ObstacleRecord, index: int, colour: str) -> None:
    """Draw an obstacle at a time: its zone, filled if near to the vehicle, else an outline; and its shape.

    What would only hide what matters is left out: large zones that are far away, and in a crowd all that are.
    """
    from matplotlib.patches import PathPatch, Polygon

    length = float(np.ptp(recording.position, axis=0).max())
    near = obstacle.clearance[index] < CLOSE_BY * length
    size, own = (
        float(np.ptp(points, axis=0).max()) for points in (obstacle.zone_at(index).reshape(-1, 2), obstacle.body)
    )
    large = size > LARGE * length and size > UNSURE * own
    if not near and len(recording.bodies) > CROWD:
        return
    if near or not large:
        edge = (colour, 0.9 if near else 0.35)
        fill: Any = (colour, 0.22) if near else "none"
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
        axes.add_patch(Polygon(body, facecolor="none", edgecolor=colour, linewidth=1.4, zorder=3.6))
    elif obstacle.padded and near:
        body = obstacle.body_at(index)
        axes.add_patch(Polygon(body, facecolor=(colour, 0.35), edgecolor="none", zorder=2.1))


def _stands(recording: Recording, obstacle: ObstacleRecord) -> bool:
    """Whether an obstacle and its zone are the same all the time."""
    length = float(np.ptp(recording.position, axis=0).max())
    # Of what really was it is known whether it stood, whatever its zones did.
    courses = [obstacle.center, obstacle.boundary] if obstacle.truth is None else [obstacle.truth]
    # What is not known of at some time is NaN, and no less than anything.
    return all(np.ptp(course, axis=0).max() < STILL * length for course in courses)


def _nearest(obstacle: ObstacleRecord) -> int:
    """Index of the time at which an obstacle's zone is nearest to the vehicle."""
    return int(np.where(np.isnan(obstacle.clearance), np.inf, obstacle.clearance).argmin())


def _draw_plans(axes: Axes, recording: Recording, indices: Index) -> None:
    """Draw what was planned at the times that are shown."""
    for index, colour in zip(indices, COLOURS, strict=False):
        path = recording.paths[recording.path_index[index]]
        axes.plot(*path.T, color=colour, linewidth=1.0, linestyle=(0, (4, 2)), zorder=2.8)


def _draw_speed(axes: Axes, recording: Recording) -> None:
    from matplotlib.collections import LineCollection

    points = recording.position
    axes.plot(*points.T, color="white", linewidth=5.0, solid_capstyle="round", zorder=2.9)
    segments: Any = np.stack([points[:-1], points[1:]], axis=1)
    line = LineCollection(segments, cmap="cividis_r", linewidth=3.2, capstyle="round", zorder=3)
    line.set_array(0.5 * (recording.speed[:-1] + recording.speed[1:]))
    line.set_clim(0.0, recording.max_speed)
    axes.add_collection(line)
    figure = axes.get_figure(root=False)
    assert figure is not None
    bar = figure.colorbar(line, ax=axes, fraction=0.025, pad=0.01, aspect=18, shrink=0.85)
    bar.set_label("speed (m/s)")
    bar.ax.spines[:].set_visible(False)


def _draw_vehicle(axes: Axes, recording: Recording, index: int, colour: str) -> None:
    from matplotlib.patches import Circle

    for disc in discs_at(recording.position, recording.heading, recording.discs):
        x, y = disc[index]
        axes.add_patch(Circle((x, y), recording.radius, facecolor=colour, edgecolor="white", linewidth=0.8, zorder=4))


def _name(axes: Axes, recording: Recording, obstacle: ObstacleRecord, indices: Index, places: list[Array]) -> None:
    """Write an obstacle's id beside its zone at the shown time at which it is nearest to the vehicle.

    It is left out where it would hide one of the names that have their places already.
    """
    from matplotlib.patheffects import withStroke

    low, high = recording.extent()
    clearance = obstacle.clearance[indices]
    index = int(indices[np.where(np.isnan(clearance), np.inf, clearance).argmin()])
    zone = obstacle.zone_at(index)
    above: bool | None = bool(obstacle.center[index, 1] >= recording.position[index, 1])
    x, y = float(obstacle.center[index, 0]), float(zone[..., 1].max() if above else zone[..., 1].min())
    room = NAME_HEIGHT * float((high - low).max())
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
        fontsize=7.5,
        zorder=6,
        path_effects=[withStroke(linewidth=2.0, foreground="white")],
    )
