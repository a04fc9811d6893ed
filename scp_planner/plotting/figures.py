"""The figures of a plan and of a closed loop."""

from __future__ import annotations

from os import PathLike
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from scp_planner.arrays import Array
from scp_planner.plotting.drawn import map_extent
from scp_planner.plotting.maps import draw_map
from scp_planner.plotting.profiles import draw_profiles
from scp_planner.plotting.recording import Recording, Truth, record_plan
from scp_planner.plotting.run_recording import record_run
from scp_planner.plotting.scales import nearest_indices, nice_times
from scp_planner.plotting.style import DPI, check_figure, finish, style

if TYPE_CHECKING:
    from matplotlib.figure import Figure, SubFigure

    from scp_planner.planning.plan import Plan
    from scp_planner.scenario.models import Scenario
    from scp_planner.simulation.run import Run

WIDTH, PROFILES_HEIGHT, PROFILES_WIDTH = 10.0, 3.4, 4.0
"""inches: of a figure with the profiles below the map; of the profiles below and beside it"""
SHOWN = 7
"""A map shows no more times than these."""


def plot_plan(
    plan: Plan,
    scenario: Scenario,
    path: str | PathLike[str] | None = None,
    *,
    truth: Truth | None = None,
    times: ArrayLike | None = None,
) -> Figure:
    """Draw a plan: the map at several times, and what the vehicle does against its limits.

    Parameters
    ----------
    plan : Plan
    scenario : Scenario
    path : path, optional
        Where to save the figure: .png, .pdf or .svg.
    truth : mapping, optional
        What obstacles really did, see `scp_planner.plotting.recording.Truth`.
    times : (n,) array, optional
        Absolute times to show on the map, s, at most 7; default: up to 6 round ones.

    Returns
    -------
    matplotlib.figure.Figure

    Raises
    ------
    ValueError
        If the suffix is another one, there are too many times, or `truth` names an unknown obstacle.
    """
    check_figure(path)
    shown = _shown(times, plan.start_time, plan.arrival_time)
    grid = np.linspace(plan.start_time, plan.arrival_time, 300)
    recording = record_plan(plan, scenario, np.union1d(grid, shown), truth)
    return _plot_recording(recording, shown, path)


def plot_run(run: Run, path: str | PathLike[str] | None = None, *, times: ArrayLike | None = None) -> Figure:
    """Draw a closed loop: what was driven and planned, the zones as they were known, and what really was.

    Parameters
    ----------
    run : Run
    path : path, optional
        Where to save the figure: .png, .pdf or .svg.
    times : (n,) array, optional
        Absolute times to show on the map, s, at most 7; default: up to 6 round ones.

    Returns
    -------
    matplotlib.figure.Figure

    Raises
    ------
    ValueError
        If the suffix is another one, or there are too many times.
    """
    check_figure(path)
    shown = _shown(times, float(run.time[0]), float(run.time[-1]))
    return _plot_recording(record_run(run, times=shown), shown, path)


def plot_profiles(
    plan: Plan, scenario: Scenario, path: str | PathLike[str] | None = None, *, truth: Truth | None = None
) -> Figure:
    """Draw speed, accelerations, curvature and clearance of a plan over time, against their limits.

    Parameters
    ----------
    plan : Plan
    scenario : Scenario
    path : path, optional
        Where to save the figure: .png, .pdf or .svg.
    truth : mapping, optional
        What obstacles really did, see `scp_planner.plotting.recording.Truth`.

    Returns
    -------
    matplotlib.figure.Figure

    Raises
    ------
    ValueError
        If the suffix is another one, or `truth` names an unknown obstacle.
    """
    check_figure(path)
    return _plot_profiles(record_plan(plan, scenario, 300, truth), path)


def plot_run_profiles(run: Run, path: str | PathLike[str] | None = None) -> Figure:
    """Draw speed, accelerations, curvature and clearance of a closed loop over time, against their limits.

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
    check_figure(path)
    return _plot_profiles(record_run(run), path)


def _shown(times: ArrayLike | None, start: float, end: float) -> Array:
    if times is None:
        return nice_times(start, end)
    if np.ndim(times) != 1 or not 1 <= np.size(times) <= SHOWN:
        raise ValueError(f"times: must be 1 to {SHOWN} times, not an array of shape {np.shape(times)}")
    return np.clip(np.asarray(times, dtype=float), start, end)


def _plot_recording(recording: Recording, shown: Array, path: str | PathLike[str] | None) -> Figure:
    indices = nearest_indices(recording.time, shown)
    with style():
        box = map_extent(recording, indices)
        figure, map_part, profile_part, narrow = _parts(box)
        panels = profile_part.subplots(6, 1) if narrow else profile_part.subplots(2, 3)
        draw_map(map_part.subplots(), recording, indices, box, narrow=narrow)
        draw_profiles(list(panels.ravel()), recording, indices, stacked=narrow)
        return finish(figure, path)


def _plot_profiles(recording: Recording, path: str | PathLike[str] | None) -> Figure:
    from matplotlib.figure import Figure

    with style():
        figure = Figure(figsize=(7.5, 8.5), dpi=DPI)
        figure.set_layout_engine("constrained", w_pad=0.06, h_pad=0.06)
        panels = list(figure.subplots(6, 1, height_ratios=[0.9, 1, 1, 1, 1, 1]))
        draw_profiles(panels, recording, np.array([], dtype=np.intp), stacked=True, fact_width=80)
        return finish(figure, path)


def _parts(extent: tuple[Array, Array]) -> tuple[Figure, SubFigure, SubFigure, bool]:
    """Make a figure with a part for the map and one, below or beside it, for the profiles."""
    from matplotlib.figure import Figure

    low, high = extent
    aspect = float((high[1] - low[1]) / (high[0] - low[0]))
    # A higher map has the profiles beside it.
    narrow = aspect > 0.9
    parts: Any
    if narrow:
        map_width = float(np.clip(6.3 / aspect, 2.8, 6.2)) + 1.4
        figure = Figure(figsize=(map_width + PROFILES_WIDTH, 7.5), dpi=DPI)
        parts = figure.subfigures(1, 2, width_ratios=[map_width, PROFILES_WIDTH])
    else:
        map_height = float(np.clip(0.92 * WIDTH * aspect, 1.5, 6.5)) + 0.75
        figure = Figure(figsize=(WIDTH, map_height + PROFILES_HEIGHT), dpi=DPI)
        parts = figure.subfigures(2, 1, height_ratios=[map_height, PROFILES_HEIGHT])
    figure.set_layout_engine("constrained", w_pad=0.06, h_pad=0.06)
    return figure, parts[0], parts[1], narrow
