"""CommonRoad: its scenarios, plans for its models, and their solutions, as its official checker asks for them.

Start with `reading.load_commonroad`, `planning.plan_commonroad` and `solution.export_commonroad_solution`, which are
names of this package, too. `roads`, `lines`, `goals` and `obstacles` say what of a file becomes what, `cars` and
`checker` know the benchmark's vehicles and how they are judged. Needs commonroad-io (the extra `commonroad`).
"""

from scp_planner.formats.commonroad.planning import plan_commonroad
from scp_planner.formats.commonroad.reading import load_commonroad
from scp_planner.formats.commonroad.solution import export_commonroad_solution

__all__ = ["export_commonroad_solution", "load_commonroad", "plan_commonroad"]
