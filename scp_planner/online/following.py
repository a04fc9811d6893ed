"""Distance between the vehicle and its plan, and the allowance for it."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from scp_planner.certificate.ends import can_reverse
from scp_planner.online.remaining import State
from scp_planner.online.stops import braking_of
from scp_planner.online.tolerances import OFF
from scp_planner.scenario.models import Vehicle
from scp_planner.scenario.scale import TOP_SPEED
from scp_planner.settings.online import OnlineSettings
from scp_planner.threat_zones.error_tube import TrackingTube
from scp_planner.trips.trip import Trip


@dataclass(frozen=True)
class Deviation:
    """Distance, m, and differences of speed, m/s, and heading, rad, between a reported state and a trip."""

    distance: float
    speed: float
    heading: float

    @classmethod
    def of(cls, state: State, trip: Trip, vehicle: Vehicle) -> Deviation:
        points, _ = trip.at(np.array([state.time]))
        (place,) = trip.frame.to_world(points.path.position).tolist()
        heading = 0.0
        if state.heading is not None:
            (ahead,) = trip.frame.vectors_to_world(points.path.direction).tolist()
            either = can_reverse(vehicle, max(state.speed, float(points.speed[0])))
            turn = state.heading - math.atan2(ahead[1], ahead[0])
            heading = abs(math.remainder(turn, math.pi if either else 2.0 * math.pi))
        return cls(math.dist(place, state.position), abs(state.speed - float(points.speed[0])), heading)


def larger(vehicle: Vehicle, tube: TrackingTube | None) -> Vehicle:
    """Return a vehicle larger by what it may be off when it stands."""
    return vehicle if tube is None else vehicle.model_copy(update={"radius": vehicle.radius + tube.standing})


@dataclass(frozen=True)
class Following:
    vehicle: Vehicle  # As `larger` makes it
    largest: float  # The most that it may be off, m
    speed: float | None = None  # The most that its speed may be off, m/s; None: what `allows` derives
    heading: float | None = None  # The most that its heading may be off, rad; None: what `allows` derives
    tube: TrackingTube | None = None

    @classmethod
    def of(cls, vehicle: Vehicle, online: OnlineSettings, tube: TrackingTube | None) -> Following:
        """Return how a vehicle follows by its settings, or in a tube in place of their tracking error."""
        if tube is None:
            return cls(vehicle, online.tracking_error, online.speed_error, online.heading_error)
        within = replace(tube, standing=0.0)
        return cls(vehicle, tube.bound(vehicle), online.speed_error, online.heading_error, within)

    @property
    def room(self) -> float:
        """The most that it may be off besides when it drives, m."""
        return 0.0 if self.tube is None else self.tube.bound(self.vehicle)

    @property
    def top_speed(self) -> float:
        """Highest speed that the vehicle reaches in its scene, m/s."""
        return min(self.vehicle.max_speed, TOP_SPEED)

    def allows(self, off: Deviation) -> bool:
        # A stop at once from the reported state ends within d + T dv + V T dh / 2 of the plan's own stop: d is the
        # distance, dv and dh are the differences of speed and heading, T is the time of a stop from the top speed V.
        # A tolerance that the follower states replaces its term.
        top, apart = self.top_speed, off.distance
        stopping = braking_of(self.vehicle).time(top)
        if self.speed is None:
            apart += stopping * off.speed
        elif off.speed > self.speed + OFF:
            return False
        if self.heading is None:
            apart += 0.5 * stopping * top * off.heading
        elif off.heading > self.heading + OFF:
            return False
        return apart <= self.largest + OFF
