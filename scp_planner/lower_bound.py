"""Times that no trip can be shorter than."""

from __future__ import annotations

import numpy as np

from scp_planner.problem import Limits, straight_travel_time
from scp_planner.scenario import Scenario


def kinematic_bound(scenario: Scenario) -> float:
    """No trip is shorter than a straight one without obstacles, s, and none arrives before it may.

    Parameters
    ----------
    scenario : Scenario
    """
    time, _ = straight_travel_time(
        float(np.hypot(*np.subtract(scenario.goal.position, scenario.start.position))) - scenario.goal.radius,
        scenario.start.speed,
        Limits.of(scenario),
        scenario.goal.speed,
    )
    earliest = scenario.goal.earliest_arrival
    return time if earliest is None else max(time, earliest - scenario.start.time)
