"""Limits of a trip at all times, clearance aside: how far each is used, and whether it is kept."""

from __future__ import annotations

import numpy as np

from scp_planner.arrays import Array
from scp_planner.certificate.bounding import Bounded, largest
from scp_planner.certificate.checked_trip import Checked, CheckedTrip, EnclosedT, Finding
from scp_planner.certificate.enclosures import Enclosure, Pieces
from scp_planner.certificate.tolerances import END_TOLERANCE, RELATIVE_TOLERANCE
from scp_planner.certificate.verdict import LimitUse
from scp_planner.mathematics.refinement import highest
from scp_planner.scenario.limits import Limits
from scp_planner.scenario.places import Stretch, stretches


def limits_found(checked: CheckedTrip, limits: Limits, pieces: Pieces, enclosure: Enclosure) -> dict[str, Finding]:
    """Check all limits of a trip."""
    vehicle = checked.scenario.vehicle
    found = _speed_and_acceleration(checked, limits)
    for name, limit in (
        ("curvature", limits.curvature),
        ("lateral_acceleration", limits.lateral_acceleration),
        ("curvature_rate", vehicle.max_curvature_rate),
        ("total_acceleration", vehicle.max_total_acceleration),
        ("power", vehicle.max_power),
    ):
        if limit is not None:
            found[name] = _bend_limit(checked, name, limit, pieces, enclosure)
    if vehicle.max_jerk is not None:
        found["jerk"] = _jerk(checked, vehicle.max_jerk)
    return found | speed_limits_found(checked, pieces, enclosure)


def speed_limits_found(checked: Checked[EnclosedT], pieces: Pieces, enclosed: EnclosedT) -> dict[str, Finding]:
    """Check the limits of speed on stretches of lines."""
    parts = {f"speed_limits[{number}]": part for number, part in enumerate(stretches(checked.scenario))}
    return {name: _speed_limit(checked, name, part, pieces, enclosed) for name, part in parts.items()}


def keeps_speed_later(checked: CheckedTrip, limits: Limits) -> bool:
    """True if a trip is not too fast for a vehicle that is on its way, either."""
    top = max(limits.speed, checked.trajectory.space.start_speed)
    return float(checked.trajectory.speed_control_points().max()) <= top * (1 + RELATIVE_TOLERANCE)


def _speed_and_acceleration(checked: CheckedTrip, limits: Limits) -> dict[str, Finding]:
    trajectory = checked.trajectory
    basis, tau = trajectory.space.acceleration, trajectory.travel_time
    speeds = basis.antiderivative.combine(tau * trajectory.beta)
    speeds[:, 0] += trajectory.space.start_speed
    accelerations = basis.combine(trajectory.beta)
    top = max(limits.speed, checked.start_speed)
    fastest = _kept(checked, "speed", speeds, top)
    slowest = _kept(checked, "speed", speeds, 0.0, -1.0, RELATIVE_TOLERANCE * top)
    gained = _kept(checked, "acceleration", accelerations, limits.acceleration)
    lost = _kept(checked, "acceleration", accelerations, limits.deceleration, -1.0)
    gains = gained.use.worst / limits.acceleration >= -lost.use.worst / limits.deceleration
    return {
        "speed": Finding(
            LimitUse(fastest.use.worst, limits.speed, fastest.use.time), fastest.violations + slowest.violations
        ),
        "acceleration": Finding((gained if gains else lost).use, gained.violations + lost.violations),
    }


def _kept(
    checked: CheckedTrip,
    what: str,
    coefficients: Array,
    limit: float,
    sign: float = 1.0,
    tolerance: float | None = None,
) -> Finding:
    """Use of an upper limit by a piecewise polynomial of normalised time, times a sign."""
    basis = checked.trajectory.space.acceleration
    allowed = limit + (RELATIVE_TOLERANCE * limit if tolerance is None else tolerance)
    found = highest(sign * coefficients, allowed)
    sigma = float(basis.breakpoints[found.piece] + found.local * basis.widths[found.piece])
    return checked.finding(what, sign * found.value, sign * limit, sigma, kept=found.kept)


def _bounded(checked: CheckedTrip, name: str, enclosure: Enclosure) -> Bounded:
    match name:
        case "curvature":
            return Bounded(np.abs(enclosure.curvature), enclosure.curvature_bound)
        case "lateral_acceleration":
            return Bounded(np.abs(enclosure.lateral), enclosure.lateral_bound)
        case "curvature_rate":
            points = enclosure.path
            value = enclosure.speed * checked.trajectory.path.curvature_rate(points) / points.speed
            return Bounded(np.abs(value), enclosure.curvature_rate)
        case "total_acceleration":
            return Bounded(
                np.hypot(enclosure.acceleration, enclosure.lateral),
                np.hypot(enclosure.acceleration_bound, enclosure.lateral_bound),
            )
        case "power":
            return Bounded(np.maximum(enclosure.acceleration, 0.0) * enclosure.speed, enclosure.power_bound)
    raise AssertionError(name)


def _bend_limit(checked: CheckedTrip, name: str, limit: float, pieces: Pieces, enclosure: Enclosure) -> Finding:
    """Curvature, its rate, accelerations across or in total, or power."""
    checked.go_on()
    allowed = limit * (1.0 + RELATIVE_TOLERANCE)
    found = largest(checked, pieces, enclosure, allowed, lambda one: _bounded(checked, name, one), parts=4)
    return checked.finding(name, found.value, limit, found.when, kept=found.kept)


def _jerk(checked: CheckedTrip, limit: float) -> Finding:
    """The jerk by the ends of its pieces, which are straight: accelerations are quadratic at most."""
    trajectory = checked.trajectory
    basis, breaks = trajectory.space.acceleration, trajectory.space.acceleration.breakpoints
    if basis.coefficients.shape[1] == 1:
        jumps = np.abs(np.diff(trajectory.beta))
        worst = int(np.argmax(jumps)) if len(jumps) else 0
        sigma = float(breaks[1:-1][worst]) if len(jumps) else 0.0
        value = 1e12 if jumps.max(initial=0.0) > 0.0 else 0.0  # said of the jerk where the acceleration jumps
    else:
        pieces = basis.derivative.combine(trajectory.beta) / trajectory.travel_time
        ends = np.abs(np.concatenate([pieces[:, :1], pieces.sum(axis=1, keepdims=True)], axis=1))
        piece, end = np.unravel_index(int(np.argmax(ends)), ends.shape)
        sigma, value = float(breaks[piece + end]), float(ends[piece, end])
    return checked.finding("jerk", value, limit, sigma, kept=not value > limit * (1.0 + RELATIVE_TOLERANCE))


def _speed_limit(checked: Checked[EnclosedT], name: str, part: Stretch, pieces: Pieces, enclosed: EnclosedT) -> Finding:
    """The speed wherever the vehicle may be in a stretch of a line."""
    checked.go_on()
    allowed, driven = part.speed * (1.0 + RELATIVE_TOLERANCE), checked.followed(part.line)

    def speed_there(one: EnclosedT) -> Bounded:
        pace = one.pace
        position = checked.frame.to_world(pace.position)
        about = None if driven is None else np.interp(pace.progress, *driven)
        station = part.line.nearest(position, about)
        there = (station >= part.first) & (station <= part.last)
        fast = pace.fastest > allowed
        fast[fast] = part.line.may_be_between(
            position[fast],
            (pace.fastest * pace.half)[fast] + END_TOLERANCE * checked.unit.length,
            part.first,
            part.last,
            None if about is None else about[fast],
        )
        return Bounded(np.where(there, pace.speed, -np.inf), np.where(fast, pace.fastest, -np.inf))

    found = largest(checked, pieces, enclosed, allowed, speed_there, parts=2)
    return checked.finding(name, max(found.value, 0.0), part.speed, found.when, kept=found.kept)
