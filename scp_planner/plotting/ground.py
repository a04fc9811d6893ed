"""The ground of a map: where the vehicle may not be, where it may not be fast, and the guide."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from scp_planner.arrays import Array
from scp_planner.mathematics.convex_pieces import in_convex
from scp_planner.mathematics.occupancy import OccupancyMap
from scp_planner.plotting.borders import borders_of
from scp_planner.plotting.recording import Recording
from scp_planner.plotting.style import FORBIDDEN, GREY, SLOW, SLOW_TEXT, halo
from scp_planner.scenario.places import limits_at

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.path import Path

CELLS = 320
"""Slow places are told from others at so many points along the longer side of a map."""

FORBIDDEN_LOOK: dict[str, Any] = {"facecolor": FORBIDDEN, "edgecolor": GREY, "hatch": "////"}
SLOW_LOOK: dict[str, Any] = {"facecolor": (SLOW, 0.30), "edgecolor": SLOW, "hatch": "..", "linewidth": 0.0}
LANE_LOOK: dict[str, Any] = {"color": GREY, "linewidth": 0.6, "alpha": 0.7}
GUIDE_LOOK: dict[str, Any] = {"color": GREY, "linewidth": 0.9, "linestyle": (0, (6, 2, 1, 2))}


def draw_ground(axes: Axes, recording: Recording, low: Array, high: Array) -> None:
    """Draw what stands: bounds, corridor, walls, lanes, slow places and guide; what is forbidden is hatched."""
    from matplotlib.patches import PathPatch, Polygon, Rectangle

    # All below the grid, which has 0.5.
    if recording.corridor:
        _forbid_box(axes, low, high, 0.1)
        for polygon in recording.corridor:
            axes.add_patch(Polygon(polygon, facecolor="white", edgecolor="none", zorder=0.15))
    _draw_slow(axes, recording, low, high)
    if recording.bounds is not None:
        corner, opposite = (np.asarray(each, dtype=float) for each in recording.bounds)
        left, right = np.clip([corner[0], opposite[0]], low[0], high[0])
        _forbid_box(axes, low, np.array([left, high[1]]), 0.3)
        _forbid_box(axes, np.array([right, low[1]]), high, 0.3)
        _forbid_box(axes, np.array([left, low[1]]), np.array([right, corner[1]]), 0.3)
        _forbid_box(axes, np.array([left, opposite[1]]), np.array([right, high[1]]), 0.3)
        sides = opposite - corner
        axes.add_patch(
            Rectangle((float(corner[0]), float(corner[1])), *sides, fill=False, edgecolor=GREY, linewidth=1.4, zorder=1)
        )
    if recording.corridor:
        border = path_of(borders_of(list(recording.corridor)))
        axes.add_patch(PathPatch(border, facecolor="none", edgecolor=GREY, linewidth=1.4, zorder=1))
    for lane in recording.lanes:
        axes.plot(*lane.T, **LANE_LOOK, zorder=0.9)
    if recording.map is not None:
        _draw_cells(axes, recording.map, low, high)
    for wall in recording.walls:
        axes.add_patch(Polygon(wall, **FORBIDDEN_LOOK, linewidth=1.0, zorder=1))
    if recording.guide is not None:
        axes.plot(*recording.guide.T, **GUIDE_LOOK, zorder=1.2)


def _draw_cells(axes: Axes, ground: OccupancyMap, low: Array, high: Array) -> None:
    """Draw the occupied cells of the part of a map that is in the picture."""
    from matplotlib.colors import ListedColormap
    from matplotlib.transforms import Affine2D

    corners = ground.local(np.array([low, high, [low[0], high[1]], [high[0], low[1]]]))
    first, last = np.floor(corners.min(axis=0)).astype(np.intp), np.floor(corners.max(axis=0)).astype(np.intp)
    cells = ground.window(first, last)
    turned = Affine2D().scale(ground.resolution).rotate(ground.yaw).translate(*ground.origin)
    axes.imshow(
        np.where(cells, 0.0, np.nan),
        cmap=ListedColormap([GREY]),
        extent=(float(first[0]), float(last[0] + 1), float(first[1]), float(last[1] + 1)),
        origin="lower",
        interpolation="nearest",
        transform=turned + axes.transData,
        zorder=0.95,
    )
    axes.set_xlim(low[0], high[0])
    axes.set_ylim(low[1], high[1])


def has_forbidden(recording: Recording) -> bool:
    """True if there is ground that the vehicle may not be on."""
    return bool(recording.corridor or recording.walls or recording.map or recording.bounds is not None)


def slow_cells(recording: Recording, x: Array, y: Array) -> Array:
    """Speed limits by place at the points of a grid, (len(y), len(x)) m/s; inf where there is none."""
    points = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    limits = limits_at(recording.stretches, points)
    if recording.corridor:
        limits[~np.any([in_convex(polygon, points) for polygon in recording.corridor], axis=0)] = np.inf
    if recording.bounds is not None:
        corner, opposite = recording.bounds
        limits[((points < corner) | (points > opposite)).any(axis=1)] = np.inf
    return limits.reshape(len(y), len(x))


def slow_boxes(recording: Recording, low: Array, high: Array) -> dict[float, list[Array]]:
    """Cover slow places with boxes that do not overlap."""
    if not recording.stretches:
        return {}
    cell = float((high - low).max()) / CELLS
    x, y = (np.arange(start + 0.5 * cell, end, cell) for start, end in zip(low, high, strict=True))
    limits = slow_cells(recording, x, y)
    found: dict[float, list[Array]] = {}
    for speed in sorted(set(limits[np.isfinite(limits)].tolist())):
        slow = np.pad(limits == speed, ((0, 1), (1, 1)))
        below, since = slow[-1], 0
        for row, here in enumerate(slow):
            if (here != below).any():
                edges = np.flatnonzero(np.diff(below.astype(int))).reshape(-1, 2)
                found.setdefault(speed, []).extend(
                    low + cell * np.array([[left, since], [right, row]]) for left, right in edges
                )
                below, since = here, row
    return found


def path_of(bits: Array) -> Path:
    """Give a path of bits of a border, (n, 2, 2) m."""
    from matplotlib.path import Path

    return Path(bits.reshape(-1, 2), np.tile([Path.MOVETO, Path.LINETO], len(bits)))


def _forbid_box(axes: Axes, low: Array, high: Array, zorder: float) -> None:
    from matplotlib.patches import Rectangle

    if (high > low).all():
        corner, (width, height) = (float(low[0]), float(low[1])), high - low
        axes.add_patch(Rectangle(corner, width, height, **FORBIDDEN_LOOK, linewidth=0.0, zorder=zorder))


def _draw_slow(axes: Axes, recording: Recording, low: Array, high: Array) -> None:
    """Fill where the speed is limited, and write there how fast the vehicle may be."""
    if not recording.stretches:
        return
    cell = float((high - low).max()) / CELLS
    x, y = (np.arange(start, end + cell, cell) for start, end in zip(low, high, strict=True))
    limits = slow_cells(recording, x, y)
    for speed in sorted(set(limits[np.isfinite(limits)].tolist())):
        here = limits == speed
        region = axes.contourf(
            x, y, here.astype(float), levels=[0.5, 1.5], zorder=0.2, colors=[(SLOW, 0.30)], hatches=[".."]
        )
        region.set_edgecolor((SLOW, 1.0))
        region.set_linewidth(0.0)
        _write_limit(
            axes, recording, np.stack(np.meshgrid(x, y), axis=-1)[here], f"\N{LESS-THAN OR EQUAL TO}{speed:.3g} m/s"
        )


def _write_limit(axes: Axes, recording: Recording, places: Array, text: str) -> None:
    """Write a limit where it holds, as far from the trip as there is room."""
    (left, right), (bottom, top) = axes.get_xlim(), axes.get_ylim()
    room = 0.06 * max(right - left, top - bottom)
    x, y = places.T
    fits = (x > left + room) & (x < right - room) & (y > bottom + 0.5 * room) & (y < top - 0.5 * room)
    if not fits.any():
        return
    places = places[fits]
    # Equally far ones: the middle of them.
    away = np.min(
        np.linalg.norm(places[:, None] - recording.position[:: max(1, len(recording.position) // 40)], axis=2), axis=1
    )
    far = places[away > 0.98 * away.max()]
    x, y = far[np.argmin(np.linalg.norm(far - far.mean(axis=0), axis=1))]
    axes.annotate(
        text,
        (x, y),
        ha="center",
        va="center",
        fontsize=7.5,
        color=SLOW_TEXT,
        zorder=1.9,
        path_effects=halo(),
    )
