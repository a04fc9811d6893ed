"""An earliest time of arrival. A latest one is no constraint: the trip is to be as fast as it may be anyway."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from math import inf
from typing import ClassVar

import numpy as np

from scp_planner.arrays import Array, Index
from scp_planner.constraints.constraint import Constraint
from scp_planner.constraints.setup import Setup
from scp_planner.trips.trajectory import Trajectory

EARLIEST_MARGIN = 5e-4  # units of time, by which the trip is planned to arrive later than it has to, if it may


@dataclass(frozen=True)
class EarliestArrival(Constraint):
    """By how much a trip takes less than a travel time, s."""

    name: ClassVar[str] = "earliest arrival"

    travel_time: float

    def excess(self, trip: Trajectory) -> Array:
        return np.array([self.travel_time - trip.travel_time])

    def gradient(self, trip: Trajectory, index: Index) -> Array:
        count = len(index)
        return self.setup.of_drive(np.zeros((count, len(trip.beta))), np.full(count, -trip.travel_time))


def earliest_arrival(setup: Setup) -> Iterator[Constraint]:
    """Make the constraint of a goal that is not to be reached too early."""
    goal, start = setup.scenario.goal, setup.scenario.start.time
    if goal.earliest_arrival is not None and goal.earliest_arrival > start:
        latest = inf if goal.latest_arrival is None else goal.latest_arrival
        margin = min(EARLIEST_MARGIN, 0.5 * (latest - goal.earliest_arrival))
        yield EarliestArrival(setup, goal.earliest_arrival - start + margin)
