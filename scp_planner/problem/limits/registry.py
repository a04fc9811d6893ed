"""Which optional limits there are: each makes what a scenario asks for of it.

To add one, write its file, with a subclass of `OptionalLimit` and a function that makes it, and name that here.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import TypeAlias

from scp_planner.problem.limits.arrival import earliest_arrival
from scp_planner.problem.limits.discs import disc_limits
from scp_planner.problem.limits.drive import power_limit, total_acceleration_limit
from scp_planner.problem.limits.goals import goal_limits
from scp_planner.problem.limits.inputs import LimitInputs
from scp_planner.problem.limits.limit import OptionalLimit
from scp_planner.problem.limits.rates import curvature_rate_limit, jerk_limit
from scp_planner.problem.limits.speed import speed_limits

Maker: TypeAlias = Callable[[LimitInputs], Iterable[OptionalLimit]]

LIMITS: dict[str, Maker] = {
    "earliest arrival": earliest_arrival,
    "goal": goal_limits,
    "speed_limits": speed_limits,
    "jerk": jerk_limit,
    "curvature_rate": curvature_rate_limit,
    "power": power_limit,
    "total_acceleration": total_acceleration_limit,
    "discs": disc_limits,
}
"""What makes them, by what they limit. A latest arrival is none: the trip is to be as fast as it may be anyway."""


def optional_limits(inputs: LimitInputs) -> tuple[OptionalLimit, ...]:
    """Return what a scenario asks for beyond what every trip keeps.

    Parameters
    ----------
    inputs : LimitInputs

    Returns
    -------
    tuple of OptionalLimit
    """
    return tuple(limit for made in LIMITS.values() for limit in made(inputs))
