from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import TypeAlias

from scp_planner.constraints.arrival import earliest_arrival
from scp_planner.constraints.box import workspace
from scp_planner.constraints.clearance import clearance
from scp_planner.constraints.constraint import Constraint
from scp_planner.constraints.curvature import curvature
from scp_planner.constraints.curvature_rate import curvature_rate
from scp_planner.constraints.discs import discs
from scp_planner.constraints.drive import top_speed
from scp_planner.constraints.goals import goal_speed, open_goal
from scp_planner.constraints.jerk import jerk
from scp_planner.constraints.lateral import lateral_acceleration
from scp_planner.constraints.meeting import meetings
from scp_planner.constraints.passing import passing
from scp_planner.constraints.power import power
from scp_planner.constraints.setup import Setup
from scp_planner.constraints.speed_limits import speed_limits
from scp_planner.constraints.total_acceleration import total_acceleration

Maker: TypeAlias = Callable[[Setup], Iterable[Constraint]]

CONSTRAINTS: dict[str, Maker] = {
    "clearance": clearance,
    "lateral_acceleration": lateral_acceleration,
    "curvature": curvature,
    "speed": top_speed,
    "workspace bounds": workspace,
    "goal speed": goal_speed,
    "earliest arrival": earliest_arrival,
    "goal": open_goal,
    "goals": passing,
    "goals met": meetings,
    "speed_limits": speed_limits,
    "jerk": jerk,
    "curvature_rate": curvature_rate,
    "power": power,
    "total_acceleration": total_acceleration,
    "discs": discs,
}


def constraints_of(setup: Setup) -> tuple[Constraint, ...]:
    """Return all that a scenario asks for; clearance is the first."""
    return tuple(constraint for made in CONSTRAINTS.values() for constraint in made(setup))
