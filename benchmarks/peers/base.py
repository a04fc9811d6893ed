"""What a peer is: built once for a family, then solved from a start; and how its answer is judged."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from benchmarks.peers.starts import Start
from scp_planner.arrays import Array
from verification.dense_check import check_trip
from verification.findings import DenseReport, Tolerances

Scenario = Mapping[str, Any]

# The same for every method. Clearance: 5 mm. The others are about a thousandth of the reference scenarios'
# limits: none of these methods is asked for more accuracy than its users would ask for.
JUDGE = Tolerances(
    clearance=5e-3,
    position=5e-3,
    heading=2e-3,
    boundary_speed=2e-3,
    speed=3e-3,
    acceleration=2e-3,
    lateral_acceleration=2e-3,
    curvature=1e-3,
)

# One start may take this long, s; a peer that allows it is stopped there, and the start counts as failed.
TIME_LIMIT = 20.0


class MissingPeerError(RuntimeError):
    """An optional package is not installed; the message names it and how to get it."""


@dataclass(frozen=True)
class Attempt:
    """What a method returned from one start.

    ``success`` is the method's own verdict. ``position`` maps times (n,) in s, on the scenario's clock, to
    positions (n, 2) in m; None if there is nothing to look at.
    """

    success: bool
    position: Callable[[Array], Array] | None
    start_time: float
    arrival_time: float
    iterations: int
    detail: str

    @property
    def travel_time(self) -> float:
        """Duration of the trip, s."""
        return self.arrival_time - self.start_time


class Peer(Protocol):
    """One method of planning."""

    name: str
    own_starts: bool  # it chooses its starts itself, and plans once

    def build(self, scenarios: Sequence[Scenario]) -> None:
        """Prepare whatever is shared by the scenarios of a family; not timed as planning."""

    def solve(self, scenario: Scenario, start: Start) -> Attempt:
        """Plan one trip from one start."""


def judge(scenario: Scenario, attempt: Attempt) -> DenseReport | None:
    """Dense check of an attempt with the tolerances that hold for all; None without a trip to check."""
    if attempt.position is None or not np.isfinite(attempt.arrival_time):
        return None
    if attempt.arrival_time <= attempt.start_time:
        return None
    return check_trip(scenario, attempt.position, attempt.start_time, attempt.arrival_time, tolerances=JUDGE)


def require_plain(scenario: Scenario) -> None:
    """Refuse scenarios beyond the reference families: the peers are written for those.

    Raises
    ------
    ValueError
        If an obstacle is not a disc with exact motion, or the goal is more than a position.
    """
    goal = scenario["goal"]
    if goal.get("heading") is not None or goal.get("speed") is not None or goal.get("radius"):
        raise ValueError(f"{scenario['name']}: the peers know goals that are a position only")
    if scenario.get("bounds") is not None or scenario.get("guide") is not None:
        raise ValueError(f"{scenario['name']}: the peers know neither bounds nor guides")
    for obstacle in scenario["obstacles"]:
        if "disc" not in obstacle["shape"] or obstacle.get("motion") is None:
            raise ValueError(f"{scenario['name']}: obstacle {obstacle['id']!r} is not a disc with exact motion")


def motion_row(motion: Mapping[str, Any]) -> list[float]:
    """Position, velocity and acceleration of a motion, SI units."""
    still = (0.0, 0.0)
    return [*motion["position"], *motion.get("velocity", still), *motion.get("acceleration", still)]


def disc_arrays(scenario: Scenario) -> Array:
    """Obstacles (n, 7): position, velocity, acceleration, and the distance to keep, SI units."""
    radius = float(scenario["vehicle"]["radius"])
    rows = []
    for obstacle in scenario["obstacles"]:
        motion = obstacle["motion"]
        keep = float(obstacle["shape"]["disc"]) + radius + float(obstacle.get("margin") or 0.0)
        rows.append([*motion_row(motion), keep])
    return np.array(rows, dtype=float).reshape(-1, 7)
