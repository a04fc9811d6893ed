"""Animations: a recording played in real time."""

from __future__ import annotations

import shutil
import subprocess
from collections.abc import Iterator
from itertools import pairwise
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from scp_planner.arrays import Array
from scp_planner.files import check_suffix, replacing
from scp_planner.plotting.maps import (
    NAMED,
    border_of,
    draw_ends,
    draw_key_above,
    draw_tracks,
    lay_out,
    outline_of,
    vehicle_patches,
)
from scp_planner.plotting.profiles import draw_clearance, draw_profile
from scp_planner.plotting.recording import ObstacleRecord, Recording, Truth, frame_count, record_plan
from scp_planner.plotting.style import COLOURS, FAINT, INK, LABEL, colour_of, halo, settle, style
from scp_planner.settings.pictures import FILM_SUFFIXES
from scp_planner.trips.trip import discs_at

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes

    from scp_planner.planning.plan import Plan
    from scp_planner.scenario.models import Scenario

Image = NDArray[np.uint8]

FILM_WIDTH, FILM_PROFILES_HEIGHT = 7.2, 1.75
"""inches"""
GIF_TICK = 0.01
"""s. Times between the frames of a GIF are whole multiples of it."""
UNCHANGED = 255
"""Colour number of what a frame of a GIF leaves as it is."""


def animate_plan(
    plan: Plan,
    scenario: Scenario,
    path: str | PathLike[str],
    *,
    truth: Truth | None = None,
    frames_per_second: float = 12.5,
) -> None:
    """Save an animation of a plan, in real time.

    Parameters
    ----------
    plan : Plan
    scenario : Scenario
    path : path
        .gif, or .mp4 if ffmpeg is installed.
    truth : mapping, optional
        What obstacles really did, see `scp_planner.plotting.recording.Truth`.
    frames_per_second : float
        1/s; less if the trip is very long.

    Raises
    ------
    ValueError
        If the suffix is another one, there is no ffmpeg, or `truth` names an unknown obstacle.
    """
    check_suffix(path, FILM_SUFFIXES)
    frames = frame_count(plan.travel_time, frames_per_second)
    animate(record_plan(plan, scenario, frames + 1, truth), path)


def animate(recording: Recording, path: str | PathLike[str], *, hold: float = 1.0) -> None:
    """Save an animation of a recording, in real time; each of its times, evenly spread, is a frame.

    Parameters
    ----------
    recording : Recording
    path : path
        .gif, or .mp4 if ffmpeg is installed.
    hold : float
        For how long the last frame stays, s.

    Raises
    ------
    ValueError
        If the suffix is another one, or there is no ffmpeg.
    """
    suffix = check_suffix(path, FILM_SUFFIXES)
    ffmpeg = shutil.which("ffmpeg")
    if suffix == ".mp4" and ffmpeg is None:
        raise ValueError(f"{path}: .mp4 needs ffmpeg, which is not installed; .gif does without")
    count = len(recording.time)
    interval = float(recording.time[-1] - recording.time[0]) / (count - 1)
    with style(), replacing(path) as temporary:
        film = Film(recording)
        frames = (film.frame(index) for index in range(count))
        if suffix == ".gif":
            _write_gif(temporary, frames, interval, hold)
        else:
            _write_video(str(ffmpeg), temporary, frames, interval, hold)


class Film:
    """A picture of one time of a recording, that can be moved from time to time."""

    def __init__(self, recording: Recording) -> None:
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure

        low, high = recording.extent()
        height = float(np.clip(0.9 * FILM_WIDTH * (high[1] - low[1]) / (high[0] - low[0]), 1.2, 6.0)) + 0.8
        figure = Figure(figsize=(FILM_WIDTH, height + FILM_PROFILES_HEIGHT), dpi=100)
        figure.set_layout_engine("constrained", w_pad=0.08, h_pad=0.08)
        parts: Any = figure.subfigures(2, 1, height_ratios=[height, FILM_PROFILES_HEIGHT])
        self._recording = recording
        self._moving: list[tuple[Axes, Artist]] = []
        self._draw_map(parts[0].subplots())
        self._cursors = self._draw_profiles(list(parts[1].subplots(1, 3)))
        # Lay out once, while what moves still counts: text of changing width must not make the axes jump.
        canvas: Any = FigureCanvasAgg(figure)
        self._move_to(0)
        settle(figure)
        for _, artist in self._moving:
            artist.set_animated(True)
        canvas.draw()
        self._canvas = canvas
        self._still = canvas.copy_from_bbox(figure.bbox)

    def frame(self, index: int) -> Image:
        """Draw one of the recording's times, (height, width, 3)."""
        self._move_to(index)
        self._canvas.restore_region(self._still)
        for axes, artist in self._moving:
            axes.draw_artist(artist)
        return np.asarray(self._canvas.buffer_rgba())[..., :3].copy()

    def _move_to(self, index: int) -> None:
        recording = self._recording
        time = recording.time[index] - recording.epoch
        self._title.set_text(f"{recording.name}   {time:.1f} s")
        self._path.set_data(*recording.paths[recording.path_index[index]].T)
        self._done.set_data(*recording.position[: index + 1].T)
        for disc, place in zip(self._vehicle, self._discs, strict=False):
            x, y = place[index]
            disc.set_center((x, y))
        if (body := recording.vehicle_at(index)) is not None:
            self._vehicle[-1].set_xy(body)
        for obstacle, patches in zip(recording.bodies, self._patches, strict=True):
            patches.move_to(obstacle, index)
        for cursor, values in self._cursors:
            cursor.set_data([time], [values[index]])

    def _draw_map(self, axes: Axes) -> None:
        recording = self._recording
        lay_out(axes, recording, *recording.extent())
        draw_tracks(axes, recording)
        draw_key_above(axes, recording)
        self._title = axes.set_title(" ", loc="left", fontweight="bold")
        self._patches = [
            _ObstaclePatches(axes, obstacle, colour_of(number), named=len(recording.bodies) <= NAMED)
            for number, obstacle in enumerate(recording.bodies)
        ]
        (self._path,) = axes.plot([], [], color=FAINT, linewidth=2.0)
        (self._done,) = axes.plot([], [], color=INK, linewidth=2.0)
        self._discs = discs_at(recording.position, recording.heading, recording.discs)
        self._vehicle: list[Any] = vehicle_patches(recording)
        for disc in self._vehicle:
            axes.add_patch(disc)
        moving: list[Artist] = [patch for patches in self._patches for patch in patches.all]
        moving += [self._path, self._done, *draw_ends(axes, recording), *self._vehicle, self._title]
        self._moving += [(axes, artist) for artist in (*moving, *(patches.name for patches in self._patches))]

    def _draw_profiles(self, panels: list[Axes]) -> list[tuple[Any, Array]]:
        """Draw the first profiles and the clearance; return a movable mark for each, with its values."""
        recording = self._recording
        unmarked = np.array([], dtype=np.intp)
        *profile_panels, clearance_panel = panels
        drawn = []
        for panel, profile in zip(profile_panels, recording.profiles, strict=False):
            draw_profile(panel, recording, profile, unmarked)
            drawn.append((panel, profile.values))
        draw_clearance(clearance_panel, recording, unmarked)
        if recording.obstacles:
            drawn.append((clearance_panel, recording.clearance))
        cursors: list[tuple[Any, Array]] = []
        for panel, values in drawn:
            panel.locator_params(axis="y", nbins=3)
            (cursor,) = panel.plot([], [], "o", markersize=6, color=COLOURS[0], markeredgecolor="white")
            cursor.set_clip_on(False)
            cursors.append((cursor, values))
            self._moving.append((panel, cursor))
        return cursors


class _ObstaclePatches:
    """One obstacle on the map: its zone, its shape where it is thought to be, and where it really is."""

    def __init__(self, axes: Axes, obstacle: ObstacleRecord, colour: str, *, named: bool) -> None:
        from matplotlib.patches import PathPatch, Polygon

        self._zone = PathPatch(outline_of(obstacle, 0), facecolor=(colour, 0.2), edgecolor="none")
        self._border = PathPatch(border_of(obstacle, 0), facecolor="none", edgecolor=colour)
        self._thought = Polygon(obstacle.body_at(0), facecolor=(colour, 0.5), edgecolor="none")
        self._true = Polygon(obstacle.body_at(0), facecolor=(colour, 0.7), edgecolor=INK)
        patches = (self._zone, self._border, self._thought, self._true)
        for patch in patches:
            axes.add_patch(patch)
        look: dict[str, Any] = {"ha": "center", "va": "bottom", "path_effects": halo(), **LABEL}
        self.name = axes.text(0.0, 0.0, obstacle.id if named else "", fontweight="bold", **look)
        self.all = patches

    def move_to(self, obstacle: ObstacleRecord, index: int) -> None:
        """Move to one of the recording's times."""
        self._zone.set_path(outline_of(obstacle, index))
        self._border.set_path(border_of(obstacle, index))
        center = obstacle.truth_at(index)
        self._true.set_visible(center is not None)
        self._thought.set_visible(center is None)
        body, patch = obstacle.body_at(index, center), self._thought if center is None else self._true
        patch.set_xy(body)
        self.name.set_visible(bool(np.isfinite(body).all()))
        self.name.set_position((float(body[:, 0].mean()), float(body[:, 1].max())))


def _write_gif(path: Path, frames: Iterator[Image], interval: float, hold: float) -> None:
    """Write a GIF whose frames share their colours and hold only what differs from the frame before."""
    from PIL import Image as images

    pictures = [images.fromarray(frame) for frame in frames]
    some = np.vstack([np.asarray(pictures[i]) for i in (0, len(pictures) // 2, -1)])
    common = images.fromarray(some).quantize(UNCHANGED)
    colours = np.array(common.getpalette()).reshape(-1, 3)
    colours[colours.min(axis=1) >= 248] = 255  # the background, or else only nearly white
    palette = colours.ravel().tolist()
    common.putpalette(palette)
    indexed = [np.array(picture.quantize(palette=common, dither=images.Dither.NONE)) for picture in pictures]
    changes = [np.where(new == old, np.uint8(UNCHANGED), new) for old, new in pairwise(indexed)]
    parts = [images.fromarray(part) for part in (indexed[0], *changes)]
    for part in parts:
        part.putpalette(palette)
    # The ticks of the times, not of the intervals, so that rounding does not add up.
    ticks = np.rint(interval / GIF_TICK * np.arange(len(parts) + 1)).astype(int)
    durations = np.maximum(np.diff(ticks), 2) * round(1000 * GIF_TICK)
    durations[-1] += round(1000 * hold)
    parts[0].save(
        path,
        save_all=True,
        append_images=parts[1:],
        duration=durations.tolist(),
        loop=0,
        disposal=1,
        transparency=UNCHANGED,
        optimize=False,
    )


def _write_video(ffmpeg: str, path: Path, frames: Iterator[Image], interval: float, hold: float) -> None:
    first = next(frames)
    height, width, _ = first.shape
    raw = ["-f", "rawvideo", "-pix_fmt", "rgb24", "-s", f"{width}x{height}", "-r", f"{1.0 / interval:.6f}"]
    # Most players know only colours at half the resolution, which asks for even sides.
    even = ["-vf", "pad=ceil(iw/2)*2:ceil(ih/2)*2", "-pix_fmt", "yuv420p"]
    command = [ffmpeg, "-loglevel", "error", "-y", *raw, "-i", "-", *even, str(path)]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        assert process.stdin is not None and process.stderr is not None
        last = first
        process.stdin.write(first.tobytes())
        for last in frames:
            process.stdin.write(last.tobytes())
        for _ in range(round(hold / interval)):
            process.stdin.write(last.tobytes())
        process.stdin.close()
        said = process.stderr.read().decode(errors="replace").strip()
    if process.returncode != 0:
        raise ValueError(f"{path}: ffmpeg failed: {said}")
