"""Scale of length and time of a scene, behind its natural units."""

from __future__ import annotations

from math import atan2, dist, frexp, ldexp, pi, sqrt
from typing import Any

from scp_planner.mathematics.dubins import Pose, shortest_paths
from scp_planner.units import Units

TRIP_LENGTH = 20.0  # units of length
TOP_SPEED = 3.0  # units of length in a unit of time
SHORTEST_TRIP = 1e-3  # radii of the vehicle; a goal where it stands is not the scale of anything
OTHER_LENGTH = 2.0  # times or parts of the straight way, from which on a trip's own length is the scale
LOOPS = 4.0 * pi  # radii, beyond which no shortest way is so much longer than the straight one
UNIT_BITS, FEWEST_UNIT_BITS = 46, 36  # of a unit: as many as a scene tells; the fewer, the farther away it is moved


def units_of(scenario: Any, trip: float | None = None) -> Units:
    """Return the units of a scene: by the length of its trip, m, and the highest speed that can be reached on it."""
    vehicle, start = scenario.vehicle, scenario.start
    if trip is None:
        line = scenario.guide or (scenario.goal.position,)
        trip = max(dist(start.position, point) for point in line)  # however winding it is
        trip = _loop(scenario, trip) or trip
    trip = max(trip, SHORTEST_TRIP * vehicle.radius)
    away = frexp(max(map(abs, start.position)) / trip)[1]
    bits = min(max(UNIT_BITS - away, FEWEST_UNIT_BITS), UNIT_BITS)
    length = _short(trip / TRIP_LENGTH, bits)
    top = max(min(vehicle.max_speed, _within_reach(scenario, trip)), start.speed)
    return Units(length, _short(TOP_SPEED * length / top, bits), start.position, start.time)


def _loop(scenario: Any, straight: float) -> float | None:
    """Length of the shortest way of a vehicle that has to turn about, m, if it is much longer than the straight one."""
    vehicle, start, goal = scenario.vehicle, scenario.start, scenario.goal
    bends = vehicle.max_curvature and vehicle.steering == "ahead" and start.heading is not None
    if not bends or scenario.guide or straight * vehicle.max_curvature > LOOPS:
        return None
    toward = atan2(goal.position[1] - start.position[1], goal.position[0] - start.position[0])
    first, last = (None if one.heading is None else one.heading - toward for one in (start, goal))
    # In radii, along the straight way: so that it is the same in a scene that is moved, turned or scaled
    ends = Pose((0.0, 0.0), first), Pose((straight * vehicle.max_curvature, 0.0), last)
    length = min(path.length for path in shortest_paths(*ends, 1.0).values()) / vehicle.max_curvature
    return length if length > OTHER_LENGTH * straight else None


def _short(unit: float, bits: int) -> float:
    """A unit with its last bits rounded away, which a scene that is moved, turned or scaled has different."""
    mantissa, exponent = frexp(unit)
    return ldexp(round(ldexp(mantissa, bits)), exponent - bits)


def _within_reach(scenario: Any, trip: float) -> float:
    """Highest speed that can be reached on a trip of a length, m/s, and left again for that at the goal."""
    start, end = scenario.start.speed, scenario.goal.speed
    a, d = scenario.vehicle.max_acceleration, scenario.vehicle.max_deceleration
    if end is None:
        return sqrt(start * start + 2.0 * a * trip)  # not by a power: that is not rounded alike in all units
    return sqrt((2.0 * a * d * trip + d * start * start + a * end * end) / (a + d))
