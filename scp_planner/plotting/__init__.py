"""Pictures and animations of plans.

Colours are safe for colour-blind readers. matplotlib is imported by the functions that draw; its global state
(pyplot, rcParams) is left alone.
"""

from __future__ import annotations

from scp_planner.plotting.animation import animate, animate_plan
from scp_planner.plotting.figures import plot_plan
from scp_planner.plotting.space_time import plot_space_time

__all__ = ["animate", "animate_plan", "plot_plan", "plot_space_time"]
