"""Earliest time at which a target can be met, whatever stands in the way."""

from __future__ import annotations

from itertools import pairwise
from math import hypot, inf

import numpy as np

from scp_planner.arrays import Array
from scp_planner.certificate.tolerances import END_TOLERANCE, SPEED_ROUNDING
from scp_planner.mathematics.polynomials import expanded
from scp_planner.scenario.models import Scenario
from scp_planner.threat_zones.target import TargetMotion


def first_meeting(scenario: Scenario, target: TargetMotion, since: float = 0.0) -> float:
    """Return the least t, s after the start, with |q(t) - x0| <= d(t) + r, from a time on; inf if there is none.

    q is the target's place, r the goal's radius, and d the distance driven at full acceleration up to the top speed. On
    each piece |q - x0|^2 - (d + r)^2 is a polynomial, whose first root is looked for: without one the target is proven
    to get away.
    """
    start, vehicle = scenario.start, scenario.vehicle
    radius, v0, a = scenario.goal.radius + END_TOLERANCE, start.speed, vehicle.max_acceleration
    top = max(vehicle.max_speed, v0)
    rise = (top - v0) / a
    if since == 0.0 and hypot(*np.subtract(target.place(start.time), start.position)) <= radius:
        return 0.0
    breaks = target.centers.breakpoints[0] - start.time
    inner = [float(t) for t in (rise, *breaks[1:-1]) if t > since and np.isfinite(t)]
    for begin, end in pairwise([since, *sorted(set(inner)), inf]):
        driven = _driven(begin, v0, a, rise, top)
        gap = _gap(_piece(target, start.time + begin), np.array(start.position), driven, radius)
        found = _first_root(gap, end - begin)
        if found is not None:
            return max((begin + found) * (1.0 - SPEED_ROUNDING), since)
    return inf


def _driven(begin: float, v0: float, a: float, rise: float, top: float) -> Array:
    """Distance driven, as a polynomial of the time since a piece begins, m."""
    if begin < rise:
        return np.array([v0 * begin + 0.5 * a * begin**2, v0 + a * begin, 0.5 * a])
    return np.array([0.5 * (v0 + top) * rise + top * (begin - rise), top])


def _piece(target: TargetMotion, time: float) -> Array:
    """Place of a target from an absolute time on, as a polynomial of the time since then, (P, 2) m."""
    breaks, coefficients = target.centers.breakpoints[0], target.centers.coefficients[0]
    number = min(max(int(np.searchsorted(breaks, time, "right")) - 1, 0), len(coefficients) - 1)
    moved: Array = expanded(coefficients[number][None], np.array([time - breaks[number]]))[0]
    return moved


def _gap(place: Array, origin: Array, driven: Array, radius: float) -> Array:
    """|q - x0|^2 - (d + r)^2, ascending powers."""
    away = place.copy()
    away[0] -= origin
    reach = driven.copy()
    reach[0] += radius
    parts = [np.convolve(away[:, 0], away[:, 0]), np.convolve(away[:, 1], away[:, 1]), -np.convolve(reach, reach)]
    total = np.zeros(max(map(len, parts)))
    for part in parts:
        total[: len(part)] += part
    return total


def _first_root(gap: Array, length: float) -> float | None:
    """First time within a piece at which a polynomial is not positive, s; None if it stays positive."""
    if gap[0] <= 0.0:
        return 0.0
    roots = np.roots(np.trim_zeros(gap[::-1], "f")) if np.any(gap[1:]) else np.zeros(0)
    # Roots that are double but for rounding come in pairs with a small imaginary part: they count.
    real = roots.real[np.abs(roots.imag) <= 1e-7 * (1.0 + np.abs(roots.real))]
    ahead = real[(real >= 0.0) & (real <= length)]
    return float(ahead.min()) if len(ahead) else None
