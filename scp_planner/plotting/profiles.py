"""Quantities over time against their limits."""

from __future__ import annotations

from textwrap import wrap
from typing import TYPE_CHECKING

import numpy as np

from scp_planner.arrays import Array, Index
from scp_planner.plotting.drawn import length_of
from scp_planner.plotting.recording import Profile, Recording
from scp_planner.plotting.scales import unit_of, unit_of_rate
from scp_planner.plotting.style import GREY, INK, WARNING, colour_of, limit_times, tick_lengths, time_label

if TYPE_CHECKING:
    from matplotlib.axes import Axes


def draw_profiles(
    panels: list[Axes], recording: Recording, indices: Index, *, stacked: bool, fact_width: int = 36
) -> None:
    """Draw the facts, the profiles and the clearance, one a panel."""
    facts, *profiles, clearance = panels
    write_facts(facts, recording, fact_width)
    for axes, profile in zip(profiles, recording.profiles, strict=True):
        draw_profile(axes, recording, profile, indices)
    draw_clearance(clearance, recording, indices)
    bottom = panels[-1:] if stacked else panels[3:]
    for axes in panels[1:]:
        if axes not in bottom:
            axes.set_xlabel("")
            axes.tick_params(labelbottom=False)


def draw_profile(axes: Axes, recording: Recording, profile: Profile, indices: Index) -> None:
    """Draw one profile, its limits, and marks at some times."""
    values = profile.values
    limits = [limit for limit in (profile.lower, profile.upper) if limit is not None]
    low, high = min([*limits, values.min()]), max([*limits, values.max()])
    pad = 0.08 * (high - low) or 1.0
    for limit, edge in ((profile.lower, low - pad), (profile.upper, high + pad)):
        if limit is not None:
            _forbid(axes, limit, edge)
    if profile.upper_at is not None and profile.upper is not None:
        time = recording.time - recording.epoch
        axes.fill_between(time, profile.upper_at, profile.upper, color=WARNING, alpha=0.10, linewidth=0)
        axes.plot(time, profile.upper_at, color=WARNING, linewidth=0.9)
    axes.plot(recording.time - recording.epoch, values, color=INK, linewidth=1.3)
    unit = unit_of_rate(profile.unit, max(abs(low), abs(high)))
    _finish(axes, recording, unit.label(profile.name), low - pad, high + pad)
    tick_lengths(axes.yaxis, unit)
    _mark(axes, recording, values, indices)


def draw_clearance(axes: Axes, recording: Recording, indices: Index) -> None:
    """Draw the clearance to each zone and the least of them."""
    least = recording.clearance
    known = least[np.isfinite(least)]
    if len(known):
        for number, obstacle in enumerate([*recording.bodies, *(one for one in recording.obstacles if one.outside)]):
            colour = GREY if obstacle.outside else colour_of(number)
            axes.plot(recording.time - recording.epoch, obstacle.clearance, color=colour, linewidth=0.8)
        axes.plot(recording.time - recording.epoch, least, color=INK, linewidth=1.3)
        top = max(1.1 * float(known.max()), 2.0 * recording.radius)
        bottom = min(1.1 * float(known.min()), -0.06 * top)
        _mark(axes, recording, least, indices)
    else:
        bottom, top = -0.06, 1.0
        axes.text(0.5, 0.5, "no obstacles", transform=axes.transAxes, ha="center", va="center", color=GREY)
    _forbid(axes, 0.0, bottom)
    unit = unit_of(length_of(recording))
    _finish(axes, recording, unit.label("clearance to zones"), bottom, top)
    tick_lengths(axes.yaxis, unit)


def write_facts(axes: Axes, recording: Recording, width: int) -> None:
    """Write the scenario's name and what there is to tell of the whole."""
    axes.set_axis_off()
    axes.set_title(recording.name, loc="left", pad=3, fontweight="bold")
    texts = [wrap(text, width) for _, text in recording.facts]
    most, above = max(6, sum(len(lines) for lines in texts)), 0
    for (name, _), lines in zip(recording.facts, texts, strict=True):
        for k, line in enumerate(lines):
            y = 1.0 - (above + k + 0.75) / most
            if k == 0:
                axes.text(0.0, y, name, transform=axes.transAxes, color=GREY, fontsize=8, va="baseline")
            axes.text(0.36, y, line, transform=axes.transAxes, fontsize=8, va="baseline")
        above += len(lines)


def _finish(axes: Axes, recording: Recording, title: str, low: float, high: float) -> None:
    axes.set_title(title, loc="left", pad=3)
    axes.set_xlabel(time_label(recording.epoch))
    axes.set_ylim(low, high)
    axes.locator_params(axis="y", nbins=4)
    limit_times(axes, recording)


def _forbid(axes: Axes, limit: float, edge: float) -> None:
    axes.axhspan(limit, edge, color=WARNING, alpha=0.10, linewidth=0)
    axes.axhline(limit, color=WARNING, linewidth=0.9)


def _mark(axes: Axes, recording: Recording, values: Array, indices: Index) -> None:
    for index in indices:
        axes.plot(
            recording.time[index] - recording.epoch,
            values[index],
            "o",
            markersize=4.5,
            color=INK,
            markeredgecolor="white",
            markeredgewidth=0.5,
            clip_on=False,
            zorder=4,
        )
