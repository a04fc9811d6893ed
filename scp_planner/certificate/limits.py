"""Limits of a trip at all times, clearance aside: how far each is used, and whether it is kept."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from scp_planner.arrays import Array
from scp_planner.certificate.checked_trip import PIECES, CheckedTrip, Finding
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
    for number, part in enumerate(stretches(checked.scenario)):
        name = f"speed_limits[{number}]"
        found[name] = _speed_limit(checked, name, part, pieces, enclosure)
    return found


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
    use = LimitUse(sign * found.value, sign * limit, checked.absolute(sigma))
    return Finding(use, () if found.kept else (checked.broken(what, use.worst, sign * limit, sigma),))


@dataclass(frozen=True)
class _Bounded:
    """A quantity on pieces: values (n,) in their middles, and bounds (n,) of its absolute values."""

    value: Array
    bound: Array


def _bounded(checked: CheckedTrip, name: str, enclosure: Enclosure) -> _Bounded:
    match name:
        case "curvature":
            return _Bounded(enclosure.curvature, enclosure.curvature_bound)
        case "lateral_acceleration":
            return _Bounded(enclosure.lateral, enclosure.lateral_bound)
        case "curvature_rate":
            points = enclosure.path
            value = enclosure.speed * checked.trajectory.path.curvature_rate(points) / points.speed
            return _Bounded(value, enclosure.curvature_rate)
        case "total_acceleration":
            return _Bounded(
                np.hypot(enclosure.acceleration, enclosure.lateral),
                np.hypot(enclosure.acceleration_bound, enclosure.lateral_bound),
            )
        case "power":
            return _Bounded(np.maximum(enclosure.acceleration, 0.0) * enclosure.speed, enclosure.power_bound)
    raise AssertionError(name)


def _bend_limit(checked: CheckedTrip, name: str, limit: float, pieces: Pieces, enclosure: Enclosure) -> Finding:
    """Curvature, its rate, accelerations across or in total, or power, by quartering: rounds cost most."""
    checked.go_on()
    allowed = limit * (1.0 + RELATIVE_TOLERANCE)
    best, best_sigma, kept = -1.0, 0.0, False
    for _ in range(PIECES.max_halvings // 2):
        quantity = _bounded(checked, name, enclosure)
        worst = int(np.argmax(np.abs(quantity.value)))
        if abs(quantity.value[worst]) > best:
            best, best_sigma = float(abs(quantity.value[worst])), float(pieces.middle[worst])
        undecided = quantity.bound > allowed
        kept = not best > allowed and not undecided.any()
        if best > allowed or kept:
            break
        pieces = pieces.quarters(undecided)
        enclosure = checked.enclosed(pieces)
    use = LimitUse(best, float(limit) if np.isfinite(limit) else None, checked.absolute(best_sigma))
    return Finding(use, () if kept else (checked.broken(name, best, limit, best_sigma),))


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
    kept = not value > limit * (1.0 + RELATIVE_TOLERANCE)
    use = LimitUse(value, limit, checked.absolute(sigma))
    return Finding(use, () if kept else (checked.broken("jerk", value, limit, sigma),))


def _speed_limit(checked: CheckedTrip, name: str, part: Stretch, pieces: Pieces, enclosure: Enclosure) -> Finding:
    """The speed wherever the vehicle may be in a stretch of a line, by halving."""
    checked.go_on()
    allowed = part.speed * (1.0 + RELATIVE_TOLERANCE)
    best, best_sigma, kept = 0.0, 0.0, False
    driven = _followed(checked, part)
    for _ in range(PIECES.max_halvings):
        about = None if driven is None else np.interp(enclosure.path.station, *driven)
        half, speed = enclosure.half, enclosure.speed
        position = checked.trip.frame.to_world(enclosure.path.position)
        fastest = speed + enclosure.acceleration_bound * half
        station = part.line.nearest(position, about)
        there = np.flatnonzero((station >= part.first) & (station <= part.last))
        if len(there):
            worst = there[np.argmax(speed[there])]
            if speed[worst] > best:
                best, best_sigma = float(speed[worst]), float(pieces.middle[worst])
        if best > allowed:
            break
        undecided = fastest > allowed
        undecided[undecided] = part.line.may_be_between(
            position[undecided],
            (fastest * half)[undecided] + END_TOLERANCE,
            part.first,
            part.last,
            None if about is None else about[undecided],
        )
        kept = not undecided.any()
        if kept:
            break
        pieces = pieces.halves(undecided)
        enclosure = checked.enclosed(pieces)
    use = LimitUse(best, part.speed, checked.absolute(best_sigma))
    return Finding(use, () if kept else (checked.broken(name, best, part.speed, best_sigma),))


def _followed(checked: CheckedTrip, part: Stretch) -> tuple[Array, Array] | None:
    """Stations along the guide, and those along a line that crosses itself of a vehicle there, m; or None."""
    if not np.isfinite(part.line.loop):
        return None
    space = checked.trajectory.space
    parameters = np.linspace(0.0, 1.0, max(PIECES.fewest_followed, 2 * space.tables.cells) + 1)
    places = checked.trip.frame.to_world(checked.trajectory.path.places(parameters))
    stations = part.line.followed(places)
    return None if stations is None else (parameters * space.length, stations)
