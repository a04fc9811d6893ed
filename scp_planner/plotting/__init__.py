"""Pictures and animations of plans and closed loops.

Colours are safe for colour-blind readers. matplotlib is imported by the functions that draw; its global state
(pyplot, rcParams) is left alone.

May import plans, runs and all below. Begin with `views`; a `recording` is what pictures show.
"""

from __future__ import annotations

from scp_planner.plotting.animation import animate, animate_plan
from scp_planner.plotting.figures import plot_plan, plot_profiles, plot_run, plot_run_profiles
from scp_planner.plotting.space_time import plot_run_space_time, plot_space_time
from scp_planner.settings.pictures import View

__all__ = [
    "View",
    "animate",
    "animate_plan",
    "plot_plan",
    "plot_profiles",
    "plot_run",
    "plot_run_profiles",
    "plot_run_space_time",
    "plot_space_time",
]
