"""Tolerances that a certificate grants, and rounding that it allows for; in natural units if not said."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from scp_planner.scenario.models import Scenario
from scp_planner.scenario.scale import TOP_SPEED, TRIP_LENGTH
from scp_planner.trips.trip import Trip

RELATIVE_TOLERANCE = 1e-9  # of limits: rounding
BRAKING_SHARE = 1.0 - 1e-6  # of the strongest braking and jerk: an excess may fall by so much slower, for rounding
END_TOLERANCE = 1e-6  # of lengths, speeds and angles at the ends of the trip, in natural units and rad
GOAL_SPEED_TOLERANCE = 1e-3  # units of speed, of which the highest has three
LENGTH_TOLERANCE = 1e-9  # units of length: of clearances, and of positions against the trip that is certified
ARRIVAL_TOLERANCE = 1e-7  # of the travel time, around the earliest and latest arrival
STEP_TOLERANCE = 0.01  # of the step that the arrival is on
LARGEST_OFF_STEP = 1e-3  # units of time
ROUNDING = 2.0 * END_TOLERANCE  # of lengths and speeds: what is certified keeps its ends to END_TOLERANCE
SPEED_ROUNDING = 1e-8  # relative, of speeds and of distances driven
LEAST_TOP = 1e-9  # of the highest speed allowed: rounding, of a vehicle that stands
SHORTEST_CHECK = 1e-9  # normalised time that is checked
CELL_EDGE = 1e-9  # of a cell: places nearer than this to its edge are on both sides
ALIGNED = 1.0 - 1e-6  # of a step that moves by whole cells
NORMAL_OFFSET = 1e-9  # rad: support points are taken so far to both sides of an edge's normal
REPORT_PRECISION = 1e-3  # units of length: by how much the reported clearance may be below the true one
STANDING_TURN = 1e-3  # rad; by so much a direction in which a vehicle moves off may miss its heading, by interpolation


@dataclass(frozen=True)
class TripUnit:
    """Units of tolerances, in those of the scenario: a drive of 20 long at a top speed of 3 has 1 of each.

    They follow from the drive alone: a limit, a hint or an obstacle that it never comes near is the unit of nothing.
    """

    length: float = 1.0
    time: float = 1.0
    speed: float = 1.0

    @property
    def acceleration(self) -> float:
        """Unit of speed in a unit of time."""
        return self.speed / self.time

    @classmethod
    def of(cls, scenario: Scenario, length: float, duration: float, top: float) -> TripUnit:
        """Units of a drive of a length that takes a time and is no faster than a speed; no less than the vehicle."""
        vehicle = scenario.vehicle
        length = max(min(length, vehicle.max_speed * duration) / TRIP_LENGTH, vehicle.radius)
        speed = max(min(top, max(vehicle.max_speed, scenario.start.speed)), LEAST_TOP * vehicle.max_speed) / TOP_SPEED
        return cls(length, min(length / speed, duration * TOP_SPEED / TRIP_LENGTH), speed)

    @classmethod
    def of_trips(cls, scenario: Scenario, trips: Sequence[Trip]) -> TripUnit:
        """Units of a drive that consists of trips, each of which is one."""
        driven = [trip.trajectory for trip in trips]
        return cls.of(
            scenario,
            sum(one.driven_length for one in driven),
            sum(one.travel_time for one in driven),
            max(one.top_speed for one in driven),
        )
