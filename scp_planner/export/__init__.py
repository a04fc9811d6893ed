"""Plans and runs in the forms that other programs read: tables, and messages of the Robot Operating System (ROS).

May import plans, runs and all below. Begin with `files`.
"""

from __future__ import annotations

from scp_planner.export.files import EXPORT_SUFFIXES, export_plan, export_run
from scp_planner.export.foxglove import save_scene
from scp_planner.export.ros import plan_messages, run_messages, save_messages
from scp_planner.export.tables import cycle_table, plan_table, run_table, save_table

__all__ = [
    "EXPORT_SUFFIXES",
    "cycle_table",
    "export_plan",
    "export_run",
    "plan_messages",
    "plan_table",
    "run_messages",
    "run_table",
    "save_messages",
    "save_scene",
    "save_table",
]
