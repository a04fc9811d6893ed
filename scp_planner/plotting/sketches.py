"""Small pictures for notebooks, of what stands by itself."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from scp_planner.plotting.scales import unit_of, unit_of_rate
from scp_planner.plotting.style import GREY, INK, label_lengths, settle, style

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from scp_planner.planning.plan import Plan


def sketch_plan(plan: Plan) -> Figure:
    """Draw where a plan leads, in the colours of its speed, and its speed over time; no obstacles: a plan has none."""
    from matplotlib.collections import LineCollection
    from matplotlib.figure import Figure

    time = np.linspace(plan.start_time, plan.arrival_time, 300)
    position, speed = plan.position(time), plan.speed(time)
    with style():
        figure = Figure(figsize=(7.5, 2.6), dpi=110)
        figure.set_layout_engine("constrained", w_pad=0.06, h_pad=0.06)
        places, speeds = figure.subplots(1, 2, width_ratios=[3, 2])
        line = LineCollection(
            list(np.stack([position[:-1], position[1:]], axis=1)), cmap="cividis_r", linewidth=3.0, capstyle="round"
        )
        line.set_array(0.5 * (speed[:-1] + speed[1:]))
        places.add_collection(line)
        places.plot(*position[0], "o", color=INK, markersize=5)
        places.plot(*position[-1], "s", color=INK, markersize=5)
        places.set_aspect("equal", adjustable="datalim")
        places.margins(0.08)
        places.autoscale_view()
        unit = unit_of(float(np.ptp(position, axis=0).max()))
        label_lengths(places.xaxis, "x", unit)
        label_lengths(places.yaxis, "y", unit)
        pace = unit_of_rate("m/s", float(speed.max()))
        bar = figure.colorbar(line, ax=places, shrink=0.9)
        label_lengths(bar.ax.yaxis, "speed", pace)
        speeds.plot(time, speed, color=INK, linewidth=1.3)
        speeds.set_xlim(time[0], time[-1])
        speeds.set_ylim(0.0, 1.06 * float(speed.max()))
        speeds.set_xlabel("time (s)")
        label_lengths(speeds.yaxis, "speed", pace)
        speeds.axhline(0.0, color=GREY, linewidth=0.6)
        settle(figure)
    return figure
