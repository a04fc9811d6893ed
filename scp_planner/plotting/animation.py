"""Animations: a recording played in real time."""

from __future__ import annotations

import math
from os import PathLike
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from scp_planner.files import replacing
from scp_planner.plotting.maps import draw_ends, draw_tracks, key_to_symbols, lay_out
from scp_planner.plotting.profiles import draw_clearance, draw_profile
from scp_planner.plotting.style import COLOURS, FAINT, INK, check_suffix, style
from scp_planner.recording import ObstacleRecord, Recording, Truth, record_plan

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from scp_planner.plan import Plan
    from scp_planner.scenario import Scenario

Array = NDArray[np.float64]

ANIMATION_SUFFIXES = (".gif", ".mp4")
MOST_FRAMES = 1200
WIDTH, PROFILES_HEIGHT = 7.2, 1.3
"""inches"""
DPI = 100


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
        What obstacles really did, see `scp_planner.recording.Truth`.
    frames_per_second : float
        1/s; less if the trip is very long. GIF players know only times of 1/100 s between frames.

    Raises
    ------
    ValueError
        If the suffix is another one, there is no ffmpeg, or `truth` names an unknown obstacle.
    """
    check_suffix(path, ANIMATION_SUFFIXES)
    frames = int(np.clip(math.ceil(plan.travel_time * frames_per_second), 2, MOST_FRAMES))
    animate(record_plan(plan, scenario, frames + 1, truth), path)


def animate(recording: Recording, path: str | PathLike[str], *, hold: float = 1.0) -> None:
    """Save an animation of a recording, in real time; each of its times is a frame.

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
    suffix = check_suffix(path, ANIMATION_SUFFIXES)
    count = len(recording.time)
    rate = (count - 1) / float(recording.time[-1] - recording.time[0])
    with style():
        writer = _writer(suffix, rate)
        film = Film(recording)
        with replacing(path) as temporary, writer.saving(film.figure, str(temporary), dpi=DPI):
            for index in [*range(count), *[count - 1] * round(hold * rate)]:
                film.show(index)
                writer.grab_frame()


class Film:
    """A figure of one time of a recording, to be moved from time to time.

    Parameters
    ----------
    recording : Recording

    Attributes
    ----------
    figure : matplotlib.figure.Figure
    """

    def __init__(self, recording: Recording) -> None:
        from matplotlib.figure import Figure

        low, high = recording.extent()
        height = float(np.clip(0.9 * WIDTH * (high[1] - low[1]) / (high[0] - low[0]), 1.2, 6.0)) + 0.6
        self.figure: Figure = Figure(figsize=(WIDTH, height + PROFILES_HEIGHT), dpi=DPI, layout="constrained")
        parts: Any = self.figure.subfigures(2, 1, height_ratios=[height, PROFILES_HEIGHT])
        map_part, profile_part = parts
        self._recording = recording
        axes: Axes = map_part.subplots()
        self._draw_map(axes)
        self._cursors = self._draw_profiles(list(profile_part.subplots(1, 3)))
        # Text of changing width must not make the axes jump: the layout of the first frame stays.
        self.show(0)
        self.figure.draw_without_rendering()
        self.figure.set_layout_engine("none")

    def show(self, index: int) -> None:
        """Move everything to one of the recording's times."""
        recording = self._recording
        self._title.set_text(f"{recording.name}   {recording.time[index] - recording.epoch:.1f} s")
        self._path.set_data(*recording.paths[recording.path_index[index]].T)
        self._done.set_data(*recording.position[: index + 1].T)
        x, y = recording.position[index]
        self._vehicle.set_center((x, y))
        for obstacle, shown in zip(recording.obstacles, self._shown, strict=True):
            shown.show(obstacle, index)
        for cursor, values in self._cursors:
            cursor.set_data([recording.time[index] - recording.epoch], [values[index]])

    def _draw_map(self, axes: Axes) -> None:
        from matplotlib.patches import Circle

        recording = self._recording
        lay_out(axes, recording)
        draw_tracks(axes, recording)
        draw_ends(axes, recording)
        key_to_symbols(recording).set_above(axes, "right")
        self._title = axes.set_title("", loc="left", fontweight="bold")
        (self._path,) = axes.plot([], [], color=FAINT, linewidth=2.0, zorder=2.5)
        (self._done,) = axes.plot([], [], color=INK, linewidth=2.0, zorder=2.6)
        self._vehicle = Circle(
            (0.0, 0.0), recording.radius, facecolor=INK, edgecolor="white", linewidth=0.8, zorder=4
        )
        axes.add_patch(self._vehicle)
        self._shown = [
            _ShownObstacle(axes, obstacle, COLOURS[number % len(COLOURS)])
            for number, obstacle in enumerate(recording.obstacles)
        ]

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
        for panel in panels:
            panel.locator_params(axis="y", nbins=3)
        mark: dict[str, Any] = {"markersize": 6, "color": COLOURS[0], "markeredgecolor": "white"}
        return [
            (panel.plot([], [], "o", clip_on=False, zorder=5, **mark)[0], values) for panel, values in drawn
        ]


class _ShownObstacle:
    """The patches of one obstacle: zone, shape where it is thought to be, shape where it really is."""

    def __init__(self, axes: Axes, obstacle: ObstacleRecord, colour: str) -> None:
        from matplotlib.patches import Polygon

        self._zone = Polygon(obstacle.zone_at(0), facecolor=(colour, 0.2), edgecolor=colour, zorder=2)
        self._thought = Polygon(obstacle.body_at(0), facecolor=(colour, 0.5), edgecolor="none", zorder=2.1)
        self._true = Polygon(obstacle.body_at(0), facecolor=(colour, 0.7), edgecolor=INK, zorder=3)
        for patch in (self._zone, self._thought, self._true):
            axes.add_patch(patch)

    def show(self, obstacle: ObstacleRecord, index: int) -> None:
        self._zone.set_xy(obstacle.zone_at(index))
        center = obstacle.truth_at(index)
        self._true.set_visible(center is not None)
        self._thought.set_visible(center is None)
        if center is None:
            self._thought.set_xy(obstacle.body_at(index))
        else:
            self._true.set_xy(obstacle.body_at(index, center))


def _writer(suffix: str, rate: float) -> Any:
    from matplotlib.animation import FFMpegWriter, PillowWriter

    if suffix == ".gif":
        return PillowWriter(fps=rate)  # type: ignore[arg-type]
    if not FFMpegWriter.isAvailable():
        raise ValueError(f"{suffix}: needs ffmpeg, which is not installed; .gif does without")
    # Most players know only colours at half the resolution, which ask for an even size.
    even = ["-vf", "pad=ceil(iw/2)*2:ceil(ih/2)*2", "-pix_fmt", "yuv420p"]
    return FFMpegWriter(fps=rate, extra_args=even)  # type: ignore[arg-type]
