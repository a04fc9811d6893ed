"""The figure of a plan."""

from __future__ import annotations

from os import PathLike
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from scp_planner.plotting.maps import draw_map
from scp_planner.plotting.profiles import draw_profiles
from scp_planner.plotting.style import COLOURS, FIGURE_SUFFIXES, check_suffix, save, settle, style
from scp_planner.recording import Recording, Truth, nearest_indices, nice_times, record_plan

if TYPE_CHECKING:
    from matplotlib.figure import Figure, SubFigure

    from scp_planner.plan import Plan
    from scp_planner.scenario import Scenario

SAMPLES = 300
DPI = 150
WIDTH, PROFILES_HEIGHT, PROFILES_WIDTH = 10.0, 3.4, 4.0
"""inches: of a figure with the profiles below the map; of the profiles below and beside it"""
NARROW = 0.9
"""A map higher than this part of its width has the profiles beside it."""


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
        What obstacles really did, see `scp_planner.recording.Truth`.
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
    if path is not None:
        check_suffix(path, FIGURE_SUFFIXES)
    if times is None:
        shown = nice_times(plan.start_time, plan.arrival_time)
    else:
        shown = np.clip(np.asarray(times, dtype=float), plan.start_time, plan.arrival_time)
    if shown.ndim != 1 or not 1 <= len(shown) <= len(COLOURS):
        raise ValueError(f"times: must be 1 to {len(COLOURS)} times, not an array of shape {shown.shape}")
    grid = np.linspace(plan.start_time, plan.arrival_time, SAMPLES)
    recording = record_plan(plan, scenario, np.union1d(grid, shown), truth)
    indices = nearest_indices(recording.time, shown)
    with style():
        figure, map_part, profile_part, narrow = _parts(recording)
        panels = profile_part.subplots(6, 1) if narrow else profile_part.subplots(2, 3)
        draw_map(map_part.subplots(), recording, indices, narrow=narrow)
        draw_profiles(list(panels.ravel()), recording, indices, stacked=narrow)
        settle(figure)
        if path is not None:
            save(figure, path)
    return figure


def _parts(recording: Recording) -> tuple[Figure, SubFigure, SubFigure, bool]:
    """Make a figure with a part for the map and one, below or beside it, for the profiles."""
    from matplotlib.figure import Figure

    low, high = recording.extent()
    aspect = float((high[1] - low[1]) / (high[0] - low[0]))
    narrow = aspect > NARROW
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
