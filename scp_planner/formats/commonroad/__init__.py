"""CommonRoad: its scenarios, plans for its models, and their solutions, as its official checker asks for them.

Start with the functions named here. Needs commonroad-io (the extra `commonroad`), of 2024 or newer.
"""

from scp_planner.formats.commonroad.planning import plan_commonroad
from scp_planner.formats.commonroad.reading import load_commonroad
from scp_planner.formats.commonroad.solution import export_commonroad_solution

__all__ = ["export_commonroad_solution", "load_commonroad", "plan_commonroad"]
