"""Limits of a trip at all times, clearance aside: how far each is used, and whether it is kept."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from scp_planner.arrays import Array
from scp_planner.certificate.bounding import Bounded, largest
from scp_planner.certificate.checked_trip import Checked, CheckedTrip, EnclosedT, Finding
from scp_planner.certificate.enclosures import Enclosure, Pieces
from scp_planner.certificate.excess import cubics
from scp_planner.certificate.tolerances import END_TOLERANCE, RELATIVE_TOLERANCE
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


def _speed_and_acceleration(checked: CheckedTrip, limits: Limits) -> dict[str, Finding]:
    trajectory, tau = checked.trajectory, checked.trajectory.travel_time
    start_speed = trajectory.space.start_speed
    speeds = trajectory.space.acceleration.antiderivative.combine(tau * trajectory.beta)
    speeds[:, 0] += start_speed
    speed = _Curve(speeds, trajectory.speed_at, lambda: checked.hardest_stop.slows_to(limits.speed))
    fastest = _kept(checked, "speed", speed, limits.speed)
    slowest = _kept(checked, "speed", speed, 0.0, -1.0, RELATIVE_TOLERANCE * max(limits.speed, start_speed))
    acceleration = _Curve(
        trajectory.space.acceleration.combine(trajectory.beta),
        lambda sigma: trajectory.drive_at(sigma).acceleration,
        lambda: checked.hardest_stop.eases_to(-limits.deceleration, limits.acceleration),
    )
    gained = _kept(checked, "acceleration", acceleration, limits.acceleration)
    lost = _kept(checked, "acceleration", acceleration, limits.deceleration, -1.0)
    gains = gained.use.worst / limits.acceleration >= -lost.use.worst / limits.deceleration
    return {
        "speed": Finding(fastest.use, fastest.violations + slowest.violations),
        "acceleration": Finding((gained if gains else lost).use, gained.violations + lost.violations),
    }


@dataclass(frozen=True)
class _Curve:
    """A piecewise polynomial of normalised time."""

    coefficients: Array  # (n, order), local powers
    at: Callable[[Array], Array]
    excess: Callable[[], float]  # For how long it may exceed its limit, s, if the vehicle brakes its hardest


def _kept(
    checked: CheckedTrip, what: str, curve: _Curve, limit: float, sign: float = 1.0, tolerance: float | None = None
) -> Finding:
    """Use of an upper limit by a curve times a sign."""
    basis = checked.trajectory.space.acceleration
    allowed = limit + (RELATIVE_TOLERANCE * limit if tolerance is None else tolerance)
    edges, coefficients = basis.breakpoints, curve.coefficients
    found = highest(sign * coefficients, allowed)
    if not found.kept:
        begin = checked.excused_until(curve.excess() if limit > 0.0 else 0.0)
        edges = np.append(begin, edges[edges > begin])
        found = highest(sign * cubics(curve.at, edges), allowed)
    sigma = float(edges[found.piece] + found.local * (edges[found.piece + 1] - edges[found.piece]))
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
    excess = 0.0
    if not found.kept and name in ("total_acceleration", "power"):
        stop = checked.hardest_stop
        most = limit / max(float(stop.speed.max()), 1e-300) if name == "power" else limit
        excess = stop.eases_to(-np.inf if name == "power" else -limit, most)
    if excess > 0.0:
        pieces = pieces.after(checked.excused_until(excess))
        enclosure = checked.enclosed(pieces)
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
    excess = 0.0 if found.kept else checked.hardest_stop.slows_to(part.speed)
    if excess > 0.0 and _begins_on(checked, part):
        pieces = pieces.after(checked.excused_until(excess))
        found = largest(checked, pieces, checked.enclosed(pieces), allowed, speed_there, parts=2)
    return checked.finding(name, max(found.value, 0.0), part.speed, found.when, kept=found.kept)


def _begins_on(checked: Checked[EnclosedT], part: Stretch) -> bool:
    """True if the check begins on a stretch of a line."""
    first = checked.enclosed(Pieces(np.array([checked.first]), np.zeros(1))).pace
    driven = checked.followed(part.line)
    about = None if driven is None else np.interp(first.progress, *driven)
    station = float(part.line.nearest(checked.frame.to_world(first.position), about)[0])
    return part.first - END_TOLERANCE <= station <= part.last + END_TOLERANCE
