"""Scale of length and time of a scene, behind its natural units."""

from __future__ import annotations

from math import dist, frexp, ldexp, sqrt
from typing import Any

from scp_planner.units import Units

TRIP_LENGTH = 20.0  # units of length
TOP_SPEED = 3.0  # units of length in a unit of time
UNIT_BITS, FEWEST_UNIT_BITS = 46, 36  # of a unit: as many as a scene tells; the fewer, the farther away it is moved


def units_of(scenario: Any, trip: float | None = None) -> Units:
    """Return the units of a scene: by the length of its trip, m, and the highest speed that can be reached on it."""
    vehicle, start = scenario.vehicle, scenario.start
    if trip is None:
        line = scenario.guide or (scenario.goal.position,)
        trip = max(dist(start.position, point) for point in line)  # however winding it is
    away = frexp(max(map(abs, start.position)) / trip)[1]
    bits = min(max(UNIT_BITS - away, FEWEST_UNIT_BITS), UNIT_BITS)
    length = _short(trip / TRIP_LENGTH, bits)
    top = max(min(vehicle.max_speed, _within_reach(scenario, trip)), start.speed)
    return Units(length, _short(TOP_SPEED * length / top, bits), start.position, start.time)


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
